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
# The solver outside of a compiled program, for expensive model evaluations: many data, searches that share evaluations.
# Gauss-Newton, with Marquardt's damping after an uphill step (J. SIAM 11, 1963): optimistix's rule takes 6 to 36 % more
# evaluations.

T = TypeVar("T")
MAX_STEPS = 200
SHORT, LEAST_STEP = 1e-3, 1e-6
"""Lengths of the next step [sd] below which it is undamped, and below which the search has ended."""
LEVEL = 1e-10
"""Rise of the cost, relative to 1 + cost, that counts as rounding."""
DAMPING, FACTOR, LEAST, MOST = 1e-3, 10.0, 1e-9, 1e12
"""Damping: after the first uphill step, its factor per change, the value that counts as zero, and the value above which
the search ends."""
GAINS = 0.25, 0.75
"""Ratios of actual to predicted fall of the cost: below the first the step was too long, above the second the damping
falls."""

MANY, BLOCK = 1000, 100
"""Number of residuals above which their QR triangle saves time, and rows per block of it; measured."""

Weigh = Callable[["End"], tuple[Float[np.ndarray, "R"], Float[np.ndarray, "R P"]]]


def together(
    searches: "Sequence[Generator[Any, End, T]]",
    looks: "Callable[[list[Any]], list[End]]",
    ended: Callable[[], Any] = bool,
) -> list[T]:
    """Run several searches at once with shared model evaluations; return their results.

    Args:
        searches: each yields the point to evaluate next.
        looks: evaluates a list of points.
        ended: called whenever a search has ended.
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
    """Minimise a sum of squares from a start; return the end, and whether it was reached before the steps ran out.

    The generator yields a point and is sent the prediction there, so that several searches can share evaluations.

    Args:
        weigh: returns residuals and their slope at an evaluated point.
        start: theta.
        held: assignment that the model keeps at the first point.
        to_the_end: whether to continue where the model would choose another assignment.
        steps: at most.
        ask: makes the yielded point from theta and the last assignment.
    """

    def at(here: End) -> tuple[End, np.ndarray, np.ndarray]:
        residuals, slope = weigh(here)
        with np.errstate(over="ignore", invalid="ignore"):  # a pole at critical damping has no slope
            here = here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)
        if len(residuals) > MANY:  # their triangle keeps lengths and angles: enough for a step
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
        if near:  # gains are close to rounding and no longer measure a step
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
    """Return the triangle R of QR, in blocks of rows: for many rows at once LAPACK starts threads that wait."""
    blocks = np.pad(rows, ((0, -len(rows) % BLOCK), (0, 0))).reshape((-1, BLOCK, rows.shape[1]))
    return np.asarray(np.linalg.qr(np.concatenate(np.linalg.qr(blocks, mode="r")), mode="r"))


def _next_damping(damping: float, gain: float) -> float:
    """Return the damping after a step with this ratio of actual to predicted gain; NaN if the model had no solution."""
    if not gain > GAINS[0]:
        return FACTOR * damping or DAMPING
    if gain > GAINS[1]:
        return damping / FACTOR if damping > LEAST else 0.0
    return damping


def step_length(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> float:
    """Return the length of the next undamped step [sd], as in `convergence`; infinite if there is no slope."""
    if not np.isfinite(slope).all():
        return np.inf
    return float(np.linalg.norm(reached(slope).T @ residuals))


def _step(residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"], damping: float) -> np.ndarray:
    """Return the step to the least cost of the linear model, with each coordinate damped by its own slope."""
    widths = np.sqrt(damping) * np.linalg.norm(slope, axis=0)
    damped = np.vstack([slope, np.diag(widths)])
    step, *_ = np.linalg.lstsq(damped, -np.append(residuals, np.zeros(len(widths))), rcond=RANK_TOLERANCE)
    return np.asarray(step)


# -------- Least squares
# One search: Levenberg-Marquardt from one start, and the evaluation of model and Jacobian at a point.

WHOLE, NOTHING = np.array(1.0), np.array(0.0)
TO_THE_END, UNTIL_REMATCHED = np.array(True), np.array(False)
STEEP = 1e-2
"""Gradient of the cost by theta above which a search has not reached an optimum; assumed."""
WORTH = 1e-7
"""Fall of the cost by a search that justifies another search; assumed."""
TURNS = 6
"""Most searches in a row, each with another assignment of the values to modes, or with more steps."""


class Row(NamedTuple):
    """A constraint weights' theta = value: one more residual, zero if the width is infinite."""

    weights: Float[AnyArray, "P"]
    value: Float[AnyArray, ""]
    width: Float[AnyArray, ""]

    def weighed(self, theta: AnyArray, residuals: AnyArray, slope: AnyArray) -> tuple[Any, Any]:
        """Return residuals and their slope at theta, with this row added."""
        xp = library(theta, residuals, slope)
        off = (self.weights @ theta - self.value) / self.width
        return xp.append(residuals, off), xp.vstack([slope, self.weights / self.width])


class End(NamedTuple):
    """End of one search: theta, sum of squares and its gradient, predictions and Jacobian, the model's choice."""

    theta: Any
    cost: Any
    gradient: Any
    predicted: Any
    jacobian: Any
    choice: Choice

    @property
    def score(self) -> float:
        """Minus twice the logarithm of the probability of data, prior and labels."""
        return float(self.cost + self.choice.cost.sum())


def evaluate(problem: InverseProblem, theta: Float[AnyArray, "P"] | None = None) -> End:
    """Return predictions and their Jacobian at theta, by default at the parameters' starting values.

    No measured value is used: values are assigned to modes by their labels alone. This is a search in which all weights
    are zero, so that the program compiled for the fit serves here as well.
    """
    blank = replace(without_priors(problem), sigma=np.full_like(problem.sigma, np.inf))
    start = problem.parameters.theta_start if theta is None else theta
    return searched(blank, start, None, TO_THE_END, NOTHING)[0]


def look(problem: InverseProblem, theta: Float[AnyArray, "P"], held: Any) -> End:
    """Evaluate the problem at theta as a search does, with a held assignment, without a step."""
    here = searched(problem, theta, held, TO_THE_END, NOTHING)[0]
    residuals, slope = (np.asarray(part) for part in problem.weigh(here.predicted, here.jacobian, np.asarray(theta)))
    return here._replace(cost=residuals @ residuals, gradient=2 * slope.T @ residuals)


LANES = 10
"""Points evaluated together for several searches. Of Table 1 one takes 2.3 ms and 16 take 7.1; its explanations ask for
one at a time, for up to 11, or for 17 to 19: in tens they evaluate three fifths of the points that they would in 16."""


class Way(NamedTuple):
    """A point, the directions (P, p) of the required slopes, and the assignment that the model holds there."""

    theta: Float[np.ndarray, "P"]
    directions: Float[np.ndarray, "P p"]
    held: Any


def looks(whole: InParts, ways: Sequence[Way], lanes: int = LANES) -> list[tuple[np.ndarray, np.ndarray, Choice]]:
    """Return predictions, slopes (D, p) and the choice at several points with equal numbers of directions."""
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
    """Return the problem without priors; with `but_nuisances`, those of the nuisances stay."""

    def free(item: Parameter) -> Parameter:
        if item.nuisance and but_nuisances:
            return item
        return eqx.tree_at(lambda q: q.prior_sd, item, np.full_like(item.prior_sd, np.inf))

    return replace(problem, parameters=Parameters(tuple(map(free, problem.parameters.items))))


def solve(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None, choice: Any = None) -> End:
    """Run Levenberg-Marquardt from one start; the cost is NaN where the model has no solution.

    If the model assigns its values to modes, a search holds the assignment and ends where another one becomes more
    probable; there the next search begins. If this does not converge, a search with the example's assignment follows.

    Args:
        problem: model, data and unknowns.
        start: theta.
        example: the best end so far, if any.
        choice: an assignment from a point nearby; if it stays the most probable one, no other search is made. Likewise
            if the example's own choice is not the most probable one there: no other assignment belongs to that optimum.
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
    """Continue a search from its end with its assignment held, whether or not that stays the most probable one."""
    held = end.choice.held
    return _held(problem, end.theta, None if held is None else held.by_shape())


def _like(problem: InverseProblem, start: Float[AnyArray, "P"], example: End) -> list[End]:
    """Search with the example's mode order held; if that is not the most probable choice, continue from there."""
    first = _held(problem, start, example.choice.held.by_place())
    if np.isfinite(first.cost) and _is_steep(first):  # the held order blocks two modes from crossing
        first = _held(problem, first.theta, first.choice.held.by_shape())
    if first.choice.settled or not np.isfinite(first.cost):
        return [first]
    then = choosing(problem, first.theta)
    return [first, then if then.choice.settled else _held(problem, then.theta, then.choice.held)]


def _is_steep(end: End) -> bool:
    return not np.abs(end.gradient).max() < STEEP


def choosing(problem: InverseProblem, start: Float[AnyArray, "P"], example: End | None = None) -> End:
    """Search, and restart wherever another choice is more probable, until one stays so or after `TURNS` searches.

    After `TURNS` it has not converged: its choice is not settled. The example is not used.
    """
    held = None
    for _ in range(TURNS):
        end, finished = searched(problem, start, held, UNTIL_REMATCHED)
        if end.choice.settled or not np.isfinite(end.cost):
            return end if finished else _held(problem, end.theta, end.choice.held)
        start, held = end.theta, end.choice.held.rematched()
    return end


def _held(problem: InverseProblem, start: Float[AnyArray, "P"], held: Any) -> End:
    """Search with a held assignment; restart when steps run out, as long as the cost still falls."""
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
    """Search from and to host arrays, with padded values of weight zero: one program serves all starts and data.

    Without a held assignment the model chooses; without a row no combination of the unknowns is held.
    """
    parts = problem.in_parts
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
        return [
            End(theta, np.nan, np.full_like(theta, np.nan), *_predicted(parts, theta, held)) for theta, held in asked
        ]

    (found,) = together([descent(weigh, np.asarray(start), held, bool(to_the_end))], look_there)
    return found


def _predicted(whole: InParts, theta: Float[np.ndarray, "P"], held: Any) -> tuple[np.ndarray, np.ndarray, Choice]:
    """Return predictions, their Jacobian and the choice, computed part by part."""
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
    """Run Levenberg-Marquardt from one start with a held assignment, to the end or until the model would choose again.

    Return also whether it ended before the steps ran out (see `descent`). `weight` applies to the residuals; the row
    of a held combination has its own.
    """
    from ident.inference.levenberg_marquardt import damped_minimum  # optimistix is slow to import

    def there(theta: Array, held: Any) -> tuple[End, Array, Array]:
        predicted, J, choice = _with_jacobian(problem, theta, held)
        residuals, slope = row.weighed(theta, *(weight * part for part in problem.weigh(predicted, J, theta)))
        return End(theta, (residuals**2).sum(), 2 * slope.T @ residuals, predicted, J, choice), residuals, slope

    return damped_minimum(there, start, held, to_the_end, steps)


@jit
def _with_jacobian(problem: InverseProblem, theta: AnyArray, held: Any) -> tuple[Array, Array, Choice]:
    """Return predictions and their Jacobian; jitted, so that the solver's several calls trace it once."""
    return _with_slopes(problem, theta, jnp.eye(theta.shape[0]), held)


def _with_slopes(problem: InverseProblem, theta: AnyArray, directions: Array, held: Any) -> tuple[Array, Array, Choice]:
    def along(direction: Array) -> tuple[Array, Array, Choice]:
        return jax.jvp(lambda theta: problem.predict_matched(theta, held), (theta,), (direction,), has_aux=True)

    return jax.vmap(along, 1, out_axes=(None, -1, None))(directions)


# -------- Convergence
# Whether a search has reached an optimum: the length of the next step in standard deviations.

OPTIMUM_STEP = 1e-3
"""Length of the Gauss-Newton step [sd] below which a point is an optimum; assumed."""
SEVERAL = 3.0
"""Distance in theta, e-folds of a stiffness; a direction is open if its cost does not rise over this distance and twice
this distance; assumed."""
RISE = 1e-2
"""Rise of the cost over that distance that counts as none; assumed."""


class Convergence(NamedTuple):
    """Convergence of a search.

    Attributes:
        step: [sd] length of the next Gauss-Newton step in all but the open directions.
        open: (N, P) directions in theta along which the cost stays flat or still falls over several e-folds.
    """

    step: float
    open: Float[np.ndarray, "N P"]

    @property
    def converged(self) -> bool:
        """Whether this is an optimum in all but the open directions."""
        return self.step < OPTIMUM_STEP


def convergence(problem: InverseProblem, end: End) -> Convergence:
    """Measure the next step from the end of a search.

    With residuals r and their slope J = U S V', the Gauss-Newton step is -V S^-1 U'r. In standard deviations of the
    linear approximation, V S^-1, its components are those of U'r: a gradient scaled by the information.
    Directions in the null space of J are open. So are directions determined to less than several e-folds along which
    the cost of the full model does not rise.
    """
    residuals, slope = weighed(problem, end)
    if not (np.isfinite(residuals).all() and np.isfinite(slope).all()):
        return Convergence(np.inf, np.empty((0, len(end.theta))))
    square = np.vstack([slope, np.zeros((slope.shape[1], slope.shape[1]))])  # so that Vt spans all directions
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
    """Return residuals and their slope, without a compiled program."""
    residuals, slope = problem.weigh(*(np.asarray(part) for part in (end.predicted, end.jacobian, end.theta)))
    return np.asarray(residuals), np.asarray(slope)


# -------- Descent
# BFGS: the last part of the way where Levenberg-Marquardt converges slowly or gets stuck.

WALL = 1e3
"""Cost where the model has no solution, as a multiple of the cost at the start; assumed."""
ITERATIONS = 200
"""Most iterations."""
AGAIN = 4
"""Most restarts of a stuck search."""


def ended(problem: InverseProblem, end: End) -> tuple[End, Convergence]:
    """Return a search's end and its convergence; a stuck search continues until it converges, or stays as it was.

    Gauss-Newton neglects the curvature of the residuals. Where they are large, as in a poor optimum or where two modes
    cross, it converges only linearly; BFGS learns the curvature from the gradients. If BFGS gets stuck too, for example
    because the assignment of values to modes changes with every step downhill, the search restarts halfway towards the
    parameters' starting values.
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
    """Minimise half the cost from an end, in coordinates scaled to one standard deviation, with the choice held."""
    from scipy.optimize import minimize  # slow to import, and most fits do not need it

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
# Searches from many starts: with many data, first over a part of them, then over all from the end of that search.

SAME = 1e-3
"""Difference of theta within which two searches over a part have reached the same optimum."""


class Searcher:
    """Search as `solve` does, in less time for many data.

    The time of a search over many data grows with its steps. Most steps approach an optimum, and a representative part
    of the data suffices for these (`problem.Parts`); only a few steps over the full data remain. Starts that reach one
    optimum of the part share one search over the full data. If the part has no solution, the whole search is over the
    full data.

    Args:
        problem: model, data and unknowns.
        search: searches from one start, with the best end so far, if any.
    """

    def __init__(self, problem: InverseProblem, search: Callable[[InverseProblem, Any, End | None], End] = solve):
        parts = problem.in_parts
        self.problem, self.search = problem, search
        self.part = None if parts.whole else parts.problems[0]
        self.ends: list[tuple[End, End]] = []

    def __call__(self, start: Float[Any, "P"], example: End | None = None, *, near: bool = False) -> End:
        """Return the end of a search from a start.

        Args:
            start: theta.
            example: the best end so far, if any.
            near: whether the start is already near an optimum: then the search is over all data from the beginning.
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
