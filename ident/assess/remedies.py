"""Which change cures it: torsional stiffness first, mass centres second, both, or another speed."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.assess.task import CONFIDENT, Task
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate, binomial_from_json, binomial_to_json
from ident.vibrate.redesign.constraints import Requirements
from ident.vibrate.redesign.search import Effort, Search
from ident.vibrate.redesign.sweep import SPEED, axis, sweep
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.simulate import simulate
from ident.vibrate.response.study import measures

SPEEDS = np.linspace(0.5, 1.5, 9)
"""Speeds that are tried, of the present one."""
FEW = 20
"""Draws by which a speed is chosen."""
EFFORT = Effort()
"""Of the search for several numbers together."""
KINDS = ("torsion", "mass centre", "both", "speed")
"""Kinds of remedies in the paper's order; what it does not speak of comes last."""
FULL = 100.0
"""Speed [%] above which none is advised."""
TRIED = 41
"""Values of a single number that are tried: to twice as much in steps of 3.5 %."""
JUDGED = 10
"""Of these, those that are judged by draws, at most."""
PROVED = 3
"""Cures that are tried again at most, until one holds."""


@dataclass(frozen=True)
class Remedy:
    """A change and what comes of it.

    Attributes:
        kind: `torsion`, `mass centre`, `both` or `speed`.
        values: the numbers after the change, by path [SI]; none for another speed.
        before: the same numbers as they are.
        percent: [%] speed.
        amplitude: (3,) [m] expected: of the arm itself.
        keeps: probability that the limit is kept.
        frequency: [Hz] first natural frequency, the lower of both ends of the motion.
        deflection: [m] static deflection, the larger of both ends.
        amount: amount of change, see `design.Place`.
    """

    kind: str
    values: dict[str, float]
    before: dict[str, float]
    percent: float
    amplitude: Float[np.ndarray, "3"]
    keeps: BinomialEstimate
    frequency: float
    deflection: float
    amount: float

    @property
    def cures(self) -> bool:
        """Whether the limit is kept with confidence."""
        return self.keeps.share >= CONFIDENT

    @property
    def largest(self) -> float:
        """Largest expected amplitude of the three directions [m]."""
        return float(self.amplitude.max())


@dataclass(frozen=True)
class Proof:
    """A remedy by the exact equations, and by draws that it was not chosen by.

    Attributes:
        amplitude: (3,) [m] by the exact equations.
        keeps: probability of keeping the limit by fresh draws.
        holds: whether the limit is kept by both, with confidence.
    """

    amplitude: Float[np.ndarray, "3"]
    keeps: BinomialEstimate
    holds: bool


def remedies(task: Task, scatter: float, progress: Progress = iter) -> tuple[Remedy, ...]:
    """Return what can be done, the best first: what cures with the least change, then what helps most.

    A single number takes the least change that cures most draws. Several together aim at the limit divided by the
    scatter of the draws, so that most of them keep it. Where that is out of reach, it is the least amplitude.

    Args:
        task: what is asked.
        scatter: factor from the amplitude of the arm itself to the 95 % quantile of its draws.
        progress: shows how far it is, over the remedies.
    """
    jobs = list(_jobs(task, task.limit / max(scatter, 1.0)))
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        pending = [pool.submit(job) for job in jobs]
        found = [pending[k].result() for k in progress(range(len(jobs)))]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return tuple(sorted(found, key=_rank))


def _jobs(task: Task, aim: float) -> Iterator[Callable[[], Remedy]]:
    """Yield what finds each remedy, the longest first."""
    groups = {"torsion": task.torsion, "mass centre": task.centres, "both": (*task.torsion, *task.centres)}
    for kind, variables in groups.items():
        if len(variables) > 1 and (kind != "both" or task.centres):
            yield partial(_together, task, variables, kind, aim)
    yield partial(_slower_or_faster, task)
    single = [(v, "torsion") for v in task.torsion] + [(v, "mass centre") for v in task.centres]
    for variable, kind in single:
        yield partial(_alone, task, variable, kind)


def _rank(remedy: Remedy) -> tuple[bool, int, float]:
    """Sort what cures by the paper's order and the amount of change, then what does not by its amplitude."""
    if remedy.cures:
        return False, KINDS.index(remedy.kind), remedy.amount
    return True, 0, remedy.largest


def _alone(task: Task, variable: Variable, kind: str) -> Remedy:
    """Try values of one number: return the least change that most draws are cured by, else the quietest."""
    changes = np.linspace(*variable.span(task.arm), TRIED)[:, None]
    amplitude = task.trial(variable).amplitudes(changes)[:, :, 0].max(0)
    size = np.abs(changes[:, 0]) / np.abs(changes).max()
    good = np.flatnonzero(amplitude <= task.limit)
    for place in good[np.argsort(size[good])][:JUDGED]:
        found = _remedy(task, (variable,), kind, changes[place], float(size[place]))
        if found.cures:
            return found
    best = np.argmin(amplitude)
    return _remedy(task, (variable,), kind, changes[best], float(size[best]))


def _together(task: Task, variables: Sequence[Variable], kind: str, aim: float) -> Remedy:
    """Take the least change of several numbers that reaches the aim, or the quietest; from two starts."""
    search = Search(task.trial(*variables), Requirements(), EFFORT)
    begins = search.starts(2, seed=0)
    reached = [found for begin in begins if (found := search.minimum_change(begin, aim)) is not None]
    if reached:
        best = min(reached, key=search.objective.change_norm)
    else:
        quiet = [found for begin in begins if (found := search.minimum_amplitude(begin)) is not None]
        best = min([*begins, *quiet], key=search.objective.largest)
    return _remedy(task, variables, kind, best * search.objective.scale, search.objective.change_norm(best))


def _remedy(
    task: Task, variables: Sequence[Variable], kind: str, changes: Float[np.ndarray, "V"], amount: float
) -> Remedy:
    """Judge a change by the draws."""
    trial = task.trial(*variables, draws=task.seen)
    whole = trial.amplitudes(changes[None])[:, 0]
    stands = trial.end_states(changes[None])
    values = trial.values(changes)
    return Remedy(
        kind,
        values,
        {path: float(task.arm.get(path)) for path in values},
        task.percent,
        whole[:, 0],
        binomial_estimate(whole[:, 1:].max(0) <= task.limit),
        float(stands.frequency[0]),
        float(stands.deflection[0]),
        amount,
    )


def _slower_or_faster(task: Task) -> Remedy:
    """Return the speed nearest to the present one at which the limit is kept, else the quietest."""
    few = {path: values[:FEW] for path, values in task.seen.items()}
    tried = task.percent * SPEEDS
    speeds = axis(task.arm, [SPEED], tried[tried <= max(FULL, task.percent)], task.percent)
    found = sweep(task.trial(draws=few), [speeds])
    assert found.draws is not None
    ratio = speeds.values / speeds.present
    keeps = (found.draws.max(0) <= task.limit).mean(1)
    other = np.abs(ratio - 1) > 1e-9
    good = np.flatnonzero(other & (keeps >= CONFIDENT) & (found.amplitude.max(0) <= task.limit))
    quiet = np.where(other, found.amplitude.max(0), np.inf)
    best = int(good[np.argmin(np.abs(np.log(ratio[good])))] if len(good) else np.argmin(quiet))
    stands = task.trial().end_states(np.zeros((1, 0)))
    amplitude, at = found.amplitude[:, best], float(speeds.values[best])
    judged = sweep(task.trial(draws=task.seen), [replace(speeds, values=speeds.values[best : best + 1])])
    assert judged.draws is not None
    kept = binomial_estimate(judged.draws[:, 0].max(0) <= task.limit)
    change = abs(float(np.log(ratio[best])) / np.log(2))
    frequency, deflection = float(stands.frequency[0]), float(stands.deflection[0])
    return Remedy("speed", {}, {}, at, amplitude, kept, frequency, deflection, change)


def verify_in_turn(task: Task, found: Sequence[Remedy], progress: Progress = iter) -> tuple[Proof, ...]:
    """Prove the first remedy, and those that follow as long as they are said to cure and none has held."""
    proofs: list[Proof] = []
    for remedy in found[:PROVED]:
        if proofs and (proofs[-1].holds or not remedy.cures):
            break
        proofs.append(verify_remedy(task, remedy, progress))
    return tuple(proofs)


def chosen(proofs: Sequence[Proof]) -> int:
    """Return the place of the remedy to be advised: the one that holds, or else the first."""
    return len(proofs) - 1 if proofs[-1].holds else 0


def verify_remedy(task: Task, remedy: Remedy, progress: Progress = iter) -> Proof:
    """Simulate a remedy exactly, and with draws that it was not chosen by."""
    ratio = remedy.percent / task.percent
    moved = task.motion.at_speed(100 * ratio)
    exact = simulate(task.arm.replace(remedy.values), moved, loads=task.loads, method="exact", rate=task.rate)
    variables = tuple(Variable((path,), value, value) for path, value in remedy.values.items())
    trial = task.trial(*variables, draws=task.unseen)
    changes = np.array([float(variable.change(task.arm, variable.low)) for variable in variables])
    step = task.step / max(ratio, 1.0)
    largest = replace(trial, motion=moved, step=step).amplitudes(changes[None], progress)[:, 0, 1:].max(0)
    peak, keeps = measures(exact, task.limit).peak, binomial_estimate(largest <= task.limit)
    return Proof(peak, keeps, bool(peak.max() <= task.limit) and keeps.share >= CONFIDENT)


def remedy_to_json(remedy: Remedy) -> dict[str, Any]:
    """Return a remedy as JSON knows it."""
    return asdict(remedy) | {"amplitude": remedy.amplitude.tolist(), "keeps": binomial_to_json(remedy.keeps)}


def remedy_from_json(found: Mapping[str, Any]) -> Remedy:
    """Return the remedy again."""
    told = {"amplitude": np.array(found["amplitude"]), "keeps": binomial_from_json(found["keeps"])}
    return Remedy(**{**found, **told})
