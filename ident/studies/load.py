"""Bring a saved result back."""

import importlib
from pathlib import Path

from ident.errors import InputError, Problem
from ident.studies import STUDIES
from ident.studies.result import Result, study_of


def load(path: str | Path) -> Result:
    """Return the result that a study has saved, as it was.

    Args:
        path: a `.json` or `.nc` file of `Result.save` or of a command.

    Raises:
        InputError: the file is none, or one of another version of ident.
    """
    from ident.codec import CodecError, decode
    from ident.present.files.document import EXPECTED, RERUN, check_format, read_result
    from ident.text import one_line, quoted

    where, (form, encoded, arrays) = one_line(str(path)), read_result(path)
    study = study_of(form)
    if study not in STUDIES:
        raise InputError(Problem(where, f"the format {quoted(form)}", EXPECTED, RERUN))
    kind: type[Result] = getattr(importlib.import_module(f"ident.studies.{study}"), f"{study.capitalize()}Result")
    check_format(form, kind.form, where, EXPECTED)
    if kind.suffix != Path(path).suffix == ".json":
        remedy = f"load {one_line(Path(path).with_suffix(kind.suffix).name)} beside it"
        raise InputError(Problem(where, f"no result to load ({form}, without its arrays)", EXPECTED, remedy))
    try:
        result = decode(encoded, arrays)
        if not isinstance(result, kind):
            raise CodecError(f"no {kind.__name__}")
    except CodecError as error:
        got = f"a result that this version of ident can't load ({one_line(str(error))})"
        raise InputError(Problem(where, got, EXPECTED, "run the command again")) from None
    return result
