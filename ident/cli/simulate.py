"""`ident simulate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import moving, options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.assess.simulation import Simulation
    from ident.measure import Trace
    from ident.vibrate.motion.motion import Motion
    from ident.vibrate.response.study import SimulatedMotion
    from ident.vibrate.signal.compare import Comparison


@app.command("simulate")
def simulate_command(
    arm: options.ArmArgument,
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
    draws: moving.DrawsOption = 200,
    seed: moving.DrawSeedOption = None,
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
    from ident.assess.basis import Basis
    from ident.assess.simulation import Simulation
    from ident.description.file import read_arm
    from ident.identify.conditions import loads_of
    from ident.measure import Load, read_trace
    from ident.vibrate.response.study import draw, simulate_motion

    arm_file = read_arm(arm)
    fitted, drawn, described = moving.values(arm_file.arm, fit, posterior, draws, seed, changed)
    measured = read_trace(trace) if trace else None
    hung = Load.parse(load)
    loads = loads_of(described, hung)
    motion, log = moving.motion(described, asked, path)
    _check_time(at, motion)
    how: dict[str, Any] = {"loads": loads, "elastic_belts": elastic_belts, "rate": rate}
    chosen = method or ("fast" if drawn else "both")
    done = options.renamed(
        moving.NAMED,
        simulate_motion,
        described,
        motion,
        method=chosen,
        progress=running.progress("exact method"),
        **how,
    )
    bands = None
    if drawn and done.interrupted is None:
        settle: dict[str, Any] = {"tolerance": tolerance / 1e3, "at": at, "progress": running.progress("draws")}
        bands = draw(described, motion, moving.drawn(drawn, changed), **settle, **how)
    simulation = Simulation(
        Basis(arm_file, described, motion, moving.percent(asked, path), hung, log, fitted, drawn, changed),
        done,
        tolerance / 1e3,
        at=at,
        limit=None if limit is None else limit / 1e3,
        draws=bands,
        trace=measured,
        comparisons=_compared(done, measured, limits) if measured else None,
    )
    _write(simulation, asked, out / moving.name(arm, asked, path), no_figure)
    if done.interrupted is not None:
        typer.echo(f"interrupted at {done.interrupted:.4g} s; what there is was written", err=True)
        raise typer.Exit(130)


def _compared(done: "SimulatedMotion", measured: "Trace", band: tuple[float, float]) -> "dict[str, Comparison] | None":
    """Compare with a trace; what an interruption has left may be too short for it."""
    from ident.vibrate.response.study import against

    try:
        return against(done.response, measured.time, measured.values, measured.kind, band)
    except InputError:
        if done.interrupted is None:
            raise
        return None


def _write(simulation: "Simulation", asked: dict[str, Any], path: Path, no_figure: bool) -> None:
    """Print the report, and write series, summary and figures."""
    from ident.present.files.document import write_json
    from ident.present.files.simulate import dataset, simulate_document, write_csv, write_netcdf
    from ident.present.text.simulate import simulate_report

    report, document, data = (
        simulate_report(simulation),
        simulate_document(simulation, asked),
        dataset(simulation, asked),
    )
    figures = {}
    if not no_figure:
        from ident.present.figures.simulate import drives_figure, simulate_figure

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


def _check(asked: dict[str, Any], path: Path | None) -> None:
    """Refuse options that do not go together, and numbers that can't be."""
    options.check_positive(asked["tolerance"], "--tolerance")
    options.check_positive(asked["limit"], "--limit")
    moving.check(asked, path)


def _check_time(at: float | None, motion: "Motion") -> None:
    first, last = float(motion.breaks[0]), float(motion.breaks[-1])
    if at is not None and not first <= at <= last:
        remedy = "hold the arm longer (--dwell)" if at > last else "correct it"
        raise InputError(Problem("--at", f"{at:g} s", f"a time from {first:g} to {last:.4g} s", remedy))


def _beside(path: Path, end: str) -> Path:
    return path.parent / f"{path.name}.simulate.{end}"
