"""`ident plan`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import ArmOption, NoFigureOption, OutOption, command, finish
from ident.errors import InputError, Problem
from ident.studies.plan import PlanOptions


@command(PlanOptions)
def plan_command(
    options: PlanOptions,
    campaign: Annotated[
        Path | None, typer.Argument(help="what is measured already, a CSV file; leave it out for nothing")
    ] = None,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Rank what to measure next by what it would tell for its cost, and say what the intervals will become.

    Writes CAMPAIGN.plan.json, CAMPAIGN.plan.csv (a campaign to fill in) and CAMPAIGN.plan.png into the folder given by
    --out. Without CAMPAIGN, name the arm (--arm); the files are then called after its file.
    """
    from ident.description.file import read_arm
    from ident.studies.plan import plan

    if campaign is not None:
        measured, described = running.read(campaign, arm)
        finish(plan(described, measured, options, progress=running.progress), out, no_figure)
    elif arm is not None:
        finish(plan(read_arm(arm), None, options), out, no_figure)
    else:
        raise InputError(Problem("", "neither campaign nor arm", "one of them", "as ident plan --arm arm.toml"))
