"""`ident predict`."""

import typer

from ident.cli.command import ArmArgument, FitOption, PosteriorOption, command
from ident.studies.predict import PredictOptions


@command(PredictOptions)
def predict_command(
    arm: ArmArgument, options: PredictOptions, fit: FitOption = None, posterior: PosteriorOption = None
) -> None:
    """Predict natural frequencies, modes and static deflection of an arm."""
    from ident.description.file import read_arm
    from ident.studies.predict import predict

    typer.echo(predict(read_arm(arm), options, fit=fit, posterior=posterior).report())
