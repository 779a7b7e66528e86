"""Which change meets the limit: torsional stiffness first, mass centres second, both, or another speed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ident.assess.keeping import keeping
from ident.assess.task import CONFIDENT, RATE, Task
from ident.assess.vibration import exact_response, likely_excitation
from ident.vibrate.redesign.binomial import BinomialEstimate
from ident.vibrate.redesign.constraints import Requirements
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.objective import Point
from ident.vibrate.redesign.search import Effort, Search
from ident.vibrate.redesign.side_by_side import side_by_side
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.redesign.worst_case import settled, with_cut
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.response import peak

KINDS = ("torsion", "mass centre", "both", "speed")
"""Kinds of remedies in the paper's order; what it does not speak of comes last."""
FULL = 100.0
"""Speed [%] above which none is advised."""
CANDIDATES = 10
"""Values of a single number that are assessed by draws, at most."""
VERIFIED = 3
"""Remedies that are verified at most, until one is."""


@dataclass(frozen=True)
class Remedy:
    """A change and what comes of it.

    Attributes:
        kind: `torsion`, `mass centre`, `both` or `speed`.
        values: the numbers after the change, by path [SI]; none for another speed.
        before: the same numbers as they are.
        percent: [%] speed after the change.
        percent_before: [%] speed as it is.
        amplitude: (3,) [m] expected: of the arm itself, with the excitation of the task.
        keeps: probability that the limit is kept.
        frequency: [Hz] first natural frequency, the lower of both ends of the motion.
        deflection: [m] static deflection, the larger of both ends.
        change_norm: [-] size of the change, see `design.Place`; of speed, in powers of two.
    """

    kind: str
    values: dict[str, float]
    before: dict[str, float]
    percent: float
    percent_before: float
    amplitude: Float[np.ndarray, "3"]
    keeps: BinomialEstimate
    frequency: float
    deflection: float
    change_norm: float

    @property
    def meets_limit(self) -> bool:
        """Whether the limit is kept with confidence."""
        return self.keeps.share >= CONFIDENT

    @property
    def largest(self) -> float:
        """Largest expected amplitude of the three directions [m]."""
        return float(self.amplitude.max())


@dataclass(frozen=True)
class Verification:
    """A remedy by the exact equations, and by draws that it was not chosen by.

    Attributes:
        amplitude: (3,) [m] by the exact equations, with an excitation as of `at_confidence`.
        keeps: probability of keeping the limit by fresh draws.
        limit: [m]
    """

    amplitude: Float[np.ndarray, "3"]
    keeps: BinomialEstimate
    limit: float

    @property
    def largest(self) -> float:
        """Largest amplitude of the three directions [m]."""
        return float(self.amplitude.max())

    @property
    def holds(self) -> bool:
        """Whether the limit is kept by both, with confidence."""
        return self.largest <= self.limit and self.keeps.share >= CONFIDENT


def remedies(task: Task, scatter: float, progress: Progress = iter) -> tuple[Remedy, ...]:
    """Return what can be done, the best first: what meets the limit with the least change, then what helps most.

    A single number takes the least change that meets the limit for most draws. Several together aim at the limit
    divided by the scatter of the draws, so that most of them keep it. Where that is out of reach, it is the least
    amplitude.

    Args:
        task: what is asked.
        scatter: factor from the amplitude of the arm itself to the 95 % quantile of its draws.
        progress: shows how far it is, over the remedies.
    """
    jobs = list(_jobs(task, task.limit / max(scatter, 1.0)))
    return tuple(sorted(side_by_side(jobs, progress), key=_rank))


def _jobs(task: Task, aim: float) -> Iterator[Callable[[], Remedy]]:
    """Yield what computes each remedy, the longest first."""
    groups = {"torsion": task.torsion, "mass centre": task.centres, "both": (*task.torsion, *task.centres)}
    for kind, variables in groups.items():
        if len(variables) > 1 and (kind != "both" or task.centres):
            yield partial(_together, task, variables, kind, aim)
    yield partial(_slower_or_faster, task)
    single = [(v, "torsion") for v in task.torsion] + [(v, "mass centre") for v in task.centres]
    for variable, kind in single:
        yield partial(_alone, task, variable, kind)


def _rank(remedy: Remedy) -> tuple[bool, int, float]:
    """Sort what meets the limit by the paper's order and the change norm, then what does not by its amplitude."""
    if remedy.meets_limit:
        return False, KINDS.index(remedy.kind), remedy.change_norm
    return True, 0, remedy.largest


def _alone(task: Task, variable: Variable, kind: str) -> Remedy:
    """Try values of one number: return the least change that meets the limit, else that of the least amplitude."""
    changes = np.linspace(*variable.span(task.basis.arm), task.effort.values)[:, None]
    amplitude = task.evaluator(variable).amplitudes(changes)[:, :, 0].max(0)
    size = np.abs(changes[:, 0]) / np.abs(changes).max()
    evaluator = task.evaluator(variable, draws=task.assessment_draws)
    return _least(
        size, amplitude, task.limit, lambda k: _remedy(task, evaluator, kind, changes[k], change_norm=float(size[k]))
    )


def _least(
    size: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"], limit: float, remedy: Callable[[int], Remedy]
) -> Remedy:
    """Return the remedy of the least size that meets the limit, else that of the least amplitude."""
    good = np.flatnonzero(amplitude <= limit)
    tried: dict[int, Remedy] = {}
    for place in good[np.argsort(size[good], kind="stable")][:CANDIDATES].tolist():
        tried[place] = remedy(place)
        if tried[place].meets_limit:
            return tried[place]
    quietest = int(np.argmin(amplitude))
    return tried.get(quietest) or remedy(quietest)


def _together(task: Task, variables: Sequence[Variable], kind: str, aim: float) -> Remedy:
    """Take the least change of several numbers that reaches the aim, or the least amplitude; from two starts."""
    effort = Effort(task.effort.screened, task.effort.iterations)
    oracle = partial(_likely, task)
    search, _ = oracle(Search(task.evaluator(*variables), Requirements(), effort), np.zeros(len(variables)))
    starts, objective = search.starts(2, seed=0), search.objective
    quiet: list[Point] = []
    near = starts
    if min(map(objective.largest, starts)) > aim:  # out of reach, it seems: the least amplitude tells
        quiet = [u for start in starts if (u := search.minimum_amplitude(start)) is not None]
        near = [u for u in quiet if objective.largest(u) <= aim]

    def change(search: Search, start: Point) -> Point | None:
        return search.minimum_change(start, aim)

    ends = [settled(search, change, change(search, start), oracle) for start in near]
    reached = [u for _, u, _ in ends if u is not None]
    if reached:
        best = min(reached, key=objective.change_norm)
    else:
        quiet = quiet or [u for start in near if (u := search.minimum_amplitude(start)) is not None]
        best = min([0 * objective.scale, *starts, *quiet], key=objective.largest)
    evaluator = task.evaluator(*variables, draws=task.assessment_draws)
    return _remedy(task, evaluator, kind, best * objective.scale, change_norm=objective.change_norm(best))


def _likely(task: Task, search: Search, u: Point) -> tuple[Search, float]:
    """Return a search that sees the excitation that is likely at a place as well, and the amplitude with it [m]."""
    evaluator, change = search.objective.evaluator, u * search.objective.scale
    excitation = likely_excitation(task.over_phases(evaluator), task.basis.unknown, change)
    if not excitation:
        return search, 0.0
    excited = replace(evaluator, arm=evaluator.arm.replace(excitation))
    return with_cut(search, excitation), float(excited.amplitudes(change[None]).max())


def _slower_or_faster(task: Task) -> Remedy:
    """Return the speed nearest to the present one that meets the limit, else that of the least amplitude."""
    ratios = np.unique([ratio for ratio in task.effort.speeds if ratio != 1])
    ratios = ratios[ratios * task.basis.percent <= max(FULL, task.basis.percent)]
    evaluators = [_at_speed(task, ratio, ratio / ratios[0]) for ratio in ratios]
    amplitude = np.array([each.alone.amplitudes(np.zeros((1, 0))).max() for each in evaluators])
    size = np.abs(np.log2(ratios))
    return _least(
        size,
        amplitude,
        task.limit,
        lambda k: _remedy(task, evaluators[k], "speed", np.zeros(0), ratio=ratios[k], change_norm=float(size[k])),
    )


def _at_speed(task: Task, ratio: float, clock: float) -> Evaluator:
    """Return what simulates at another speed, with as many samples and steps as where the clock is 1."""
    evaluator = task.evaluator(draws=task.assessment_draws)
    moved = task.basis.motion.at_speed(100 * ratio)
    return replace(evaluator, motion=moved, rate=RATE * clock, step=task.step / clock)


def _remedy(
    task: Task,
    evaluator: Evaluator,
    kind: str,
    changes: Float[np.ndarray, "V"],
    *,
    change_norm: float,
    ratio: float = 1.0,
) -> Remedy:
    """Assess a change by the draws."""
    amplitude, keeps = keeping(evaluator, changes, task.limit)
    end_state = evaluator.end_states(changes[None])
    values = evaluator.values(changes)
    return Remedy(
        kind,
        values,
        {path: float(task.basis.arm.get(path)) for path in values},
        float(ratio * task.basis.percent),
        task.basis.percent,
        amplitude,
        keeps,
        float(end_state.frequency[0]),
        float(end_state.deflection[0]),
        change_norm,
    )


def verify_in_turn(
    ranked: Sequence[Remedy], verify: Callable[[Remedy], Verification], count: int = VERIFIED
) -> tuple[Verification, ...]:
    """Verify the first remedy, and those that follow as long as they should meet the limit and none holds.

    Args:
        ranked: the best first.
        verify: verifies one.
        count: remedies that are verified, at most.
    """
    verifications: list[Verification] = []
    for remedy in ranked[:count]:
        if verifications and (verifications[-1].holds or not remedy.meets_limit):
            break
        verifications.append(verify(remedy))
    return tuple(verifications)


def verify_remedy(task: Task, remedy: Remedy, progress: Progress = iter) -> Verification:
    """Simulate a remedy exactly, and with draws that it was not chosen by."""
    ratio = remedy.percent / task.basis.percent
    motion = task.basis.motion.at_speed(100 * ratio)
    variables = tuple(Variable((path,), value, value) for path, value in remedy.values.items())
    evaluator = task.evaluator(*variables, draws=task.fresh_draws)
    evaluator = replace(evaluator, motion=motion, step=task.step / max(ratio, 1.0))
    changes = np.array([float(variable.change(task.basis.arm, variable.low)) for variable in variables])
    excitation = likely_excitation(task.over_phases(evaluator), task.basis.unknown, changes)
    response = exact_response(replace(evaluator, arm=evaluator.changed_arm(changes).replace(excitation)))
    _, keeps = keeping(evaluator, changes, task.limit, progress)
    return Verification(np.asarray(peak(response.vibration)), keeps, task.limit)
