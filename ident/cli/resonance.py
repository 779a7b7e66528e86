"""`ident resonance`."""

from pathlib import Path

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
from ident.studies.resonance import ResonanceOptions


@command(ResonanceOptions)
def resonance_command(
    arm: ArmArgument,
    options: ResonanceOptions,
    path: PathOption = None,
    fit: FitOption = None,
    posterior: PosteriorOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Draw the Campbell diagram of a motion: pulley frequencies against natural frequencies (the paper's Figure 4).

    Writes ARM.MOTION.resonance.json and .png into the folder given by --out.
    """
    from ident.description.file import read_arm
    from ident.studies.resonance import resonance

    finish(resonance(read_arm(arm), options, path=path, fit=fit, posterior=posterior), out, no_figure)
