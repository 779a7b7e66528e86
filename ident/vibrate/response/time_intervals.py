"""Time intervals: what changes with the posture is computed at a few nodes of each and interpolated between them."""

from collections.abc import Callable
from math import gcd
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.polynomial import Polynomial

from ident.jit import AnyArray
from ident.vibrate.motion.motion import Motion, last_before
from ident.vibrate.response.few_sizes import ladder, where

NODES = 6
"""Nodes of an interval: the slow quantities are polynomials of degree five in it."""
NODE_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
"""The nodes within an interval, from 0 to 1."""
TURN = 0.8
"""Largest turn of a pin within an interval [rad]: polynomials of degree five follow its sine to 1e-6."""
TURN_WITH_ERROR = 0.5
"""The same where a drive has a kinematic error, which shakes the pins so hard that errors of the transition matrices
count: inverses are less smooth than a sine, wrong by 2e-4 in the folded arm at a turn of 0.8, at this 17 times less."""
JUMP = 1e-6
"""Jump of a derivative, against its largest value, that counts as one."""

FINER = 8
"""Intervals are at most this much shorter than they must be, where that makes them more alike."""
INTERVAL_COST = 90
"""What an interval costs apart from its steps, in steps: measured on the paper's arm."""
MOST_STEPS = 200
"""Steps of an interval at most: beyond, its intermediate values leave the cache."""
FEWEST = 24
"""Intervals of the least program: the paper's stroke at 5 to 50 % of full speed and a second's dwell has no more."""
TOGETHER = 4
"""Intervals within which derivatives of the equations are computed together. Of the paper's arm along three directions
all of the least program take 52 ms, eight at a time 31, four 30, three 28."""
SHORTEST = 1e-9
"""Time [s] within which a jump counts as at the edge."""

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
    speed = fastest(motion).max()
    longest = min(turn / max(speed, 1e-9), MOST_STEPS * step)
    shares = np.outer(np.diff(edges), 1 / np.arange(1, FINER)).ravel()
    candidates = [longest, *shares[(shares < longest) & (shares > longest / FINER)]]
    counts = min((_counts(edges, length) for length in candidates), key=lambda counts: _cost(edges, counts, step))
    lengths = np.diff(edges) / counts
    start = np.concatenate([low + n * np.arange(c) for low, n, c in zip(edges, lengths, counts, strict=False)])
    length = np.repeat(lengths, counts)
    steps = _steps(length, step)
    return TimeIntervals(start, length / steps, steps)


def _counts(edges: np.ndarray, longest: float) -> np.ndarray:
    return np.ceil(np.diff(edges) / longest - 1e-9).astype(int)


def _steps(lengths: np.ndarray, step: float) -> int:
    return max(1, int(np.ceil(lengths.max() / step - 1e-9)))


def _cost(edges: np.ndarray, counts: np.ndarray, step: float) -> int:
    """Return the cost of intervals, in steps: all have as many as the longest asks for."""
    return int(counts.sum()) * (_steps(np.diff(edges) / counts, step) + INTERVAL_COST)


def fastest(motion: Motion) -> Float[np.ndarray, "driven"]:
    """Return the highest speed of each driven joint [rad/s], by samples; the motion is known, also under `jit`."""
    breaks, rate = np.asarray(motion.breaks), _derivative(motion, 1)
    time = np.linspace(breaks[0], breaks[-1], 2000)
    piece = np.clip(last_before(breaks, time), 0, len(breaks) - 2)
    return np.asarray(np.abs(np.polyval(rate[:, piece], (time - breaks[piece])[:, None])).max(0))


def _jumps(motion: Motion) -> np.ndarray:
    """Return the breaks at which a derivative up to the third jumps: there a smooth method loses its order."""
    inner = np.asarray(motion.breaks)[1:-1]
    jumps = np.zeros(len(inner), bool)
    for order in range(1, 4):
        largest = max(np.abs(_derivative(motion, order)[-1]).max(), 1e-12)
        jumps |= (jumps_of(motion, order) > JUMP * largest).any(1)
    return inner[jumps]


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


def weights(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights (NODES, places) by which values at the nodes give value, slope and curvature elsewhere.

    Places run from 0 to 1 over the interval; slope and curvature are by that coordinate.
    """
    values, slopes, curvatures = (np.stack([p.deriv(k)(places) for p in basis(NODE_PLACES)]) for k in range(3))
    return values, slopes, curvatures


def some_at_a_time(f: Callable[[TimeIntervals], Any], grid: TimeIntervals) -> Any:
    """Return what f gives for intervals, `TOGETHER` at a time: for all at once it would leave the cache.

    Args:
        f: gives floating-point arrays, the intervals on the first axis.
        grid: the intervals. Where the first of some that are computed together starts at infinity, all of these are
            left out, and zeros stand for what f gives.
    """
    together = gcd(len(grid.start), TOGETHER)
    start, step = (jnp.asarray(x).reshape((-1, together)) for x in (grid.start, grid.step))

    @jax.jit  # traced once for the shapes and the loop
    def of(start: Array, step: Array) -> Any:
        return f(TimeIntervals(start, step, grid.steps))

    def some(none: None, given: tuple[Array, Array]) -> tuple[None, tuple[Array, ...]]:
        return none, tuple(jax.tree.leaves(of(*given)))

    leaves, tree = jax.tree.flatten(jax.eval_shape(of, start[0], step[0]))
    real = where(lambda given: jnp.isfinite(given[0][0]), some, *(leaf.shape for leaf in leaves))
    parts: tuple[Array, ...] = jax.lax.scan(real, None, (start, step))[1]
    return jax.tree.unflatten(tree, [part.reshape((-1, *part.shape[2:])) for part in parts])


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
