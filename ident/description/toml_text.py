"""TOML text as plain data, and its mistakes as one-line problems."""

import re
import tomllib
from typing import Any

from ident.errors import InputError, Problem


def load_toml(text: str, where: str) -> dict[str, Any]:
    """Return the content of a TOML text, not checked; `where` names it in errors.

    Raises:
        InputError: it is no TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        parts = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error), re.S)
        what, line, column = parts.groups() if parts else (str(error), "", "")
        if not line and "end of document" in what:
            line = str(text.count("\n") + 1)
        place, column = f"{where}:{line}" if line else where, f"column {column}" if column else ""
        if where.lower().endswith(".csv"):
            raise InputError(Problem(where, "a table", "an arm description as TOML", "name the arm's file")) from None
        raise InputError(Problem(place, what.lower(), "TOML", "correct the syntax", column)) from None
