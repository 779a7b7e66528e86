"""`ident sample`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import (
    ArmOption,
    CampaignArgument,
    NoFigureOption,
    OutOption,
    StrictOption,
    command,
    finish,
    leave,
)
from ident.studies.sample import SampleOptions


@command(SampleOptions)
def sample_command(
    campaign: CampaignArgument,
    options: SampleOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    restart: Annotated[bool, typer.Option("--restart", help="throw away the checkpoints of an unfinished run")] = False,
    no_figure: NoFigureOption = False,
    strict: StrictOption = False,
) -> None:
    """Sample the posterior of a campaign: how sure each stiffness is, and which combinations are known.

    Goes on where an earlier run of the same inputs was stopped. Writes CAMPAIGN.sample.nc (ArviZ InferenceData) and
    figures into the folder given by --out. Exit status 3 where the chains are too short.
    """
    from ident.store import Store
    from ident.studies.sample import sample

    measured, described = running.read(campaign, arm)
    folder = out / f"{measured.name}.sample.part"
    try:
        result = sample(described, measured, options, folder=folder, restart=restart, progress=running.progress)
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    finish(result, out, no_figure)
    if result.enough:
        Store.discard(folder)
    else:
        typer.echo(f"kept {folder}: the same command with more --steps goes on from there")
    leave(short=not result.enough, doubtful=bool(result.sample.fitted.doubts), strict=strict)
