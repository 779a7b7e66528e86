"""Files of another result that would be overwritten: they are kept under another name."""

import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.files import move_file, together
from ident.studies.result import Result


def set_aside(result: Result, folder: Path, inputs: Collection[str] | None = None) -> str:
    """Rename files that a folder holds under a result's name, where they are not of the same; say so in a line.

    The same are results of the same options and inputs; an input is the same by its path, so that a file may be
    edited and tried again, or by its contents.

    Args:
        result: what is about to be written.
        folder: where.
        inputs: only where one of these inputs differs, whatever else does; by default any input, or the options.

    Returns:
        What was kept, and as what; nothing where nothing is in the way.

    Raises:
        InputError: the files can't be moved.
    """
    there = _head(result, folder)
    differing = [] if there is None else _differing(there, result.head)
    if not [name for name in differing if inputs is None or name in inputs]:
        return ""
    files = [path for path in folder.iterdir() if path.is_file() and _is_of(path.name, result.name)]
    number = next(n for n in range(1, 10**9) if not any(_is_of(path.name, f"{result.name}.{n}") for path in files))
    with together():
        for path in files:
            end = path.name.removeprefix(result.name)
            if not end.split(".")[1].isdigit():
                move_file(path, path.with_name(f"{result.name}.{number}{end}"))
    what = f"of other {' and '.join(differing)}"
    return f"kept the {result.name} that was there, {what}, as {result.name}.{number}"


def _is_of(file: str, name: str) -> bool:
    return file.startswith(f"{name}.")


def _head(result: Result, folder: Path) -> Mapping[str, Any] | None:
    """Return inputs and options of the result that is there; None where there is none that can be read."""
    from ident.present.files.document import EXPECTED, read_document
    from ident.present.files.netcdf import read_group, whole

    document, main = (folder / f"{result.name}{end}" for end in (".json", result.suffix))
    try:
        if os.path.exists(document):
            return read_document(document, EXPECTED)
        if not os.path.exists(main):
            return None
        with whole(main, "other contents", EXPECTED, "give the file that ident wrote"):
            attributes = read_group(main).attrs
            return {name: json.loads(attributes[name]) for name in ("inputs", "options")}
    except InputError:
        return None


def _differing(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Return the names of inputs that differ, and of options."""
    old, new = (own if isinstance(own := each.get("inputs"), Mapping) else {} for each in (there, here))
    wanted = json.loads(json.dumps(here.get("options")))
    names = [name for name in sorted({*old, *new}) if not _same(old.get(name), new.get(name))]
    return names + ["options"] * (there.get("options") != wanted)


def _same(one: Any, other: Any) -> bool:
    """Tell whether two inputs are the same; what a file of other contents says is none."""
    if not (isinstance(one, Mapping) and isinstance(other, Mapping) and one and other):
        return not one and not other
    return one.get("path") == other.get("path") or one.get("sha256") == other.get("sha256")
