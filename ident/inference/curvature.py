"""Where intervals, and widths of combinations, end: by the linear approximation, or on the cost where it bends."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.constrained_fit import REACH, WIDTH, ConstrainedFit, Point
from ident.inference.convergence import weighed
from ident.inference.gauss_newton import minimum
from ident.inference.information import WEAK_ABOVE, Direction, Information, alone, half_width
from ident.inference.least_squares import End, look
from ident.inference.optima import Optimum
from ident.inference.problem import InverseProblem
from ident.inference.profile_path import profile_path

LEVEL = 0.95
"""Chance of covering the true value, of the intervals whose ends are looked at."""
BETTER = 1e-3
"""Fall of the cost below the optimum from which the fit is said to be beaten."""
LINEAR = 0.2
"""Share by which half an interval may differ from the linear one's half and still count as linear."""
LOOKS, NEAR, LONGEST = 8, 0.1, 6.0
"""Constrained searches for an end of a combination at most, the share within which it is found, and the factor by which
one reaches beyond the last at most."""


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


def fixed_combinations(
    problem: InverseProblem, end: End, known: Information, *, widths: bool = True
) -> tuple[Direction, ...]:
    """Return the combinations that the data fix, each with the width of its profile as its standard deviation.

    The linear standard deviation of a combination w'theta is a promise about the optimum's surroundings only: where
    the cost bends along the other combinations, w turns on the way, and the product is known less well, by much where
    data are few. So theta is fitted again with w'theta held, by data and priors, outwards on both sides until the cost
    has risen to the 95 % limit; half the distance of the two ends, over 1.96, is the standard deviation.

    Args:
        problem: what was fitted.
        end: the optimum, as the end of a search.
        known: what data and priors tell there.
        widths: whether to look for the widths; NaN otherwise.

    Returns:
        One for each direction of `known` that is not open, as one parameter where it is hardly more (`alone`); infinite
        where an end is not met within `REACH`, NaN where the cost falls below the optimum's.
    """
    found = []
    for direction in known.directions:
        if not direction.open:
            weights = alone(direction.weights)
            ends = [_distance(problem, end, sign * weights, known) for sign in (-1, 1)] if widths else [math.nan]
            found.append(Direction(weights, sum(ends) / (2 * half_width(LEVEL))))
    return tuple(found)


def _distance(problem: InverseProblem, end: End, weights: Float[np.ndarray, "P"], known: Information) -> float:
    """Return how far w'theta may rise until the least cost has risen to the 95 % limit."""
    width, furthest = half_width(LEVEL), math.log(REACH)
    covariance = np.nan_to_num(known.covariance, nan=0.0, posinf=furthest**2)
    sd = math.sqrt(weights @ covariance @ weights)
    path = {0.0: (0.0, np.asarray(end.theta))}  # root of the rise, and theta, by distance
    follow = covariance @ weights / sd**2  # how theta moves per unit of w'theta in the linear approximation
    distance, steps = min(width * sd, furthest), _aside(covariance)
    for _ in range(LOOKS):
        answered = [known for known, (root, _) in path.items() if np.isfinite(root)]
        nearest = min(answered, key=lambda known: abs(known - distance))
        start = path[nearest][1] + follow * (distance - nearest)
        value = float(weights @ path[0.0][1]) + distance
        reached = [_with_held(problem, end, weights, value, start + step) for step in steps]
        there = min(reached, key=lambda each: np.nan_to_num(each.cost, nan=np.inf))
        rise = float(there.cost) - float(end.cost)
        if rise < -BETTER:
            return math.nan
        root = math.sqrt(max(rise, 0.0))
        if abs(root / width - 1) <= NEAR:
            return distance * width / root
        if root < width and distance >= furthest:
            return math.inf
        if np.isfinite(root):
            follow, steps = (there.theta - path[nearest][1]) / (distance - nearest), steps[:1]
        path[distance] = (root, np.asarray(there.theta))
        distance = _next_distance({known: root for known, (root, _) in path.items()}, width, furthest)
    return distance


def _aside(covariance: Float[np.ndarray, "P P"]) -> list[Float[np.ndarray, "P"]]:
    """Return steps from where a search begins: none, and where a valley is long, another along it.

    At its middle the cost may be level to both sides, though it falls there: springs in series of equal stiffness.
    """
    variance, axes = np.linalg.eigh(covariance)
    step = math.sqrt(variance[-1]) * axes[:, -1]
    return [0 * step, step] if variance[-1] > WEAK_ABOVE**2 else [0 * step]


def _next_distance(path: Mapping[float, float], width: float, furthest: float) -> float:
    """Return where the root of the rise is expected to meet the width, of its values by distance.

    Outwards as a power of the distance, one in the linear approximation, less where the valley turns away.
    """
    near = max(distance for distance, root in path.items() if root < width)
    far = min((distance for distance, root in path.items() if not root < width), default=math.inf)
    low = max(path[near], 1e-9)
    if math.isfinite(far):
        share = (width - low) / (path[far] - low) if math.isfinite(path[far]) else 0.5
        return near + (far - near) * min(max(share, 0.1), 0.9)
    before = max((distance for distance in path if 0 < distance < near), default=0.0)
    power = math.log(low / max(path[before], 1e-9)) / math.log(near / before) if before else 1.0
    return min(near * min((width / low) ** (1 / max(power, 0.3)), LONGEST), furthest)


def _with_held(
    problem: InverseProblem, optimum: End, weights: Float[np.ndarray, "P"], value: float, start: Float[np.ndarray, "P"]
) -> End:
    """Fit theta with w'theta held, as by a narrow normal prior; the cost is that of data and priors alone."""

    def weigh(end: End) -> tuple[np.ndarray, np.ndarray]:
        residuals, slope = weighed(problem, end)
        return np.append(residuals, (weights @ end.theta - value) / WIDTH), np.vstack([slope, weights / WIDTH])

    def look_there(theta: Float[np.ndarray, "P"], held: Any) -> End:
        here = look(problem, theta, held)
        return here._replace(cost=here.cost + ((weights @ theta - value) / WIDTH) ** 2)

    held = None if optimum.choice.held is None else optimum.choice.held.likened()
    end, _ = minimum(look_there, weigh, start, held, True)
    residuals, _ = weighed(problem, end)
    return end._replace(cost=residuals @ residuals)
