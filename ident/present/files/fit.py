"""Measurements as columns, and fitted values out of a fit's result file."""

import hashlib
from pathlib import Path
from typing import Any

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.values import Robot, Values, doubtful
from ident.measure import Campaign
from ident.present.files.document import check_format, read_document
from ident.text import LARGEST_BINARY, one_line, read_bytes

EXPECTED = "a result file of ident fit (.fit.json)"


def read_fit(form: str, path: str | Path, arm: Arm) -> tuple[Values, Robot, float | None]:
    """Return the fitted values of a result file, with what they were fitted, and at which height their base gives.

    Args:
        form: the format.
        path: the file.
        arm: whose numbers are looked for.
    """
    where, document = one_line(str(path)), read_document(path, EXPECTED)
    check_format(document["format"], form, where, EXPECTED)
    try:
        parameters: dict[str, Any] = document["summary"]["parameters"]
        best: dict[tuple[str, ...], float] = {(name,): _number(value) for name, value in parameters.items()}
        doubts, fitted = document["summary"]["doubts"], document["inputs"]["arm"]["sha256"]
        scaled = tuple(map(str, document["summary"]["scaled"]))
        remark, base = doubtful(doubts), document["options"]["soft_base"]
        soft_base = None if base is None else _number(base)
        robot = Robot.read(document.get("robot"), str(fitted or ""))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise InputError(Problem(where, "other contents", EXPECTED, "give the file that ident fit wrote")) from None
    sha256_of_fit = hashlib.sha256(read_bytes(path, EXPECTED, LARGEST_BINARY)).hexdigest()
    return Values.of_arm(best, arm, where, sha256_of_fit, remark, scaled), robot, soft_base


def _number(value: Any) -> float:
    """Return what the file has as a number, which text and truth are not."""
    if isinstance(value, bool | str):
        raise TypeError
    return float(value)


def rows(campaign: Campaign) -> dict[str, list[Any]]:
    """Return what is known of each measurement, as columns."""
    return {
        "kind": [m.kind for m in campaign],
        "row": [m.where for m in campaign],
        "mode": [m.mode or "" for m in campaign],
        "point": [m.point or "" for m in campaign],
        "joint": [m.joint or "" for m in campaign],
        "sigma": [m.sigma for m in campaign],
    }
