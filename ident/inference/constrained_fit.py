"""An inverse problem in which one parameter is held and all others are fitted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ident.inference.convergence import OPTIMUM_STEP, step_length, weighed
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, solve
from ident.inference.optima import Optimum
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

WIDTH = 1e-5
"""Width of the prior that holds a parameter, in its standard deviations, or in theta where that is less."""
GAIN = 1e-6
"""Fall of the cost that is not worth a further step."""
MORE = 3
"""Further searches where none has converged."""
BEYOND = 100.0
"""Delta chi-squared above which a point is outside of every interval, and need not be known any better."""
REACH = 1000.0
"""Factor on a positive parameter beyond which a profile is called open; for the others, ln(REACH) units of theta or
standard deviations, whichever is more."""
STEEPEST = 5.0
"""The other parameters' theta are foreseen to move at most so many times as far as the held one's."""


class Point(NamedTuple):
    """A point of a profile.

    Attributes:
        theta: (P,) all parameters.
        delta_chi_squared: cost above the optimum's, data and priors.
        converged: whether the other parameters' next step is negligible.
        tangent: (P,) estimated d(theta) / d(theta of the held one) along the profile.
        choice: by what the model knows what its values belong to; None where it chooses nothing.
        said: minus twice the logarithm of the probability of what was said of the values.
    """

    theta: Any
    delta_chi_squared: float
    converged: bool
    tangent: Any
    choice: Any = None
    said: float = 0.0


@dataclass(frozen=True)
class ConstrainedFit:
    """A fitted problem with one parameter that is held.

    What holds it is a narrow normal prior in place of its own, so that the program compiled for the fit serves all
    parameters. It moves the parameter by WIDTH^2 sd^2 / 2 times the slope of the cost, some 1e-10 of a standard
    deviation; and since its cost does not depend on the others, these are fitted exactly for where it is.

    Attributes:
        problem: what was fitted.
        optimum: where.
        end: the same as the end of a search, whose choice others may take over.
        index: place of the parameter in theta.
    """

    problem: InverseProblem
    optimum: Optimum
    end: End
    index: int

    @property
    def sd(self) -> float:
        """Standard deviation of the parameter's theta in the linear approximation; may be infinite."""
        return float(self.optimum.sd[self.index])

    @property
    def centre(self) -> float:
        """The parameter's fitted theta."""
        return float(self.optimum.theta[self.index])

    def limit(self, reach: float = REACH) -> float:
        """Return the distance in theta beyond which nothing is looked for, see `REACH`."""
        wide = not self.problem.parameters.items[self.index].positive and 1 < self.sd < math.inf
        return math.log(reach) * (self.sd if wide else 1.0)

    def start(self) -> Point:
        """Return the optimum."""
        _, slope = weighed(self.problem, self.end)
        tangent = self._tangent(slope)
        return Point(self.optimum.theta, 0.0, self.optimum.converged, tangent, self.end.choice.held, self.optimum.said)

    def at(self, theta: float, near: Sequence[Point]) -> Point | None:
        """Fit all others with the held one at theta; None where the model has no answer.

        Args:
            theta: of the held parameter.
            near: points to start from. Each is tried with and without its tangent, until an attempt converges; if none
                does, as in a long valley, the best one goes on.
        """
        problem = self._held(theta)
        points: list[Point] = []

        def converges(guess: np.ndarray, choice: Any) -> bool:
            point = self._point(solve(problem, guess, self.end, choice))
            points.extend([] if point is None else [point])
            return point is not None and point.converged

        for point in near:
            for slope in (point.tangent, np.zeros_like(point.tangent)):
                guess = point.theta + slope * (theta - point.theta[self.index])
                guess[self.index] = theta
                if converges(guess, point.choice):
                    return _best(points)
        for _ in range(MORE if points else 0):
            best = _best(points)
            if best.delta_chi_squared > BEYOND or converges(
                best.theta, None if self.end.choice.settled else best.choice
            ):
                break
        return _best(points) if points else None

    def _held(self, theta: float) -> InverseProblem:
        items = list(self.problem.parameters.items)
        item = items[self.index]
        centre = np.exp(theta) if item.positive else theta * item.scale
        width = WIDTH * min(self.sd, 1.0)
        items[self.index] = Parameter(item.paths, item.positive, item.start, centre, width, item.scale)
        return replace(self.problem, parameters=Parameters(tuple(items)))

    def _point(self, end: End) -> Point | None:
        """Weigh where a search ended by the problem's own priors."""
        if not np.isfinite(end.cost):
            return None
        theta = np.asarray(end.theta)
        residuals, slope = weighed(self.problem, end)
        cost = float(residuals @ residuals)
        others = np.arange(len(theta)) != self.index
        converged = step_length(residuals, slope[:, others]) < OPTIMUM_STEP
        said = float(end.choice.cost.sum())
        return Point(theta, cost - self.optimum.cost, converged, self._tangent(slope), end.choice.held, said)

    def _tangent(self, slope: np.ndarray) -> np.ndarray:
        """Return how the others follow in the linear approximation; the shortest way where that is open."""
        tangent, others = np.zeros(slope.shape[1]), np.arange(slope.shape[1]) != self.index
        if not np.isfinite(slope).all():
            return tangent
        # the held parameter's own prior lies in a row of its own and so moves no other
        follow = -np.linalg.lstsq(slope[:, others], slope[:, self.index], rcond=RANK_TOLERANCE)[0]
        tangent[others] = np.clip(follow, -STEEPEST, STEEPEST)
        return tangent


def _best(points: Sequence[Point]) -> Point:
    """Return the point of least cost; a converged one where that makes next to no difference."""
    return min(points, key=lambda point: point.delta_chi_squared - GAIN * point.converged)
