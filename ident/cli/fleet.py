"""The command `ident fleet`: many robots of one design."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import NoFigureOption, OutOption, StrictOption, command, finish, leave
from ident.cli.output import output
from ident.studies.fleet import FleetOptions, fleet


@command(FleetOptions)
def fleet_command(
    robots: Annotated[Path, typer.Argument(help="folder with a CSV file, or a folder with one, for each robot")],
    options: FleetOptions,
    arm: Annotated[
        Path | None, typer.Option("--arm", help="arm of robots whose folder has none; default: arm.toml beside them")
    ] = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
    strict: StrictOption = False,
) -> None:
    """Fit each robot of a fleet, and say how their stiffnesses spread and which robot stands out.

    Goes on where an earlier run of the same inputs was stopped. Writes ROBOTS.fleet.json, .prior (flags of ident fit
    for the next robot) and .png into the folder given by --out. Exit status 3 where a robot failed.
    """
    folder = out / f"{robots.absolute().name}.fleet.robots"
    try:
        result = fleet(robots, arm, options, folder=folder, progress=running.progress)
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    finish(result, out, no_figure)
    output().say(f"kept {folder}: fits of robots whose files have not changed are taken from there")
    leave(result, strict=strict)
