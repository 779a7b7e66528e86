"""`ident sweep`."""

from pathlib import Path

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
from ident.studies.sweep import SweepOptions


@command(SweepOptions)
def sweep_command(
    arm: ArmArgument,
    options: SweepOptions,
    path: PathOption = None,
    fit: FitOption = None,
    posterior: PosteriorOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Vary numbers of the arm, or its speed: how the vibration over a motion depends on them (Figures 9 and 10).

    Each parameter alone, the others as they are; two together with --grid. By the fast method. Writes
    ARM.MOTION.PARAMETERS.sweep.csv, .json and .png into the folder given by --out, when all is done.
    """
    from ident.description.file import read_arm
    from ident.studies.sweep import sweep

    described, shown = read_arm(arm), running.progress
    finish(sweep(described, options, path=path, fit=fit, posterior=posterior, progress=shown), out, no_figure)
