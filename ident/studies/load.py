"""Bring a saved result back."""

import importlib
from pathlib import Path

from ident.errors import InputError, Problem
from ident.studies.result import Result

STUDIES = (
    *("predict", "check", "fit", "profile", "sample", "plan"),
    *("resonance", "simulate", "spectrum", "sweep", "design", "diagnose"),
)
"""Studies whose results can be loaded; the format of a file names its study, as in `ident-fit/2`."""


def load(path: str | Path) -> Result:
    """Return the result that a study has saved, as it was.

    Args:
        path: a `.json` or `.nc` file of `Result.save` or of a command.

    Raises:
        InputError: the file is none, or one of another version of ident.
    """
    from ident.present.files.document import EXPECTED, read_result
    from ident.text import one_line, quoted

    form, fields = read_result(path)
    study = form.removeprefix("ident-").partition("/")[0]
    kind = _result_of(study) if study in STUDIES else None
    if kind is None or kind.form != form:
        remedy = "run the command again with this version of ident"
        raise InputError(Problem(one_line(str(path)), f"the format {quoted(form)}", EXPECTED, remedy))
    return kind(**fields)


def _result_of(study: str) -> type[Result]:
    module = importlib.import_module(f"ident.studies.{study}")
    result: type[Result] = getattr(module, f"{study.capitalize()}Result")
    return result
