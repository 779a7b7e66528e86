"""Result files as netCDF: variables that other tools read, and beside them, in the group `ident`, what loads again."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.codec import encode
from ident.errors import InputError, Problem
from ident.files import replace_path
from ident.present.files.document import EXPECTED, fields_of
from ident.text import one_line, read_bytes

if TYPE_CHECKING:
    import h5netcdf

GROUP = "ident"
TREE = "tree"
BROKEN = (OSError, ValueError, KeyError, TypeError, RuntimeError)
"""What reading a file may raise that is damaged or none of ours."""


def write_netcdf_result(form: str, write: Callable[[Path], object], fields: Mapping[str, Any], path: Path) -> None:
    """Write a result whole or not at all: variables for people, and the fields that `read_result` brings back.

    An array that is among the variables already, to the bit, is not written twice.

    Args:
        form: the format.
        write: writes the variables into a netCDF4 file at the path it is given.
        fields: what the result is made of.
        path: the file.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """

    def write_all(part: Path) -> None:
        write(part)
        _append(part, form, fields)

    replace_path(path, write_all, make_folders=True)


def read_netcdf_result(path: str | Path) -> tuple[str, dict[str, Any]]:
    """Return the format of a netCDF result and its fields.

    Raises:
        InputError: the file is no result that this version of ident can load.
    """
    import h5netcdf

    where = one_line(str(path))
    read_bytes(path, EXPECTED)
    try:
        with h5netcdf.File(path, "r") as file:
            if GROUP not in file.groups:
                raise InputError(Problem(where, _without_result(file), EXPECTED, "run the command again"))
            group = file.groups[GROUP]
            form, document = str(group.attrs["format"]), json.loads(_array(group.variables[TREE]).tobytes())
            arrays = {
                name: _array(file[place["variable"]]).reshape(place["shape"]).astype(place["dtype"], copy=False)
                for name, place in document["arrays"].items()
            }
    except BROKEN:
        remedy = "give the file that ident wrote"
        raise InputError(Problem(where, "other contents", EXPECTED, remedy)) from None
    return form, fields_of(document["result"], where, arrays)


def _without_result(file: "h5netcdf.File") -> str:
    form = file.attrs.get("format")
    return f"no result to load ({one_line(str(form).strip(chr(34)))})" if form else "no result to load"


def _append(path: Path, form: str, fields: Mapping[str, Any]) -> None:
    """Add the group `ident` to a file."""
    import h5netcdf

    arrays: dict[str, np.ndarray] = {}
    encoded = encode(dict(fields), arrays)
    with h5netcdf.File(path, "a") as file:
        there = {(data.dtype, data.size, data.tobytes()): name for name, data in _variables(file)}
        group, places = file.create_group(GROUP), {}
        for name, array in arrays.items():
            place = there.get((array.dtype, array.size, array.tobytes()))
            if place is None:
                place = _add(group, name, array)
            places[name] = {"variable": place, "shape": array.shape, "dtype": array.dtype.str}
        document = json.dumps({"result": encoded, "arrays": places})
        _add(group, TREE, np.frombuffer(document.encode("utf-8"), np.uint8))
        group.attrs["format"] = form


def _variables(group: "h5netcdf.Group") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numeric variables of a file, each by its path in it."""
    for variable in group.variables.values():
        if np.dtype(variable.dtype).kind in "fiu":
            yield variable.name, _array(variable)
    for own in group.groups.values():
        yield from _variables(own)


def _add(group: "h5netcdf.Group", name: str, array: np.ndarray) -> str:
    data = array.view(np.uint8) if array.dtype == bool else array
    for axis, size in enumerate(data.shape):
        group.dimensions[f"{name}_{axis}"] = size
    dimensions = tuple(f"{name}_{axis}" for axis in range(data.ndim))
    variable = group.create_variable(
        name, dimensions, data.dtype, data=data, compression="gzip", shuffle=True, fletcher32=True
    )
    return str(variable.name)


def _array(variable: "h5netcdf.Variable") -> np.ndarray:
    return np.asarray(variable[...])
