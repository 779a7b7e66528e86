"""`ident simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import (
    ArmArgument,
    FitOption,
    NoFigureOption,
    OutOption,
    PathOption,
    PosteriorOption,
    command,
    finish,
)
from ident.studies.simulate import SimulateOptions

TraceOption = Annotated[
    Path | None,
    typer.Option(help="measured vibration to compare with: CSV with time [s], x [mm] or x [m/s^2], ..."),
]


@command(SimulateOptions)
def simulate_command(
    arm: ArmArgument,
    options: SimulateOptions,
    path: PathOption = None,
    fit: FitOption = None,
    posterior: PosteriorOption = None,
    trace: TraceOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Simulate how the arm's end vibrates while the arm carries out a motion.

    Writes ARM.MOTION.simulate.csv, .nc and .json and figures into the folder given by --out, when all is done. Ctrl-C
    during the exact method: what there is, is written.
    """
    from ident.description.file import read_arm
    from ident.studies.simulate import simulate

    result = simulate(
        read_arm(arm), options, path=path, fit=fit, posterior=posterior, trace=trace, progress=running.progress
    )
    finish(result, out, no_figure)
    if result.interrupted is not None:
        typer.echo(f"interrupted at {result.interrupted:.4g} s; what there is was written", err=True)
        raise typer.Exit(130)
