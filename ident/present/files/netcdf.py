"""Result files as netCDF: arrays that other tools read, and in a group of its own the result to load again."""

import json
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, Problem
from ident.files import replace_path
from ident.present.files.document import EXPECTED, RERUN
from ident.text import one_line, read_bytes

GROUP = "ident"
"""Group of the result: its fields as JSON, and what of them are large arrays."""
TREE = "tree"


def write_netcdf_result(
    form: str, encoded: Any, arrays: Mapping[str, np.ndarray], path: Path, write: Callable[[Path], object]
) -> None:
    """Write a result with what other tools read beside it, whole or not at all.

    Args:
        form: format and version.
        encoded: the result, as `ident.codec` writes it.
        arrays: the large arrays apart from it.
        path: where the file goes.
        write: writes the file for other tools at the path it is given.
    """
    import xarray

    tree = json.dumps(encoded, allow_nan=False, ensure_ascii=False).encode("utf-8", "surrogatepass")
    parts = {**arrays, TREE: np.frombuffer(tree, np.uint8)}
    variables = {name: ([f"{name}_{i}" for i in range(part.ndim)], part) for name, part in parts.items()}
    data = xarray.Dataset(variables, attrs={"format": form})
    packed = {name: {"zlib": True, "complevel": 4} for name in parts}

    def write_both(part: Path) -> None:
        write(part)
        data.to_netcdf(part, mode="a", group=GROUP, engine="h5netcdf", encoding=packed)

    replace_path(path, write_both, make_folders=True)


def read_netcdf_result(path: str | Path) -> tuple[str, Any, Mapping[str, np.ndarray]]:
    """Return the format of a result file, the result as `ident.codec` has written it, and the arrays apart from it."""
    import xarray

    where, file = one_line(str(path)), BytesIO(read_bytes(path, EXPECTED))
    try:
        with xarray.open_dataset(file, group=GROUP, engine="h5netcdf", mask_and_scale=False) as data:
            arrays = {str(name): part.values for name, part in data.data_vars.items()}
            form = str(data.attrs["format"])
        return form, json.loads(arrays.pop(TREE).tobytes().decode("utf-8", "surrogatepass")), arrays
    except (OSError, ValueError, KeyError, RecursionError):
        raise InputError(Problem(where, "no result to load", EXPECTED, RERUN)) from None
