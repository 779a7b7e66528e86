"""`ident spectrum`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.command import NoFigureOption, OutOption, command, finish
from ident.studies.spectrum import SpectrumOptions

TraceArgument = Annotated[
    Path, typer.Argument(help="trace: CSV with time [s], x [mm] or x [m/s^2], ...; as of ident simulate")
]
ModesOption = Annotated[Path | None, typer.Option("--arm", help="arm description: marks its natural frequencies")]
AgainstOption = Annotated[Path | None, typer.Option(help="another trace, drawn over the first, as a measured one")]


@command(SpectrumOptions)
def spectrum_command(
    file: TraceArgument,
    options: SpectrumOptions,
    arm: ModesOption = None,
    against: AgainstOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Show at which frequencies a trace vibrates, and how much.

    Writes FILE.spectrum.json and .png, and with --spectrogram and --orders further figures, into the folder given by
    --out.
    """
    from ident.studies.spectrum import spectrum

    finish(spectrum(file, options, arm=arm, against=against), out, no_figure)
