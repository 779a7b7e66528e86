"""Result files as netCDF: arrays that other tools read, and in a group of its own the result to load again."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.measure.recordings.hdf5 import leads_away
from ident.present.files.document import EXPECTED, RERUN, check_digest, digest
from ident.text import LARGEST_BINARY, one_line, read_bytes

if TYPE_CHECKING:
    import xarray

GROUP = "ident"
"""Group of the result: its fields as JSON, and what of them are large arrays."""
TREE = "tree"
PACKED = {"zlib": True, "complevel": 4}
"""How large variables are compressed."""
MOST_BYTES = 4_000_000_000
"""Bytes of a group's variables: ten times a million draws of fifty unknowns."""


def write_netcdf_result(
    form: str, encoded: Any, arrays: Mapping[str, np.ndarray], path: Path, groups: "Mapping[str, xarray.Dataset]"
) -> None:
    """Write a result with what other tools read beside it, whole or not at all.

    HDF5 writes into memory: where a disk is full it does not survive its own error.

    Args:
        form: format and version.
        encoded: the result, as `ident.codec` writes it.
        arrays: the large arrays apart from it.
        path: where the file goes.
        groups: what other tools read, by name, "/" at the root; how a variable is packed, its `encoding` says.
    """
    import xarray

    tree = json.dumps(encoded, allow_nan=False, ensure_ascii=False).encode("utf-8", "surrogatepass")
    parts = {**arrays, TREE: np.frombuffer(tree, np.uint8)}
    variables = {name: ([f"{name}_{i}" for i in range(part.ndim)], part) for name, part in parts.items()}
    data = xarray.Dataset(variables, attrs={"format": form, "result_sha256": digest(encoded)})
    for name in parts:
        data[name].encoding = PACKED
    file = BytesIO()
    for i, (group, own) in enumerate({**groups, GROUP: data}.items()):
        own.to_netcdf(file, mode="a" if i else "w", group=group, engine="h5netcdf")
    replace_file(path, lambda out: out.write(file.getbuffer()), make_folders=True)


def read_netcdf_result(path: str | Path) -> tuple[str, Any, Mapping[str, np.ndarray]]:
    """Return the format of a result file, the result as `ident.codec` has written it, and the arrays apart from it."""
    file = BytesIO(read_bytes(path, EXPECTED, LARGEST_BINARY))
    with whole(path, "no result to load", EXPECTED, RERUN):
        data = read_group(file, GROUP, mask_and_scale=False)
        arrays = {str(name): part.values for name, part in data.data_vars.items()}
        tree = json.loads(arrays.pop(TREE).tobytes().decode("utf-8", "surrogatepass"))
        check_digest(data.attrs.get("result_sha256"), tree, path)
        return str(data.attrs["format"]), tree, arrays


def is_of_ident(path: str | Path) -> bool:
    """Tell whether ident has written a netCDF file; what can't be read may well be one."""
    try:
        return "format" in read_group(path).attrs
    except Exception:  # whatever the bytes of a damaged file lead to: who reads it says so
        return True


def read_group(file: "str | Path | BytesIO", group: str | None = None, **how: Any) -> "xarray.Dataset":
    """Return a group of a netCDF file with all its variables; a few bytes may claim more than there is memory for.

    Raises:
        ValueError: it leads to another file, or its variables are larger than `MOST_BYTES`; besides, whatever the
            libraries raise.
    """
    import h5netcdf
    import h5py
    import xarray

    h5netcdf.File._writable = False  # of one that it fails to open, and asks for this when that is thrown away
    with h5py.File(file, "r") as opened:  # what is no such file at all ends here: in h5netcdf it would not end quietly
        if away := leads_away(opened):
            raise ValueError(f"{away[0]}: {away[1]}")
    with xarray.open_dataset(file, group=group, engine="h5netcdf", **how) as data:
        if data.nbytes > MOST_BYTES:
            raise ValueError(f"{data.nbytes / 1e9:.3g} GB of numbers")
        return data.load()


@contextmanager
def whole(path: str | Path, got: str, expected: str, remedy: str) -> Iterator[None]:
    """Refuse a file in which reading fails within: damaged, h5py and xarray raise whatever its bytes lead to.

    Raises:
        InputError: it does.
    """
    try:
        yield
    except InputError:
        raise
    except Exception:
        raise InputError(Problem(one_line(str(path)), got, expected, remedy)) from None
