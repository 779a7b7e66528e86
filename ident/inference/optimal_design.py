"""What to measure next: the experiments that tell most for their cost, for any model whose predictions have a Jacobian.

The gains are those of the linear-Gaussian model. With C and C' the covariance of theta before and after,

    d     ln det(C) / 2 - ln det(C') / 2 [nat]: the expected information gain, or mutual information
    a     (tr C - tr C') / P: the mean variance that goes
    NAME  ln sd - ln sd' of that parameter

each averaged over the points of `PriorInformation`. C is that of the sought parameters, whatever the nuisances are.

References:
    Lindley, "On a measure of the information provided by an experiment", Ann. Math. Stat. 27(4), 1956.
    Chaloner, Verdinelli, "Bayesian experimental design: a review", Statistical Science 10(3), 1995, sections 2 and 4.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from jaxtyping import Float, Int

from ident.errors import InputError, Problem
from ident.inference.prior_information import PriorInformation, fisher, marginal, sds
from ident.text import did_you_mean, quoted

D_OPTIMAL, A_OPTIMAL = "d", "a"
MOST = 2_000_000
"""Sets that an exhaustive search looks at, at most."""
TOGETHER = 20_000
"""Matrices of one array in it."""

Gain = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Experiments:
    """What could be measured: each experiment is a set of values that are taken together, and paid together.

    Attributes:
        information: (C, T, P, P) what each alone would add at each point of `PriorInformation`.
        cost: (C,) in any one unit.
        group: (C,) experiments of one number have errors in common; None where all are independent.
        whole: (C, T, P+S, P+S) information of each on the parameters and on the S errors that those of its group have
            in common, each in its standard deviation, without what is known of these; None likewise.
    """

    information: Float[np.ndarray, "C T P P"]
    cost: Float[np.ndarray, "C"]
    group: Int[np.ndarray, "C"] | None = None
    whole: Float[np.ndarray, "C T Q Q"] | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.cost).all() and (self.cost > 0).all()):
            got = f"an experiment that costs {self.cost.min():g}"
            raise InputError(Problem("", got, "a cost > 0", "raise its costs"))

    def __len__(self) -> int:
        return len(self.cost)

    @classmethod
    def with_common_errors(
        cls, whole: Float[np.ndarray, "C T Q Q"], count: int, group: Int[np.ndarray, "C"], cost: Float[np.ndarray, "C"]
    ) -> "Experiments":
        """Return experiments with so many parameters, and errors that those of a group have in common."""
        return cls(without_common(whole, count), cost, group, whole)

    def after(self, chosen: Sequence[int]) -> Float[np.ndarray, "C T P P"]:
        """Return what each would add after those chosen: less where it shares an error with some of them."""
        if self.group is None or self.whole is None:
            return self.information
        added, count = self.information, self.information.shape[-1]
        for group in {int(self.group[i]) for i in chosen}:
            before = self.whole[[i for i in chosen if self.group[i] == group]].sum(0)
            own = self.group == group
            added = np.where(own[:, None, None, None], 0.0, added)
            added[own] = without_common(before + self.whole[own], count) - without_common(before, count)
        return added

    def together(self, chosen: Sequence[int]) -> Float[np.ndarray, "T P P"]:
        """Return what those chosen add together."""
        added = np.zeros(self.information.shape[1:])
        for place, i in enumerate(chosen):
            added = added + self.after(chosen[:place])[i]
        return added


def without_common(whole: Float[np.ndarray, "*batch Q Q"], count: int) -> Float[np.ndarray, "*batch P P"]:
    """Return the information on the first parameters, whatever the common errors after them are: normal, of sd 1."""
    known = np.diag(np.where(np.arange(whole.shape[-1]) < count, 0.0, 1.0))
    return marginal(whole + known, range(count))


def bundle(scaled: Float[np.ndarray, "T D P"], rows: Sequence[Sequence[int]], cost: Sequence[float]) -> Experiments:
    """Return the experiments that take these rows of a scaled Jacobian (`scaled_jacobians`) together."""
    return Experiments(np.stack([fisher(scaled[:, list(own)]) for own in rows]), np.asarray(cost, float))


@dataclass(frozen=True)
class Step:
    """One experiment of a batch, after those before it.

    Attributes:
        experiment: its place among the candidates.
        cost: what it costs.
        nats: () [nat] mean information gain, whatever the criterion.
        gain: () what the criterion says.
        sd: (T, sought) standard deviation of each sought theta after it, at each point.
    """

    experiment: int
    cost: float
    nats: float
    gain: float
    sd: Float[np.ndarray, "T sought"]


def criterion(name: str, names: Sequence[str]) -> Gain:
    """Return the gain of a criterion: `d`, `a`, or a parameter's name, as at the head of this module.

    Raises:
        InputError: it is none of them.
    """
    if name.lower() in (D_OPTIMAL, A_OPTIMAL):
        return {D_OPTIMAL: information_gain, A_OPTIMAL: variance_gain}[name.lower()]
    if name not in names:
        remedy = did_you_mean(name, names, "name one of the unknowns")
        raise InputError(Problem("criterion", quoted(name), "d, a, or a parameter's name", remedy))
    place = list(names).index(name)
    return lambda before, after: np.log(sds(before)[..., place] / sds(after)[..., place])


def information_gain(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return ln det(after) / 2 - ln det(before) / 2 of inverse covariances."""
    return (np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]) / 2


def variance_gain(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return by how much the mean variance shrinks between two inverse covariances."""
    return (sds(before) ** 2 - sds(after) ** 2).mean(-1)


def gains(known: PriorInformation, experiments: Experiments, gain: Gain) -> Float[np.ndarray, "C"]:
    """Return what each experiment alone would gain, averaged over the points."""
    return _gains(known, known.information, experiments.information, gain)


def greedy(
    known: PriorInformation, experiments: Experiments, count: int, gain: Gain = information_gain, *, target: float = 0.0
) -> tuple[Step, ...]:
    """Choose experiments one by one, each the one with most gain per cost after those before it; none is barred twice.

    Errors that experiments have in common are no smaller in a repeat, so that the next one goes elsewhere.

    At equal costs the information gain of the batch is at least 1 - 1/e (63 %) of what the best one of its size has,
    as ln det is submodular; in practice it is within a few percent.

    Args:
        known: what is known now.
        experiments: what could be measured.
        count: experiments at most.
        gain: what they are chosen for, see `criterion`.
        target: stop as soon as every standard deviation at the first point is below; 0 to take all.

    References:
        Nemhauser, Wolsey, Fisher, "An analysis of approximations for maximizing submodular set functions",
        Mathematical Programming 14, 1978.
    """
    steps: list[Step] = []
    information = known.information
    while len(steps) < count and not (sds(known.of_sought(information[0])) < target).all():
        added = experiments.after([step.experiment for step in steps])
        per_cost = _gains(known, information, added, gain) / experiments.cost
        best = int(np.argmax(per_cost))
        after = information + added[best]
        sought = known.of_sought(after)
        nats = float(information_gain(known.of_sought(information), sought).mean())
        cost = float(experiments.cost[best])
        steps.append(Step(best, cost, nats, float(per_cost[best]) * cost, sds(sought)))
        information = after
    return tuple(steps)


def fewest(known: PriorInformation, experiments: Experiments, target: float, most: int = 4) -> tuple[int, ...] | None:
    """Search all sets of 1, 2, ... different experiments for the smallest that brings all sds below a target.

    The sds are those at the first point. Of the sets of that size it is the one whose largest sd is smallest; None if
    `most` do not suffice. Common errors are not looked at.

    Raises:
        InputError: there are too many sets.
    """
    for size in range(1, most + 1):
        worst, chosen = np.inf, None
        for sets in _chunks(len(experiments), size):
            after = known.information[0] + experiments.information[sets, 0].sum(1)
            largest = sds(known.of_sought(after)).max(-1)
            if largest.min() < worst:
                worst, chosen = float(largest.min()), sets[int(np.argmin(largest))]
        if chosen is not None and worst < target:
            return tuple(map(int, chosen))
    return None


def _gains(known: PriorInformation, information: np.ndarray, added: np.ndarray, gain: Gain) -> np.ndarray:
    after = known.of_sought(information + added)
    return gain(known.of_sought(information), after).mean(-1)


def _chunks(count: int, size: int) -> Iterator[np.ndarray]:
    number = int(np.prod([(count - i) / (i + 1) for i in range(size)]))
    if number > MOST:
        remedy = "search among fewer experiments, or choose greedily"
        raise InputError(Problem("", f"{number} sets of {size} experiments", f"{MOST} at most", remedy))
    sets = combinations(range(count), size)
    while chunk := list(islice(sets, TOGETHER)):
        yield np.array(chunk)
