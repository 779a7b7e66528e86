"""A diagnosis with little effort, at full speed, where a motion is short: what is tested is the way through.

As a program it is the command `small`, to be killed.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from arms import DATA

from ident.cli.command import ArmOption, CampaignArgument, OutOption, PathOption, command
from ident.cli.commands import diagnose_command
from ident.studies.cure.diagnose import DiagnoseOptions, DiagnoseResult
from ident.studies.cure.effort import DiagnosisEffort

SMALL = DiagnosisEffort(
    steps=500,
    draws=30,
    band_draws=4,
    assessment_draws=10,
    speeds=(0.5, 1.25),
    values=5,
    screened=4,
    iterations=2,
)
OPTIONS = DiagnoseOptions(speed=100.0, dwell=0.2, limit=1.3, effort=SMALL)
CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"


def small_command(
    campaign: CampaignArgument,
    options: DiagnoseOptions,
    arm: ArmOption = None,
    path: PathOption = None,
    restart: Annotated[bool, typer.Option("--restart")] = False,
    out: OutOption = Path("out"),
) -> Iterator[DiagnoseResult]:
    """Diagnose with little effort."""
    yield from diagnose_command(campaign, replace(options, effort=SMALL), arm, path, None, restart, out)


if __name__ == "__main__":
    from ident import cli

    command(DiagnoseOptions)(small_command)
    cli.main()
