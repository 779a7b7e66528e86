"""`ident predict`."""

import typer

from ident.cli.command import ArmArgument, command
from ident.studies.predict import PredictOptions


@command(PredictOptions)
def predict_command(arm: ArmArgument, options: PredictOptions) -> None:
    """Predict natural frequencies, modes and static deflection of an arm."""
    from ident.description.file import read_arm
    from ident.studies.predict import predict

    typer.echo(predict(read_arm(arm), options).report())
