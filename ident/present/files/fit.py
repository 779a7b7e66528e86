"""A fit as rows, and fitted values out of its result file."""

import hashlib
import math
from pathlib import Path
from typing import Any

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.identify.values import Robot, Values, doubtful
from ident.measure import KINDS, Campaign
from ident.present.files.document import check_format, read_document
from ident.present.text.units import unit_of
from ident.text import LARGEST_BINARY, one_line, read_bytes
from ident.units import QUANTITIES

EXPECTED = "a result file of ident fit (.fit.json)"


def fit_rows(fit: CampaignFit) -> list[dict[str, Any]]:
    """Return a row for each parameter: value, interval [SI] and whether the data support it."""
    names = fit.problem.parameters.names
    return [
        {
            "parameter": name,
            "value": float(value),
            "unit": unit_of(name),
            "low_95": float(low),
            "high_95": float(high),
            "supported": bool(supported),
        }
        for name, value, (low, high), supported in zip(
            names, fit.best.values, fit.interval(), fit.supported, strict=True
        )
    ]


def measurement_rows(fit: CampaignFit) -> list[dict[str, Any]]:
    """Return a row for each measurement: what it is, measured, predicted and sigma [SI], and how far it is off.

    `residual` is (measured - predicted) / sigma [-], as reports have it; `too_far_off` marks what they mark. Angles are
    in degrees.
    """
    return [
        {
            "row": m.where.rpartition(":")[2] or str(i + 1),
            "kind": m.kind,
            "posture": " ".join(f"{math.degrees(angle) + 0.0:.10g}" for angle in m.posture),
            "load": str(m.load),
            "place": m.mode or m.point or m.joint or "",
            "unit": QUANTITIES[KINDS[m.kind]].si,
            "measured": m.value,
            "predicted": float(fit.predicted[i]),
            "sigma": m.sigma,
            "residual": -float(fit.off[i]),
            "too_far_off": bool(far),
        }
        for i, (m, far) in enumerate(zip(fit.campaign, fit.suspicious, strict=True))
    ]


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
