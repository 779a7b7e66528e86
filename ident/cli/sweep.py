"""`ident sweep`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import moving, options, running, varying
from ident.cli.app import app

if TYPE_CHECKING:
    from ident.assess.sweep import SweepStudy
    from ident.vibrate.redesign.evaluator import Evaluator
    from ident.vibrate.redesign.sweep import Axis, Sweep

NAMED = moving.NAMED | {"measure": "--measure", "axes": "--vary"}
"""The option that gives each argument of the library."""


@app.command("sweep")
def sweep_command(
    arm: options.ArmArgument,
    vary: varying.VaryOption,
    grid: Annotated[bool, typer.Option("--grid", help="both of two parameters together, as a map")] = False,
    measure: Annotated[str, typer.Option(help="peak or rms over the motion, or residual: peak after arrival")] = "peak",
    limit: Annotated[float | None, typer.Option(help="amplitude [mm] that should not be exceeded")] = None,
    speed: moving.SpeedOption = None,
    profile: moving.ProfileOption = None,
    retract: moving.RetractOption = False,
    dwell: Annotated[float, typer.Option(help="time [s] that the arm is held at the end")] = 2.0,
    path: moving.PathOption = None,
    smoothing: moving.SmoothingOption = 0.0,
    load: options.LoadOption = "",
    change: options.SetOption = None,
    fit: moving.FitOption = None,
    posterior: moving.PosteriorOption = None,
    draws: moving.DrawsOption = 50,
    seed: moving.DrawSeedOption = None,
    elastic_belts: Annotated[bool, typer.Option("--elastic-belts", help="belts stretch")] = False,
    rate: Annotated[float, typer.Option(help="samples a second")] = 500.0,
    out: options.OutOption = Path("out"),
    no_figure: options.NoFigureOption = False,
) -> None:
    """Vary numbers of the arm, or its speed: how the vibration over a motion depends on them (Figures 9 and 10).

    Each parameter alone, the others as they are; two together with --grid. By the fast method. Writes
    ARM.MOTION.PARAMETERS.sweep.csv, .json and .png into the folder given by --out, when all is done.
    """
    asked = options.recorded(locals())
    options.check_positive(limit, "--limit")
    options.check_positive(rate, "--rate")
    moving.check(asked, path)
    changed = options.assignments(change)
    running.start()
    from ident.assess.sweep import SweepStudy
    from ident.description.file import read_arm
    from ident.identify.conditions import loads_of
    from ident.measure import Load
    from ident.vibrate.redesign.evaluator import Evaluator
    from ident.vibrate.redesign.ranges import COUNT, MAP_COUNT
    from ident.vibrate.response.amplitude import amplitude

    wanted = varying.ranges(vary)
    if grid:
        varying.check_map(wanted)
    arm_file = read_arm(arm)
    fitted, found, described = moving.values(arm_file.arm, fit, posterior, draws, seed, changed)
    hung = Load.parse(load)
    how: dict[str, Any] = {"loads": loads_of(described, hung), "elastic_belts": elastic_belts, "rate": rate}
    motion, log = moving.motion(described, asked, path)
    percent = moving.percent(asked, path)
    axes = varying.axes(described, vary, wanted, percent, arm_file.extents, MAP_COUNT if grid else COUNT)
    if grid:
        varying.check_points(axes)
    options.renamed(NAMED, amplitude, measure, motion, rate)
    own = moving.drawn(found, changed) if found else {}
    trial = Evaluator(described, motion, (), measure, own, **how)
    swept = options.renamed(NAMED, _swept, trial, axes, grid)
    sweeping = SweepStudy(
        arm_file, trial, hung, swept, None if limit is None else limit / 1e3, log, fitted, found, changed
    )
    name = f"{moving.name(arm, asked, path)}.{varying.label(wanted, grid)}.sweep"
    _write(sweeping, asked, out / name, no_figure)


def _swept(trial: "Evaluator", axes: "list[Axis]", grid: bool) -> "tuple[Sweep, ...]":
    from ident.vibrate.redesign.sweep import sweep, sweeps

    progress = running.progress("simulations")
    return (sweep(trial, axes, progress),) if grid else sweeps(trial, axes, progress)


def _write(sweeping: "SweepStudy", asked: dict[str, Any], path: Path, no_figure: bool) -> None:
    """Print the report, and write table, summary and figure."""
    from ident.present.files.document import write_json
    from ident.present.files.sweep import sweep_document, write_csv
    from ident.present.text.sweep import sweep_report

    report, document = sweep_report(sweeping), sweep_document(sweeping, asked)
    figures = {}
    if not no_figure:
        from ident.present.figures.sweep import sweep_figure

        figures = {_beside(path, "png"): sweep_figure(sweeping)}
    typer.echo(report)
    write_csv(sweeping, asked, _beside(path, "csv"))
    write_json(document, _beside(path, "json"))
    for end in ("csv", "json"):
        typer.echo(f"wrote {_beside(path, end)}")
    running.draw(figures)


def _beside(path: Path, end: str) -> Path:
    return path.parent / f"{path.name}.{end}"
