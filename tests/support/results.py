"""Results of studies, saved and brought back."""

import json

import numpy as np

import ident


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
    assert list(loaded.figures()) == list(result.figures())
    again = loaded.save(folder / "again")
    assert [one.name for one in again] == [one.name for one in paths]
    assert _texts(again, folder / "again" / path.name) == _texts(paths, path)
    return loaded


def _texts(paths, main):
    """Texts of files, without the time at which they were written."""
    created = json.loads(main.read_text())["created"]
    return [path.read_text().replace(created, "") for path in paths]


def assert_plain(rows):
    """Rows of a table hold text and numbers of Python's own, under the same names in each."""
    assert rows
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert {type(value) for row in rows for value in row.values()} <= {str, float, int, bool}
