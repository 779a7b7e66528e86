"""`ident predict`."""

from math import radians
from pathlib import Path
from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

NOT_NEGATIVE = ("mass", "k_bend", "k_tors", "tau_bend", "tau_tors")


@app.command("predict")
def predict_command(
    arm: Annotated[Path, typer.Argument(help="arm description, a TOML file (data/README.md)")],
    posture: Annotated[
        list[str] | None,
        typer.Option("--posture", "-q", help="joint angles in degrees, as 30,-60,30; may be repeated"),
    ] = None,
    load: Annotated[str, typer.Option(help="load case, as 'glass' or '5 kg @ tip'")] = "",
    modes: Annotated[int, typer.Option(min=1, help="number of modes")] = 6,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", help="number to change, in SI, as link2.mass=30 (inertia stays as it is)"),
    ] = None,
) -> None:
    """Predict natural frequencies, modes and static deflection of an arm."""
    running.start()
    from ident.arm.file import read_arm
    from ident.identify.survey import survey
    from ident.measure import Load
    from ident.present.survey_report import survey_report

    described = read_arm(arm)
    described = described.replace(dict(_assignment(text) for text in change or ()))
    postures = [_posture(text) for text in posture or ()] or [(0.0,) * len(described.driven)]
    for held in postures:
        typer.echo(survey_report(survey(described, held, Load.parse(load), modes)))


def _assignment(text: str) -> tuple[str, float]:
    path, _, value = text.partition("=")
    number, field = options.number(value, f"--set {text}"), path.split(".")[1:2]
    if field and field[0] in NOT_NEGATIVE and number < 0:
        raise InputError(Problem(f"--set {text}", f"{number:g}", "a value >= 0", "correct it"))
    return path, number


def _posture(text: str) -> tuple[float, ...]:
    return tuple(radians(options.number(part, f"--posture {text}")) for part in text.split(","))
