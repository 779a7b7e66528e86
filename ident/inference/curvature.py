"""Where intervals end: by the linear approximation, or on the cost itself where that is no parabola."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.constrained_fit import ConstrainedFit, Point
from ident.inference.information import half_width
from ident.inference.least_squares import End
from ident.inference.optima import Optimum
from ident.inference.problem import InverseProblem
from ident.inference.profile_path import profile_path

LEVEL = 0.95
"""Chance of covering the true value, of the intervals whose ends are looked at."""
BETTER = 1e-3
"""Fall of the cost below the optimum from which the fit is said to be beaten."""
LINEAR = 0.2
"""Share by which half an interval may differ from the linear one's half and still count as linear."""


def stretches(
    problem: InverseProblem, optimum: Optimum, end: End, which: Bool[np.ndarray, "P"]
) -> tuple[Float[np.ndarray, "P 2"], Float[np.ndarray, "P"] | None]:
    """Return by what factor each half of an interval is longer than the linear one, below and above; infinite if open.

    One where the profile of the cost (see `profile`) says of the linear end that it is where it should be, to `LINEAR`;
    elsewhere the profile is followed to the end. What that does to coverage is in tests/benchmarks/README.md.

    Args:
        problem: what was fitted.
        optimum: where.
        end: the same as the end of a search.
        which: the parameters that are looked at.

    Returns:
        Also theta where the cost is lowest on the way, if it falls below the optimum's: then there is a better optimum,
        and the factors mean nothing.
    """
    found, points = np.ones((len(which), 2)), list[Point]()
    for index in np.flatnonzero(which):
        constrained = ConstrainedFit(problem, optimum, end, int(index))
        for side, sign in enumerate((-1, 1)):
            found[index, side], seen = _stretch(constrained, sign)
            points += seen
    lowest = max(points, key=lambda point: _fall(optimum, point), default=None)
    return found, lowest.theta if lowest and _fall(optimum, lowest) > BETTER else None


def _stretch(constrained: ConstrainedFit, sign: int) -> tuple[float, Sequence[Point]]:
    """Return the factor of one half, and the points at which the cost was looked at."""
    width, start = half_width(LEVEL), constrained.start()
    there = constrained.at(constrained.centre + sign * width * constrained.sd, [start])
    if there and there.converged and abs(width / math.sqrt(max(there.delta_chi_squared, 1e-9)) - 1) <= LINEAR:
        return 1.0, [there]
    path = profile_path(constrained, sign, constrained.limit(), [width**2])
    return path.bounds[0].distance / (width * constrained.sd), [*path.points, there or start]


def _fall(optimum: Optimum, point: Point) -> float:
    """Return how far the cost is below the optimum's, less what speaks more against labels and the like there."""
    return -float(point.delta_chi_squared) - max(point.said - optimum.said, 0.0)
