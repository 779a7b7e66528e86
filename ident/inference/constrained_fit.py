"""An inverse problem in which one parameter is held and all others are fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ident.inference.convergence import SHORT, step_length
from ident.inference.fit import Fit
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, solve
from ident.inference.parameters import AnyArray, Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.jit import jit

WIDTH = 1e-5
"""Width of the prior that holds a parameter, in its standard deviations, or in theta where that is less."""
GAIN = 1e-6
"""Fall of the cost that is not worth a further step."""
MORE = 3
"""Further searches where none has converged."""
STEEPEST = 5.0
"""The other parameters' theta are foreseen to move at most so many times as far as the held one's."""


class Point(NamedTuple):
    """A point of a profile.

    Attributes:
        theta: (P,) all parameters.
        delta_chi_squared: cost above the optimum's, data and priors.
        converged: whether the other parameters' next step is negligible.
        tangent: (P,) estimated d(theta) / d(theta of the held one) along the profile.
    """

    theta: Any
    delta_chi_squared: float
    converged: bool
    tangent: Any


@dataclass(frozen=True)
class ConstrainedFit:
    """A fitted problem with one parameter that is held.

    What holds it is a narrow normal prior in place of its own, so that the program compiled for the fit serves all
    parameters. It moves the parameter by WIDTH^2 sd^2 / 2 times the slope of the cost, some 1e-10 of a standard
    deviation; and since its cost does not depend on the others, these are fitted exactly for where it is.

    Attributes:
        fit: of the problem.
        index: place of the parameter in theta.
    """

    fit: Fit
    index: int

    @property
    def sd(self) -> float:
        """Standard deviation of the parameter's theta in the linear approximation; may be infinite."""
        return float(self.fit.information.sd[self.index])

    @property
    def optimum(self) -> float:
        """The parameter's fitted theta."""
        return float(self.fit.best.theta[self.index])

    def start(self) -> Point:
        """Return the optimum."""
        _, slope = _weighed(self.fit.problem, self._end)
        return Point(self.fit.best.theta, 0.0, self.fit.best.converged, self._tangent(np.asarray(slope)))

    def at(self, theta: float, near: Sequence[Point]) -> Point | None:
        """Fit all others with the held one at theta; None where the model has no answer.

        Args:
            theta: of the held parameter.
            near: points to start from. Each is tried with and without its tangent, until an attempt converges; if none
                does, as in a long valley, the best one goes on.
        """
        problem = self._held(theta)
        points: list[Point] = []

        def converges(guess: np.ndarray) -> bool:
            point = self._point(solve(problem, jnp.asarray(guess), self._end))
            points.extend([] if point is None else [point])
            return point is not None and point.converged

        for point in near:
            for slope in (point.tangent, np.zeros_like(point.tangent)):
                guess = point.theta + slope * (theta - point.theta[self.index])
                guess[self.index] = theta
                if converges(guess):
                    return _best(points)
        for _ in range(MORE if points else 0):
            if converges(_best(points).theta):
                break
        return _best(points) if points else None

    @property
    def _end(self) -> End:
        """The optimum as the end of a search, whose choice others may take over."""
        theta = self.fit.best.theta
        return End(theta, 0.0, theta, self.fit.predicted, self.fit.jacobian, self.fit.choice)

    def _held(self, theta: float) -> InverseProblem:
        items = list(self.fit.problem.parameters.items)
        item = items[self.index]
        centre = jnp.exp(theta) if item.positive else theta * item.scale
        width = WIDTH * min(self.sd, 1.0)
        items[self.index] = Parameter(item.paths, item.positive, item.start, centre, width, item.scale)
        return replace(self.fit.problem, parameters=Parameters(tuple(items)))

    def _point(self, end: End) -> Point | None:
        """Weigh where a search ended by the problem's own priors."""
        if not np.isfinite(end.cost):
            return None
        theta = np.asarray(end.theta)
        residuals, slope = (np.asarray(x) for x in _weighed(self.fit.problem, end))
        cost = float(residuals @ residuals)
        others = np.arange(len(theta)) != self.index
        converged = step_length(residuals, slope[:, others]) < SHORT
        return Point(theta, cost - self.fit.best.cost, converged, self._tangent(slope))

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


@jit
def _weighed(problem: InverseProblem, end: End) -> tuple[AnyArray, AnyArray]:
    return problem.weigh(end.predicted, end.jacobian, end.theta)
