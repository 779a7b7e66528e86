"""`ident predict`."""

from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app


@app.command("predict")
def predict_command(
    arm: options.ArmArgument,
    posture: Annotated[
        list[str] | None,
        typer.Option("--posture", "-q", help="joint angles in degrees, as 30,-60,30; may be repeated"),
    ] = None,
    load: options.LoadOption = "",
    modes: Annotated[int, typer.Option(min=1, help="number of modes")] = 6,
    change: options.SetOption = None,
) -> None:
    """Predict natural frequencies, modes and static deflection of an arm."""
    running.start()
    from ident.description.file import read_arm
    from ident.identify.modal_analysis import modal_analysis
    from ident.measure import Load
    from ident.present.text.predict import predict_report

    described = read_arm(arm).arm.replace(options.assignments(change))
    postures = [options.posture(text) for text in posture or ()] or [(0.0,) * len(described.driven)]
    for held in postures:
        typer.echo(predict_report(modal_analysis(described, held, Load.parse(load), modes)))
