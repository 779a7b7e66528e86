"""A fit as rows, and fitted values out of its result file."""

import hashlib
from pathlib import Path
from typing import Any

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.identify.values import OTHER_ARM, Values, doubtful
from ident.measure import Campaign
from ident.present.files.document import check_format, read_document
from ident.present.text.units import unit_of
from ident.text import LARGEST_BINARY, one_line, read_bytes

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


def read_fit(form: str, path: str | Path, arm: Arm, sha256: str = "") -> tuple[Values, float | None]:
    """Return the fitted values of a result file, with what speaks against them, and at which height their base gives.

    Args:
        form: the format.
        path: the file.
        arm: whose numbers are looked for.
        sha256: hash of the arm's file; where the fit is of another one, a remark says so.
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
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise InputError(Problem(where, "other contents", EXPECTED, "give the file that ident fit wrote")) from None
    sha256_of_fit = hashlib.sha256(read_bytes(path, EXPECTED, LARGEST_BINARY)).hexdigest()
    values = Values.of_arm(best, arm, where, sha256_of_fit, remark, scaled)
    return (values.remarked(OTHER_ARM) if sha256 and fitted and sha256 != fitted else values), soft_base


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
