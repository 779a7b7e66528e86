"""A fit and a plan as rows, and fitted values out of a fit's result file."""

import csv
import hashlib
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.identify.fit import CampaignFit
from ident.identify.plan import CampaignPlan
from ident.identify.values import Robot, Values, doubtful
from ident.measure import KINDS, Campaign, format_campaign
from ident.present.files.document import check_format, read_document
from ident.present.text.words import unit_of
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


# -------- Plan
# A plan as rows, and as a campaign with empty values to fill in.


def write_form(plan: CampaignPlan, path: Path) -> None:
    """Write the batch as a campaign whose values are left to be filled in, the expected ones in the notes."""
    _refuse_filled(path)
    campaign = plan.campaign()
    rows = tuple(replace(m, group="", member=0) for m in campaign)  # a row may be left out: groups count their rows
    alone = replace(campaign, measurements=rows, covariance=None)
    table = list(csv.DictReader(io.StringIO(format_campaign(alone, relative_sigma=True))))
    text = io.StringIO()
    text.write("# Made by `ident plan`. Fill in `value`; `expected` in the notes is a prediction, not a measurement.\n")
    if not any(experiment.labelled for experiment in plan.batch):
        text.write("# Rows without mode are matched in ascending order within one posture and load: enter them all.\n")
    names = list(dict.fromkeys([name for row in table for name in row] + ["note"]))
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in table:
        note = f"expected {float(row['value']):.4g} {row['unit']}. {row.get('note') or ''}".strip()
        writer.writerow({**row, "value": "", "note": note, "relative_sigma": f"{float(row['relative_sigma']):.4g}"})
    replace_file(path, lambda file: file.write(text.getvalue().encode()), make_folders=True)


def plan_rows(plan: CampaignPlan) -> list[dict[str, Any]]:
    """Return a row for each experiment of the batch: posture [deg], load, what is done, cost [min], gain, nat."""
    return [
        {
            "step": number,
            **{f"{joint.name} [deg]": math.degrees(q) for joint, q in zip(plan.arm.driven, each.posture, strict=True)},
            "load": str(each.load),
            "hammer": each.hammer,
            "labelled": each.labelled,
            "dial_gauge": each.dial,
            "minutes": step.cost,
            "gain": step.gain,
            "nats": step.nats,
        }
        for number, (step, each) in enumerate(zip(plan.steps, plan.batch, strict=True), 1)
    ]


def _refuse_filled(path: Path) -> None:
    try:
        lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
    except (OSError, UnicodeDecodeError):
        return
    if any((row.get("value") or "").strip() for row in csv.DictReader(lines)):
        remedy = "move it away, or choose another folder (`folder`)"
        raise InputError(
            Problem(one_line(str(path)), "a form that has been filled in", "none, or an empty one", remedy)
        )
