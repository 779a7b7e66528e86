"""`ident design`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import ArmArgument, FitOption, NoFigureOption, OutOption, PathOption, command, finish
from ident.studies.design import DesignOptions


@command(DesignOptions)
def design_command(
    arm: ArmArgument,
    options: DesignOptions,
    path: PathOption = None,
    fit: FitOption = None,
    posterior: Annotated[
        Path | None, typer.Option(help="posterior of ident sample (.nc): the design shall keep --limit by its draws")
    ] = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Say what to change on the arm so that it vibrates least, within bounds, and what the amplitude depends on most.

    Writes ARM.MOTION.design.json, .toml (the arm with the changed numbers) and figures into the folder given by --out,
    when all is done; with --sensitivities ARM.MOTION.sensitivities.json and .png. See also ident sweep.
    """
    from ident.description.file import read_arm
    from ident.studies.design import design

    described, shown = read_arm(arm), running.progress
    finish(design(described, options, path=path, fit=fit, posterior=posterior, progress=shown), out, no_figure)
