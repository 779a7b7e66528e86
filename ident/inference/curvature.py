"""Where intervals end: by the linear approximation, or on the cost itself where that is no parabola."""

import math

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.constrained_fit import ConstrainedFit
from ident.inference.information import half_width
from ident.inference.least_squares import End
from ident.inference.optima import Optimum
from ident.inference.problem import InverseProblem
from ident.inference.profile_path import profile_path

LEVEL = 0.95
"""Chance of covering the true value, of the intervals whose ends are looked at."""
LINEAR = 0.2
"""Share by which half an interval may differ from the linear one's half and still count as linear."""


def stretches(
    problem: InverseProblem, optimum: Optimum, end: End, which: Bool[np.ndarray, "P"]
) -> Float[np.ndarray, "P 2"]:
    """Return by what factor each half of an interval is longer than the linear one, below and above; infinite if open.

    One where the profile of the cost (see `profile`) says of the linear end that it is where it should be, to `LINEAR`;
    elsewhere the profile is followed to the end. What that does to coverage is in tests/benchmarks/README.md.

    Args:
        problem: what was fitted.
        optimum: where.
        end: the same as the end of a search.
        which: the parameters that are looked at.
    """
    found = np.ones((len(which), 2))
    for index in np.flatnonzero(which):
        constrained = ConstrainedFit(problem, optimum, end, int(index))
        found[index] = [_stretch(constrained, sign) for sign in (-1, 1)]
    return found


def _stretch(constrained: ConstrainedFit, sign: int) -> float:
    width = half_width(LEVEL)
    there = constrained.at(constrained.centre + sign * width * constrained.sd, [constrained.start()])
    if there and there.converged and abs(width / math.sqrt(max(there.delta_chi_squared, 1e-9)) - 1) <= LINEAR:
        return 1.0
    (bound,) = profile_path(constrained, sign, constrained.limit(), [width**2]).bounds
    return bound.distance / (width * constrained.sd)
