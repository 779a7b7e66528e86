"""From a table of runs to the sources of an arm, their certainty, and the prediction of other runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.multibody import IMBALANCE, ExcitingOrder
from ident.errors import InputError, refusal
from ident.measure.runs import Runs
from ident.studies.cause.run_problem import clock_of, posed, problem_of
from ident.studies.cause.trials import Tried
from ident.vibrate.motion import stroke
from ident.vibrate.source_causes import Causes, check_peak, compared
from ident.vibrate.source_identification import (
    Identification,
    clock_offsets,
    explained,
    gain,
    identified,
    least_told,
    with_further,
)
from ident.vibrate.source_problem import Channel, Prior, slow_columns
from ident.vibrate.unit_response import UNITS, Run

RARE = 1e-3
"""Probability of a test below which runs contradict each other; assumed."""
GAINS = (0.5, 1.5)
"""Range of the gain, the share of the computed vibration in the measured one; outside, the model is not that of the
run. Noise alone does not shift the gain; assumed."""
FARTHEST = 4.0
"""Prior standard deviations by which a stiffness, a damping, a clock's rate or a direction may shift; assumed."""
MISSED = 0.2
"""Share of a left-out run's mean square by which its prediction may be wrong beyond noise; assumed."""
RATES = np.linspace(-5e-3, 5e-3, 21)
"""Relative clock errors tried if a left-out run is not predicted; assumed."""
FURTHER = (5.0, 7.0, 10.0, 14.0, 20.0)
"""Speeds [%] of the runs that are tried if some source is not determined; assumed."""
TESTED = 100
"""Draws for the prediction of a run."""


@dataclass(frozen=True)
class Prediction:
    """A left-out run with its prediction.

    Attributes:
        run: its name.
        channel: its sensor channel.
        shown: (T,) [SI] measured, without the slow part.
        computed: (T,) [SI] predicted, without the slow part.
        peaks: (D,) [SI] largest magnitude with each of some draws of the sources, all else at the estimate.
        noise: [SI^2] mean square that the used runs leave unexplained, at most.
        rate: relative clock error with which the run would be predicted; 0 for none.
    """

    run: str
    channel: Channel
    shown: Float[np.ndarray, "T"]
    computed: Float[np.ndarray, "T"]
    peaks: Float[np.ndarray, "D"]
    noise: float = 0.0
    rate: float = 0.0

    @property
    def missed(self) -> float:
        """Share of the measured mean square by which the prediction is wrong, beyond noise."""
        return float((np.mean((self.shown - self.computed) ** 2) - self.noise) / np.mean(self.shown**2))

    @property
    def explained(self) -> float:
        """See `source_identification.explained`."""
        return explained(self.shown, self.computed)

    @property
    def gain(self) -> float:
        """See `source_identification.gain`."""
        return gain(self.shown, self.computed)

    @property
    def ratio(self) -> float:
        """Ratio of predicted to measured root mean square."""
        return float(np.linalg.norm(self.computed) / np.linalg.norm(self.shown))


@dataclass(frozen=True)
class SourceStudy:
    """The sources of an arm, and the prediction of left-out runs.

    Attributes:
        found: the identified numbers.
        held: predictions of the left-out runs.
        known: whether stiffnesses come from a posterior.
        further: standard deviations [units] of the sources' amplitudes with a further run, by its speed [%]; empty if
            all are determined, or the arm has no stroke.
        causes: possible causes of the queried peak.
    """

    found: Identification
    held: tuple[Prediction, ...]
    known: bool
    further: Mapping[float, Float[np.ndarray, "S"]] = field(default_factory=dict)
    causes: Causes | None = None

    @property
    def next_run(self) -> tuple[float, list[ExcitingOrder]]:
        """Speed [%] of the most informative further run, and the sources that it would determine; 0 for none."""
        hidden = [(k, each) for k, each in enumerate(self.found.estimates) if not each.told]

        def told(speed: float) -> list[ExcitingOrder]:
            return [each.source for k, each in hidden if each.amplitude > least_told(self.further[speed][k])]

        def worth(speed: float) -> tuple[int, float]:
            return len(told(speed)), -sum(float(self.further[speed][k]) / each.amplitude for k, each in hidden)

        best = max(self.further, key=worth, default=0.0)
        return (best, told(best)) if best and told(best) else (0.0, [])

    def tried(self, count: int = TESTED, seed: int = 0) -> list[Tried]:
        """Return the effects of masses that were added for runs, with draws."""
        problem, factors = self.found.problem, self.found.place.factors @ (1, 1j)
        if not problem.trials:
            return []
        drawn, every = self.found.factors(count, seed) @ (1, 1j), list[Tried]()
        for k, trial in enumerate(problem.trials):
            drive = problem.sources[trial.source].drive
            stated = complex(*trial.parts) * problem.masses[drive] * UNITS[IMBALANCE]
            every.append(Tried(problem.runs[trial.run].name, drive, stated, complex(factors[k]), drawn[:, k]))
        return every

    @property
    def told(self) -> int:
        """Number of sources that the runs determine."""
        return sum(each.told for each in self.found.estimates)

    @property
    def moved(self) -> dict[str, float]:
        """Numbers that the runs shift by more than `FARTHEST` prior standard deviations."""
        return {name: shift for name, shift in self.found.moved.items() if abs(shift) > FARTHEST}

    @property
    def contradicting(self) -> list[ExcitingOrder]:
        """Sources for which the single runs give contradicting estimates."""
        pairs = zip(self.found.problem.sources, self.found.agreement.tolist(), strict=True)
        return [source for source, chance in pairs if chance < RARE / len(self.found.problem.sources)]

    @property
    def poor(self) -> dict[str, float]:
        """Gains of the channels that do not follow the computed vibration, by name."""
        pairs = zip([channel.name for channel in self.found.problem.channels], self.found.gain.tolist(), strict=True)
        return {name: share for name, share in pairs if not GAINS[0] < share < GAINS[1]}

    @property
    def astray(self) -> tuple[Prediction, ...]:
        """Left-out traces with a failed prediction."""
        return tuple(each for each in self.held if each.missed > MISSED)

    @property
    def doubtful(self) -> bool:
        """Whether the runs contradict each other or the model, or their result fails to predict another run."""
        return bool(self.moved or self.contradicting or self.poor or self.astray)

    @property
    def usable(self) -> bool:
        """Whether its estimates may be used."""
        return self.found.settled and not self.doubtful


def studied(
    arm: Arm,
    table: Runs,
    draws: Mapping[str, Float[np.ndarray, "D"]],
    *,
    offset: float,
    hold_out: Sequence[str] = (),
    peak: float | None = None,
    teeth: Mapping[str, float] | None = None,
    calibration: float = 0.0,
    progress: Any = iter,
) -> SourceStudy:
    """Identify the sources of an arm from a table of runs, and predict the left-out ones.

    Args:
        arm: the arm.
        table: the runs.
        draws: of its stiffnesses, by path; empty without a posterior.
        offset: [s] largest clock error.
        hold_out: files of the runs to predict.
        peak: frequency [Hz] of a peak whose cause is to be found.
        teeth: of the belts' driving pulleys, by the belt's name.
        calibration: standard deviation of the relative error of each sensor's calibration.
        progress: shows the progress of the search.

    Raises:
        InputError: a run that is missing, does not match the arm, or has too few turns; clocks beyond the offset.
    """
    for name in hold_out:
        if name not in table.names:
            raise refusal("hold_out", name, f"one of {', '.join(table.names)}", "correct it")
    used = [name for name in table.names if name not in hold_out]
    if not used:
        raise refusal("hold_out", "all runs held out", "at least one to identify with", "keep one")
    for name in hold_out:
        _same_group(table, name, used)
    prior = Prior.of(arm, draws)
    problem = replace(posed(arm, table, used, prior, offset=offset), calibration=calibration)
    for name in hold_out:
        problem_of(arm, table, [name], prior, offset)
    if peak is not None or teeth:
        check_peak(problem, peak, teeth or {})
    found = identified(problem, progress)
    for run, (clock, _) in zip(problem.runs, found.place.clock.tolist(), strict=True):
        if abs(clock) > offset * (1 - 1e-9):
            raise _late(run.name, clock, offset)
    if not SourceStudy(found, (), True).usable:
        _refuse_late(arm, table, used, offset)
    held = [prediction for name in hold_out for prediction in _predicted(found, table, name, used)]
    known = all(path in draws for path in stiffness_paths(arm))
    first, rate, further = problem.runs[0], min(channel.rate for channel in problem.channels), dict[float, Run]()
    if arm.stroke is not None:
        further = {speed: replace(first, motion=stroke(arm.stroke, percent=speed, dwell=1.0)) for speed in FURTHER}
    hidden = not all(each.told for each in found.estimates)
    tells = {speed: with_further(found, run, rate) for speed, run in further.items()} if hidden else {}
    causes = None
    if peak is not None:
        causes = compared(problem, found.place, found.covariance, peak, teeth=teeth, further=further)
    return SourceStudy(found, tuple(held), known, tells, causes)


def _refuse_late(arm: Arm, table: Runs, names: Sequence[str], offset: float) -> None:
    """Refuse a run if its trace shows a clock beyond the offset, though the table states its delay."""
    for name in (name for name in names if table.of(name)[0].row.delay is not None):
        try:
            clock = clock_of(arm, table, name)
        except InputError:  # its trace does not show it
            continue
        if abs(clock.offset) > offset:
            raise _late(name, clock.offset, offset)


def _late(name: str, clock: float, offset: float) -> InputError:
    got, remedy = f"a clock {1e3 * clock:.0f} ms off the motion's", "check delay and speed, or allow more (`offset`)"
    return refusal(name, got, f"at most {1e3 * offset:.0f} ms", remedy)


def _same_group(table: Runs, name: str, used: Sequence[str]) -> str:
    """Return a used run of the phase group of a left-out one: else its pulleys' phases are unknown."""
    row = table.of(name)[0].row
    same = [other for other in used if row.group and table.of(other)[0].row.group == row.group]
    if not same:
        got = f"a run of group {row.group}" if row.group else "a run of no group"
        remedy = "give it the group of a run that is used: its pulleys' phases are not known else"
        raise refusal(row.where, got, "that of a run which is used", remedy, "group")
    return same[0]


def _predicted(found: Identification, table: Runs, name: str, used: Sequence[str]) -> "list[Prediction]":
    """Return computed and measured channels of a left-out run, with only its clock fitted."""
    known = found.problem
    group = known.groups[list(used).index(_same_group(table, name, used))]
    own = replace(problem_of(known.arm, table, [name], known.prior, known.offset), calibration=known.calibration)
    place = own.start._replace(changes=found.place.changes, parts=found.place.parts[group][None])
    if known.calibration:
        of_sensor = dict(zip(known.measuring, found.place.calibration[list(known.sensors)], strict=True))
        for k, sensor in zip(own.sensors, own.measuring, strict=True):
            place.calibration[k] = of_sensor.get(sensor, 0.0)
    responses, parts = own.responses(place), own.parts_of(0, place)
    place = place._replace(clock=clock_offsets(own, responses, place, parts.ravel())[0])
    places = [place._replace(parts=each.parts[group][None]) for each in found.places(TESTED)]
    drawn = np.stack([own.parts_of(0, each).ravel() for each in places], 1)
    left = {sensor: np.mean(r**2) for sensor, r in zip(known.measuring, found.residual, strict=True)}
    result = []
    for k, channel in enumerate(own.channels):
        slow = slow_columns(channel)
        sure, columns, _ = own.seen(k, responses[0], place)
        every = np.column_stack([channel.values, sure + columns @ parts.ravel(), sure[:, None] + columns @ drawn])
        rest = every - slow @ (slow.T @ every)
        noise = float(left.get(own.measuring[k], max(left.values())))
        result.append(Prediction(name, channel, rest[:, 0], rest[:, 1], np.abs(rest[:, 2:]).max(0), noise))
    if not any(each.missed > MISSED for each in result):
        return result
    further = replace(own, offset=own.offset + RATES[-1] * float(own.runs[0].motion.breaks[-1]) / 2)

    def left_with(rate: float) -> float:
        tried = place._replace(clock=np.array([[0.0, rate]]))
        return float(clock_offsets(further, responses, tried, parts.ravel())[1][0])

    rate = min(RATES.tolist(), key=left_with)
    return [replace(each, rate=rate) for each in result] if left_with(rate) < left_with(0.0) / 2 else result
