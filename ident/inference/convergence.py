"""Whether a search has ended in an optimum: how far the next step would lead, in standard deviations."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ident.inference.information import RANK_TOLERANCE
from ident.inference.least_squares import End, evaluate
from ident.inference.problem import InverseProblem

OPTIMUM_STEP = 1e-3
"""Length of the Gauss-Newton step [sd] below which a point is an optimum."""
SEVERAL = 3.0
"""Way in theta, e-folds of a stiffness, over which, and over as much again, an open direction's cost does not rise."""
RISE = 1e-2
"""Rise of the cost over that way that would not be noticed."""


class Convergence(NamedTuple):
    """How a search ended.

    Attributes:
        step: [sd] length of the next Gauss-Newton step in all directions but the open ones.
        open: (N, P) directions in theta along which the cost stays flat or still falls over several e-folds.
    """

    step: float
    open: Float[np.ndarray, "N P"]

    @property
    def converged(self) -> bool:
        """Whether this is an optimum in all directions but the open ones."""
        return self.step < OPTIMUM_STEP


def convergence(problem: InverseProblem, end: End) -> Convergence:
    """Measure the next step from where a search ended.

    With residuals r and their slope J = U S V', the Gauss-Newton step is -V S^-1 U'r. In standard deviations of the
    linear approximation, V S^-1, its components are those of U'r: a gradient, measured by what is known.
    Directions of which J sees nothing are open, and so are those known to less than several e-folds along which the
    model itself shows that the cost does not rise.
    """
    residuals, slope = weighed(problem, end)
    if not (np.isfinite(residuals).all() and np.isfinite(slope).all()):
        return Convergence(np.inf, np.empty((0, len(end.theta))))
    components, s, Vt = _next_step(residuals, slope)
    open_ones = s <= RANK_TOLERANCE * max(s[0], 1e-300)
    far = ~open_ones & (s < 1 / SEVERAL) & (np.abs(components) >= OPTIMUM_STEP)
    for i in np.flatnonzero(far):
        step = -np.sign(components[i]) * SEVERAL * Vt[i]
        there, beyond = (_cost(problem, np.asarray(end.theta) + times * step) for times in (1, 2))
        open_ones[i] = there < float(end.cost) + RISE and beyond < there + RISE
    return Convergence(float(np.linalg.norm(components[~open_ones])), Vt[open_ones])


def step_length(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> float:
    """Return the length of the next step [sd] in all directions that are seen; infinite where there is no slope."""
    if not np.isfinite(slope).all():
        return np.inf
    components, s, _ = _next_step(residuals, slope)
    return float(np.linalg.norm(components[s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)]))


def _next_step(
    residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "P"], Float[np.ndarray, "P P"]]:
    """Return the next step's components [sd] along the slope's right singular vectors, singular values, and those."""
    padded = np.vstack([slope, np.zeros((slope.shape[1], slope.shape[1]))])
    U, s, Vt = np.linalg.svd(padded, full_matrices=False)
    return U[: len(residuals)].T @ residuals, s, Vt


def _cost(problem: InverseProblem, theta: Float[np.ndarray, "P"]) -> float:
    residuals, _ = weighed(problem, evaluate(problem, theta))
    return float(residuals @ residuals) if np.isfinite(residuals).all() else np.inf


def weighed(problem: InverseProblem, end: End) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals and their slope, without a program for them."""
    residuals, slope = problem.weigh(*(np.asarray(part) for part in (end.predicted, end.jacobian, end.theta)))
    return np.asarray(residuals), np.asarray(slope)
