"""Optimal design: the information before a plan, and the gain of each experiment.

What to measure next: the experiments with the most information for their cost, for any model with a Jacobian.

The gains are those of the linear-Gaussian model. With C and C' the covariance of theta before and after,

    d     ln det(C) / 2 - ln det(C') / 2 [nat]: the expected information gain, or mutual information
    a     (tr C - tr C') / P: the fall of the mean variance
    NAME  ln sd - ln sd' of that parameter

each averaged over the points of `PriorInformation`. C is that of the sought parameters, the nuisances integrated out.

References:
    Lindley, "On a measure of the information provided by an experiment", Ann. Math. Stat. 27(4), 1956.
    Chaloner, Verdinelli, "Bayesian experimental design: a review", Statistical Science 10(3), 1995, sections 2 and 4.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ident.errors import refusal, require
from ident.inference.fit import Fit
from ident.inference.parameters import Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.text import did_you_mean, quoted

# -------- Prior information
# Information on the parameters before a plan: plausible points, and the inverse covariance there.

OPEN_SD = 3.0
"""Standard deviation in theta of a parameter without a prior, for planning only: a factor of 20 for a stiffness."""
DRAWS = 8


@dataclass(frozen=True)
class PriorInformation:
    """Present information by prior and data.

    A gain is a mean over the points, so that a plan does not depend on one guess of the unknowns. The first point is
    the best estimate; the standard deviations of a plan are reported there.

    Attributes:
        names: (P,) parameters.
        points: (T, P) theta.
        information: (T, P, P) inverse covariance of theta by prior and data, linearized at each point.
        nuisance: uncertain parameters that are not sought.
    """

    names: tuple[str, ...]
    points: Float[np.ndarray, "T P"]
    information: Float[np.ndarray, "T P P"]
    nuisance: tuple[str, ...] = ()

    @property
    def sought(self) -> tuple[str, ...]:
        """The other parameters."""
        return tuple(name for name in self.names if name not in self.nuisance)

    @property
    def sd(self) -> Float[np.ndarray, "T sought"]:
        """Standard deviation of each sought theta at each point."""
        return sds(self.of_sought(self.information))

    def of_sought(self, information: Float[np.ndarray, "*batch P P"]) -> Float[np.ndarray, "*batch sought sought"]:
        """Return the inverse covariance of the sought parameters alone, the nuisances integrated out."""
        return marginal(information, [self.names.index(name) for name in self.sought])

    def at(self, chosen: np.ndarray) -> "PriorInformation":
        """Return the information at some of the points."""
        return replace(self, points=self.points[chosen], information=self.information[chosen])

    def without(self, names: Sequence[str]) -> "PriorInformation":
        """Return the information on the other parameters, with these integrated out."""
        kept = [i for i, name in enumerate(self.names) if name not in names]
        return PriorInformation(
            tuple(self.names[i] for i in kept),
            self.points[:, kept],
            marginal(self.information, kept),
            tuple(name for name in self.nuisance if name not in names),
        )


def sds(information: Float[np.ndarray, "*batch P P"]) -> Float[np.ndarray, "*batch P"]:
    """Return the standard deviations of inverse covariances."""
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def marginal(information: Float[np.ndarray, "*batch P P"], kept: Sequence[int]) -> Float[np.ndarray, "*batch K K"]:
    """Return the inverse covariance of some parameters, the others integrated out."""
    others = [i for i in range(information.shape[-1]) if i not in kept]
    own, between = information[..., kept, :][..., kept], information[..., others, :][..., kept]
    if not others:
        return own
    return own - between.swapaxes(-1, -2) @ np.linalg.solve(information[..., others, :][..., others], between)


def prior_information(parameters: Parameters, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return the information of the priors, before any measurement; see `_normal_prior`."""
    centre, sd = _normal_prior(parameters)
    information = np.diag(1 / sd**2)
    points = _spread(centre, np.diag(sd**2), draws, seed)
    return _known(parameters, points, np.repeat(information[None], len(points), 0))


def prior_and_data_information(fit: Fit, *, draws: int = DRAWS, seed: int = 0) -> PriorInformation:
    """Return the information of a fit: points about its optimum, with Fisher information of data and priors at each."""
    parameters = fit.problem.parameters
    _, sd = _normal_prior(parameters)
    best, prior = fit.best.theta, np.diag(1 / sd**2)
    scaled = fit.problem.scaled(np.asarray(fit.jacobian))
    points = _spread(best, np.linalg.inv(scaled.T @ scaled + prior), draws, seed)
    return _known(parameters, points, fisher(scaled_jacobians(fit.problem, points)) + prior)


def _known(parameters: Parameters, points: np.ndarray, information: np.ndarray) -> PriorInformation:
    nuisance = tuple(item.name for item in parameters.items if item.nuisance)
    return PriorInformation(parameters.names, points, information, nuisance)


def scaled_jacobians(problem: InverseProblem, points: Iterable[np.ndarray]) -> Float[np.ndarray, "T D P"]:
    """Return d(predicted / sigma)/d(theta) at each point; zero rows where the model has no solution.

    It needs no more than `fit` does, so a plan is possible for any model, not only an arm.
    """
    rows = [problem.scaled(np.asarray(evaluate(problem, jnp.asarray(theta)).jacobian)) for theta in points]
    return np.nan_to_num(np.stack(rows))


def fisher(scaled: Float[np.ndarray, "*batch D P"]) -> Float[np.ndarray, "*batch P P"]:
    """Return the Fisher information J'J of rows that are scaled by their sigma."""
    return np.einsum("...dp,...dq->...pq", scaled, scaled)


def _normal_prior(parameters: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Return means and standard deviations of the normal priors that replace the parameters' priors in a plan.

    A flat prior is replaced by a normal one of about its width, a missing one by `OPEN_SD`; for a nuisance without a
    prior only the data have information.
    """
    return parameters.theta_centre, np.where(parameters.proper | parameters.nuisance, parameters.normal_sd, OPEN_SD)


def _spread(mean: np.ndarray, covariance: np.ndarray, draws: int, seed: int) -> np.ndarray:
    """Return the mean, then quasi-random draws about it, which cover a normal law more evenly than random ones."""
    if not draws:
        return mean[None]
    from scipy.stats import qmc  # slow to import, and seldom needed

    sampler = qmc.MultivariateNormalQMC(np.zeros(len(mean)), rng=np.random.default_rng(seed))
    # whole powers of two keep a Sobol sequence balanced
    z = sampler.random(2 ** int(np.ceil(np.log2(draws))))[:draws]
    return np.vstack([mean, mean + z @ np.linalg.cholesky(covariance).T])


# -------- Optimal design
# Experiments with the most information for their cost: information gain, greedy batches.

D_OPTIMAL, A_OPTIMAL = "d", "a"

Gain = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Experiments:
    """Candidate experiments: each is a set of values measured together, at one cost.

    Attributes:
        whole: (C, T, P+S, P+S) information of each, at each point of `PriorInformation`, on the parameters and on the S
            common errors of its group, each in its standard deviation, without the priors of these errors.
        count: of the parameters.
        group: (C,) group number; experiments of one group have common errors.
        cost: (C,) in any one unit.
        before: by group, the (T, P+S, P+S) information of earlier measurements there; its part on the parameters is
            already in the prior information: a further value is averaged with it.
    """

    whole: Float[np.ndarray, "C T Q Q"]
    count: int
    group: Int[np.ndarray, "C"]
    cost: Float[np.ndarray, "C"]
    before: Mapping[int, Float[np.ndarray, "T Q Q"]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.cost).all() and (self.cost > 0).all()):
            raise refusal("", f"an experiment that costs {self.cost.min():g}", "a cost > 0", "raise its costs")

    @cached_property
    def information(self) -> Float[np.ndarray, "C T P P"]:
        """Information that each alone would add at each point."""
        added = without_common(self.whole, self.count)
        for group, before in self.before.items():
            own = self.group == group
            added[own] = self.added(before, self.whole[own])
        return added

    def added(self, before: Float[np.ndarray, "*#batch Q Q"], whole: np.ndarray) -> Float[np.ndarray, "*batch P P"]:
        """Return the information on the parameters that values add after others of their group."""
        return without_common(before + whole, self.count) - without_common(before, self.count)

    def taken(self, group: int, chosen: Sequence[int]) -> Float[np.ndarray, "T Q Q"]:
        """Return the information of all values of a group: those already measured, and those chosen."""
        own = [i for i in chosen if self.group[i] == group]
        return np.asarray(self.whole[own].sum(0) + self.before.get(group, 0.0))

    def after(self, chosen: Sequence[int]) -> Float[np.ndarray, "C T P P"]:
        """Return the information that each adds after those chosen: less if it shares an error with these."""
        added = self.information.copy()
        for group in {int(self.group[i]) for i in chosen}:
            own = self.group == group
            added[own] = self.added(self.taken(group, chosen), self.whole[own])
        return added

    def together(self, chosen: Sequence[int]) -> Float[np.ndarray, "T P P"]:
        """Return the information that those chosen add together."""
        added = np.zeros(self.information.shape[1:])
        for place, i in enumerate(chosen):
            added = added + self.after(chosen[:place])[i]
        return added


def without_common(whole: Float[np.ndarray, "*batch Q Q"], count: int) -> Float[np.ndarray, "*batch P P"]:
    """Return the information on the first parameters; the common errors after them (normal, sd 1) integrated out."""
    known = np.diag(np.where(np.arange(whole.shape[-1]) < count, 0.0, 1.0))
    return marginal(whole + known, range(count))


@dataclass(frozen=True)
class Step:
    """One experiment of a batch, after those before it.

    Attributes:
        experiment: its index among the candidates.
        cost: of the experiment.
        nats: () [nat] mean information gain, for any criterion.
        gain: () by the criterion.
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
    remedy = did_you_mean(name, names, "name one of the unknowns")
    require(name in names, "criterion", quoted(name), "d, a, or a parameter's name", remedy)
    place = list(names).index(name)
    return lambda before, after: np.log(sds(before)[..., place] / sds(after)[..., place])


def information_gain(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return ln det(after) / 2 - ln det(before) / 2 of inverse covariances."""
    return (np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]) / 2


def variance_gain(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the fall of the mean variance between two inverse covariances."""
    return (sds(before) ** 2 - sds(after) ** 2).mean(-1)


def gains(
    known: PriorInformation, information: Float[np.ndarray, "T P P"], added: Float[np.ndarray, "C T P P"], gain: Gain
) -> Float[np.ndarray, "C"]:
    """Return the gain of each of several additions to an information, averaged over the points."""
    return gain(known.of_sought(information), known.of_sought(information + added)).mean(-1)


def greedy(
    known: PriorInformation, experiments: Experiments, count: int, gain: Gain = information_gain, *, target: float = 0.0
) -> tuple[Step, ...]:
    """Choose experiments one by one, each with the most gain per cost after those before it; repeats are allowed.

    A repeat does not reduce common errors, so that the next experiment goes elsewhere.

    At equal costs the information gain of the batch is at least 1 - 1/e (63 %) of that of the best batch of its size,
    as ln det is submodular; in practice it is within a few percent.

    Args:
        known: present information.
        experiments: candidates.
        count: most experiments.
        gain: criterion of the choice, see `criterion`.
        target: stop as soon as every standard deviation at the first point is below; 0 to take all.

    References:
        Nemhauser, Wolsey, Fisher, "An analysis of approximations for maximizing submodular set functions",
        Mathematical Programming 14, 1978.
    """
    steps: list[Step] = []
    information = known.information
    while len(steps) < count and not (sds(known.of_sought(information[0])) < target).all():
        added = experiments.after([step.experiment for step in steps])
        per_cost = gains(known, information, added, gain) / experiments.cost
        best = int(np.argmax(per_cost))
        after = information + added[best]
        sought = known.of_sought(after)
        nats = float(information_gain(known.of_sought(information), sought).mean())
        cost = float(experiments.cost[best])
        steps.append(Step(best, cost, nats, float(per_cost[best]) * cost, sds(sought)))
        information = after
    return tuple(steps)
