"""`ident resonance`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ident.cli import moving, options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

NAMED = {"margin": "--margin", "orders": "--orders", "count": "--count"}
"""The option that gives each argument of the library."""


@app.command("resonance")
def resonance_command(
    arm: options.ArmArgument,
    speed: moving.SpeedOption = None,
    profile: moving.ProfileOption = None,
    retract: moving.RetractOption = False,
    path: moving.PathOption = None,
    smoothing: moving.SmoothingOption = 0.0,
    load: options.LoadOption = "",
    change: options.SetOption = None,
    fit: moving.FitOption = None,
    posterior: moving.PosteriorOption = None,
    draws: moving.DrawsOption = 200,
    seed: moving.DrawSeedOption = None,
    count: Annotated[int, typer.Option(min=1, help="lowest natural frequencies that are followed")] = 3,
    orders: Annotated[
        str | None,
        typer.Option(help="multiples of the pulleys' frequencies, as 1,2; default: 1, and 2 with a kinematic error"),
    ] = None,
    margin: Annotated[float, typer.Option(help="percent of a natural frequency that count as near")] = 10.0,
    out: options.OutOption = Path("out"),
    no_figure: options.NoFigureOption = False,
) -> None:
    """Compare the pulleys' frequencies with the arm's natural frequencies along a motion (the paper's Figure 4).

    Writes ARM.MOTION.resonance.json and .png into the folder given by --out.
    """
    asked = options.recorded(locals()) | {"dwell": 0.0}
    moving.check(asked, path)
    changed, multiples = options.assignments(change), _orders(orders)
    running.start()
    from ident.description.file import read_arm
    from ident.identify.conditions import loads_of
    from ident.measure import Load
    from ident.present.files.document import write_json
    from ident.present.text.resonance import resonance_document, resonance_report
    from ident.vibrate.modal.branches import branches
    from ident.vibrate.modal.excitation import excitation
    from ident.vibrate.modal.resonance import resonance_crossings

    arm_file = read_arm(arm)
    _, found, described = moving.values(arm_file.arm, fit, posterior, draws, seed, changed)
    motion, _ = moving.motion(described, asked, path)
    of_draws = described.replace(moving.drawn(found, changed)) if found else described
    followed = options.renamed(
        NAMED, branches, of_draws, motion, count=count, loads=loads_of(described, Load.parse(load))
    )
    shaken = options.renamed(NAMED, excitation, described, motion, orders=multiples)
    met = options.renamed(NAMED, resonance_crossings, followed, shaken, margin=margin / 100)
    title = f"{arm_file.arm.name}, {motion.name}"
    typer.echo(resonance_report(followed, shaken, met, title=title, margin=margin / 100))
    name = out / f"{moving.name(arm, asked, path)}.resonance"
    result = name.with_name(f"{name.name}.json")
    write_json(resonance_document(followed, shaken, met, arm_file, asked), result)
    typer.echo(f"wrote {result}")
    if not no_figure:
        from ident.present.figures.resonance import resonance_figure

        running.draw({name.with_name(f"{name.name}.png"): resonance_figure(followed, shaken, met, title=title)})


def _orders(text: str | None) -> tuple[int, ...] | None:
    """Read whole multiples with commas between."""
    if text is None:
        return None
    found: list[Any] = list(options.several(text, "--orders"))
    if any(order != int(order) or order < 1 for order in found):
        raise InputError(Problem(f"--orders {text}", f"'{text}'", "whole numbers from 1", "as 1,2"))
    return tuple(int(order) for order in found)
