"""`ident design`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import changing, moving, options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.assess.design import DesignStudy
    from ident.identify.values import Values
    from ident.vibrate.redesign.design import Design
    from ident.vibrate.redesign.evaluator import Evaluator
    from ident.vibrate.redesign.search import Requirements

NAMED = moving.NAMED | {
    "measure": "--measure",
    "limit": "--limit",
    "frequency": "--min-frequency",
    "deflection": "--max-deflection",
    "amount": "--max-amount",
    "variables": "--change",
}
"""The option that gives each argument of the library."""
SEARCHING = ("change", "limit", "min_frequency", "max_deflection", "max_amount", "no_curve")
"""Options that pose the search."""


@app.command("design")
def design_command(
    arm: options.ArmArgument,
    change: changing.ChangeOption = None,
    limit: Annotated[float | None, typer.Option(help="amplitude [mm] that should not be exceeded")] = None,
    min_frequency: Annotated[
        float | None, typer.Option(help="first natural frequency [Hz] to keep at both ends of the motion")
    ] = None,
    max_deflection: Annotated[float | None, typer.Option(help="static deflection [mm] to keep at both ends")] = None,
    max_amount: Annotated[
        float | None,
        typer.Option(help="largest amount of change: 1 is one number of weight 1 at its farther bound"),
    ] = None,
    measure: Annotated[str, typer.Option(help="peak or rms over the motion, or residual: peak after arrival")] = "peak",
    sensitivities: Annotated[bool, typer.Option("--sensitivities", help="only the table of sensitivities")] = False,
    starts: Annotated[int, typer.Option(min=1, help="starts of the search")] = 3,
    no_curve: Annotated[bool, typer.Option("--no-curve", help="no trade-off of amplitude and change")] = False,
    speed: moving.SpeedOption = None,
    profile: moving.ProfileOption = None,
    retract: moving.RetractOption = False,
    dwell: Annotated[float, typer.Option(help="time [s] that the arm is held at the end")] = 1.0,
    path: moving.PathOption = None,
    smoothing: moving.SmoothingOption = 0.0,
    load: options.LoadOption = "",
    assigned: options.SetOption = None,
    fit: moving.FitOption = None,
    posterior: Annotated[
        Path | None, typer.Option(help="posterior of ident sample (.nc): the design shall keep --limit by its draws")
    ] = None,
    draws: Annotated[int, typer.Option(min=1, help="draws of the posterior for the search")] = 16,
    fresh: Annotated[int, typer.Option(min=0, help="other draws, by which the design is verified")] = 1000,
    seed: options.SeedOption = 0,
    elastic_belts: Annotated[bool, typer.Option("--elastic-belts", help="belts stretch")] = False,
    rate: Annotated[float, typer.Option(help="samples a second")] = 500.0,
    out: options.OutOption = Path("out"),
    no_figure: options.NoFigureOption = False,
) -> None:
    """Say what to change on the arm so that it vibrates least, within bounds, and what the amplitude depends on most.

    Writes ARM.MOTION.design.json, .toml (the arm with the changed numbers) and figures into the folder given by --out,
    when all is done; with --sensitivities ARM.MOTION.sensitivities.json and .png. See also ident sweep.
    """
    asked = options.recorded(locals())
    _check(asked, path)
    set_by_user = options.assignments(assigned)
    running.start()
    from ident.assess.design import DesignStudy
    from ident.description.file import read_arm_file
    from ident.identify.conditions import loads_of
    from ident.measure import Load
    from ident.vibrate.redesign.evaluator import Evaluator
    from ident.vibrate.response.amplitude import amplitude

    arm_file = read_arm_file(arm)
    fitted, drawn, others, described = _values(arm_file.arm, fit, posterior, asked, set_by_user)
    extents = arm_file.extents
    variables = () if sensitivities else changing.variables(described, change or (), extents)
    hung = Load.parse(load)
    motion, log = moving.motion(described, asked, path)
    options.renamed(NAMED, amplitude, measure, motion, rate)
    own = moving.drawn(drawn, set_by_user) if drawn else {}
    how: dict[str, Any] = {"loads": loads_of(described, hung), "elastic_belts": elastic_belts, "rate": rate}
    trial = Evaluator(described, motion, variables, measure, own, **how)
    given: dict[str, Any] = {"log": log, "fit": fitted, "posterior": drawn, "changed": set_by_user}
    if sensitivities:
        found = _sensitivities(trial)
        _write(
            DesignStudy(arm_file, trial, hung, found, **given), asked, out / moving.name(arm, asked, path), no_figure
        )
        return
    _check_written(described, trial, drawn, fitted, set_by_user, arm_file.path)
    trial = _shared(trial)
    done = _design(trial, asked, _required(asked), extents)
    found = _sensitivities(trial)
    unseen = moving.drawn(others, set_by_user) if others else None
    verified = _verify(done, unseen)
    given |= {"starts": starts, "fresh": len(next(iter(unseen.values()))) if unseen else 0}
    designing = DesignStudy(arm_file, trial, hung, found, done, verified, **given)
    _write(designing, asked, out / moving.name(arm, asked, path), no_figure)


def _shared(trial: "Evaluator") -> "Evaluator":
    """Return the trial with one step, so that search, sensitivities and verification share programs."""
    from dataclasses import replace

    return replace(trial, step=trial.step_for(trial.bounds))


def _values(
    arm: "Arm", fit: Path | None, posterior: Path | None, asked: dict[str, Any], changed: dict[str, float]
) -> "tuple[Values | None, Values | None, Values | None, Arm]":
    """Read fitted values, draws of the search and others, and return them with the arm that takes over the values."""
    from ident.identify.values import read_two_groups

    if posterior is None:
        fitted, _, described = moving.values(arm, fit, None, 1, None, changed)
        return fitted, None, None, described
    drawn, others = read_two_groups(posterior, arm, asked["draws"], asked["fresh"], asked["seed"])
    fitted, _, described = moving.values(arm, fit, None, 1, None, ({} if fit else drawn.medians) | changed)
    return fitted, drawn, others, described


def _required(asked: dict[str, Any]) -> "Requirements":
    from math import inf

    from ident.vibrate.redesign.search import Requirements

    deflection, amount = asked["max_deflection"], asked["max_amount"]
    return Requirements(
        asked["min_frequency"] or 0.0,
        inf if deflection is None else deflection / 1e3,
        inf if amount is None else amount,
    )


def _design(trial: "Evaluator", asked: dict[str, Any], required: "Requirements", extents: Any) -> "Design":
    from ident.vibrate.redesign.design import design

    return options.renamed(
        NAMED,
        design,
        trial,
        limit=None if asked["limit"] is None else asked["limit"] / 1e3,
        required=required,
        extents=extents,
        starts=asked["starts"],
        curve=not asked["no_curve"],
        seed=asked["seed"],
        progress=running.progress("starts"),
    )


def _sensitivities(trial: "Evaluator") -> Any:
    from ident.vibrate.redesign.sensitivity import sensitivities

    return options.renamed(NAMED, sensitivities, trial, progress=running.progress("sensitivities"))


def _verify(done: "Design", fresh: Any) -> Any:
    from ident.vibrate.redesign.verify import verify

    return verify(done.evaluator, done.best, done.limit, fresh, running.progress("verification"))


def _write(designing: "DesignStudy", asked: dict[str, Any], path: Path, no_figure: bool) -> None:
    """Print the report, and write summary, arm file and figures."""
    from ident.present.files.design import design_document, revised, write_arm
    from ident.present.files.fit import write_json
    from ident.present.text.design import design_report
    from ident.present.text.sensitivity import sensitivity_report

    design = designing.design
    base = path.parent / f"{path.name}.{'design' if design else 'sensitivities'}"
    document = design_document(designing, asked)
    report = design_report(designing) if design else sensitivity_report(designing)
    text = revised(designing, design.best.values) if design else ""
    figures = {} if no_figure else _figures(designing, base)
    typer.echo(report)
    write_json(document, _beside(base, "json"))
    typer.echo(f"wrote {_beside(base, 'json')}")
    if design:
        note = f"by ident design from {designing.arm_file.path}, sha256 {designing.arm_file.sha256}"
        write_arm(text, note, _beside(base, "toml"))
        typer.echo(f"wrote {_beside(base, 'toml')}")
    running.draw(figures)


def _figures(designing: "DesignStudy", base: Path) -> dict[Path, Any]:
    from ident.present.figures.design import before_after_figure, trade_off_figure
    from ident.present.figures.sensitivity import sensitivity_figure

    if designing.design is None:
        return {_beside(base, "png"): sensitivity_figure(designing)}
    return {
        _beside(base, "png"): trade_off_figure(designing),
        _beside(base, "vibration.png"): before_after_figure(designing),
        _beside(base, "sensitivities.png"): sensitivity_figure(designing),
    }


def _check(asked: dict[str, Any], path: Path | None) -> None:
    """Refuse options that do not go together, and numbers that can't be."""
    for name in ("limit", "min_frequency", "max_deflection", "max_amount", "rate"):
        options.check_positive(asked[name], f"--{name.replace('_', '-')}")
    if asked["sensitivities"]:
        for name in SEARCHING:
            if asked[name]:
                option = f"--{name.replace('_', '-')}"
                raise InputError(Problem(option, "it beside --sensitivities", "one of them", "drop one"))
    moving.check(asked, path)


def _check_written(
    arm: "Arm",
    trial: "Evaluator",
    drawn: "Values | None",
    fitted: "Values | None",
    changed: dict[str, float],
    path: str,
) -> None:
    """Refuse what could not be written into the arm file in the end."""
    from ident.present.files.design import check_written

    taken = fitted or drawn
    names = [name for variable in trial.variables for name in variable.paths]
    check_written(arm, [*names, *(taken.values if taken else ()), *changed], path)


def _beside(path: Path, end: str) -> Path:
    return path.parent / f"{path.name}.{end}"
