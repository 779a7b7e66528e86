"""The equations of motion linearised about the quasi-static deflection, at the nodes of time intervals: see `fast`.

They do not depend on amplitude or phase of the excitation, and so serve many simulations.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from math import gcd
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import Polynomial

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.linalg import inverse_unpivoted, solve_positive
from ident.arm.mechanics import block_diagonal, equilibrium, flat
from ident.arm.modes import in_shaft_axes
from ident.arm.multibody import (
    Command,
    Kinematics,
    Multibody,
    Turning,
    balanced,
    bushing_rotations,
    deviations,
    kinematics,
    pins,
    residual,
    residual_of,
)
from ident.arm.rotations import matvec
from ident.arm.structural import structural_damping
from ident.programs import AnyArray, library
from ident.vibrate.motion import Motion, command, last_before

# -------- Few sizes
# Pad to a few standard sizes, so that one compiled program serves many lengths; padded steps are skipped.

PIECES, POWERS = 32, 14
"""Least number of pieces and of powers of a motion: a stroke has no more, whatever its profile."""
AFTER = 1e6
"""Start [s] of the padding pieces of a motion, and their length."""


def ladder(count: int, least: int, growth: int = 4) -> int:
    """Return the padded size that holds `count` entries: the least one, times a power of the growth."""
    size = least
    while size < count:
        size *= growth
    return size


def where(
    real: Callable[[Any], Array], body: Callable[[Any, Any], tuple], *shapes: tuple[int, ...]
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return a body of `jax.lax.scan` that skips padding.

    Its results for padding, arrays of these shapes, are zeros.
    """

    def guarded(state: Any, given: Any) -> tuple[Any, Any]:
        def nothing(state: Any) -> tuple:
            return state, tuple(jnp.zeros(shape) for shape in shapes)

        return jax.lax.cond(real(given), lambda state: body(state, given), nothing, state)

    return guarded


def in_chunks(f: Callable[..., Any], chunks: tuple[Array, ...], real: Bool[Array, "chunks"]) -> Any:
    """Apply f to each chunk and stack the results; padding chunks are not computed and give zeros.

    Args:
        f: of a chunk of each of the arrays; gives floating-point arrays.
        chunks: arrays, whose first axis counts the chunks.
        real: which chunks count.
    """
    f = jax.jit(f)  # traced once for the shapes and the loop
    leaves, tree = jax.tree.flatten(jax.eval_shape(f, *(x[0] for x in chunks)))

    def some(none: None, given: tuple[Array, ...]) -> tuple[None, tuple[Array, ...]]:
        return none, tuple(jax.tree.leaves(f(*given[1:])))

    body = where(lambda given: given[0], some, *(leaf.shape for leaf in leaves))
    return jax.tree.unflatten(tree, jax.lax.scan(body, None, (real, *chunks))[1])


def filled_up(motion: Motion) -> Motion:
    """Return the motion padded with pieces long after its end, and with zero powers; without name and arrival.

    Traced pieces stay as they are.
    """
    breaks, c = motion.breaks, motion.coefficients
    if library(breaks, c) is np:
        breaks, c = np.asarray(breaks), np.asarray(c)
        powers, pieces = (ladder(count, least) - count for count, least in zip(c.shape, (POWERS, PIECES), strict=False))
        q = np.asarray(motion.on_piece(c.shape[1] - 1, breaks[-1])[0])
        still = np.concatenate([np.zeros((c.shape[0] - 1, pieces, c.shape[2])), np.tile(q, (1, pieces, 1))])
        c = np.pad(np.concatenate([c, still], 1), ((powers, 0), (0, 0), (0, 0)))
        breaks = np.concatenate([breaks, breaks[-1] + AFTER * np.arange(1, pieces + 1)])
    return Motion("motion", breaks, c, arrival=float(motion.breaks[0]))


# -------- Quasi static
# The quasi-static deflection of an arm along its motion, about which it vibrates.

START_STEPS = 3
"""Newton steps that take the weight of the eccentric masses into account."""
BELT_STEPS = 3
"""Newton steps that take the stretch of belts into account; it moves the equilibrium by less than a thousandth."""


def quasi_static_deflection(
    arm: Arm, model: Multibody, posture: AnyArray, loads: Loads | None = None
) -> Float[Array, "n *#batch"]:
    """Return the coordinates of the static equilibrium at a posture (driven, *batch) [rad]; see `kinematics`.

    Differentiable. The eccentric masses are on their axes here: they excite the arm and do not bend it.

    Raises:
        ModelError: the posture does not fit the arm.
    """
    chain = at_posture(arm, posture, loads)
    y = flat(in_shaft_axes(chain, equilibrium(chain)))
    if not model.belt_driven:
        return y
    model = balanced(model)
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)

    def improve(_: Array, y: Array) -> Array:
        none = jnp.zeros_like(y)
        K = slope(lambda y: residual(model, still, y, none, none), y)
        return y - solve_positive(K, residual(model, still, y, none, none))

    taut = jnp.zeros((len(model.belt_driven), *y.shape[1:]))
    return jax.lax.fori_loop(0, BELT_STEPS, improve, jnp.concatenate([y, taut]))


def slope(function: Any, at: Float[Array, "n *batch"]) -> Float[Array, "k n *batch"]:
    """Return the Jacobian of a function of one flat vector, whose entries are independent over the batch."""

    def column(k: Array) -> Array:
        direction = jnp.zeros_like(at).at[k].set(1.0)
        return jax.jvp(function, (at,), (direction,))[1]

    return jax.vmap(column, out_axes=1)(jnp.arange(at.shape[0]))


def initial_equilibrium(
    model: Multibody, motion: Motion, balanced: Float[Array, "n"], stiffness: Float[Array, "n n"]
) -> Float[Array, "n"]:
    """Return the coordinates of the static equilibrium before a motion, the weight of the eccentric masses included.

    By steps of Newton's method with the stiffness without them, which they change by less than a thousandth.

    Args:
        model: gathered with `rank=1`.
        motion: at whose start the arm is at rest.
        balanced: coordinates of the equilibrium with the eccentric masses on their axes.
        stiffness: of that equilibrium.
    """
    posture = jnp.asarray(motion(motion.breaks[:1])[0])
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)
    none, K = jnp.zeros((len(balanced), 1)), stiffness[..., None]

    def improve(_: Array, y: Array) -> Array:
        return y - solve_positive(K, residual(model, still, y, none, none))

    return jax.lax.fori_loop(0, START_STEPS, improve, balanced[:, None])[:, 0]


# -------- Time intervals
# Time intervals: what changes with the posture is computed at a few nodes of each and interpolated between them.

NODES = 6
"""Nodes of an interval: the slow quantities are polynomials of degree five in it."""
NODE_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
"""The nodes within an interval, from 0 to 1."""
TURN = 0.8
"""Largest turn of a pin within an interval [rad]: polynomials of degree five follow its sine to 1e-6."""
TURN_WITH_ERROR = 0.5
"""The same where a drive has a transmission error, which shakes the pins so hard that errors of the transition matrices
count: inverses are less smooth than a sine, wrong by 2e-4 in the folded arm at a turn of 0.8, at this 17 times less."""
JUMP = 1e-6
"""Jump of a derivative, against its largest value, that counts as one."""
ROUNDED = 1000.0
"""Largest jump between pieces by rounding, in roundings of an angle; a spline through samples has some tens."""

FINER = 8
"""Intervals are at most this much shorter than they must be, where that makes them more alike."""
INTERVAL_COST = 90
"""What an interval costs apart from its steps, in steps: measured on the paper's arm."""
STEPS, MOST_CHUNKS = 24, 9
"""Steps that are computed together: few are slower each, of many more are beyond the last of an interval; and chunks of
them in an interval at most: beyond, its intermediate values leave the cache."""
MOST_STEPS = MOST_CHUNKS * STEPS
FEWEST = 28
"""Intervals of the least program: the paper's stroke at 5 to 50 % of full speed and two seconds' dwell has no more."""
TOGETHER = 4
"""Intervals whose derivatives are computed together: of the paper's arm all of 24 take 52 ms, four 30, three 28."""
ROUGH, FINEST, MOST_FINE = 5e-3, 0.01, 8
"""An interval is halved where its polynomial misses the acceleration by more, times its length, than this share of the
largest speed; down to this length [s] at least, and to so many times more intervals at most. Measured on the paper's
arm: the vibration of its stroke at 100 % (trapezoid), shaped by ZV and ZVD, is that of the exact equations within 0.7 %
in each direction with 45 to 48 intervals, within 1.8 % with twice the share, and within 9 % with 19, none halved."""
SHORTEST = 1e-9
"""Time [s] within which a jump counts as at the edge."""
PROBES = np.linspace(0.0, 1.0 - SHORTEST, 3 * NODES)
"""Where within an interval its polynomial is held against the acceleration."""

Times = Float[Array | np.ndarray, "T"]


class TimeIntervals(NamedTuple):
    """A span of time in intervals, each of as many equal steps.

    Attributes:
        start: (P,) [s] where the intervals start.
        step: (P,) [s] the steps of each.
        steps: number S of steps of an interval.
    """

    start: Float[Array | np.ndarray, "P"]
    step: Float[Array | np.ndarray, "P"]
    steps: int | Int[Array | np.ndarray, ""]

    @property
    def nodes(self) -> Float[Array | np.ndarray, "P m"]:
        """Times of the nodes [s]."""
        return self.start[:, None] + (self.step * self.steps)[:, None] * NODE_PLACES

    def filled_up(self) -> "TimeIntervals":
        """Return the same with intervals that start at infinity, in one of few numbers."""
        more = ladder(len(self.start), FEWEST, 2) - len(self.start)
        start, step = np.pad(self.start, (0, more), constant_values=np.inf), np.pad(self.step, (0, more), mode="edge")
        return TimeIntervals(start, step, np.asarray(self.steps))

    def steps_of(self, time: Times) -> tuple[Array, Array, Array, Array]:
        """Return for each time its interval, its step there, the share of that past, and the step's length [s]."""
        start = jnp.asarray(self.start)
        interval = jnp.clip(last_before(start, time), 0, len(start) - 1)
        h = jnp.asarray(self.step)[interval]
        count = (time - start[interval]) / h
        step = jnp.clip(jnp.floor(count).astype(int), 0, self.steps - 1)
        return interval, step, jnp.asarray(count - step), h


def time_intervals(motion: Motion, end: float, step: float, *, turn: float = TURN) -> TimeIntervals:
    """Divide the time from the first break of a motion, none of them across a jump of its derivatives.

    Args:
        motion: the commanded motion.
        end: last time [s].
        step: longest step [s].
        turn: largest turn of a pin within an interval [rad].
    """
    jumps = _jumps(motion)
    first = float(motion.breaks[0])
    within = jumps[(jumps > first + SHORTEST) & (jumps < end - SHORTEST)]
    edges = np.concatenate([[first], within, [end]])
    spans, speed = np.diff(edges), fastest(motion).max()
    longest = min(turn / max(speed, 1e-9), MOST_STEPS * step)
    shares = np.outer(spans, 1 / np.arange(1, FINER)).ravel()
    candidates = [longest, *shares[(shares < longest) & (shares > longest / FINER)]]

    def cost(counts: np.ndarray) -> int:
        """In steps: all intervals have as many as the longest asks for."""
        return int(counts.sum()) * (_steps(spans / counts, step) + INTERVAL_COST)

    counts = min((np.ceil(spans / length - 1e-9).astype(int) for length in candidates), key=cost)
    lengths = spans / counts
    start = np.concatenate([low + n * np.arange(c) for low, n, c in zip(edges, lengths, counts, strict=False)])
    start, length = _halved(motion, start, np.repeat(lengths, counts), ROUGH * speed)
    steps = _steps(length, step)
    return TimeIntervals(start, length / steps, steps)


def _halved(
    motion: Motion, start: Float[np.ndarray, "P"], length: Float[np.ndarray, "P"], most_missed: float
) -> tuple[Float[np.ndarray, "more"], Float[np.ndarray, "more"]]:
    """Halve intervals whose polynomial misses an impulse [rad/s]: the acceleration bends in a log or an average."""
    done: list[tuple[np.ndarray, np.ndarray]] = []
    most = MOST_FINE * len(start)
    while len(start):
        at, nodes = (np.asarray(motion(start[:, None] + length[:, None] * x)[2]) for x in (PROBES, NODE_PLACES))
        rough = length * np.abs(at - nodes @ AT_PROBES).max((0, 2)) > most_missed
        rough &= (length > 2 * FINEST) & bool(len(start) + sum(len(each) for _, each in done) < most)
        done.append((start[~rough], length[~rough]))
        half = length[rough] / 2
        start, length = np.concatenate([start[rough], start[rough] + half]), np.tile(half, 2)
    start, length = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(start)
    return start[order], length[order]


def _steps(lengths: np.ndarray, step: float) -> int:
    return max(1, int(np.ceil(lengths.max() / step - 1e-9)))


def fastest(motion: Motion) -> Float[np.ndarray, "driven"]:
    """Return the highest speed of each driven joint [rad/s], by samples; the motion is known, also under `jit`."""
    breaks, rate = np.asarray(motion.breaks), _derivative(motion, 1)
    time = np.linspace(breaks[0], breaks[-1], 2000)
    piece = np.clip(last_before(breaks, time), 0, len(breaks) - 2)
    return np.asarray(np.abs(np.polyval(rate[:, piece], (time - breaks[piece])[:, None])).max(0))


def _jumps(motion: Motion) -> np.ndarray:
    """Return the breaks at which a derivative up to the third jumps: there a smooth method loses its order."""
    breaks, c = np.asarray(motion.breaks), np.asarray(motion.coefficients)
    jumps = np.zeros(len(breaks) - 2, bool)
    rounding, lengths = ROUNDED * np.finfo(float).eps * np.abs(c[-1]).max(), np.diff(breaks)
    beside = np.minimum(lengths[:-1], lengths[1:])[:, None]
    for order in range(1, 4):
        largest = max(np.abs(_derivative(motion, order)[-1]).max(), 1e-12)
        least = np.maximum(JUMP * largest, rounding / beside**order)  # between dense samples their rounding jumps
        jumps |= (jumps_of(motion, order) > least).any(1)
    return breaks[1:-1][jumps]


def jumps_of(motion: Motion, order: int) -> Float[np.ndarray, "inner driven"]:
    """Return by how much a derivative of each angle jumps at the inner breaks [rad/s^order]."""
    rate = _derivative(motion, order)
    powers = np.arange(len(rate))[::-1, None, None]
    ends = (rate * np.diff(np.asarray(motion.breaks))[:, None] ** powers).sum(0)
    return np.abs(rate[-1, 1:] - ends[:-1])


def _derivative(motion: Motion, order: int) -> Float[np.ndarray, "powers pieces driven"]:
    """Return the coefficients of a derivative of the angles, the highest power first."""
    c = np.asarray(motion.coefficients)
    for _ in range(order):
        c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None, None] if len(c) > 1 else np.zeros_like(c)
    return c


def basis(places: np.ndarray) -> list[Polynomial]:
    """Return the polynomials that are one at one of the places and zero at the others (Lagrange)."""
    products = [Polynomial.fromroots(np.delete(places, n)) for n in range(len(places))]
    return [p / p(place) for p, place in zip(products, places, strict=True)]


def evaluate(polynomials: list[Polynomial], u: Array) -> Float[Array, "T polynomials"]:
    """Return the values of polynomials at u."""
    return jnp.stack([jnp.polyval(jnp.asarray(p.coef[::-1]), u) for p in polynomials], 1)


NODE_POWERS = np.stack([p.coef for p in basis(NODE_PLACES)])
"""Coefficients (nodes, powers) of the polynomials of an interval."""
AT_PROBES = np.stack([p(PROBES) for p in basis(NODE_PLACES)])
"""Weights (nodes, places) of the nodes for the values at `PROBES`."""


def weights(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights (NODES, places) of nodal values for value, slope and curvature elsewhere.

    Places run from 0 to 1 over the interval; slope and curvature are by that coordinate.
    """
    value, slope, curvature = (np.stack([p.deriv(k)(places) for p in basis(NODE_PLACES)]) for k in range(3))
    return value, slope, curvature


def some_at_a_time(f: Callable[[TimeIntervals], Any], grid: TimeIntervals) -> Any:
    """Apply f to intervals, `TOGETHER` at a time: all at once would not fit in the cache.

    Args:
        f: gives floating-point arrays, the intervals on the first axis.
        grid: the intervals. A group whose first interval starts at infinity is padding: it is skipped and gives zeros.
    """
    together = gcd(len(grid.start), TOGETHER)
    start, step = (jnp.asarray(x).reshape((-1, together)) for x in (grid.start, grid.step))

    def of(start: Array, step: Array) -> Any:
        return f(TimeIntervals(start, step, grid.steps))

    whole = in_chunks(of, (start, step), jnp.isfinite(start[:, 0]))
    return jax.tree.map(lambda part: part.reshape((-1, *part.shape[2:])), whole)


def interpolate(x: Float[Array, "*rest m"], W: Float[AnyArray, "m places"]) -> Float[Array, "*rest places"]:
    """Return the sum over the nodes, on the last axis of x, of their values times their weights."""
    return jnp.tensordot(x, jnp.asarray(W), 1)


def between_nodes(
    grid: TimeIntervals, x: Float[Array, "P c m"], time: Times
) -> tuple[Float[Array, "c T"], Float[Array, "c T"]]:
    """Return values at times within the intervals by those at the nodes, and their rates."""
    k, s, share, h = grid.steps_of(time)
    u = ((s + share) / grid.steps)[:, None]
    coefficients = jnp.moveaxis(jnp.tensordot(x, jnp.asarray(NODE_POWERS), 1), 2, 0)[:, k]
    value, slope = coefficients[-1], jnp.zeros_like(coefficients[-1])
    for lower in coefficients[-2::-1]:
        value, slope = value * u + lower, slope * u + value
    return value.T, (slope / (h * grid.steps)[:, None]).T


# -------- Step weights
# Weights of the nodes of a time interval for the steps within it, in chunks padded to a few standard numbers.

STAGES = 3
"""Stages of a step; the order is twice as high."""
GAUSS = (np.polynomial.legendre.leggauss(STAGES)[0] + 1) / 2
"""The stages within a step, from 0 to 1."""


class StepWeights(NamedTuple):
    """Weights of an interval's nodes for its start, its edges, steps about nodes, and each of its steps, in chunks.

    Attributes:
        steps: () number S of steps of an interval.
        about_nodes: (STAGES, m, m) for the stages of steps about the nodes.
        within: (chunks, STEPS) the steps' numbers.
        middles: (chunks, m, STEPS) for the middles of the steps.
        in_steps: (chunks, STEPS STAGES) places of the stages, in steps.
        stages: (chunks, 3, m, STEPS STAGES) for the stages: value, slope, curvature.
    """

    steps: Int[AnyArray, ""]
    about_nodes: Float[AnyArray, "stages m m"]
    within: Int[AnyArray, "chunks steps"]
    middles: Float[AnyArray, "chunks m steps"]
    in_steps: Float[AnyArray, "chunks places"]
    stages: Float[AnyArray, "chunks 3 m places"]


@lru_cache
def step_weights(S: int) -> StepWeights:
    """Return the weights for intervals of S steps, filled up to one of few numbers of chunks."""
    within = np.arange(ladder(-(-S // STEPS), MOST_CHUNKS) * STEPS).reshape((-1, STEPS))
    at = np.minimum(within, S - 1)
    in_steps = (at[..., None] + GAUSS).reshape((len(at), -1))
    return StepWeights(
        steps=np.asarray(S),
        about_nodes=np.stack([weights(NODE_PLACES + (stage - 0.5) / S)[0] for stage in GAUSS]),
        within=within,
        middles=np.moveaxis(weights((at.ravel() + 0.5) / S)[0].reshape((NODES, *at.shape)), 1, 0),
        in_steps=in_steps,
        stages=np.moveaxis(np.stack(weights(in_steps.ravel() / S)).reshape((3, NODES, *in_steps.shape)), 2, 0),
    )


# -------- Linear

ONCE, TWICE = ([p.integ(k) for p in basis(GAUSS)] for k in (1, 2))
"""Rate and value within a step by the stages' accelerations; h and h^2 are factors."""
A, B = np.array([[p(c) for p in ONCE] for c in GAUSS]), np.array([p(1.0) for p in ONCE])
A2, B2 = A @ A, B @ A
"""The same, of the method for first-order equations applied twice: unlike TWICE at the stages it is always stable."""
AT_NODES = weights(NODE_PLACES)
"""Weights of the nodes for value, slope and curvature at the nodes."""


class Linear(NamedTuple):
    """The linearised equations without what excites them, at the nodes of each interval.

    Attributes:
        quasi_static: coordinates at static equilibrium.
        K: stiffness.
        by_pin: derivatives of the residual by the pins' angles and their two rates; none without transmission errors.
        residual: of the quasi-static deflection.
        lost: damping by loss factors and by mass, which acts on all rates; None without any.
        kinematics: there.
        gain: the accelerations at the stages of a step about the node by the state at its start,
        yields: and by the forces at the stages.
        along: the state at the end of the step by that at its start.
    """

    quasi_static: Float[Array, "P n m"]
    K: Float[Array, "P n n m"]
    by_pin: tuple[Array, ...]
    residual: Float[Array, "P n m"]
    lost: Float[Array, "P n n m"] | None
    kinematics: Kinematics
    gain: Float[Array, "P m stages state"]
    yields: Float[Array, "P m stages stages"]
    along: Float[Array, "P m state state"]


def linearised(
    arm: Arm, model: Multibody, motion: Motion, grid: TimeIntervals, at: StepWeights, loads: Loads | None = None
) -> Linear:
    """Linearise the equations along a motion: the same for all eccentricities, phases and transmission errors.

    Intervals that start at infinity are left out.

    Args:
        arm: the arm.
        model: its multibody model under the load, gathered with `rank=1`.
        motion: the commanded motion.
        grid: the time intervals.
        at: weights for the steps of an interval.
        loads: the load case.
    """
    M, D, slow = _slow(arm, model, motion, loads, grid._replace(steps=at.steps))

    def interval(h: Array, M: Array, D: Array, K: Array) -> tuple[Array, ...]:
        gain, yields = _transitions(M, D, K, jnp.asarray(at.about_nodes), h)
        drift, push = advance(h, model.size)
        return gain, yields, drift + push @ gain

    real = jnp.isfinite(jnp.asarray(grid.start))
    gain, yields, along = in_chunks(interval, (jnp.asarray(grid.step), M, D, slow["K"]), real)
    return Linear(**slow, gain=gain, yields=yields, along=along)


def _slow(
    arm: Arm, model: Multibody, motion: Motion, loads: Loads | None, grid: TimeIntervals
) -> tuple[Array, Array, dict[str, Any]]:
    """Linearise the equations at the nodes, nothing exciting them: in the coordinates and in the pins' angles.

    Returns:
        Mass and damping, and the fields of `Linear` that change with the posture alone.
    """
    length = (grid.step * grid.steps)[:, None]
    smooth, commanded = balanced(model), command(model, motion, grid.nodes.ravel())
    y = quasi_static_deflection(arm, model, commanded.q, loads)

    def by_interval(x: Array) -> Array:
        return x.reshape((*x.shape[:-1], len(grid.start), NODES))

    line = [(interpolate(by_interval(y), W) / length**k).reshape(y.shape) for k, W in enumerate(AT_NODES)]
    turning = pins(smooth, commanded, Turning(*(deviations(model, part) for part in line)))

    def shifted(k: int, pin: Array) -> Array:
        angles = [part + pin if i == k else part for i, part in enumerate(turning.pin)]
        return residual_of(smooth, eqx.tree_at(lambda t: t.pin, turning, Turning(*angles)), *line)

    still = jnp.zeros((model.joints, *y.shape[1:]))
    M, D, K, lost = matrices(smooth, commanded, y)
    off = residual_of(smooth, turning, *line)
    if lost is not None:
        D, off = D + lost, off + matvec(lost, line[1])
    slow = {
        "quasi_static": y,
        "K": K,
        "by_pin": tuple(slope(partial(shifted, k), still) for k in range(3)) if model.transmission_error else (),
        "residual": off,
        "lost": lost,
        "kinematics": kinematics(smooth, turning.pin, *(bushing_rotations(model, part) for part in line)),
    }
    return jax.tree.map(lambda x: jnp.moveaxis(by_interval(x), -2, 0), (M, D, slow))


def matrices(
    model: Multibody, commanded: Command, y: Float[Array, "n *batch"]
) -> tuple[Array, Array, Array, Array | None]:
    """Return mass, damping and stiffness (n, n, *batch) of a model that nothing excites, and what `_lost` adds."""
    none = jnp.zeros_like(y)
    M = slope(lambda ydd: residual(model, commanded, y, none, ydd), none)
    D = slope(lambda yd: residual(model, commanded, y, yd, none), none)
    K = slope(lambda y: residual(model, commanded, y, none, none), y)
    return M, D, K, _lost(model, commanded, y, M)


def _lost(
    model: Multibody, commanded: Command, y: Float[Array, "n *batch"], M: Float[Array, "n n *batch"]
) -> Float[Array, "n n *batch"] | None:
    """Return the damping of the bushings by loss factors, at rest in y, and mass: belts lose by their own time."""
    if model.loss is None and model.alpha is None:
        return None
    own, more = 3 * model.joints, len(model.belt_driven)
    D = jnp.zeros_like(M[:own, :own]) if model.alpha is None else model.alpha * M[:own, :own]
    if model.loss is not None:
        none, still = jnp.zeros_like(y), Command(commanded.q, *(jnp.zeros_like(commanded.q),) * 2)
        K = slope(lambda y: residual(model, still, y, none, none), y)
        L = jnp.broadcast_to(block_diagonal(model.loss), (own, own, *M.shape[2:]))
        D = D + structural_damping(M[:own, :own], K[:own, :own], L)
    return jnp.pad(D, ((0, more), (0, more), *((0, 0),) * (M.ndim - 2)))


def advance(h: Array, n: int) -> tuple[Float[Array, "state state"], Float[Array, "state stages"]]:
    """Return the matrices from x and dx/dt at the start of a step, and the stages' accelerations, to those at its end.

    z' = drift z + push a.
    """
    unit = np.eye(n)
    drift = jnp.eye(2 * n) + h * np.kron([[0, 1], [0, 0]], unit)
    return drift, jnp.concatenate([h * h * np.kron(B2, unit), h * np.kron(B, unit)])


def _transitions(
    M: Array, D: Array, K: Array, about_nodes: Float[Array, "inner m m"], h: Array
) -> tuple[Float[Array, "m stages state"], Float[Array, "m stages stages"]]:
    """Return how the accelerations at the stages of a step follow from the state at its start, and from f.

    They are computed for steps about the nodes; between, they change as slowly as M, D and K do.
    """
    rows, known = [], []
    for i, W in enumerate(about_nodes):
        m, d, k = (interpolate(X, W) for X in (M, D, K))
        rows.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * A2[i, j] * k for j in range(STAGES)])
        known.append([-k, -d - h * GAUSS[i] * k])
    left, right = (jnp.concatenate([jnp.concatenate(row, 1) for row in part], 0) for part in (rows, known))
    yields, right = (jnp.moveaxis(X, -1, 0) for X in (inverse_unpivoted(left), right))
    return yields @ right, yields
