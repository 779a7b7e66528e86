"""Which change meets the limit: torsional stiffness first, mass centres second, both, or another speed."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.fields import SPEED
from ident.assess.task import CONFIDENT, Task
from ident.assess.vibration import exact_response
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.redesign.constraints import Requirements
from ident.vibrate.redesign.evaluator import Draws
from ident.vibrate.redesign.search import Effort, Search
from ident.vibrate.redesign.sweep import Axis, axis, sweep
from ident.vibrate.redesign.variable import Variable
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
        amplitude: (3,) [m] expected: of the arm itself.
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
        amplitude: (3,) [m] by the exact equations.
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
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        pending = [pool.submit(job) for job in jobs]
        computed = [pending[k].result() for k in progress(range(len(jobs)))]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return tuple(sorted(computed, key=_rank))


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
    good = np.flatnonzero(amplitude <= task.limit)
    for place in good[np.argsort(size[good])][:CANDIDATES]:
        remedy = _remedy(task, (variable,), kind, changes[place], float(size[place]))
        if remedy.meets_limit:
            return remedy
    best = np.argmin(amplitude)
    return _remedy(task, (variable,), kind, changes[best], float(size[best]))


def _together(task: Task, variables: Sequence[Variable], kind: str, aim: float) -> Remedy:
    """Take the least change of several numbers that reaches the aim, or the least amplitude; from two starts."""
    effort = Effort(task.effort.screened, task.effort.iterations)
    search = Search(task.evaluator(*variables), Requirements(), effort)
    starts = search.starts(2, seed=0)
    reached = [u for start in starts if (u := search.minimum_change(start, aim)) is not None]
    if reached:
        best = min(reached, key=search.objective.change_norm)
    else:
        quiet = [u for start in starts if (u := search.minimum_amplitude(start)) is not None]
        best = min([*starts, *quiet], key=search.objective.largest)
    return _remedy(task, variables, kind, best * search.objective.scale, search.objective.change_norm(best))


def _remedy(
    task: Task, variables: Sequence[Variable], kind: str, changes: Float[np.ndarray, "V"], change_norm: float
) -> Remedy:
    """Assess a change by the draws."""
    evaluator = task.evaluator(*variables, draws=task.assessment_draws)
    amplitudes = evaluator.amplitudes(changes[None])[:, 0]
    end_state = evaluator.end_states(changes[None])
    values = evaluator.values(changes)
    return Remedy(
        kind,
        values,
        {path: float(task.basis.arm.get(path)) for path in values},
        task.basis.percent,
        task.basis.percent,
        amplitudes[:, 0],
        binomial_estimate(amplitudes[:, 1:].max(0) <= task.limit),
        float(end_state.frequency[0]),
        float(end_state.deflection[0]),
        change_norm,
    )


def _slower_or_faster(task: Task) -> Remedy:
    """Return the speed nearest to the present one that meets the limit, else that of the least amplitude."""
    percents = task.basis.percent * np.asarray(task.effort.speeds)
    speeds = axis(task.basis.arm, [SPEED], percents[percents <= max(FULL, task.basis.percent)], task.basis.percent)
    amplitude, keeps = _at_speeds(task, speeds, task.speed_draws)
    best = _best_speed(speeds, amplitude.max(0), keeps.mean(1) >= CONFIDENT, task.limit)
    _, keeps = _at_speeds(task, replace(speeds, values=speeds.values[best : best + 1]), task.assessment_draws)
    end_state = task.evaluator().end_states(np.zeros((1, 0)))
    return Remedy(
        "speed",
        {},
        {},
        float(speeds.values[best]),
        task.basis.percent,
        amplitude[:, best],
        binomial_estimate(keeps),
        float(end_state.frequency[0]),
        float(end_state.deflection[0]),
        float(abs(np.log(speeds.values[best] / speeds.present)) / np.log(2)),
    )


def _at_speeds(task: Task, speeds: Axis, draws: Draws) -> tuple[Float[np.ndarray, "3 K"], Bool[np.ndarray, "K D"]]:
    """Return the amplitudes of the arm itself [m], and which draws keep the limit."""
    swept = sweep(task.evaluator(draws=draws), [speeds])
    assert swept.draws is not None
    return swept.amplitude, swept.draws.max(0) <= task.limit


def _best_speed(speeds: Axis, amplitude: Float[np.ndarray, "K"], likely: Bool[np.ndarray, "K"], limit: float) -> int:
    ratio = speeds.values / speeds.present
    other = np.abs(ratio - 1) > 1e-9
    good = np.flatnonzero(other & likely & (amplitude <= limit))
    nearest = good[np.argmin(np.abs(np.log(ratio[good])))] if len(good) else None
    return int(np.argmin(np.where(other, amplitude, np.inf)) if nearest is None else nearest)


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
    response = exact_response(task.basis.arm.replace(remedy.values), motion, task.basis.loads)
    variables = tuple(Variable((path,), value, value) for path, value in remedy.values.items())
    evaluator = task.evaluator(*variables, draws=task.fresh_draws)
    evaluator = replace(evaluator, motion=motion, step=task.step / max(ratio, 1.0))
    changes = np.array([float(variable.change(task.basis.arm, variable.low)) for variable in variables])
    amplitudes = evaluator.amplitudes(changes[None], progress)[:, 0, 1:]
    keeps = binomial_estimate(amplitudes.max(0) <= task.limit)
    return Verification(np.asarray(peak(response.vibration)), keeps, task.limit)
