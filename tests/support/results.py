"""Results of studies, saved and brought back."""

import json

import numpy as np

import ident


def assert_comes_back(result, folder):
    """Save a result, load it, and save that again: all that it shows and writes is the same."""
    (path,) = result.save(folder)
    loaded = ident.load(path)
    assert type(loaded) is type(result)
    assert path.name == f"{result.name}{result.suffix}" == f"{loaded.name}{loaded.suffix}"
    assert loaded.report() == str(loaded) == result.report()
    assert loaded.options == result.options
    np.testing.assert_equal(loaded.table(), result.table())
    assert list(loaded.figures()) == list(result.figures())
    (again,) = loaded.save(folder / "again.json")
    first, second = (json.loads(each.read_text()) | {"created": ""} for each in (path, again))
    assert first == second
    return loaded


def assert_plain(rows):
    """Rows of a table hold text and numbers of Python's own, under the same names in each."""
    assert rows
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert {type(value) for row in rows for value in row.values()} <= {str, float, int, bool}
