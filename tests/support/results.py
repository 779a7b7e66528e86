"""Results of studies, saved and brought back."""

import re

import h5netcdf
import numpy as np
from reports import without_number

import ident

TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")
"""When a file was made."""


def assert_comes_back(result, folder):
    """Save a result, load it, and save that again: all that it shows and writes is the same."""
    paths = result.save(folder)
    path = folder / f"{result.name}{result.suffix}"
    loaded = ident.load(path)
    assert type(loaded) is type(result)
    assert path in paths
    assert loaded.name == result.name
    assert loaded.report() == str(loaded) == result.report()
    assert loaded.options == result.options
    np.testing.assert_equal(loaded.table(), result.table())
    assert not without_number(result.report())
    assert list(loaded.figures()) == list(result.figures())
    again = loaded.save(folder / "again")
    assert [one.name for one in again] == [one.name for one in paths]
    for one, other in zip(paths, again, strict=True):
        np.testing.assert_equal(contents(other), contents(one))
    return loaded


def contents(path):
    """All that a result file says but when it was made."""
    if path.suffix != ".nc":
        return TIME.sub("", path.read_text()).splitlines()
    with h5netcdf.File(path) as file:
        return dict(variables(file)) | {name: str(text) for name, text in file.attrs.items() if name != "created"}


def variables(group):
    for variable in group.variables.values():
        yield variable.name, np.asarray(variable[...])
    for own in group.groups.values():
        yield from variables(own)


def assert_plain(rows):
    """Rows of a table hold text and numbers of Python's own, under the same names in each."""
    assert rows
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert {type(value) for row in rows for value in row.values()} <= {str, float, int, bool}
