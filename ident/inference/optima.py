"""Optima of a fit: merge the ends of its searches, sort them by score, and find how well each is determined."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.information import (
    RANK_TOLERANCE,
    WEAK_ABOVE,
    Direction,
    Information,
    alone,
    half_width,
    information,
)
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import OPTIMUM_STEP, Convergence, End, Row, searched, solve, step_length, weighed

Ended = tuple[End, Convergence]
"""End point of a search, and its convergence."""
TIE, DIGITS = 1e-6, 4
"""Relative cost difference treated as equal; decimals of theta, and of a distance, that order ties."""
SAME = 1e-3
"""Distance of two ends, in standard deviations of the data or of theta, below which they are one optimum; assumed."""


@dataclass(frozen=True)
class Optimum:
    """An optimum in which one or several starts ended.

    Attributes:
        values: (P,) parameters [SI].
        theta: (P,) the same, unconstrained.
        cost: sum of squared residuals, data and prior.
        starts: number of starts that ended here.
        converged: whether the next step is negligible in all but the open directions.
        open: (N, P) directions in theta along which the cost stays flat or still falls over several e-folds.
        sd: (P,) standard deviation of each theta by data and prior at this point.
        said: label cost: minus twice the logarithm of the probability of the mode labels.
    """

    values: Float[np.ndarray, "P"]
    theta: Float[np.ndarray, "P"]
    cost: float
    starts: int
    converged: bool
    open: Float[np.ndarray, "N P"]
    sd: Float[np.ndarray, "P"]
    said: float = 0.0

    @property
    def score(self) -> float:
        """Cost plus label cost: the quantity that ranks optima."""
        return self.cost + self.said


def rivals(optima: Sequence[Optimum]) -> tuple[Optimum, ...]:
    """Return the competing optima: those whose cost is within the 95 % limit of the best one's."""
    limit = optima[0].score + half_width(0.95) ** 2
    return tuple(optimum for optimum in optima[1:] if optimum.converged and optimum.score < limit)


def unmet(optima: Sequence[Optimum]) -> float:
    """Return the expected number of unseen optima beyond the best one and its competitors.

    If n starts ended in w different optima, w (n - 1) / (n - w - 2) are expected in all, for independent starts and a
    uniform prior over the sizes of the optima's basins (Boender & Rinnooy Kan, "Bayesian stopping rules for multistart
    global optimization methods", Math. Programming 37, 1987). If all starts ended in one optimum, none is expected.
    """
    near = [optima[0], *rivals(optima)]
    n, w = sum(optimum.starts for optimum in near), len(near)
    if w == 1:
        return 0.0
    return w * (n - 1) / (n - w - 2) - w if n > w + 2 else np.inf


def distinct(problem: InverseProblem, ends: list[Ended]) -> tuple[Optimum, ...]:
    """Merge ends that data and prior cannot separate: a flat valley is one optimum, however long and curved.

    Ends that have not converged are dropped, except the best one.
    """
    groups: list[list[Ended]] = []
    prior_sd = normal_prior_sd(problem)
    for end, how in in_order(problem, ends):
        for group in groups:
            first, _ = group[0]
            step = end.theta - first.theta
            apart = np.concatenate([problem.scaled(np.asarray(first.jacobian @ step)), step / prior_sd])
            near = min(np.linalg.norm(apart), np.abs(step).max()) < SAME * (1 + end.cost) ** 0.5
            level = abs(end.cost - first.cost) < SAME * SAME * (1 + end.cost)
            if level and not near:  # a valley: data and prior together do not determine a direction
                rows = np.vstack([problem.scaled(np.asarray(first.jacobian)), np.diag(1 / prior_sd)])
                s = np.linalg.svd(rows, compute_uv=False)
                near = s[-1] < RANK_TOLERANCE * s[0]
            if near:
                group.append((end, how))
                break
        else:
            groups.append([(end, how)])
    optima = [group for i, group in enumerate(groups) if i == 0 or any(how.converged for _, how in group)]
    return tuple(_optimum(problem, group) for group in optima)


def in_order(problem: InverseProblem, ends: list[Ended]) -> list[Ended]:
    """Sort ends by score; ties by distance from the priors' centre, then by theta: reproducible on any machine."""
    parameters = problem.parameters
    centre, scale = parameters.theta_centre, np.minimum(parameters.normal_sd, 1.0)
    ranks: list[tuple[int, float, tuple[float, ...], int]] = []
    scores = [end.score for end, _ in ends]  # each once, as ends are sorted after every start
    places = sorted(range(len(ends)), key=scores.__getitem__)
    ends, scores = [ends[place] for place in places], [scores[place] for place in places]
    for i, (end, _) in enumerate(ends):
        level = ranks[-1][0] if i and is_tie(scores[i - 1], scores[i]) else i
        off = (end.theta - centre) / scale
        ranks.append((level, round(float(off @ off), DIGITS), tuple(np.round(end.theta, DIGITS).tolist()), i))
    return [ends[rank[-1]] for rank in sorted(ranks)]


def is_tie(a: float, b: float) -> bool:
    """Whether two costs are equal up to rounding and the searches' stopping tolerance."""
    return abs(a - b) < TIE * (1 + abs(a))


def _optimum(problem: InverseProblem, group: list[Ended]) -> Optimum:
    first, how = group[0]
    scaled = problem.scaled(np.asarray(first.jacobian))
    return Optimum(
        np.asarray(problem.parameters.values(first.theta)),
        first.theta,
        float(first.cost),
        len(group),
        any(how.converged for _, how in group),
        how.open,
        information(scaled, normal_prior_sd(problem), problem.parameters.names).sd,
        float(first.choice.cost.sum()),
    )


def normal_prior_sd(problem: InverseProblem) -> np.ndarray:
    """Return the priors' standard deviations in theta; infinite for flat priors, whose edges are one-sided."""
    parameters = problem.parameters
    return np.where(np.asarray(parameters.column("flat")) > 0, np.inf, np.asarray(parameters.column("prior_sd")))


# -------- Constrained fit
# One parameter is held fixed, and all others are fitted.

WIDTH = 1e-5
"""Width of the narrow prior that holds a parameter, in its standard deviations, or in theta if that is less."""
GAIN = 1e-6
"""Smallest fall of the cost that justifies another step; assumed."""
MORE = 3
"""Further searches if none has converged."""
BEYOND = 100.0
"""Delta chi-squared beyond every interval, ten standard deviations: there a point needs no further accuracy."""
REACH = 1000.0
"""Factor on a positive parameter beyond which a profile counts as open; for the others, ln(REACH) units of theta or
standard deviations, whichever is more."""
STEEPEST = 5.0
"""Largest predicted move of the other parameters' theta, as a multiple of the held parameter's move."""


class Point(NamedTuple):
    """A point of a profile.

    Attributes:
        theta: (P,) all parameters.
        delta_chi_squared: rise of the cost above the optimum's, data and priors.
        converged: whether the other parameters' next step is negligible.
        tangent: (P,) estimated d(theta) / d(theta of the held parameter) along the profile.
        choice: the model's assignment of values to modes; None if the model has no choice.
        said: label cost.
    """

    theta: Any
    delta_chi_squared: float
    converged: bool
    tangent: Any
    choice: Any = None
    said: float = 0.0


@dataclass(frozen=True)
class ConstrainedFit:
    """A fitted problem with one parameter held fixed.

    A narrow normal prior holds the parameter in place of its own prior, so that the program compiled for the fit serves
    all parameters. The parameter then moves by WIDTH^2 sd^2 / 2 times the slope of the cost, some 1e-10 of a standard
    deviation. The cost of this prior does not depend on the others, so their fit is exact for the actual value.

    Attributes:
        problem: the fitted problem.
        optimum: its optimum.
        end: the same optimum as the end of a search; others may adopt its choice.
        index: index of the parameter in theta.
    """

    problem: InverseProblem
    optimum: Optimum
    end: End
    index: int

    @property
    def sd(self) -> float:
        """Standard deviation of the parameter's theta in the linear approximation, possibly infinite."""
        return float(self.optimum.sd[self.index])

    @property
    def centre(self) -> float:
        """The parameter's fitted theta."""
        return float(self.optimum.theta[self.index])

    def limit(self, reach: float = REACH) -> float:
        """Return the largest distance in theta of a search, see `REACH`."""
        wide = not self.problem.parameters.items[self.index].positive and 1 < self.sd < math.inf
        return math.log(reach) * (self.sd if wide else 1.0)

    def start(self) -> Point:
        """Return the optimum."""
        _, slope = weighed(self.problem, self.end)
        tangent = self._tangent(slope)
        return Point(self.optimum.theta, 0.0, self.optimum.converged, tangent, self.end.choice.held, self.optimum.said)

    def at(self, theta: float, near: Sequence[Point]) -> Point | None:
        """Fit all others with the held parameter at theta; None where the model has no solution.

        Args:
            theta: of the held parameter.
            near: points to start from, each with and without its tangent, until an attempt converges. If none does, as
                in a long valley, the best one continues.
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
            choice = None if self.end.choice.settled else best.choice
            if best.delta_chi_squared > BEYOND or converges(best.theta, choice):
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
        """Evaluate the end of a search under the problem's own priors."""
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
        """Return how the others follow in the linear approximation: the shortest solution if that is undetermined."""
        tangent, others = np.zeros(slope.shape[1]), np.arange(slope.shape[1]) != self.index
        if not np.isfinite(slope).all():
            return tangent
        # the held parameter's prior has its own row and so moves no other parameter
        follow = -np.linalg.lstsq(slope[:, others], slope[:, self.index], rcond=RANK_TOLERANCE)[0]
        tangent[others] = np.clip(follow, -STEEPEST, STEEPEST)
        return tangent


def _best(points: Sequence[Point]) -> Point:
    """Return the point of least cost; a converged one if its cost is practically the same."""
    return min(points, key=lambda point: point.delta_chi_squared - GAIN * point.converged)


# -------- Profile path
# One side of a profile: the path outwards from the optimum, and its crossings of the thresholds.

FIRST = 0.1
"""Largest first step in theta."""
FINE, COARSE = 0.3, 0.7
"""Increase of sqrt(delta chi-squared) per step: target, and largest allowed."""
EDGE = 1e-5
"""Accuracy of an interval's end, as a share of its distance from the optimum."""


class Ending(StrEnum):
    """Why an interval ends on one side: threshold met, not met within reach, or the model ends before it."""

    CROSSED = "crossed"
    OPEN = "open"
    MODEL = "bounded by the model"


@dataclass(frozen=True)
class Bound:
    """End of an interval on one side.

    Attributes:
        distance: from the optimum in theta, infinite if open.
        ending: the reason.
    """

    distance: float
    ending: Ending


@dataclass(frozen=True)
class Side:
    """One side of a profile.

    Attributes:
        points: of the path, from the optimum outwards.
        bounds: one for each threshold.
    """

    points: tuple[Point, ...]
    bounds: tuple[Bound, ...]


def profile_path(constrained: ConstrainedFit, sign: int, limit: float, thresholds: Sequence[float]) -> Side:
    """Follow a profile to one side until the highest threshold, the limit or the end of the model.

    Each interval reaches to the outermost crossing of its threshold on the path, so that intervals are nested.

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
    """Return the points by their distance, and why the path ends.

    Steps grow where the profile is flat and shrink where it is steep. They are halved towards the end of the model and
    towards a jump; beyond a jump they start with the first length again.
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
        point = constrained.at(constrained.centre + sign * there, [path[here]])
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
    """Return where the profile finally leaves an interval; points computed on the way are added to the path."""
    from scipy.optimize import brentq  # slow to import, and a fit with near-linear intervals does not need it

    places = sorted(path)
    last = max(i for i, place in enumerate(places) if path[place].delta_chi_squared <= level or i == 0)
    if last == len(places) - 1:
        return Bound(math.inf if ending is Ending.OPEN else places[last], ending)

    def excess(distance: float) -> float:
        if distance not in path:
            inside = max(place for place in path if place < distance)
            outside = min(place for place in path if place > distance)
            point = constrained.at(constrained.centre + sign * distance, [path[inside], path[outside]])
            if point is None:
                return math.sqrt(level)
            path[distance] = point
        return _root(path[distance]) - math.sqrt(level)

    inside, outside = places[last], places[last + 1]
    if excess(inside) >= 0:
        return Bound(inside, Ending.CROSSED)
    return Bound(float(brentq(excess, inside, outside, xtol=EDGE * outside)), Ending.CROSSED)


def _root(point: Point) -> float:
    return math.sqrt(max(point.delta_chi_squared, 0.0))


# -------- Curvature
# Ends of intervals, and widths of combinations: linear, or from the cost itself where it is not quadratic.

LEVEL = 0.95
"""Coverage probability of the intervals."""
BETTER = 1e-3
"""Fall of the cost below the optimum that counts as a better optimum; assumed."""
LINEAR = 0.2
"""Relative deviation of an interval's half from the linear half that still counts as linear; assumed."""
LOOKS, NEAR, LONGEST = 8, 0.1, 6.0
"""Most constrained searches for an end of a combination, the relative accuracy of the end, and the largest ratio of
successive distances."""


def stretches(
    problem: InverseProblem, optimum: Optimum, end: End, which: Bool[np.ndarray, "P"]
) -> tuple[Float[np.ndarray, "P 2"], Float[np.ndarray, "P"] | None]:
    """Return the interval scales: each half over the linear half, below and above; infinite if open.

    The scale is 1 if the profile of the cost (see `profile`) confirms the linear end to `LINEAR`; otherwise the profile
    is followed to the end. The effect on coverage is in tests/benchmarks/README.md.

    Args:
        problem: the fitted problem.
        optimum: its optimum.
        end: the same optimum as the end of a search.
        which: parameters to examine.

    Returns:
        Also the theta of lowest cost on the way, if that is below the optimum's: then there is a better optimum, and
        the scales are meaningless.
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
    """Return the scale of one half, and the points at which the cost was computed."""
    width, start = half_width(LEVEL), constrained.start()
    there = constrained.at(constrained.centre + sign * width * constrained.sd, [start])
    if there and there.converged and abs(width / math.sqrt(max(there.delta_chi_squared, 1e-9)) - 1) <= LINEAR:
        return 1.0, [there]
    path = profile_path(constrained, sign, constrained.limit(), [width**2])
    return path.bounds[0].distance / (width * constrained.sd), [*path.points, there or start]


def _fall(optimum: Optimum, point: Point) -> float:
    """Return how far the cost is below the optimum's, less the rise of the label cost."""
    return -float(point.delta_chi_squared) - max(point.said - optimum.said, 0.0)


def fixed_combinations(
    problem: InverseProblem, end: End, known: Information, *, widths: bool = True
) -> tuple[Direction, ...]:
    """Return the combinations that the data determine, each with its profile's width as standard deviation.

    The linear standard deviation of a combination w'theta holds near the optimum only: where the cost is not quadratic
    along the other combinations, w turns on the way, and the product is less well determined, much less with few data.
    So theta is fitted again with w'theta held, by data and priors, outwards on both sides until the cost has risen to
    the 95 % limit; half the distance of the two ends, over 1.96, is the standard deviation.

    Args:
        problem: the fitted problem.
        end: the optimum, as the end of a search.
        known: information of data and priors there.
        widths: whether to compute the widths; NaN otherwise.

    Returns:
        One for each direction of `known` that is not open, as a single parameter if the others are negligible
        (`alone`); infinite if an end is not met within `REACH`, NaN if the cost falls below the optimum's.
    """
    found = []
    for direction in known.directions:
        if not direction.open:
            weights = alone(direction.weights)
            ends = [_distance(problem, end, sign * weights, known) for sign in (-1, 1)] if widths else [math.nan]
            found.append(Direction(weights, sum(ends) / (2 * half_width(LEVEL))))
    return tuple(found)


def _distance(problem: InverseProblem, end: End, weights: Float[np.ndarray, "P"], known: Information) -> float:
    """Return the rise of w'theta at which the least cost reaches the 95 % limit."""
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
    """Return offsets of a search's start: zero, and in a long valley also a step along it.

    At its middle the cost may be stationary, though it falls to both sides: springs in series of equal stiffness.
    """
    variance, axes = np.linalg.eigh(covariance)
    step = math.sqrt(variance[-1]) * axes[:, -1]
    return [0 * step, step] if variance[-1] > WEAK_ABOVE**2 else [0 * step]


def _next_distance(path: Mapping[float, float], width: float, furthest: float) -> float:
    """Return the distance at which the root of the rise is expected to reach the width.

    Extrapolation is by a power of the distance: 1 in the linear approximation, less where the valley turns away.
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
    """Fit theta with w'theta held; the cost is that of data and priors alone."""
    held = None if optimum.choice.held is None else optimum.choice.held.by_shape()
    end, _ = searched(problem, start, held, row=Row(weights, np.array(value), np.array(WIDTH)))
    residuals, _ = weighed(problem, end)
    return end._replace(cost=residuals @ residuals)
