"""The solver of a search among data so many that each look at the model counts: one for each step.

Gauss-Newton with Marquardt's damping where a step leads upwards (Marquardt, J. SIAM 11, 1963), in NumPy.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ident.inference.information import RANK_TOLERANCE

if TYPE_CHECKING:
    from ident.inference.least_squares import End

MAX_STEPS = 200
SHORT = 1e-3
"""Length of the next step [sd] that is taken along a straight line without another look, and ends the search."""
LEVEL = 1e-10
"""Rise of the cost, relative to one plus the cost, that is rounding."""
DAMPING, FACTOR, LEAST, MOST = 1e-3, 10.0, 1e-9, 1e12
"""Damping after the first step that leads upwards, its factor from one to the next, where it is none, and where nothing
is left to gain."""
GAINS = 0.25, 0.75
"""Shares of the foreseen fall of the cost below which a step was too long, and above which a longer one may do."""

Look = Callable[[Float[np.ndarray, "P"], Any], "End"]
Weigh = Callable[["End"], tuple[Float[np.ndarray, "R"], Float[np.ndarray, "R P"]]]


def minimum(
    look: Look, weigh: Weigh, start: Float[np.ndarray, "P"], held: Any, to_the_end: bool, steps: int = MAX_STEPS
) -> "tuple[End, bool]":
    """Minimise a sum of squares from a start; return where, and whether it has ended before it ran out of steps.

    Args:
        look: predicts at theta, by what the model holds.
        weigh: gives residuals and their slope there.
        start: theta.
        held: what the model holds at the first point.
        to_the_end: whether it goes on where the model would choose anew.
        steps: at most.
    """
    here, damping = look(start, held), 0.0
    for _ in range(steps):
        residuals, slope = weigh(here)
        if not (np.isfinite(here.cost) and np.isfinite(slope).all() and (to_the_end or here.choice.settled)):
            return here, True
        if damping > MOST:
            return here, True
        if _length(residuals, slope) < SHORT:
            return _along_the_line(here, _step(residuals, slope, 0.0), weigh), True
        step = _step(residuals, slope, damping)
        there = look(here.theta + step, here.choice.held)
        foreseen = here.cost - ((residuals + slope @ step) ** 2).sum()
        gain = (here.cost - there.cost) / max(foreseen, 1e-300)
        damping = _next_damping(damping, gain)
        if there.cost <= here.cost + LEVEL * (1 + here.cost):
            here = there
    return here, False


def _next_damping(damping: float, gain: float) -> float:
    """Return the damping after a step that has gained so much of what was foreseen; NaN where there is no answer."""
    if not gain > GAINS[0]:
        return FACTOR * damping or DAMPING
    if gain > GAINS[1]:
        return damping / FACTOR if damping > LEAST else 0.0
    return damping


def _along_the_line(here: "End", step: Float[np.ndarray, "P"], weigh: Weigh) -> "End":
    """Return where a short step leads: what bends on the way is less than the square of its length."""
    there = here._replace(theta=here.theta + step, predicted=here.predicted + here.jacobian @ step)
    residuals, slope = weigh(there)
    return there._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)


def _length(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> float:
    """Return the length of the next whole step in standard deviations, as in `convergence.convergence`."""
    U, s, _ = np.linalg.svd(slope, full_matrices=False)
    return float(np.linalg.norm((U.T @ residuals)[s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)]))


def _step(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"], damping: float) -> np.ndarray:
    """Return the step to the least cost along a straight line, with each coordinate damped by its own slope."""
    widths = np.sqrt(damping) * np.linalg.norm(slope, axis=0)
    damped = np.vstack([slope, np.diag(widths)])
    step, *_ = np.linalg.lstsq(damped, -np.append(residuals, np.zeros(len(widths))), rcond=RANK_TOLERANCE)
    return np.asarray(step)
