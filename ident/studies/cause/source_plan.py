"""What planned runs would determine about the sources of an arm, from the model alone, and the best further run.

Noise is white, a share of each trace's peak, in further runs of the largest peak among traces of the first one's
kind; the sources are those of the arm. Sensors of further runs measure what the first trace measures: displacement,
velocity or acceleration. Further runs are ranked by the information that they add on all sources, 1/2 ln of the ratio
of the determinants of the covariance before and after.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ident.arm.multibody import ExcitingOrder
from ident.description.file import ArmFile
from ident.errors import refusal
from ident.measure.runs import Runs, planned_runs
from ident.studies import module_of
from ident.studies.cause.run_problem import CLOCK, posed, unmeasured
from ident.studies.cause.source_study import FURTHER
from ident.studies.options import Options
from ident.studies.result import Result
from ident.vibrate.motion import stroke
from ident.vibrate.source_identification import (
    amplitude_sd,
    further_run,
    least_told,
    noisy_columns,
    shared_information,
    shared_unknowns,
)
from ident.vibrate.source_problem import Place, Prior, SourceProblem
from ident.vibrate.unit_response import Run, Sensor, unit_of

RATE = 100.0
"""Sampling rate [Hz]: twelve samples per period at 8 Hz; assumed."""
WAYS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Candidate directions in the base frame."""
PARTS = ("whole stroke", "folded half", "unfolded half")
"""Candidate ranges of posture."""


@dataclass(frozen=True)
class FurtherRun:
    """A possible run with one sensor, in the first run's phase group, with the noise of the planned runs.

    Attributes:
        speed: [%] of full speed.
        part: of the stroke, one of `PARTS`.
        point: of the arm.
        direction: of the base.
        gain: [nat] information that it adds.
        sd: (S,) [units] of the sources after this run.
    """

    speed: float
    part: str
    point: str
    direction: str
    gain: float
    sd: Float[np.ndarray, "S"]


@dataclass(frozen=True)
class RunPlan:
    """What planned runs would determine.

    Attributes:
        problem: the runs.
        noise: share of each trace's peak.
        amplitude: (S,) [units] of the sources, as the arm has them; 0 where its file has none.
        sd: (S,) [units] after the runs.
        further: further runs, the most informative first.
    """

    problem: SourceProblem
    noise: float
    amplitude: Float[np.ndarray, "S"]
    sd: Float[np.ndarray, "S"]
    further: tuple[FurtherRun, ...]

    @cached_property
    def least(self) -> Float[np.ndarray, "S"]:
        """Least detectable amplitude [units]: twice the half-width of a 95 % interval."""
        return np.asarray(least_told(self.sd))

    @property
    def told(self) -> "list[ExcitingOrder]":
        """Sources of the arm that the runs determine."""
        pairs = zip(self.problem.sources, self.amplitude > self.least, strict=True)
        return [source for source, told in pairs if told]

    @property
    def sized(self) -> int:
        """Number of sources with an amplitude in the arm file."""
        return int((self.amplitude > 0).sum())

    def also(self, run: FurtherRun) -> "list[ExcitingOrder]":
        """Return the sources that are determined only with a further run."""
        more = (self.amplitude > least_told(run.sd)) & ~(self.amplitude > self.least)
        return [source for source, told in zip(self.problem.sources, more, strict=True) if told]


class RunPlanResult(Result):
    """What planned runs of the moving arm would determine about its drives, and which further run would add most.

    The table has a row for each source: amplitude in the arm file, standard deviation, least detectable amplitude [SI].
    There is no figure.

    Attributes:
        arm: the arm as in its file.
        plan: what the runs would determine.
        runs: the table of runs.
        options: the options of the call.
    """

    arm: ArmFile
    plan: RunPlan
    runs: Runs
    options: Options

    form = "ident-plan/10"
    subject = "runs.name"
    shown, drawn = ("plan",), ()
    made_from = ("arm", "runs")

    def _present(self, part: str, what: str) -> Any:
        return getattr(module_of("source", part), f"run_plan_{what}")(self.plan)


def planned(file: ArmFile, runs: Runs | str | Path, options: Options, *, noise: float, progress: Any) -> RunPlanResult:
    """Compute what runs would determine, and which further run would add most.

    Args:
        file: the arm; its stiffnesses count as known to 10 %, damping to a factor of two.
        runs: the table of runs, or its file.
        options: those of the plan.
        noise: share of each trace's peak.
        progress: shows progress over further runs.

    Raises:
        InputError: see `source.posed`; no source of the arm excites a run.
        ModelError: the arm collapses.
    """
    arm, table = file.arm, runs if isinstance(runs, Runs) else planned_runs(runs)
    problem = posed(arm, unmeasured(arm, table, RATE), prior=Prior.of(arm, {}), offset=CLOCK)
    place = _as_it_is(problem)
    precision, own_noise = problem.priors[0].copy(), _noise(problem, place, noise)
    for each in noisy_columns(problem, place, own_noise):
        precision += each.T @ each
    covariance, groups = np.linalg.inv(precision), place.parts.shape[0]
    first, size = sum(part.size for part in place[:-1]), place.parts[0].size
    ends = [first + group * size for group in range(groups)]
    sd = np.stack([amplitude_sd(covariance[end : end + size, end : end + size], place.parts[0]) for end in ends])
    kinds = [problem.runs[each.run].sensors[each.sensor].derivative for each in problem.channels]
    further_noise = max(each for each, kind in zip(own_noise, kinds, strict=True) if kind == kinds[0])
    found = _further(problem, place, covariance, sd, further_noise, progress("further runs"))
    further = sorted(found, key=lambda each: -each.gain)
    pooled = np.square(1 / sd).sum(0) ** -0.5
    plan = RunPlan(problem, noise, np.hypot(*place.parts[0].T), pooled, tuple(further))
    return RunPlanResult(file, plan, table, options)


def _further(
    problem: SourceProblem,
    place: Place,
    covariance: Float[np.ndarray, "P P"],
    sd: Float[np.ndarray, "groups S"],
    noise: float,
    progress: Any,
) -> Iterator[FurtherRun]:
    """Yield what one more run with each sensor would add, given the covariance of all unknowns after these runs.

    Args:
        problem: the runs.
        place: the point of linearisation.
        covariance: of all unknowns after the runs.
        sd: of each source's amplitude, by phase group.
        noise: of a further channel [SI].
        progress: shows progress.
    """
    known, count = shared_unknowns(place), place.changes.size
    shared = covariance[np.ix_(known, known)]
    before = np.linalg.inv(shared)
    others = np.square(1 / sd[1:]).sum(0)  # phase groups without this run
    for run, label in progress(list(_candidates(problem))):
        alone = further_run(problem, run, range(len(run.sensors)), RATE)
        here = alone.start._replace(parts=place.parts[:1])
        columns = noisy_columns(alone, here, [noise] * len(run.sensors))
        for sensor, own in zip(run.sensors, columns, strict=True):
            after = np.linalg.inv(before + shared_information(alone, [own]))[count:, count:]
            dets = [np.linalg.slogdet(each)[1] for each in (shared[count:, count:], after)]
            name = next(name for name, way in WAYS.items() if way == sensor.direction)
            more = (1 / np.square(amplitude_sd(after, place.parts[0])) + others) ** -0.5
            yield FurtherRun(label[0], label[1], sensor.point, name, (dets[0] - dets[1]) / 2, more)


def _as_it_is(problem: SourceProblem) -> Place:
    """Return the point with the sources of the arm."""
    arm = problem.arm
    sizes = np.array([float(arm.get(each.amplitude)) / unit_of(each) for each in problem.sources])
    for k, source in enumerate(problem.sources):
        if not source.of_error and float(arm.get(f"{source.drive}.eccentric_mass")) == 0:
            sizes[k] = 0.0
    phases = np.array([float(arm.get(each.phase)) for each in problem.sources])
    parts = sizes[:, None] * np.stack([np.cos(phases), np.sin(phases)], 1)
    return problem.start._replace(parts=np.tile(parts, (max(problem.groups) + 1, 1, 1)))


def _noise(problem: SourceProblem, place: Place, share: float) -> list[float]:
    """Return the noise [SI] of each channel."""
    responses, peaks = problem.responses(place), []
    for k, channel in enumerate(problem.channels):
        _, columns, _ = problem.seen(k, responses[channel.run], place)
        peaks.append(float(np.abs(columns @ problem.parts_of(channel.run, place).ravel()).max()))
    if not max(peaks) > 0:
        remedy = "give it drives with an eccentricity or an error"
        raise refusal(problem.arm.name, "nothing that excites a run", "imbalances or transmission errors", remedy)
    return [share * (peak or max(peaks)) for peak in peaks]  # a sensor across all motion has no information


def _candidates(problem: SourceProblem) -> Iterator[tuple[Run, tuple[float, str]]]:
    """Yield possible runs, each with sensors at all points in all directions."""
    path, first = problem.arm.stroke, problem.runs[0]
    if path is None:
        return
    derivative = first.sensors[0].derivative
    sensors = tuple(Sensor(p.name, way, False, derivative) for p in problem.arm.points for way in WAYS.values())
    middle = (path.folded + path.unfolded) / 2
    parts = {
        "whole stroke": path,
        "folded half": eqx.tree_at(lambda s: s.unfolded, path, middle),
        "unfolded half": eqx.tree_at(lambda s: s.folded, path, middle),
    }
    for name in PARTS:
        for speed in FURTHER:
            yield replace(first, motion=stroke(parts[name], percent=speed, dwell=1.0), sensors=sensors), (speed, name)
