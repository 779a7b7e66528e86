"""A plan as rows, and as a campaign with empty values to fill in."""

import csv
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.identify.plan import CampaignPlan
from ident.measure import format_campaign
from ident.text import one_line


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
