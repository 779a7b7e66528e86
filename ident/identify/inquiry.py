"""Searches of a campaign's optimum with some numbers of arm and campaign otherwise than they were said to be.

One program predicts the campaign and its Jacobian by all unknowns and all such numbers; each search moves a few of
these, and is made of looks at that program (`gauss_newton`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.identify.alternatives import NUMBER_KINDS, Number, altered, altered_numbers, calibrated, largest_moments
from ident.identify.build_problem import build_problem
from ident.identify.predict import ArmModel
from ident.identify.unknowns import Unknowns
from ident.inference.gauss_newton import minimum
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, looker
from ident.inference.parameters import Parameters
from ident.inference.problem import Choice, InverseProblem
from ident.inference.score import row_tests
from ident.measure import Campaign

RIDGES = 3.0, 20.0
"""How many times its plausible width a number may move before that counts, at first and at last."""
STEP_OFF = 20.0
"""Sigmas by which a value that is wrong may be off before that counts, likewise."""
STEPS = 60
"""Looks of a search, at most: what has not ended by then has found no explanation."""
LIKELY = 0.01
"""Chance of a larger cost from which nothing is left to explain."""


@dataclass(frozen=True)
class Cause:
    """Numbers that are otherwise together, by the same amount in their own unit: one thing that may be wrong.

    Attributes:
        numbers: them; of a row that is wrong, none.
        row: place of a value that is wrong; -1 for none.
    """

    numbers: tuple[Number, ...] = ()
    row: int = -1


@dataclass(frozen=True)
class Finding:
    """The optimum of a campaign with some causes at work.

    Attributes:
        causes: them.
        amounts: of each, in its own unit (see `alternatives.KINDS`); of a row, by how many of its sigmas it is off.
        sd: of these by data and priors.
        cost: sum of squares of data and priors at the optimum, without what is known of the amounts.
        said: what speaks against the labels there, minus twice the logarithm of their probability.
        fits: whether neither cost, nor a value, nor a label speaks against it.
        theta: where: the unknowns, then all numbers that may be otherwise.
        covariance: of all these, by data and priors.
    """

    causes: tuple[Cause, ...]
    amounts: tuple[float, ...]
    sd: tuple[float, ...]
    cost: float
    said: float
    fits: bool
    theta: Float[np.ndarray, "Q"]
    covariance: Float[np.ndarray, "Q Q"]


@dataclass(frozen=True)
class Inquiry:
    """A campaign, and all numbers that may be otherwise.

    Attributes:
        problem: their values after the unknowns, all unknowns with a prior.
        unknowns: how many there are.
        numbers: what may be otherwise.
        start: theta of the unknowns at the fit, then zeros; what is predicted there, and its slope by all.
    """

    problem: InverseProblem
    unknowns: int
    numbers: tuple[Number, ...]
    start: End

    @cached_property
    def freedom(self) -> int:
        """Values and priors less the directions that they see together."""
        way = self._way(())
        s = np.linalg.svd(self._weigh(self._look(way, (), self._origin(()), self.start.choice.held), np.zeros(0))[1])[1]
        seen = int((s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)).sum())
        proper = int(self.problem.parameters.proper[: self.unknowns].sum())
        return int(np.isfinite(np.asarray(self.problem.sigma)).sum()) + proper - seen

    def search(self, causes: Sequence[Cause] = (), ridges: Sequence[float] = RIDGES) -> Finding | None:
        """Return the optimum with these causes at work; None where the model has no answer.

        They are held near zero by their plausible widths, ever less so until nothing is left to explain. The search
        begins at the fit and, where that leads nowhere, at the priors' centre.

        Args:
            causes: what may be otherwise.
            ridges: how many of its widths each may move before that counts as one.
        """
        found = []
        for start in (self._origin(causes), np.append(self._priors[0], np.zeros(len(causes)))):
            for ridge in ridges if causes else ridges[:1]:
                end = self._search(causes, start, ridge)
                if end is not None and end.fits:
                    return end
                found += [] if end is None else [end]
        return min(found, key=lambda end: end.cost, default=None)

    def _search(self, causes: Sequence[Cause], start: np.ndarray, ridge: float) -> Finding | None:
        way = self._way(causes)
        widths = ridge * self._widths(way)

        def look(x: np.ndarray, held: Any) -> End:
            here = self._look(way, causes, x, held)
            residuals, slope = self._weigh(here, widths)
            return here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)

        def weigh(here: End) -> tuple[np.ndarray, np.ndarray]:
            return self._weigh(here, widths)

        end, _ = minimum(look, weigh, start, self.start.choice.held, True, STEPS)
        if not np.isfinite(end.cost):
            return None
        _, slope = weigh(end)
        covariance = np.linalg.pinv(slope.T @ slope, rcond=RANK_TOLERANCE**2, hermitian=True)
        amounts, sd = end.theta[self.unknowns :], np.sqrt(np.diag(covariance)[self.unknowns :])
        residuals, slope = self._weigh(end, np.inf * widths)
        cost = float((residuals**2).sum())
        likely = self.chance(cost, len(causes)) >= LIKELY
        fits = bool(likely and end.choice.settled and not row_tests(self.problem, residuals, slope).outliers.any())
        whole = way @ end.theta
        return Finding(
            tuple(causes),
            tuple(map(float, amounts)),
            tuple(map(float, sd)),
            cost,
            float(np.sum(end.choice.cost)),
            fits,
            whole,
            way @ covariance @ way.T,
        )

    @property
    def effective(self) -> tuple[Number, ...]:
        """The numbers on which any value depends: a payload that was never on is none of them."""
        theta, kinds = self.start.theta, self.problem.kinds
        _, jacobian = calibrated(self.numbers, theta, kinds, self.start.predicted, self.start.jacobian)
        return tuple(n for n, column in zip(self.numbers, jacobian.T[self.unknowns :], strict=True) if column.any())

    def gain(self, causes: Sequence[Cause]) -> float:
        """Return by how much the cost would fall in the first of the searches, were the model linear."""
        way = self._way(causes)
        here = self._look(way, causes, self._origin(causes), self.start.choice.held)
        residuals, slope = self._weigh(here, RIDGES[0] * self._widths(way))
        step, *_ = np.linalg.lstsq(slope, -residuals, rcond=RANK_TOLERANCE)
        return float(residuals @ residuals - ((residuals + slope @ step) ** 2).sum())

    def chance(self, cost: float, spent: int) -> float:
        """Return the chance of a larger cost with so many causes set free, if nothing else is wrong."""
        from scipy.special import chdtrc

        left = self.freedom - spent
        return float(chdtrc(left, cost)) if left > 0 else float(cost < 1.0)

    def _origin(self, causes: Sequence[Cause]) -> Float[np.ndarray, "p"]:
        return np.append(self.start.theta[: self.unknowns], np.zeros(len(causes)))

    def _way(self, causes: Sequence[Cause]) -> Float[np.ndarray, "Q p"]:
        """Return how unknowns and causes make up all coordinates."""
        places = {number: self.unknowns + i for i, number in enumerate(self.numbers)}
        way = np.eye(self.unknowns + len(self.numbers), self.unknowns + len(causes))
        way[:, self.unknowns :] = 0.0
        for i, cause in enumerate(causes):
            for number in cause.numbers:
                way[places[number], self.unknowns + i] = 1.0
        return way

    def _look(self, way: np.ndarray, causes: Sequence[Cause], x: np.ndarray, held: Any) -> End:
        """Return what is predicted with these causes at work, gauges and wrong rows included, and its slope by x."""
        theta = way @ x
        here = self.start if np.array_equal(theta, self.start.theta) else self._at(theta, held)
        predicted, jacobian = calibrated(self.numbers, theta, self.problem.kinds, here.predicted, here.jacobian)
        along, sigma = jacobian @ way, np.asarray(self.problem.sigma)
        for i, cause in enumerate(causes, self.unknowns):
            if cause.row >= 0:
                along[cause.row, i] = sigma[cause.row]
                predicted = predicted + along[:, i] * x[i]
        return here._replace(theta=x, predicted=predicted, jacobian=along)

    def _at(self, theta: np.ndarray, held: Any) -> End:
        """Return what the model predicts, by itself."""
        predicted, jacobian, choice = self._looker(theta, held)
        return End(theta, np.nan, np.full(len(theta), np.nan), predicted, jacobian, choice)

    @cached_property
    def _looker(self) -> Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray, Choice]]:
        return looker(self.problem)

    @cached_property
    def _scaled(self) -> Callable[[np.ndarray], Any]:
        return self.problem.scaled  # looked up once: a method of a module is made anew at each look

    @cached_property
    def _priors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centre, standard deviation and flat half-length in theta of the unknowns' priors."""
        known = Parameters(self.problem.parameters.items[: self.unknowns])
        centre = np.asarray(known.theta(known.column("centre")))
        return centre, np.asarray(known.column("prior_sd")), np.asarray(known.column("flat"))

    def _weigh(self, here: End, widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of data, of the unknowns' priors and of the causes, by these widths; and their slope."""
        centre, sd, flat = self._priors
        off = here.theta[: self.unknowns] - centre
        prior = np.sign(off) * np.maximum(np.abs(off) - flat, 0.0) / sd
        slope = np.where(np.abs(off) >= flat, 1 / sd, 0.0)
        data = np.asarray(self._scaled(here.predicted - np.asarray(self.problem.measured)))
        count = len(here.theta) - self.unknowns
        causes = np.hstack([np.zeros((count, self.unknowns)), np.diag(1 / widths)])
        priors = np.hstack([np.diag(slope), np.zeros((self.unknowns, count))])
        rows = np.vstack([np.asarray(self._scaled(here.jacobian)), priors, causes])
        return np.concatenate([data, prior, here.theta[self.unknowns :] / widths]), rows

    def _widths(self, way: np.ndarray) -> Float[np.ndarray, "causes"]:
        """Return the plausible width of each cause, that of a wrong value in its sigmas."""
        own = [NUMBER_KINDS[number.kind].plausible for number in self.numbers]
        moved = way[self.unknowns :, self.unknowns :].T > 0
        return np.array([own[int(np.argmax(each))] if each.any() else STEP_OFF for each in moved])


def inquire(
    fitted: Mapping[str, float], arm: Arm, campaign: Campaign, unknowns: Unknowns, held: Any = None
) -> Inquiry | None:
    """Make ready to ask what may be otherwise than a fit takes it to be; None where the model has no answer.

    Args:
        fitted: where to begin, by path [SI]; at the priors' centre where it says nothing.
        arm: as its file has it.
        campaign: what is to be fitted.
        unknowns: what is unknown; where there is no prior, the default one is taken.
        held: what the fit has taken labels for; they are chosen anew without.
    """
    problem = build_problem(arm, campaign, unknowns.with_prior)
    model = problem.model
    if not isinstance(model, ArmModel):  # scaled by discrepancies, which are explanations already
        return None
    own = problem.parameters
    values = {path: fitted.get(path, float(x)) for path, x in own.by_path(own.column("centre")).items()}
    moments = largest_moments(model, values)
    numbers = tuple(altered_numbers(model, tuple(dict.fromkeys(problem.kinds)), values, moments))
    parameters = Parameters((*own.items, *(number.parameter for number in numbers)))
    problem = replace(problem, model=altered(model, numbers, moments), parameters=parameters)
    theta = np.asarray(own.theta(np.array([float(values[item.name]) for item in own.items])))
    predicted, jacobian, choice = looker(problem)(start := np.append(theta, np.zeros(len(numbers))), held)
    here = End(start, np.nan, np.full(len(start), np.nan), predicted, jacobian, choice)
    return Inquiry(problem, len(own.items), numbers, here) if np.isfinite(predicted).all() else None
