"""Results of studies, saved and brought back."""

import json
import pickle
import re
from pathlib import Path

import h5netcdf
import numpy as np
from reports import without_number

import ident
from ident.report.document import plain
from ident.studies.following import kept_in
from ident.text import NEWEST

RESULTS = Path(__file__).parents[1] / "data" / "results" / str(NEWEST)
"""Files of results as they are written today."""
OF_FILES = ("path", "record", "moved", "study", "values_of", "posterior_draws")
"""What a loaded result alone has: its file; and what only some studies give to others."""
TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")
"""When a file was made."""


def assert_comes_back(result, folder):
    """Save a result and read it again: it shows, and says for programs, what it did; next commands name that folder."""
    paths = result.save(folder)
    path = folder / f"{result.name}{result.suffix}"
    saved = ident.load(path)
    assert path in paths
    assert (saved.name, saved.form) == (result.name, result.form)
    assert saved.options == result.options
    assert saved.verdict == result.verdict
    assert saved.summary.keys() == result.summary.keys()
    assert {name for name in dir(saved) if name[0] != "_"} <= {*dir(result), *OF_FILES}
    assert not [name for name in saved.summary if not hasattr(result, name)]
    assert pickle.loads(pickle.dumps(result)).report() == result.report()
    with kept_in(folder):
        assert saved.report() == str(saved) == result.report()
        assert saved.report(details=True, width=72) == result.report(details=True, width=72)
        assert saved._repr_html_() == result._repr_html_()
        document = json.loads(json.dumps(result.document(), allow_nan=False))
    assert saved.document() | {"created": ""} == document | {"created": ""}
    assert json.dumps(plain(saved.table())) == json.dumps(plain(result.table()))
    assert not without_number(result.report())
    known = {name: source and (source.path, source.sha256) for name, source in result.inputs.items()}
    assert {name: source and (source.path, source.sha256) for name, source in saved.inputs.items()} == known
    return saved


def contents(path):
    """All that a result file says but when it was made."""
    if path.suffix != ".nc":
        return TIME.sub("", path.read_text()).splitlines()
    with h5netcdf.File(path) as file:
        return dict(variables(file)) | {name: TIME.sub("", str(text)) for name, text in file.attrs.items()}


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
