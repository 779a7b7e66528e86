"""Result files as JSON: what was computed, from what, with what and how, and the result itself to load again."""

import json
import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ident.codec import CodecError, decode, encode
from ident.description.file import ArmFile
from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.measure import Campaign
from ident.text import decode as decode_text
from ident.text import one_line, quoted, read_bytes

LIBRARIES = ("ident", "jax", "optimistix", "emcee", "arviz", "numpy", "scipy")
EXPECTED = "a result file of ident (.json or .nc)"
RERUN = "run the command again; files of older versions are not read"


def provenance(
    form: str, arm_file: ArmFile | None, campaign: Campaign | None, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Say what a result was made from, with what and how: the head of every result file."""
    return {
        "format": form,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()},
        "options": plain(options),
        "inputs": {
            "arm": {"path": arm_file.path, "sha256": arm_file.sha256} if arm_file is not None else None,
            "campaign": {"path": campaign.path, "sha256": campaign.sha256} if campaign is not None else None,
        },
    }


def write_result(document: Mapping[str, Any], fields: Mapping[str, Any], path: Path) -> None:
    """Write a result: a document for people, and the fields that `read_result` brings back.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    write_json({**document, "result": encode(dict(fields))}, path)


def read_result(path: str | Path) -> tuple[str, dict[str, Any]]:
    """Return the format of a result file and the fields of its result.

    Raises:
        InputError: the file is no result that this version of ident can load.
    """
    where, netcdf = one_line(str(path)), Path(path).with_suffix(".nc")
    if Path(path) == netcdf:
        from ident.present.files.netcdf import read_netcdf_result

        return read_netcdf_result(path)
    document = read_document(path, EXPECTED)
    if "result" not in document:
        remedy = f"it is for reading: load {one_line(netcdf.name)} beside it" if netcdf.exists() else RERUN
        raise InputError(Problem(where, f"no result to load ({document['format']})", EXPECTED, remedy))
    return document["format"], fields_of(document["result"], where)


def read_document(path: str | Path, expected: str) -> dict[str, Any]:
    """Return what a result file says.

    Raises:
        InputError: it is no JSON object with a format.
    """
    where = one_line(str(path))
    try:
        document = json.loads(decode_text(read_bytes(path, expected), where))
        if not isinstance(document, dict) or not isinstance(document.get("format"), str):
            raise ValueError
    except (ValueError, RecursionError):
        remedy = "give the file that ident wrote"
        raise InputError(Problem(where, "other contents", expected, remedy)) from None
    return document


def check_format(form: str, wanted: str, where: str, expected: str) -> None:
    """Refuse the result of another study or version; what names no format of ident is left to the reader.

    Raises:
        InputError: the format is another one.
    """
    if not form.startswith("ident-") or form == wanted:
        return
    study = wanted.removeprefix("ident-").partition("/")[0]
    old = form.startswith(f"ident-{study}/")
    remedy = "run the command again with this version of ident" if old else f"give the file that ident {study} wrote"
    raise InputError(Problem(where, f"the format {quoted(form)}", expected, remedy))


def fields_of(encoded: Any, where: str, arrays: Mapping[str, np.ndarray] | None = None) -> dict[str, Any]:
    """Return the fields of a result that was encoded.

    Raises:
        InputError: it is none, or one of another version of ident.
    """
    try:
        fields = decode(encoded, arrays)
        if not isinstance(fields, dict):
            raise CodecError("no fields")
    except (CodecError, TypeError) as error:
        got = f"a result that this version of ident can't load ({one_line(str(error))})"
        raise InputError(Problem(where, got, EXPECTED, "run the command again")) from None
    return fields


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document whole or not at all.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    replace_file(path, lambda file: file.write(text.encode("utf-8", "backslashreplace")), make_folders=True)


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; infinite and undefined numbers become null."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "shape"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return plain(asdict(value)) if is_dataclass(value) and not isinstance(value, type) else value
