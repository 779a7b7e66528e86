"""Searches for the minimum of a least-squares problem: two solvers, convergence, many starts."""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.inference.information import RANK_TOLERANCE, reached
from ident.inference.parameters import AnyArray, Parameter, Parameters, library
from ident.inference.problem import Choice, InParts, InverseProblem
from ident.programs import jit

# -------- Gauss-Newton
# The solver outside of a program, where each look counts: many data, searches that look together. Gauss-Newton with
# Marquardt's damping where a step leads upwards (J. SIAM 11, 1963): optimistix's rule takes 6 to 36 % more looks.

T = TypeVar("T")
MAX_STEPS = 200
SHORT, LEAST_STEP = 1e-3, 1e-6
"""Lengths of the next step [sd] below which it is taken whole, and below which the search has ended."""
LEVEL = 1e-10
"""Rise of the cost, relative to one plus the cost, that is rounding."""
DAMPING, FACTOR, LEAST, MOST = 1e-3, 10.0, 1e-9, 1e12
"""Damping after the first step that leads upwards, its factor from one to the next, where it is none, and where nothing
is left to gain."""
GAINS = 0.25, 0.75
"""Shares of the foreseen fall of the cost below which a step was too long, and above which a longer one may do."""

MANY, BLOCK = 1000, 100
"""Residuals from which on their triangle takes less time than they do, and how many are taken at a time; measured."""

Weigh = Callable[["End"], tuple[Float[np.ndarray, "R"], Float[np.ndarray, "R P"]]]


def together(
    searches: "Sequence[Generator[Any, End, T]]",
    looks: "Callable[[list[Any]], list[End]]",
    ended: Callable[[], Any] = bool,
) -> list[T]:
    """Go on with several searches at once, and look where all of them want to at a time; return what they found.

    Args:
        searches: each yields where it wants to look.
        looks: what is there.
        ended: called whenever one has ended.
    """
    found: dict[int, T] = {}
    sent: dict[int, Any] = dict.fromkeys(range(len(searches)))
    while sent:
        asked = {}
        for i, end in sent.items():
            try:
                asked[i] = searches[i].send(end)
            except StopIteration as stop:
                found[i] = stop.value
                ended()
        sent = dict(zip(asked, looks(list(asked.values())) if asked else (), strict=True))
    return [found[i] for i in range(len(searches))]


def descent(
    weigh: Weigh,
    start: Float[np.ndarray, "P"],
    held: Any,
    to_the_end: bool,
    steps: int = MAX_STEPS,
    ask: Callable[[Float[np.ndarray, "P"], Any], Any] = lambda *where: where,
) -> "Generator[Any, End, tuple[End, bool]]":
    """Minimise a sum of squares from a start; return where, and whether it has ended before it ran out of steps.

    It yields where to look, and is sent what is predicted there, so that several searches may look together.

    Args:
        weigh: gives residuals and their slope there.
        start: theta.
        held: what the model holds at the first point.
        to_the_end: whether it goes on where the model would choose again.
        steps: at most.
        ask: what is yielded of theta and what the model holds at the last point.
    """

    def at(here: End) -> tuple[End, np.ndarray, np.ndarray]:
        residuals, slope = weigh(here)
        with np.errstate(over="ignore", invalid="ignore"):  # a pole at critical damping has no slope
            here = here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)
        if len(residuals) > MANY:  # the triangle of both has their lengths and angles, so all that a step needs
            both = _triangle(np.column_stack([slope, residuals]))
            residuals, slope = both[:, -1], both[:, :-1]
        return here, residuals, slope

    here, residuals, slope = at((yield ask(start, held)))
    damping, before = 0.0, math.inf
    for _ in range(steps):
        if not (np.isfinite(here.cost) and np.isfinite(slope).all() and (to_the_end or here.choice.settled)):
            return here, True
        if damping > MOST:
            return here, True
        length = step_length(residuals, slope)
        near = length < SHORT
        if length < LEAST_STEP or (near and length >= before):
            return here, True
        step = _step(residuals, slope, 0.0 if near else damping)
        there, *weighed = at((yield ask(here.theta + step, here.choice.held)))
        limit = here.cost + LEVEL * (1 + here.cost)
        if near:  # gains are rounding soon, and no measure of a step any more
            if there.cost > limit:
                return here, True
            before = length
        else:
            foreseen = here.cost - ((residuals + slope @ step) ** 2).sum()
            damping = _next_damping(damping, (here.cost - there.cost) / max(foreseen, 1e-300))
        if near or there.cost <= limit:
            here, (residuals, slope) = there, weighed
    return here, False


def _triangle(rows: Float[np.ndarray, "R p"]) -> Float[np.ndarray, "p p"]:
    """Return the triangle R of QR, some rows at a time: of many at once a library makes threads that wait."""
    blocks = np.pad(rows, ((0, -len(rows) % BLOCK), (0, 0))).reshape((-1, BLOCK, rows.shape[1]))
    return np.asarray(np.linalg.qr(np.concatenate(np.linalg.qr(blocks, mode="r")), mode="r"))


def _next_damping(damping: float, gain: float) -> float:
    """Return the damping after a step that has gained so much of what was foreseen; NaN where there is no answer."""
    if not gain > GAINS[0]:
        return FACTOR * damping or DAMPING
    if gain > GAINS[1]:
        return damping / FACTOR if damping > LEAST else 0.0
    return damping


def step_length(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> float:
    """Return the length of the next whole step [sd], as in `convergence`; infinite where there is no slope."""
    if not np.isfinite(slope).all():
        return np.inf
    return float(np.linalg.norm(reached(slope).T @ residuals))


def _step(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"], damping: float) -> np.ndarray:
    """Return the step to the least cost along a straight line, with each coordinate damped by its own slope."""
    widths = np.sqrt(damping) * np.linalg.norm(slope, axis=0)
    damped = np.vstack([slope, np.diag(widths)])
    step, *_ = np.linalg.lstsq(damped, -np.append(residuals, np.zeros(len(widths))), rcond=RANK_TOLERANCE)
    return np.asarray(step)


# -------- Least squares
# One search: Levenberg-Marquardt from one start, and the model with its Jacobian at a point.

WHOLE, NOTHING = np.array(1.0), np.array(0.0)
TO_THE_END, UNTIL_REMATCHED = np.array(True), np.array(False)
STEEP = 1e-2
"""Gradient of the cost by theta above which a search has not ended in an optimum; assumed."""
WORTH = 1e-7
"""Fall of the cost by a whole search that is worth another one; assumed."""
TURNS = 6
"""Searches in a row at most, each with another choice of what the values belong to, or more steps."""


class Row(NamedTuple):
    """A combination that a search holds, weights' theta = value: one more residual, zero if the width is infinite."""

    weights: Float[AnyArray, "P"]
    value: Float[AnyArray, ""]
    width: Float[AnyArray, ""]

    def weighed(self, theta: AnyArray, residuals: AnyArray, slope: AnyArray) -> tuple[Any, Any]:
        """Return residuals and their slope at theta with this one among them."""
        xp = library(theta, residuals, slope)
        off = (self.weights @ theta - self.value) / self.width
        return xp.append(residuals, off), xp.vstack([slope, self.weights / self.width])


class End(NamedTuple):
    """Where one start ended: theta, sum of squares and its gradient, predictions and Jacobian, the model's choice."""

    theta: Any
    cost: Any
    gradient: Any
    predicted: Any
    jacobian: Any
    choice: Choice

    @property
    def score(self) -> float:
        """Minus twice the logarithm of the probability of data, prior and what was said of each value."""
        return float(self.cost + self.choice.cost.sum())


def evaluate(problem: InverseProblem, theta: Float[AnyArray, "P"] | None = None) -> End:
    """Return predictions and their Jacobian at theta, or else at the parameters' starting values.

    No measured value is used: what values belong to is chosen by what was said of them alone. It is a search in which
    nothing counts, so that what was compiled for the fit serves here as well.
    """
    blank = replace(without_priors(problem), sigma=np.full_like(problem.sigma, np.inf))
    start = problem.parameters.theta_start if theta is None else theta
    return searched(blank, start, None, TO_THE_END, NOTHING)[0]


def look(problem: InverseProblem, theta: Float[AnyArray, "P"], held: Any) -> End:
    """Return what a search would find at theta, with what the model holds, without a step."""
    here = searched(problem, theta, held, TO_THE_END, NOTHING)[0]
    residuals, slope = (np.asarray(part) for part in problem.weigh(here.predicted, here.jacobian, np.asarray(theta)))
    return here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)


LANES = 16
"""Points at which several searches look together: that takes little more time than one."""


class Way(NamedTuple):
    """A point, the directions (P, p) in which slopes are asked for, and what the model holds there."""

    theta: Float[np.ndarray, "P"]
    directions: Float[np.ndarray, "P p"]
    held: Any


def looks(whole: InParts, ways: Sequence[Way], lanes: int = LANES) -> list[tuple[np.ndarray, np.ndarray, Choice]]:
    """Return predictions, their slopes (D, p) and the choice at several points, each with as many directions."""
    if len(whole.problems) > 1:
        each = (_predicted(whole, way.theta, way.held) for way in ways)
        return [(x, jacobian @ way.directions, choice) for (x, jacobian, choice), way in zip(each, ways, strict=True)]
    places, found = whole.parts.places, list[tuple[np.ndarray, np.ndarray, Choice]]()
    for first in range(0, len(ways), lanes):
        some = ways[first : first + lanes]
        stacked = jax.tree.map(lambda *x: np.stack(x), *some, *[some[0]] * (lanes - len(some)))
        x, slopes, choice = jax.device_get(_looked(whole.problems[0], stacked))
        for k in range(len(some)):
            own = jax.tree.map(lambda leaf, k=k: leaf[k], choice)
            found.append((x[k, places], slopes[k, places], own._replace(cost=own.cost[places])))
    return found


@jit
def _looked(problem: InverseProblem, ways: Way) -> tuple[Array, Array, Choice]:
    return jax.vmap(lambda way: _with_slopes(problem, *way))(ways)


def without_priors(problem: InverseProblem, *, but_nuisances: bool = False) -> InverseProblem:
    """Return the problem in which priors count nothing; those of nuisances too, unless they are to."""

    def free(item: Parameter) -> Parameter:
        if item.nuisance and but_nuisances:
            return item
        return eqx.tree_at(lambda q: q.prior_sd, item, np.full_like(item.prior_sd, np.inf))

    return replace(problem, parameters=Parameters(tuple(map(free, problem.parameters.items))))


def solve(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None, choice: Any = None) -> End:
    """Run Levenberg-Marquardt from one start; the cost is NaN where the model has no answer.

    Where the model chooses what its values belong to, a search holds the choice and ends where another one has become
    more probable; there the next one begins. Where that finds no end, one with the choice of an example is made.

    Args:
        problem: model, data and unknowns.
        start: theta.
        example: the best end so far, if any.
        choice: what the model may hold from a point nearby; where it stays the most probable one, that is all. So it is
            where the example's own choice is not the most probable: nothing else belongs to that optimum.
    """
    if choice is not None:
        near = _held(problem, start, choice.by_shape())
        if (near.choice.settled and np.isfinite(near.cost)) or (example and not example.choice.settled):
            return near
    own = choosing(problem, start)
    if own.choice.settled or not np.isfinite(own.cost):
        return own
    ends = [_held(problem, own.theta, own.choice.held)]
    if example is not None:
        ends += _like(problem, start, example)
    return min(ends, key=lambda end: (not np.isfinite(end.cost), not end.choice.settled, _is_steep(end), end.cost))


def stay(problem: InverseProblem, end: End) -> End:
    """Search from where another search has ended, and hold what it has chosen, whether or not that stays probable."""
    held = end.choice.held
    return _held(problem, end.theta, None if held is None else held.by_shape())


def _like(problem: InverseProblem, start: Float[AnyArray, "P"], example: End) -> list[End]:
    """Search with the order that an example holds; where that is not the most probable choice, go on from there."""
    first = _held(problem, start, example.choice.held.by_place())
    if np.isfinite(first.cost) and _is_steep(first):  # held apart where two want to change places
        first = _held(problem, first.theta, first.choice.held.by_shape())
    if first.choice.settled or not np.isfinite(first.cost):
        return [first]
    then = choosing(problem, first.theta)
    return [first, then if then.choice.settled else _held(problem, then.theta, then.choice.held)]


def _is_steep(end: End) -> bool:
    return not np.abs(end.gradient).max() < STEEP


def choosing(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None) -> End:
    """Search, beginning again wherever another choice is more probable, until one stays so or `TURNS` are over.

    Then it has not ended: its choice is not settled. An example is of no use to it.
    """
    held = None
    for _ in range(TURNS):
        end, finished = searched(problem, start, held, UNTIL_REMATCHED)
        if end.choice.settled or not np.isfinite(end.cost):
            return end if finished else _held(problem, end.theta, end.choice.held)
        start, held = end.theta, end.choice.held.rematched()
    return end


def _held(problem: InverseProblem, start: Float[AnyArray, "P"], held: Any) -> End:
    """Search with what is held; afresh after running out of steps, as long as that gains something."""
    before = np.inf
    for _ in range(TURNS):
        end, finished = searched(problem, start, held, TO_THE_END)
        if finished or not before - end.cost > WORTH:
            break
        start, held, before = end.theta, end.choice.held, end.cost
    return end


def searched(
    problem: InverseProblem,
    start: Float[AnyArray, "P"],
    held: Any,
    to_the_end: np.ndarray = TO_THE_END,
    weight: np.ndarray = WHOLE,
    row: Row | None = None,
) -> tuple[End, bool]:
    """Search from and to host arrays, with values that do not count: one program is loaded for starts and data alike.

    Nothing that is held lets the model choose; no row holds no combination of the unknowns.
    """
    parts = problem.in_parts()
    row = row or Row(np.zeros(len(start)), NOTHING, np.array(np.inf))
    held = parts.first_matching if held is None else held
    if parts.whole:
        end, finished = jax.device_get(search(parts.problems[0], np.asarray(start), held, to_the_end, weight, row))
        places, cost = parts.parts.places, end.cost + weight**2 * parts.scatter
        choice = end.choice._replace(cost=end.choice.cost[places])
        own = End(end.theta, cost, end.gradient, end.predicted[places], end.jacobian[places], choice)
        return own, bool(finished)

    def weigh(end: End) -> tuple[np.ndarray, np.ndarray]:
        return row.weighed(end.theta, *(weight * part for part in weighed(problem, end)))

    def look_there(asked: list[Any]) -> list[End]:
        return [End(theta, np.nan, theta, *_predicted(parts, theta, held)) for theta, held in asked]

    (found,) = together([descent(weigh, np.asarray(start), held, bool(to_the_end))], look_there)
    return found


def _predicted(whole: InParts, theta: Float[np.ndarray, "P"], held: Any) -> tuple[np.ndarray, np.ndarray, Choice]:
    """Return predictions, their Jacobian and what they belong to, computed part by part."""
    places, own = whole.parts.places, whole.parts.split(held)
    each = zip(whole.problems, own, strict=True)
    found = [jax.device_get(_with_jacobian(part, theta, held)) for part, held in each]
    predicted, jacobian = (np.concatenate([each[i] for each in found])[places] for i in (0, 1))
    choices = [choice for _, _, choice in found]
    cost = np.concatenate([choice.cost for choice in choices])[places]
    settled = all(choice.settled for choice in choices)
    return predicted, jacobian, Choice(whole.parts.joined([choice.held for choice in choices]), settled, cost)


@jit
def search(
    problem: InverseProblem,
    start: Float[AnyArray, "P"],
    held: Any,
    to_the_end: Bool[AnyArray, ""],
    weight: Float[AnyArray, ""],
    row: Row,
    steps: int = MAX_STEPS,
) -> tuple[End, Array]:
    """Run Levenberg-Marquardt from one start, with what the model holds; to the end, or to where it would choose again.

    Returns also whether it has ended before it ran out of steps (see `descent`). Residuals count with their weight,
    and what holds a combination with its own.
    """
    from ident.inference.levenberg_marquardt import damped_minimum  # optimistix is long to import

    def there(theta: Array, held: Any) -> tuple[End, Array, Array]:
        predicted, J, choice = _with_jacobian(problem, theta, held)
        residuals, slope = row.weighed(theta, *(weight * part for part in problem.weigh(predicted, J, theta)))
        return End(theta, (residuals**2).sum(), 2 * slope.T @ residuals, predicted, J, choice), residuals, slope

    return damped_minimum(there, start, held, to_the_end, steps)


@jit
def _with_jacobian(problem: InverseProblem, theta: AnyArray, held: Any) -> tuple[Array, Array, Choice]:
    """Return predictions and their Jacobian; jitted, so that the solver's several looks at it trace it once."""
    return _with_slopes(problem, theta, jnp.eye(theta.shape[0]), held)


def _with_slopes(problem: InverseProblem, theta: AnyArray, directions: Array, held: Any) -> tuple[Array, Array, Choice]:
    def along(direction: Array) -> tuple[Array, Array, Choice]:
        return jax.jvp(lambda theta: problem.predict_matched(theta, held), (theta,), (direction,), has_aux=True)

    return jax.vmap(along, 1, out_axes=(None, -1, None))(directions)


# -------- Convergence
# Whether a search has ended in an optimum: how far the next step would lead, in standard deviations.

OPTIMUM_STEP = 1e-3
"""Length of the Gauss-Newton step [sd] below which a point is an optimum; assumed."""
SEVERAL = 3.0
"""Way in theta, e-folds of a stiffness, over which, and over as much again, an open direction's cost does not rise;
assumed."""
RISE = 1e-2
"""Rise of the cost over that way that would not be noticed; assumed."""


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
    square = np.vstack([slope, np.zeros((slope.shape[1], slope.shape[1]))])  # so that all directions are there
    U, s, Vt = np.linalg.svd(square, full_matrices=False)
    components = U[: len(residuals)].T @ residuals
    open_ones = s <= RANK_TOLERANCE * max(s[0], 1e-300)
    far = ~open_ones & (s < 1 / SEVERAL) & (np.abs(components) >= OPTIMUM_STEP)
    for i in np.flatnonzero(far):
        step = -np.sign(components[i]) * SEVERAL * Vt[i]
        looks = (weighed(problem, evaluate(problem, np.asarray(end.theta) + times * step))[0] for times in (1, 2))
        there, beyond = (float(r @ r) if np.isfinite(r).all() else np.inf for r in looks)
        open_ones[i] = there < float(end.cost) + RISE and beyond < there + RISE
    return Convergence(float(np.linalg.norm(components[~open_ones])), Vt[open_ones])


def weighed(problem: InverseProblem, end: End) -> tuple[np.ndarray, np.ndarray]:
    """Return residuals and their slope, without a program for them."""
    residuals, slope = problem.weigh(*(np.asarray(part) for part in (end.predicted, end.jacobian, end.theta)))
    return np.asarray(residuals), np.asarray(slope)


# -------- Descent
# The last way to an optimum that Levenberg-Marquardt nears but slowly, or from a place where it gets stuck.

WALL = 1e3
"""Times the cost at the start that counts where the model has no answer; assumed."""
ITERATIONS = 200
"""Iterations at most."""
AGAIN = 4
"""Times at most that a search which got stuck begins again."""


def ended(problem: InverseProblem, end: End) -> tuple[End, Convergence]:
    """Return where a search ended, and how; one that got stuck goes on until it ends, or is as it was.

    Gauss-Newton leaves the residuals' own bend out. Where they are large, as in a poor optimum or where two modes
    cross, its steps then take the rest of the way by a constant factor only; BFGS learns the bend from the gradients.
    Where it gets no further either, as where what the values belong to changes with every step downhill, the search
    begins again half the way towards the parameters' own start.
    """
    stuck = here = end, convergence(problem, end)
    for _ in range(AGAIN):
        end, how = here
        if not how.converged and np.isfinite(how.step):
            lower = _descended(problem, end)
            then = convergence(problem, lower)
            here = (lower, then) if then.converged and lower.cost <= end.cost else here
        if here[1].converged or not np.isfinite(here[0].cost):
            break
        nearer = solve(problem, (here[0].theta + problem.parameters.theta_start) / 2)
        here = nearer, convergence(problem, nearer)
    return here if here[1].converged else stuck


def _descended(problem: InverseProblem, end: End) -> End:
    """Minimise half the cost from there, in coordinates of one standard deviation each, with the choice held."""
    from scipy.optimize import minimize  # long to import, and most fits need none

    _, s, Vt = np.linalg.svd(weighed(problem, end)[1], full_matrices=False)
    ways = Vt.T / np.maximum(s, 1 / SEVERAL)

    def half_cost(x: Float[np.ndarray, "P"]) -> tuple[float, Float[np.ndarray, "P"]]:
        there = look(problem, end.theta + ways @ x, end.choice.held)
        if not np.isfinite(there.cost):
            return WALL * float(end.cost), np.zeros_like(x)
        return float(there.cost) / 2, ways.T @ there.gradient / 2

    options = {"gtol": OPTIMUM_STEP / 10, "norm": 2, "maxiter": ITERATIONS}
    found = minimize(half_cost, np.zeros(len(s)), jac=True, method="BFGS", options=options)
    return look(problem, end.theta + ways @ found.x, end.choice.held)


# -------- Searcher
# Searches from many starts: where data are many, first among a part of them, then among all from where that ended.

SAME = 1e-3
"""Difference of theta within which two searches among a part have ended in the same optimum."""


class Searcher:
    """Searches as `solve` does, in less time where data are many.

    A search among many data costs as much as it takes steps. Most of these are needed to come near to an optimum, which
    a part that is like the whole serves as well (`problem.Parts`); there are a few left among all. Starts that end in
    one optimum of the part end in one of the whole, which is searched once. Where the part has no answer, the search is
    among all from the beginning.

    Args:
        problem: model, data and unknowns.
        search: how to search from one start, with the best end so far, if any.
    """

    def __init__(self, problem: InverseProblem, search: Callable[[InverseProblem, Any, End | None], End] = solve):
        parts = problem.in_parts()
        self.problem, self.search = problem, search
        self.part = None if parts.whole else parts.problems[0]
        self.ends: list[tuple[End, End]] = []

    def __call__(self, start: Float[Any, "P"], example: End | None = None, *, near: bool = False) -> End:
        """Return where a search from a start ends.

        Args:
            start: theta.
            example: the best end so far, if any.
            near: whether the start is near an optimum already: then the search among all begins there.
        """
        if self.part is None:
            return self.search(self.problem, start, example)
        best = min((coarse for coarse, _ in self.ends), key=lambda end: end.score, default=None)
        coarse = self.search(self.part, start, best)
        for known, fine in self.ends:
            if np.abs(known.theta - coarse.theta).max() < SAME:
                return fine
        fine = self.search(self.problem, start if near or not np.isfinite(coarse.cost) else coarse.theta, example)
        self.ends.append((coarse, fine))
        return fine
