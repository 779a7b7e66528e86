"""`ident simulate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.identify.results import Values
    from ident.measure import Log, Trace
    from ident.present.simulation import Simulation
    from ident.vibrate.compare import Comparison
    from ident.vibrate.motion import Motion
    from ident.vibrate.study import Study

NAMED = {
    "percent": "--speed",
    "profile": "--profile",
    "dwell": "--dwell",
    "smoothing": "--smoothing",
    "method": "--method",
    "rate": "--rate",
}
"""The option that gives each argument of the library."""
STROKE = (
    "add a [stroke] with direction, folded, unfolded, speed, acceleration and jerk to the arm file, as in"
    " data/lcd_arm/arm.toml, or give a joint path (--path)"
)


@app.command("simulate")
def simulate_command(
    arm: options.ArmArgument,
    speed: Annotated[
        float | None, typer.Option(help="percent of full speed, default 10; with --path of its own speed, default 100")
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="of the stroke's speed: s-curve (default), trapezoid or cycloid")
    ] = None,
    retract: Annotated[bool, typer.Option("--retract", help="from unfolded to folded")] = False,
    dwell: Annotated[float, typer.Option(help="time [s] that the arm is held at the end")] = 2.0,
    path: Annotated[
        Path | None,
        typer.Option(help="joint path to follow instead of the stroke: CSV with time [s], joint1 [deg], ..."),
    ] = None,
    smoothing: Annotated[float, typer.Option(help="noise of that path, rms [deg]")] = 0.0,
    load: options.LoadOption = "",
    change: options.SetOption = None,
    fit: Annotated[Path | None, typer.Option(help="result file of ident fit, whose values the arm takes over")] = None,
    posterior: Annotated[
        Path | None, typer.Option(help="posterior of ident sample (.nc): bands of 5 to 95 % by its draws")
    ] = None,
    draws: Annotated[int, typer.Option(min=1, help="draws of the posterior")] = 200,
    seed: Annotated[
        int | None, typer.Option(min=0, help="choose the draws at random; default: spread evenly over the chains")
    ] = None,
    elastic_belts: Annotated[bool, typer.Option("--elastic-belts", help="belts stretch")] = False,
    method: Annotated[str | None, typer.Option(help="fast, exact or both (default; with --posterior: fast)")] = None,
    rate: Annotated[float, typer.Option(help="samples a second")] = 500.0,
    trace: Annotated[
        Path | None,
        typer.Option(help="measured vibration to compare with: CSV with time [s], x [mm] or x [m/s^2], ..."),
    ] = None,
    band: Annotated[str, typer.Option(help="band LOW:HIGH [Hz] in which the strongest frequency is compared")] = "4:8",
    tolerance: Annotated[float, typer.Option(help="of the settling time [mm]")] = 0.1,
    at: Annotated[float | None, typer.Option(help="time [s] from which on a further peak is told, as 4")] = None,
    limit: Annotated[float | None, typer.Option(help="peak [mm] that should not be exceeded")] = None,
    out: options.OutOption = Path("out"),
    no_figure: options.NoFigureOption = False,
) -> None:
    """Simulate how the arm's end vibrates while the arm carries out a motion.

    Writes ARM.MOTION.simulate.csv, .nc and .json and figures into the folder given by --out, when all is done. Ctrl-C
    during the exact method: what there is, is written.
    """
    asked = options.recorded(locals())
    _check(asked, path)
    limits = options.frequency_band(band, "--band")
    changed = options.assignments(change)
    running.start()
    from ident.arm.file import read_arm_file
    from ident.identify.conditions import loads_of
    from ident.identify.results import read_draws, read_fit
    from ident.measure import Load, read_trace
    from ident.present.simulation import Simulation
    from ident.vibrate.limits import beyond_limits
    from ident.vibrate.study import draw, study

    arm_file = read_arm_file(arm)
    fitted = read_fit(fit, arm_file.arm) if fit else None
    drawn = read_draws(posterior, arm_file.arm, draws, seed) if posterior else None
    measured = read_trace(trace) if trace else None
    central = fitted or drawn
    described = arm_file.arm.replace((central.medians if central else {}) | changed)
    hung = Load.parse(load)
    loads = loads_of(described, hung)
    motion, log = _motion(described, asked, path)
    beyond_limits(described, motion)
    _check_time(at, motion)
    how: dict[str, Any] = {"loads": loads, "elastic_belts": elastic_belts, "rate": rate}
    chosen = method or ("fast" if drawn else "both")
    done = options.renamed(
        NAMED, study, described, motion, method=chosen, progress=running.progress("exact method"), **how
    )
    bands = None
    if drawn and done.interrupted is None:
        settle: dict[str, Any] = {"tolerance": tolerance / 1e3, "at": at, "progress": running.progress("draws")}
        bands = draw(described, motion, _drawn(drawn, changed), **settle, **how)
    simulation = Simulation(
        arm_file,
        described,
        hung,
        done,
        tolerance / 1e3,
        at=at,
        limit=None if limit is None else limit / 1e3,
        log=log,
        fit=fitted,
        posterior=drawn,
        draws=bands,
        changed=changed,
        trace=measured,
        comparisons=_compared(done, measured, limits) if measured else None,
    )
    _write(simulation, asked, out / _name(arm, asked, path), no_figure)
    if done.interrupted is not None:
        typer.echo(f"interrupted at {done.interrupted:.4g} s; what there is was written", err=True)
        raise typer.Exit(130)


def _drawn(posterior: "Values", changed: dict[str, float]) -> "dict[str, Any]":
    """Return the draws of the numbers that the user has not set."""
    left = posterior.without(changed)
    if not left:
        raise InputError(Problem("--set", "every number of the posterior", "one that is drawn", "drop one of them"))
    return left


def _compared(done: "Study", measured: "Trace", band: tuple[float, float]) -> "dict[str, Comparison] | None":
    """Compare with a trace; what an interruption has left may be too short for it."""
    from ident.vibrate.study import against

    try:
        return against(done.response, measured.time, measured.values, measured.kind, band)
    except InputError:
        if done.interrupted is None:
            raise
        return None


def _write(simulation: "Simulation", asked: dict[str, Any], path: Path, no_figure: bool) -> None:
    """Print the report, and write series, summary and figures."""
    from ident.present.result import write_json
    from ident.present.simulate_report import simulate_report
    from ident.present.simulate_result import dataset, simulate_document, write_csv, write_netcdf

    report, document, data = (
        simulate_report(simulation),
        simulate_document(simulation, asked),
        dataset(simulation, asked),
    )
    figures = {}
    if not no_figure:
        from ident.present.simulate_figure import drives_figure, simulate_figure

        figures = {
            _beside(path, "png"): simulate_figure(simulation),
            _beside(path, "drives.png"): drives_figure(simulation),
        }
    typer.echo(report)
    write_csv(simulation, asked, _beside(path, "csv"))
    write_netcdf(data, _beside(path, "nc"))
    write_json(document, _beside(path, "json"))
    for end in ("csv", "nc", "json"):
        typer.echo(f"wrote {_beside(path, end)}")
    running.draw(figures)


def _motion(arm: "Arm", asked: dict[str, Any], path: Path | None) -> "tuple[Motion, Log | None]":
    """Return the stroke, or the path of a log."""
    from math import radians

    from ident.measure import read_log
    from ident.vibrate.replay import replay
    from ident.vibrate.stroke import stroke

    if path is None:
        if arm.stroke is None:
            raise InputError(Problem(arm.name, "no stroke", "what the arm shall carry out", STROKE))
        speed = 10.0 if asked["speed"] is None else asked["speed"]
        form = {"profile": asked["profile"] or "s-curve", "retract": asked["retract"], "dwell": asked["dwell"]}
        return options.renamed(NAMED, stroke, arm.stroke, percent=speed, **form), None
    log = read_log(path, [joint.name for joint in arm.driven])
    import numpy as np

    angles = np.stack(list(log.angles.values()))
    motion = options.renamed(NAMED, replay, log.time, angles, smoothing=radians(asked["smoothing"]), name=path.name)
    if asked["speed"] is not None:
        motion = options.renamed(NAMED, motion.at_speed, asked["speed"])
    return options.renamed(NAMED, motion.dwell, asked["dwell"]), log


def _check(asked: dict[str, Any], path: Path | None) -> None:
    """Refuse options that do not go together, and numbers that can't be."""
    options.check_positive(asked["tolerance"], "--tolerance")
    options.check_positive(asked["limit"], "--limit")
    if path is not None and (asked["profile"] or asked["retract"]):
        option = "--profile" if asked["profile"] else "--retract"
        raise InputError(Problem(option, "it beside --path", "one of them", "it shapes the stroke: drop one"))
    if path is None and asked["smoothing"]:
        raise InputError(Problem("--smoothing", "it without --path", "a path to smooth", "drop it, or give --path"))


def _check_time(at: float | None, motion: "Motion") -> None:
    first, last = float(motion.breaks[0]), float(motion.breaks[-1])
    if at is not None and not first <= at <= last:
        remedy = "hold the arm longer (--dwell)" if at > last else "correct it"
        raise InputError(Problem("--at", f"{at:g} s", f"a time from {first:g} to {last:.4g} s", remedy))


def _name(arm: Path, asked: dict[str, Any], path: Path | None) -> str:
    """Return what the files are called: arm, motion, percent."""
    if path is not None:
        percent = "" if asked["speed"] is None else f"-{asked['speed']:g}"
        return f"{arm.stem}.{path.stem}{percent}"
    percent = f"{10.0 if asked['speed'] is None else asked['speed']:g}"
    form = "" if asked["profile"] in (None, "s-curve") else f"-{asked['profile']}"
    return f"{arm.stem}.{'retract' if asked['retract'] else 'extend'}-{percent}{form}"


def _beside(path: Path, end: str) -> Path:
    return path.parent / f"{path.name}.simulate.{end}"
