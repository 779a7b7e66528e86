"""One side of a profile: the path outwards from the optimum, and where it meets the thresholds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ident.inference.constrained_fit import ConstrainedFit, Point

FIRST = 0.1
"""Largest first step in theta."""
FINE, COARSE = 0.3, 0.7
"""Increase of sqrt(delta chi-squared) that a step aims at, and the largest that it may bring."""
EDGE = 1e-5
"""Accuracy of an end, as a share of its distance from the optimum."""


class Ending(StrEnum):
    """Why an interval ends on one side: its cost is met, it is not met within reach, or the model ends before it."""

    CROSSED = "crossed"
    OPEN = "open"
    MODEL = "bounded by the model"


@dataclass(frozen=True)
class Bound:
    """Where an interval ends on one side.

    Attributes:
        distance: from the optimum in theta, infinite where open.
        ending: why.
    """

    distance: float
    ending: Ending


@dataclass(frozen=True)
class Side:
    """One side of a profile.

    Attributes:
        points: from the optimum outwards.
        bounds: one for each threshold.
    """

    points: tuple[Point, ...]
    bounds: tuple[Bound, ...]


def profile_path(constrained: ConstrainedFit, sign: int, limit: float, thresholds: Sequence[float]) -> Side:
    """Follow a profile to one side until the highest threshold, the limit or the end of the model.

    Each interval reaches to the outermost crossing of its threshold that the path meets, so none leaves the next one.

    Args:
        constrained: the problem, with one parameter held.
        sign: -1 towards smaller, 1 towards larger theta.
        limit: distance in theta at which the path ends.
        thresholds: of delta chi-squared, ascending.
    """
    path, ending = _outwards(constrained, sign, limit, thresholds[-1])
    bounds = tuple(_bound(constrained, sign, path, ending, level) for level in thresholds)
    return Side(tuple(point for _, point in sorted(path.items())), bounds)


def _outwards(constrained: ConstrainedFit, sign: int, limit: float, top: float) -> tuple[dict[float, Point], Ending]:
    """Return the points by their distance, and why there are no more.

    Steps grow where the profile is flat and shrink where it is steep. Towards the end of the model they are halved, and
    towards a jump; beyond one they are as long as the first.
    """
    here, wall = 0.0, math.inf
    step = first = min(FIRST, FINE * constrained.sd)
    path = {here: constrained.start()}
    while path[here].delta_chi_squared <= top:
        if here >= limit:
            return path, Ending.OPEN
        if wall - here <= EDGE * max(min(wall, limit), first):
            return path, Ending.MODEL
        there = min(here + step, limit, (here + wall) / 2)
        point = constrained.at(_theta(constrained, sign, there), [path[here]])
        if point is None:
            wall = there
            continue
        gain = _root(point) - _root(path[here])
        if gain > COARSE and there - here > EDGE * max(there, first):
            step = (there - here) / 2
            continue
        path[there] = point
        going_on = (there - here) * min(max(FINE / max(gain, 1e-9), 0.5), 2.0)
        step, here = first if abs(gain) > COARSE else going_on, there
    return path, Ending.CROSSED


def _bound(constrained: ConstrainedFit, sign: int, path: dict[float, Point], ending: Ending, level: float) -> Bound:
    """Find where the profile leaves an interval for good; the points that it takes are added to the path."""
    from scipy.optimize import brentq  # long to import, and a fit of short intervals needs none

    places = sorted(path)
    last = max(i for i, place in enumerate(places) if path[place].delta_chi_squared <= level or i == 0)
    if last == len(places) - 1:
        return Bound(math.inf if ending is Ending.OPEN else places[last], ending)

    def excess(distance: float) -> float:
        if distance not in path:
            inside = max(place for place in path if place < distance)
            outside = min(place for place in path if place > distance)
            point = constrained.at(_theta(constrained, sign, distance), [path[inside], path[outside]])
            if point is None:
                return math.sqrt(level)
            path[distance] = point
        return _root(path[distance]) - math.sqrt(level)

    inside, outside = places[last], places[last + 1]
    if excess(inside) >= 0:
        return Bound(inside, Ending.CROSSED)
    return Bound(float(brentq(excess, inside, outside, xtol=EDGE * outside)), Ending.CROSSED)


def _theta(constrained: ConstrainedFit, sign: int, distance: float) -> float:
    return constrained.centre + sign * distance


def _root(point: Point) -> float:
    return math.sqrt(max(point.delta_chi_squared, 0.0))
