"""Simulate the vibration of the end point while the arm carries out a motion."""

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import Problem, refusal, require
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import HeldMotionOptions, basis_of
from ident.studies.options import option, seed_of_draws
from ident.studies.result import Progress, Result, alias, silent
from ident.text import one_line

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log, Trace
    from ident.studies.scenario import Basis
    from ident.studies.working.simulation import Simulation
    from ident.vibrate.clock import Clock
    from ident.vibrate.response import Outline
    from ident.vibrate.study import Draws


class SimulateOptions(HeldMotionOptions):
    """Options of `ident.simulate`: the motion, the method, and the reported sizes of the vibration."""

    draws: int = option(200, "draws of the posterior", low=1, high=100_000)
    seed: int | None = seed_of_draws()
    elastic_belts: bool = option(False, "belts stretch: k_tors without them, which one from a hammer test has in it")
    method: str | None = option(
        None, "fast, exact or both (default; with --posterior: fast)", choices=("fast", "exact", "both")
    )
    rate: float = option(500.0, "samples a second", low=1.0, high=1e6)
    step: float | None = option(None, "longest time step [s] of method fast; default: as the arm needs", above=0.0)
    band: tuple[float, float] = option(
        (4.0, 8.0), "band LOW:HIGH [Hz] in which the strongest frequency is compared", read=reading.band, text="4:8"
    )
    settled: float = option(0.1, "vibration [mm] below which the end has settled once it stays there", above=0.0)
    at: float | None = option(None, "time [s] from which on a further peak is reported, as 4")
    limit: float | None = option(None, "peak [mm] that should not be exceeded", above=0.0)
    find_clock: bool = option(False, "find offset and rate of the clock of --trace, instead of taking the motion's")

    def problems(self) -> list[Problem]:
        """Refuse a step for a method that chooses its own."""
        misplaced = Problem("step", "it with another method", "the method fast", "choose that (`method`)")
        return [*super().problems(), *([misplaced] if self.step and self.method != "fast" else [])]


class SimulateResult(Result):
    """A simulated motion of an arm.

    The table has a row for each direction: peak and its time, rms, residual, time until settled [m, s].

    Attributes:
        simulation: basis, response, draws, and the compared trace.
        options: the options of the call.
        arm: the simulated arm.
        time: times [s].
        vibration: displacement of the end point from its quasi-static position, in x, y and z of the base frame [m].
        arrival: arrival time of the arm [s]; from then on it is held.
        posture: commanded joint angles [rad].
        path: position of the end point with rigid joints, in the base frame [m].
        peak: largest magnitude of the vibration in x, y and z [m].
        draws: the vibration by the draws of a posterior; None without one.
    """

    simulation: "Simulation"
    options: SimulateOptions = field(default_factory=SimulateOptions)

    subject = "simulation.basis.name"
    made_from = ("simulation.basis.sources", "simulation.trace")
    numbers = ("vibration",)
    summarised = ("arrival", "exceedance")

    arm: ClassVar["Arm"] = alias("simulation.arm")
    time: ClassVar['Float[np.ndarray, "T"]'] = alias("simulation.time")
    vibration: ClassVar['Float[np.ndarray, "3 T"]'] = alias("simulation.vibration")
    arrival: ClassVar[float] = alias("simulation.response.motion.arrival")
    posture: ClassVar['Float[np.ndarray, "driven T"]'] = alias("simulation.posture")
    path: ClassVar['Float[np.ndarray, "3 T"]'] = alias("simulation.path")
    peak: ClassVar['Float[np.ndarray, "3"]'] = alias("simulation.sizes.peak")
    draws: ClassVar["Draws | None"] = alias("simulation.draws")

    @property
    def pulleys(self) -> "Mapping[str, Float[np.ndarray, 'T']]":
        """Turning frequencies of the drives' pulleys, counted positive, by the drive's name [Hz]."""
        return {name: frequency for name, (_, frequency) in self.simulation.pulleys.items()}

    @property
    def exceedance(self) -> float | None:
        """Share of the draws [-] whose peak exceeds the limit in any direction; None without draws or limit."""
        draws, limit = self.simulation.draws, self.simulation.limit
        return None if draws is None or limit is None else float(draws.exceeds(limit)[1])

    def _figures(self) -> "dict[str, Figure]":
        """Return two figures: vibration of the end point; joints, belts and pulleys (`drives`)."""
        from ident.studies.working.simulate_figure import drives_figure, simulate_figure

        return {"": simulate_figure(self.simulation), "drives": drives_figure(self.simulation)}

    def path_figure(self, times: Sequence[float], *, factor: float = 100.0) -> "Figure":
        """Draw the path of the end point, and the arm at some times [s], from the side and from above.

        Args:
            times: [s] at which the arm is drawn.
            factor: exaggeration of the vibration.
        """
        from ident.studies.working.path_figure import path_figure

        return path_figure(self.simulation.response, self._outline(times, factor))

    def animation(self, times: Sequence[float], *, factor: float = 100.0, fps: float = 10.0) -> "FuncAnimation":
        """Animate the arm at equally spaced times [s], as in `path_figure`, with `fps` frames per second."""
        from ident.studies.working.path_figure import motion_animation

        return motion_animation(self.simulation.response, self._outline(times, factor), fps=fps)

    def _outline(self, times: Sequence[float], factor: float) -> "Outline":
        from ident.vibrate.response import outline

        return outline(self.arm, self.simulation.response, times, factor=factor, loads=self.simulation.basis.loads)

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.report.document import write_netcdf
        from ident.studies.working.simulate_files import simulate_groups, write_csv

        csv, arrays = self._beside(path, ".csv"), self._beside(path, ".nc")
        write_csv(self.simulation, head, csv)
        write_netcdf(arrays, simulate_groups(self.simulation, head))
        return csv, arrays, *super()._write(path, head)


@study
def simulate(
    arm: "ArmFile",
    options: SimulateOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    trace: "Trace | None" = None,
    progress: Progress = silent,
) -> SimulateResult:
    """Simulate the vibration of the end point [m] while the arm carries out a motion.

    Args:
        arm: the arm.
        options: motion, load, method, and the reported sizes of the vibration.
        path: a joint path to follow instead of the stroke: a log, or its file.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws for bands of 5 to 95 %, or the file of `ident sample`; the arm takes their medians unless it
            has fitted values.
        trace: measured vibration to compare with, or its file; on the clock of the motion, unless its own is to be
            found (`find_clock`).
        progress: shows progress over the draws.

    Raises:
        InputError: contradictory options, a file that does not match the arm, a motion that it can't make.
        ModelError: the arm collapses.
    """
    from ident.studies.working.simulation import Simulation, simulated_over_phases
    from ident.vibrate.response import refuse_slack
    from ident.vibrate.study import against, simulate_motion

    basis = basis_of(arm, options, path=path, fit=fit, posterior=posterior)
    _check_time(options.at, basis)
    require(trace or not options.find_clock, "find_clock", "it without a trace", "a measured trace", "give `trace`")
    clock = _clock(basis, trace) if trace and options.find_clock else None
    response, other = simulate_motion(
        basis.arm,
        basis.motion,
        loads=basis.loads,
        method=options.method or ("fast" if posterior else "both"),
        elastic_belts=options.elastic_belts,
        rate=options.rate,
        step=options.step,
    )
    if response.model.elastic and (basis.draws or response.method == "fast"):
        refuse_slack(response, [belt.name for belt in basis.arm.belts])
    simulation = Simulation(
        basis,
        response,
        other,
        options.settled / 1e3,
        options.at,
        None if options.limit is None else options.limit / 1e3,
        _draws(basis, options, progress),
        trace,
        against(response, clock.on_motion(trace.time) if clock else trace.time, trace.values, trace.kind, options.band)
        if trace
        else None,
        simulated_over_phases(basis, options.elastic_belts, options.rate, options.step),
        clock,
    )
    return SimulateResult(simulation, options)


def _draws(basis: "Basis", options: SimulateOptions, progress: Progress) -> "Draws | None":
    """Simulate the motion for the draws of the posterior, if there is one."""
    from ident.vibrate.study import draw, measures

    if not basis.draws:
        return None
    how = partial(measures, settled=options.settled / 1e3, at=options.at)
    return draw(
        basis.arm,
        basis.motion,
        basis.draws,
        loads=basis.loads,
        elastic_belts=options.elastic_belts,
        rate=options.rate,
        measure=how,
        progress=progress("draws"),
    )


def _clock(basis: "Basis", trace: "Trace") -> "Clock":
    """Return the clock of a trace of the end point against that of the motion."""
    from ident.measure.load import AXES
    from ident.vibrate.clock import find_clock
    from ident.vibrate.unit_response import Run, Sensor

    derivative = 2 if trace.kind == "acceleration" else 0
    sensors = tuple(Sensor(basis.point, AXES[name], derivative=derivative) for name in trace.values)
    run = Run(one_line(trace.path), basis.motion, basis.loads, sensors)
    return find_clock(basis.arm, run, [(trace.time, values) for values in trace.values.values()])


def _check_time(at: float | None, basis: "Basis") -> None:
    first, last = float(basis.motion.breaks[0]), float(basis.motion.breaks[-1])
    if at is not None and not first <= at <= last:
        remedy = "hold the arm longer (`dwell`)" if at > last else "correct it"
        raise refusal("at", f"{at:g} s", f"a time from {first:g} to {last:.4g} s", remedy)
