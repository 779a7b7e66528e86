"""Whether an arm keeps a limit, and the speed, stiffness, mass centre or transmission error with which it does."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import binom, binomtest

from ident.arm.multibody import exciting_orders
from ident.errors import refusal
from ident.identify.unknowns import is_damping
from ident.programs import Progress
from ident.studies.cure.balance_study import Rotor
from ident.studies.cure.effort import DiagnosisEffort
from ident.studies.scenario import Basis, OverPhases, at_share, over_phases
from ident.vibrate.binomial import BinomialEstimate, binomial_estimate, share_of_variance
from ident.vibrate.design_search import Point, Requirements, Search
from ident.vibrate.evaluator import Draws, Evaluator, exact_response, side_by_side
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response
from ident.vibrate.schedule import Schedule
from ident.vibrate.simulate import Superposition, amplitude
from ident.vibrate.variable import Variable

# -------- Task
# The task of a diagnosis: an arm in motion, a limit, and the uncertain numbers of the arm.

STIFFER = 2.0
"""Factor by which a torsional stiffness may be raised; our assumption of other available drives."""
FINER = 10.0
"""Factor by which transmission errors may be reduced; our assumption of other available drives."""
MOVED = 0.2
"""Share of a body's length by which its mass centre may be moved either way; our assumption."""
CONFIDENT = 0.95
"""Required probability of keeping the limit; assumed."""
RATE = 250.0
"""Sampling rate [Hz]."""


@dataclass(frozen=True)
class Task:
    """A diagnosis of an arm whose numbers are known within the draws.

    Attributes:
        basis: the arm with the medians of the draws, its motion and its load; its draws in random order.
        limit: [m] largest accepted vibration in any direction.
        effort: amount of computation.
        softer: whether a remedy may also make joints softer: vibration may fall, but nobody orders that unasked.
        measure: of the vibration that the limit is for: `peak`, or `settled` for what is left after the dwell.
    """

    basis: Basis
    limit: float
    effort: DiagnosisEffort = field(default_factory=DiagnosisEffort)
    softer: bool = False
    measure: str = "peak"

    @property
    def assessment_draws(self) -> Draws:
        """Draws to assess vibration and remedies."""
        return self._first(self.effort.assessment_draws)

    @property
    def band_draws(self) -> Draws:
        """Draws for the bands of natural frequencies."""
        return self._first(self.effort.band_draws)

    @property
    def fresh_draws(self) -> Draws:
        """Draws unused in assessment and optimisation."""
        return {path: values[self.effort.assessment_draws :] for path, values in self.basis.draws.items()}

    @cached_property
    def torsion(self) -> tuple[Variable, ...]:
        """The torsional stiffnesses."""
        present = {f"{j.name}.k_tors": float(j.k_tors) for j in self.basis.arm.joints if j.k_tors is not None}
        soft = {path: k for path, k in present.items() if 0 < k < np.inf}
        least = 1 / STIFFER if self.softer else 1.0
        return tuple(Variable((path,), k * least, k * STIFFER) for path, k in soft.items())

    @cached_property
    def errors(self) -> tuple[Variable, ...]:
        """The transmission errors of all drives, by one factor; empty without any."""
        paths = tuple(each.amplitude for each in exciting_orders(self.basis.arm) if each.of_error)
        own = float(self.basis.arm.get(paths[0])) if paths else 0.0
        return (Variable(paths, own / FINER, own),) if paths else ()

    @cached_property
    def centres(self) -> tuple[Variable, ...]:
        """The mass centres of the last joint's bodies along the arm, as far as their shapes are known."""
        extents, centres = self.basis.arm_file.extents, []
        for body in self.basis.arm.joints[-1].link:
            if body.name in extents:
                low, high = extents[body.name][:, 0]
                present, reach = float(body.com[0]), MOVED * (high - low)
                bounds = max(low, present - reach), min(high, present + reach)
                centres += [Variable((f"{body.name}.com.x",), *bounds)] if bounds[0] < present < bounds[1] else []
        return tuple(centres)

    @cached_property
    def step(self) -> float:
        """Time step [s] for the stiffest tried arm; one for all, so that they share their programs."""
        stiffest = Evaluator(self.basis.arm, self.basis.motion, (*self.torsion, *self.centres), loads=self.basis.loads)
        return stiffest.step_for(stiffest.bounds)

    def evaluator(self, *variables: Variable, draws: Draws | None = None) -> Evaluator:
        """Return the evaluator for repeated simulation; all evaluators of a task share one program."""
        basis, draws = self.basis, draws or {}
        how: dict[str, Any] = {"loads": basis.loads, "rate": RATE, "step": self.step}
        return Evaluator(basis.arm, basis.motion, variables, self.measure, draws, **how)

    def over_phases(self, evaluator: Evaluator) -> Evaluator:
        """Return the same over all unknown phases, with the largest possible transmission errors."""
        unknown = self.basis.unknown
        return replace(evaluator, arm=evaluator.arm.replace(unknown.highest), unknown=unknown.phases)

    def superposed(self, evaluator: Evaluator, change: Float[np.ndarray, "V"]) -> Superposition:
        """Return the vibration that counts over all unknown phases, of the arm itself after a change."""
        return evaluator.superposition(change).since(int(evaluator.amplitude.first))

    def balanced(self, rotors: Sequence[Rotor]) -> "Task":
        """Return the task of the arm with mounted corrections, each at its rotor's height.

        Each draw has the imbalance that its correction leaves; the arm itself has the one that `CONFIDENT` of the draws
        do not exceed.
        """
        if not rotors:
            return self
        basis, own, drawn = self.basis, dict[str, float](), dict[str, np.ndarray]()
        assert basis.posterior is not None  # a balanced drive was identified
        for rotor in rotors:
            mass, size, phase = (f"{rotor.drive.name}.{x}" for x in ("eccentric_mass", "eccentricity", "phase"))
            high = rotor.left[np.argsort(np.abs(rotor.left))[int(np.ceil(CONFIDENT * len(rotor.left))) - 1]]
            drawn |= {size: np.abs(rotor.left) / basis.draws.get(mass, basis.arm.get(mass))}
            drawn |= {phase: np.angle(rotor.left)}
            own |= {size: float(np.abs(high) / basis.arm.get(mass)), phase: float(np.angle(high))}
        posterior = replace(basis.posterior, values={**basis.posterior.values, **drawn})
        unknown = replace(basis.unknown, phases=tuple(path for path in basis.unknown.phases if path not in own))
        return replace(self, basis=replace(basis, arm=basis.arm.replace(own), posterior=posterior, unknown=unknown))

    def _first(self, count: int) -> Draws:
        return {path: values[:count] for path, values in self.basis.draws.items()}


# -------- Keeping
# Probability of keeping a limit: from as many draws as a verdict needs, and no more.

FIRST = 19
"""Draws at the first look; with the arm itself they fill the cores evenly. Each further look doubles them."""
UNLIKELY = 0.01
"""Significance of a look: probability of such a count, or one as improbable, if the limit were kept with exactly the
required probability; assumed."""


def is_settled(keeps: BinomialEstimate) -> bool:
    """Whether a count decides on which side of the required probability the true one lies.

    Exact binomial test at each look. Up to a thousand draws, a limit counts as kept as often as with all draws, to 0.3
    % and for any true probability; after 450 draws on average if that is 98 %, after 250 if it is 99.

    References:
        Armitage, McPherson, Rowe, "Repeated significance tests on accumulating data", Journal of the Royal Statistical
        Society A 132(2), 1969.
    """
    return bool(binomtest(keeps.count, keeps.draws, CONFIDENT).pvalue < UNLIKELY)


def keeping(
    evaluator: Evaluator, change: Float[np.ndarray, "V"], limit: float, progress: Progress = iter
) -> tuple[Float[np.ndarray, "3"], BinomialEstimate]:
    """Return the amplitude [m] of the arm itself after a change, and the probability of keeping a limit.

    Draws are simulated in their order: some first, and more until the verdict is settled.

    Args:
        evaluator: with the draws.
        change: of its variables.
        limit: [m]
        progress: shows progress over the looks.

    Raises:
        InputError: there are no draws.
    """
    if evaluator.size == 1:
        remedy = "take a posterior's draws: the arm alone says nothing of a probability"
        raise refusal("`evaluator`", "no draws", "at least one", remedy)
    parts, keeps = list(looks(evaluator.size - 1)), np.zeros(0, bool)
    for k in progress(range(len(parts))):
        draws = {path: values[parts[k]] for path, values in evaluator.draws.items()}
        amplitudes = replace(evaluator, draws=draws).amplitudes(change[None])[:, 0]
        keeps = np.append(keeps, amplitudes[:, 1:].max(0) <= limit)
        if is_settled(binomial_estimate(keeps)):
            break
    return amplitudes[:, 0], binomial_estimate(keeps)


def looks(count: int) -> Iterator[slice]:
    """Yield the draws that each look adds."""
    begin, end = 0, FIRST
    while begin < count:
        yield slice(begin, min(end, count))
        begin, end = end, 2 * end + 1


# -------- Vibration
# The vibration of the arm, and the probability that it is too large.


@dataclass(frozen=True)
class VibrationAssessment:
    """The present arm at work.

    Attributes:
        response: by the exact equations.
        amplitude: (3,) [m] of the arm itself, with the excitation of `at_confidence`; the response has the same.
        draws: (3, D) [m], each with phases and transmission errors of its own.
        keeps: probability that the limit is kept in all directions, by the draws.
        limit: [m]
        phases: the arm itself over the unknown phases; None if all are known.
        owed_to_damping: share of the draws' variance due to the damping.
        measure: of the vibration that the limit is for.
    """

    response: Response
    amplitude: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 D"]
    keeps: BinomialEstimate
    limit: float
    phases: OverPhases | None = None
    owed_to_damping: float = 0.0
    measure: str = "peak"

    @property
    def peak(self) -> Float[np.ndarray, "3"]:
        """Largest vibration in each direction by the exact equations [m], of the time that counts."""
        return amplitude(self.measure, self.response.motion, RATE)(np.asarray(self.response.vibration))

    @property
    def scatter(self) -> float:
        """Factor from the largest amplitude of the arm itself to the one most draws keep, see `tolerance_limit`."""
        return tolerance_limit(self.draws.max(0)) / float(self.amplitude.max())

    @property
    def accepted(self) -> bool:
        """Whether the limit is kept by the exact equations, and with confidence by the draws."""
        return self.keeps.share >= CONFIDENT and bool(self.peak.max() <= self.limit)


def tolerance_limit(values: Float[np.ndarray, "K"]) -> float:
    """Return the upper tolerance limit for `CONFIDENT` of all values, with the same confidence, from K values.

    From 100 values it is the second largest; their 95 % quantile would be too low every other time. From fewer than 59
    it is the largest, with less confidence.

    References:
        Wilks, "Determination of sample sizes for setting tolerance limits", Annals of Mathematical Statistics 12(1),
        1941.
    """
    place = int(binom.ppf(CONFIDENT, len(values), CONFIDENT))
    return float(np.sort(values)[min(place, len(values) - 1)])


def at_confidence(task: Task) -> Task:
    """Return a task whose arm vibrates no less than with the required share of phases.

    So the arm itself represents the unknown excitation; it stays unchanged if all is known.
    """
    if not task.basis.unknown.phases:
        return task
    excitation = likely_excitation(task, task.evaluator(), np.zeros(0))
    return replace(task, basis=replace(task.basis, arm=task.basis.arm.replace(excitation)))


def assess_vibration(task: Task, progress: Progress = iter) -> VibrationAssessment:
    """Simulate the motion exactly, and for the draws by the fast method."""
    unknown, evaluator, nothing = task.basis.unknown, task.evaluator(), np.zeros(0)
    phases = over_phases(task.superposed(task.over_phases(evaluator), nothing), unknown) if unknown.phases else None
    response = exact_response(evaluator)
    amplitudes = task.evaluator(draws=task.assessment_draws).amplitudes(np.zeros((1, 0)), progress)[:, 0]
    own, draws = amplitudes[:, 0], amplitudes[:, 1:]
    keeps = binomial_estimate(draws.max(0) <= task.limit)
    damping = {path: values for path, values in task.assessment_draws.items() if is_damping(path)}
    owed = share_of_variance(damping, draws.max(0))
    return VibrationAssessment(response, own, draws, keeps, task.limit, phases, owed, task.measure)


def likely_excitation(task: Task, evaluator: Evaluator, change: Float[np.ndarray, "V"]) -> dict[str, float]:
    """Return the excitation of an arm after a change, as `at_confidence` takes it; empty if all is known.

    Args:
        task: with the unknown phases.
        evaluator: of the task's arm.
        change: of the evaluator's variables.
    """
    if not task.basis.unknown.phases:
        return {}
    over = task.over_phases(evaluator)
    return at_share(over.changed_arm(change), task.superposed(over, change), task.basis.unknown, CONFIDENT)


# -------- Remedies

EFFORTS = {
    "schedule": "software",
    "speed": "software",
    "balance": "screwdriver",
    "transmission error": "new part",
    "torsion": "new part",
    "mass centre": "new part",
}
"""Kinds of remedies and their effort, least first; assumed."""
AND = " + "
"""Joins the kinds of a remedy that combines two."""
FULL = 100.0
"""Highest advised speed [%]."""
CANDIDATES = 10
"""Values of a single number assessed by draws, at most; to limit the time."""
COARSE = 10
"""Intervals of such values, one of which is refined; assumed."""
ROUNDS = 3
"""Searches at most, each for the ratio of amplitudes after the change of the previous one; assumed."""
AIMED = 2
"""Further searches at most, each with the aim that the draws after the last change require; assumed."""
NO_MORE = 0.01
"""Relative amount by which the amplitude may then miss the aim; assumed."""
VERIFIED = 3
"""Remedies verified at most, until one holds; to limit the time."""


@dataclass(frozen=True)
class Remedy:
    """A change and its effect.

    Attributes:
        kind: one of `EFFORTS`, or two joined by `AND`.
        values: the numbers after the change, by path [SI]; empty if no number of the arm changes.
        before: the same numbers before.
        percent: [%] speed after the change.
        percent_before: [%] present speed.
        amplitude: (3,) [m] expected: of the arm itself, with the excitation of the task.
        keeps: probability that the limit is kept.
        frequency: [Hz] first natural frequency, the lower of both ends of the motion.
        deflection: [m] static deflection, the larger of both ends.
        change_norm: [-] size of the change, see `design.Place`; of speed and time, in powers of two.
        time: [s] from start to arrival.
        schedule: speeds along the path; None for the motion's own.
        rotors: the balanced ones.
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
    time: float = 0.0
    schedule: Schedule | None = None
    rotors: tuple[Rotor, ...] = ()

    @property
    def effort(self) -> str:
        """Its effort: software, a screwdriver, a new part; or two of them."""
        return " and ".join(EFFORTS[kind] for kind in self.kind.split(AND))

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
    """A remedy by the exact equations, and by fresh draws.

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


def single_remedies(task: Task, scatter: float, progress: Progress = iter) -> list[Remedy]:
    """Return the effect of another speed, other mass centres and other torsional stiffnesses; `cures` adds the rest.

    A single number takes the least change that meets the limit for most draws. If none of a kind does, several are
    changed together: the fewer parts are touched the better. They aim at the limit divided by the scatter of the draws,
    before and then after the change, so that most draws keep it. If that is out of reach, the least amplitude is
    returned.

    Args:
        task: the diagnosis.
        scatter: factor from the amplitude of the arm itself to the amplitude that most of its draws keep.
        progress: shows progress over the remedies.
    """
    groups, aim = {"torsion": task.torsion, "mass centre": task.centres}, task.limit / max(scatter, 1.0)
    groups["transmission error"] = task.errors
    jobs = [partial(_alone, task, variable, kind) for kind, group in groups.items() for variable in group]
    found = side_by_side([partial(_slower_or_faster, task), *jobs], progress)

    enough = {remedy.kind for remedy in found if remedy.meets_limit}
    several = [(group, kind) for kind, group in groups.items() if len(group) > 1 and kind not in enough]
    found += side_by_side([partial(_together, task, group, kind, aim) for group, kind in several], progress)
    return [each for each in found if each.change_norm > 0]  # where each change makes it worse, none remains


def rank(remedy: Remedy) -> tuple[bool, Any, float, int, float]:
    """Sort remedies that meet the limit by the number of remedies combined, effort, time, kind and change norm.

    Sort the others after them, by amplitude.
    """
    kinds, efforts = remedy.kind.split(AND), list(dict.fromkeys(EFFORTS.values()))
    if remedy.meets_limit:
        every = len(kinds), [efforts.index(EFFORTS[kind]) for kind in kinds]
        return False, every, remedy.time, list(EFFORTS).index(kinds[0]), remedy.change_norm
    return True, (), remedy.largest, 0, 0.0


def _alone(task: Task, variable: Variable, kind: str) -> Remedy:
    """Try values of one number: return the least change that meets the limit, else that of the least amplitude."""
    changes = np.linspace(*variable.span(task.basis.arm), task.effort.values)[:, None]
    size, own = np.abs(changes[:, 0]) / np.abs(changes).max(), task.evaluator(variable)
    amplitude = near_limit(size, task.limit, lambda some: own.amplitudes(changes[some])[:, :, 0].max(0))
    evaluator = task.evaluator(variable, draws=task.assessment_draws)
    return least(
        size,
        amplitude.__getitem__,
        task.limit,
        lambda k: assessed(task, evaluator, kind, changes[k], change_norm=float(size[k])),
    )


def near_limit(
    size: Float[np.ndarray, "K"], limit: float, amplitudes: Callable[[np.ndarray], np.ndarray]
) -> Float[np.ndarray, "K"]:
    """Return amplitudes over a row of changes where they matter; infinite where not computed.

    First at every so many, then around the least of these that meets the limit, else around the quietest.
    """
    every, found = max(1, len(size) // COARSE), np.full(len(size), np.inf)
    coarse = np.arange(0, len(size), every)
    found[coarse] = amplitudes(coarse)
    good = np.flatnonzero(found <= limit)
    middle = int(good[np.argmin(size[good])] if len(good) else np.argmin(found))
    some = np.arange(max(0, middle - every + 1), min(len(size), middle + every))
    some = some[np.isinf(found[some])]
    if len(some):
        found[some] = amplitudes(some)
    return found


def least(
    size: Float[np.ndarray, "K"], amplitude: Callable[[int], float], limit: float, remedy: Callable[[int], Remedy]
) -> Remedy:
    """Return the remedy of the least size that meets the limit, else that of the least amplitude.

    Amplitudes are computed in the order of the sizes, up to that remedy.
    """
    found, tried = dict[int, float](), dict[int, Remedy]()
    for place in np.argsort(size, kind="stable").tolist():
        found[place] = amplitude(place)
        if found[place] <= limit and len(tried) < CANDIDATES:
            tried[place] = remedy(place)
            if tried[place].meets_limit:
                return tried[place]
    quietest = min(found, key=found.__getitem__)
    return tried.get(quietest) or remedy(quietest)


def _together(task: Task, variables: Sequence[Variable], kind: str, aim: float) -> Remedy:
    """Take the least change of several numbers that reaches the aim, or the least amplitude.

    Start from the present arm; from the quietest of some points if that fails, or all are above the aim.
    """
    whole = Search(task.evaluator(*variables), Requirements(), task.effort.screened, task.effort.iterations)
    evaluator = whole.objective.evaluator
    excitation = likely_excitation(task, evaluator, np.zeros(len(variables)))
    search = replace(whole, evaluator=replace(evaluator, arm=evaluator.arm.replace(excitation)))
    starts, objective = search.starts(2, seed=0), search.objective
    quietest, quiet = min(starts, key=objective.largest), list[Point]()
    near: Sequence[Point] = starts
    if objective.largest(quietest) > aim:  # apparently out of reach: the least amplitude decides
        quiet = [u for u in [search.minimum_amplitude(quietest)] if u is not None]
        near = [u for u in quiet if objective.largest(u) <= aim]
    over = replace(whole, evaluator=task.over_phases(evaluator))
    evaluator = task.evaluator(*variables, draws=task.assessment_draws)
    best = next((u for start in near if (u := _least_change(task, over, start, aim)) is not None), None)
    if best is None:
        quiet = quiet or [u for start in near if (u := search.minimum_amplitude(start)) is not None]
        best = min([*starts, *quiet], key=objective.largest)
    else:
        best = _for_most_draws(task, over, evaluator, best, aim)
    return assessed(task, evaluator, kind, best * objective.scale, change_norm=objective.change_norm(best))


def _for_most_draws(task: Task, search: Search, evaluator: Evaluator, u: Point, aim: float) -> Point:
    """Return the least change with which most draws keep the limit, too: they may scatter more than before a change.

    Args:
        task: the diagnosis.
        search: over all unknown phases.
        evaluator: with the draws.
        u: the least change for an aim.
        aim: [m]
    """
    for _ in range(AIMED):
        bound = tolerance_limit(evaluator.amplitudes((u * search.objective.scale)[None])[:, 0, 1:].max(0))
        if bound <= task.limit:
            break
        aim *= task.limit / bound
        found = _least_change(task, search, u, aim)
        if found is None:
            break
        u = found
    return u


def _least_change(task: Task, search: Search, start: Point, aim: float) -> Point | None:
    """Return the least change with which `CONFIDENT` of all phases reach an aim [m]; None if the search fails.

    The maximum over all phases is smooth, a quantile over phases is not: so the search uses the former, with the aim
    times the ratio of both, which a change hardly alters, until the ratio is constant.

    Args:
        task: the diagnosis.
        search: over all unknown phases.
        start: starting point.
        aim: [m]
    """

    def reached(u: Point) -> tuple[float, float]:
        """Return the amplitude for the share of the phases, and for all phases [m]."""
        superposed = task.superposed(search.objective.evaluator, u * search.objective.scale)
        largest = float(superposed.worst.max())
        if not superposed.unknown:
            return largest, largest
        peaks = over_phases(superposed, task.basis.unknown).peaks.max(0)
        return float(np.quantile(peaks, CONFIDENT, method="higher")), largest

    u, (share, largest) = start, reached(start)
    for _ in range(ROUNDS):
        found = search.minimum_change(u, aim * largest / share)
        if found is None:
            return None
        u, (share, largest) = found, reached(found)
        if abs(share / aim - 1) <= NO_MORE:
            break
    return u


def _slower_or_faster(task: Task) -> Remedy:
    """Return the speed nearest to the present one that meets the limit, else that of the least amplitude."""
    ratios = np.unique([ratio for ratio in task.effort.speeds if ratio != 1])
    ratios = ratios[ratios * task.basis.percent <= max(FULL, task.basis.percent)]
    own, motion = task.evaluator(draws=task.assessment_draws), task.basis.motion
    clocks = ratios / ratios[0]  # as many samples and steps at each speed as at the slowest
    evaluators = [
        replace(own, motion=motion.at_speed(100 * ratio), rate=RATE * clock, step=task.step / clock)
        for ratio, clock in zip(ratios, clocks, strict=True)
    ]
    size = np.abs(np.log2(ratios))
    return least(
        size,
        lambda k: float(evaluators[k].alone.amplitudes(np.zeros((1, 0))).max()),
        task.limit,
        lambda k: assessed(task, evaluators[k], "speed", np.zeros(0), ratio=ratios[k], change_norm=float(size[k])),
    )


def assessed(
    task: Task,
    evaluator: Evaluator,
    kind: str,
    changes: Float[np.ndarray, "V"],
    *,
    change_norm: float,
    ratio: float = 1.0,
    schedule: Schedule | None = None,
    rotors: tuple[Rotor, ...] = (),
) -> Remedy:
    """Assess a change by the draws of an evaluator with the motion and excitation after it."""
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
        float(evaluator.motion.arrival - evaluator.motion.breaks[0]),
        schedule,
        rotors,
    )


def verify_in_turn(ranked: Sequence[Remedy], verify: Callable[[Remedy], Verification]) -> tuple[Verification, ...]:
    """Verify the first remedy, and the following ones while they should meet the limit and none holds.

    Args:
        ranked: the best first.
        verify: verifies one.
    """
    verifications: list[Verification] = []
    for remedy in ranked[:VERIFIED]:
        if verifications and (verifications[-1].holds or not remedy.meets_limit):
            break
        verifications.append(verify(remedy))
    return tuple(verifications)


def carried_out(task: Task, remedy: Remedy) -> tuple[Task, Evaluator, Float[np.ndarray, "V"]]:
    """Return the task with a remedy's corrections, an evaluator with its motion and variables, and their changes."""
    task, ratio = task.balanced(remedy.rotors), remedy.percent / task.basis.percent
    motion = task.basis.motion.at_speed(100 * ratio)
    if remedy.schedule:
        motion = held(task, remedy.schedule)
    variables = tuple(Variable((path,), value, value) for path, value in remedy.values.items())
    evaluator = task.evaluator(*variables, draws=task.assessment_draws)
    changes = np.array([float(variable.change(task.basis.arm, variable.low)) for variable in variables])
    return task, replace(evaluator, motion=motion, step=task.step / max(ratio, 1.0)), changes


def held(task: Task, schedule: Schedule) -> Motion:
    """Return the motion of a schedule, with the dwell of the task's own motion."""
    own = task.basis.motion
    return schedule.motion.dwell(float(own.breaks[-1] - own.arrival))


def verify_remedy(task: Task, remedy: Remedy, progress: Progress = iter) -> Verification:
    """Simulate a remedy exactly, and with fresh draws."""
    task, evaluator, changes = carried_out(task, remedy)
    evaluator = replace(evaluator, draws=task.fresh_draws)
    excitation = likely_excitation(task, evaluator, changes)
    response = exact_response(replace(evaluator, arm=evaluator.changed_arm(changes).replace(excitation)))
    _, keeps = keeping(evaluator, changes, task.limit, progress)
    return Verification(evaluator.amplitude(np.asarray(response.vibration)), keeps, task.limit)
