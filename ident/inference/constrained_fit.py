"""An inverse problem in which one parameter is held and all others are fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ident.inference.fit import Fit
from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import STATIONARY, End, solve
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.jit import jit

PIN = 1e-5
"""Width of the pin, in standard deviations of the parameter, or in theta where that is less."""
GAIN = 1e-6
"""Fall of the cost that is not worth a further step."""
MORE = 3
"""Further searches where none has settled."""
STEEPEST = 5.0
"""The other parameters' theta are foreseen to move at most so many times as far as the pinned one's."""


class Point(NamedTuple):
    """A point of a profile.

    Attributes:
        theta: (P,) all parameters.
        rise: cost above the optimum's.
        settled: whether the other parameters' gradient vanishes.
        tangent: (P,) estimated d(theta) / d(theta of the pinned one) along the profile.
    """

    theta: Any
    rise: float
    settled: bool
    tangent: Any


@dataclass(frozen=True)
class ConstrainedFit:
    """A fitted problem with one parameter that is held.

    The pin is a narrow normal prior in place of the parameter's own, so that the program compiled for the fit serves
    all parameters. It moves the parameter by PIN^2 sd^2 / 2 times the slope of the cost, some 1e-10 of a standard
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
        theta = self.fit.best.theta
        _, slope = _weighed(self.fit.problem, End(theta, 0.0, theta, self.fit.predicted, self.fit.jacobian))
        return Point(theta, 0.0, self.fit.best.converged, self._tangent(np.asarray(slope)))

    def at(self, theta: float, near: Sequence[Point]) -> Point | None:
        """Fit all others with the pinned one at theta; None where the model has no answer.

        Args:
            theta: of the pinned parameter.
            near: points to start from. Each is tried with and without its tangent, until an attempt settles; if none
                does, as in a long valley, the best one goes on.
        """
        problem = self._held(theta)
        found: list[Point] = []

        def settles(guess: np.ndarray) -> bool:
            point = self._point(solve(problem, jnp.asarray(guess)))
            found.extend([] if point is None else [point])
            return point is not None and point.settled

        for point in near:
            for slope in (point.tangent, np.zeros_like(point.tangent)):
                guess = point.theta + slope * (theta - point.theta[self.index])
                guess[self.index] = theta
                if settles(guess):
                    return _best(found)
        for _ in range(MORE if found else 0):
            if settles(_best(found).theta):
                break
        return _best(found) if found else None

    def _held(self, theta: float) -> InverseProblem:
        items = list(self.fit.problem.parameters.items)
        item = items[self.index]
        centre = jnp.exp(theta) if item.positive else theta * item.scale
        width = PIN * min(self.sd, 1.0)
        items[self.index] = Parameter(item.paths, item.positive, item.start, centre, width, item.scale)
        return replace(self.fit.problem, parameters=Parameters(tuple(items)))

    def _point(self, end: End) -> Point | None:
        """Weigh where a search ended by the problem's own priors."""
        if not np.isfinite(end.cost):
            return None
        theta, gradient = np.asarray(end.theta), np.asarray(end.gradient)
        residuals, slope = (np.asarray(x) for x in _weighed(self.fit.problem, end))
        cost = float(residuals @ residuals)
        others = np.arange(len(theta)) != self.index
        settled = _settled(residuals, slope[:, others], gradient[others])
        return Point(theta, cost - self.fit.best.cost, settled, self._tangent(slope))

    def _tangent(self, slope: np.ndarray) -> np.ndarray:
        """Return how the others follow in the linear approximation; the shortest way where that is open."""
        tangent, others = np.zeros(slope.shape[1]), np.arange(slope.shape[1]) != self.index
        if not np.isfinite(slope).all():
            return tangent
        # the pinned parameter's own prior lies in a row of its own and so moves no other
        follow = -np.linalg.lstsq(slope[:, others], slope[:, self.index], rcond=RANK_TOLERANCE)[0]
        tangent[others] = np.clip(follow, -STEEPEST, STEEPEST)
        return tangent


def _best(points: Sequence[Point]) -> Point:
    """Return the point of least cost; a settled one where that makes next to no difference."""
    return min(points, key=lambda point: point.rise - GAIN * point.settled)


@jit
def _weighed(problem: InverseProblem, end: End) -> tuple[Array, Array]:
    return problem.weigh(end.predicted, end.jacobian, end.theta)


def _settled(residuals: np.ndarray, slope: np.ndarray, gradient: np.ndarray) -> bool:
    """Tell whether a search has ended: the gradient vanishes, or a further step would gain next to nothing."""
    if np.abs(gradient).max(initial=0.0) < STATIONARY * (1 + residuals @ residuals):
        return True
    if not np.isfinite(slope).all():
        return False
    step = np.linalg.lstsq(slope, residuals, rcond=RANK_TOLERANCE)[0]
    return bool(np.sum((slope @ step) ** 2) < GAIN)
