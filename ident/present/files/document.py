"""Result files as JSON: from what a result was made, with what and how, its main numbers, and the result itself."""

import hashlib
import json
import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.text import LARGEST_BINARY, one_line, quoted, read_bytes
from ident.text import decode as decode_text

LIBRARIES = ("ident", "jax", "optimistix", "emcee", "arviz", "diffrax", "ruckig", "xarray", "numpy", "scipy")
EXPECTED = "a result file of ident (.json or .nc)"
RERUN = "run the command again; files of older versions are not read"
WIDTH = 160
"""Longest line of a file, but for those of numbers."""


def provenance(form: str, inputs: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a result was made from, with what and how: the head of every result file.

    Args:
        form: format and version.
        inputs: what came from files, with `path` and `sha256`, by name; None for what was not given.
        options: as they are recorded.
    """
    sources = {
        name: None if source is None else {"path": source.path, "sha256": source.sha256}
        for name, source in inputs.items()
    }
    return {
        "format": form,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": _versions() | {"python": platform.python_version()},
        "options": plain(options),
        "inputs": sources,
    }


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in LIBRARIES}


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document whole or not at all."""
    text = _laid_out(document) + "\n"
    replace_file(path, lambda file: file.write(text.encode("utf-8", "backslashreplace")), make_folders=True)


def digest(encoded: Any) -> str:
    """Return a hash of a result as `ident.codec` has written it: one that was changed by hand is no result of ident."""
    return hashlib.sha256(json.dumps(encoded, allow_nan=False).encode()).hexdigest()


def check_digest(said: Any, encoded: Any, path: str | Path) -> None:
    """Refuse a result that is not as it was written; files without a hash are taken as they are.

    Raises:
        InputError: it has changed.
    """
    if said not in (None, digest(encoded)):
        got = "a result that was changed after ident wrote it"
        raise InputError(Problem(one_line(str(path)), got, EXPECTED, "run the command again"))


def read_document(path: str | Path, expected: str) -> dict[str, Any]:
    """Return what a result file says."""
    where = one_line(str(path))
    try:
        document = json.loads(decode_text(read_bytes(path, expected, LARGEST_BINARY), where), object_pairs_hook=_once)
        if not isinstance(document, dict) or not isinstance(document.get("format"), str):
            raise ValueError
    except (ValueError, RecursionError):
        remedy = "give the file that ident wrote"
        raise InputError(Problem(where, "other contents", expected, remedy)) from None
    return document


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a mapping; a name that is given twice means two things."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        raise ValueError
    return mapping


def read_result(path: str | Path) -> tuple[str, Any, Mapping[str, np.ndarray]]:
    """Return the format of a result file, the result as `ident.codec` has written it, and the arrays apart from it."""
    if Path(path).suffix == ".nc":
        from ident.present.files.netcdf import read_netcdf_result

        return read_netcdf_result(path)
    document = read_document(path, EXPECTED)
    if "result" in document:
        check_digest(document.get("result_sha256"), document["result"], path)
    return document["format"], document.get("result"), {}


def check_format(form: str, wanted: str, where: str, expected: str) -> None:
    """Refuse the result of another study or version."""
    if form != wanted:
        study = wanted.removeprefix("ident-").partition("/")[0]
        old = form.startswith(f"ident-{study}/")
        remedy = RERUN if old else f"give the file that ident {study} wrote"
        raise InputError(Problem(where, f"the format {quoted(form)}", expected, remedy))


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; infinite and undefined numbers become null."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "dtype"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return plain(asdict(value)) if is_dataclass(value) and not isinstance(value, type) else value


def _laid_out(value: Any, indent: str = "") -> str:
    """Return a value as JSON: what is short, and a row of numbers, on one line."""
    inner = indent + " "
    if isinstance(value, Mapping):
        parts = [f"{_laid_out(key)}: {_laid_out(item, inner)}" for key, item in value.items()]
        opening, closing = "{}"
    elif isinstance(value, list) and any(isinstance(item, list | Mapping) for item in value):
        parts = [_laid_out(item, inner) for item in value]
        opening, closing = "[]"
    else:
        return json.dumps(value, allow_nan=False, ensure_ascii=False)
    line = ", ".join(parts)
    if len(line) + len(indent) < WIDTH and "\n" not in line:
        return f"{opening}{line}{closing}"
    return f"{opening}\n{inner}" + f",\n{inner}".join(parts) + f"\n{indent}{closing}"
