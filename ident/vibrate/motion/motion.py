"""The prescribed motion of the pins as a value: joint angles over time, piece by piece a polynomial."""

import math
from collections.abc import Iterator
from functools import reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

from ident.errors import InputError, Problem
from ident.jit import AnyArray, library

JOINED = 1e-9
"""Largest jump of an angle [rad] between two pieces that counts as none."""

FEW = 64
"""Breaks among which a time is faster compared with all than searched for, within a compiled program."""

FASTEST = 1000.0
"""Highest speed override [%]."""

State = tuple[Float[AnyArray, "driven *t"], Float[AnyArray, "driven *t"], Float[AnyArray, "driven *t"]]
"""Angles [rad], their velocities [rad/s] and accelerations [rad/s^2], each `(driven, *t.shape)`."""


class Motion(eqx.Module):
    """Joint angles over time as piecewise polynomials; held still before the first break and from the last one on.

    q(t) = sum over n of c_n (t - breaks[k])^n for breaks[k] <= t < breaks[k + 1]. Angles are continuous; velocity and
    acceleration may jump at a break, where a call gives the values after the jump.

    Attributes:
        name: what the motion is called.
        breaks: (pieces + 1,) [s] times at which some derivative may jump.
        coefficients: (powers, pieces, driven) [rad/s^n] highest power first, as in `scipy.interpolate.PPoly`.
        arrival: () [s] when the arm arrives and dwell begins, on the clock of `breaks`; the end, when not given.
    """

    name: str = eqx.field(static=True)
    breaks: Float[AnyArray, " breaks"]
    coefficients: Float[AnyArray, "powers pieces driven"]
    arrival: float = eqx.field(static=True)

    def __init__(self, name: str, breaks: Any, coefficients: Any, arrival: float | None = None):
        self.name = name
        self.breaks, self.coefficients = _kept(breaks), _kept(coefficients)
        self.arrival = float(self.breaks[-1] if arrival is None else arrival)

    def __check_init__(self) -> None:
        if isinstance(self.breaks, jax.core.Tracer) or isinstance(self.coefficients, jax.core.Tracer):
            return
        problem = next(_faults(np.asarray(self.breaks), np.asarray(self.coefficients), self.arrival), None)
        if problem:
            raise InputError(Problem(self.name, *problem))

    @property
    def duration(self) -> Float[ArrayLike, ""]:
        """Time [s] from the first break to the last."""
        return self.breaks[-1] - self.breaks[0]

    def __call__(self, t: ArrayLike) -> State:
        """Return angles, velocities and accelerations at times t.

        Works under `jit` and `vmap`; differentiable in t (within a piece) and in the coefficients. Where nothing
        is traced the arrays are NumPy's.

        Args:
            t: (*t) [s]

        Returns:
            q, qd, qdd: each (driven, *t) [rad, rad/s, rad/s^2]; at a break the values on the piece after it.
        """
        xp, time, breaks, _ = self._arrays(t)
        first, last = breaks[0], breaks[-1]
        moves = (time >= first) & (time < last)
        piece = last_before(breaks, time)
        at = xp.where(moves, time, xp.where(time < first, first, last))
        q, qd, qdd = self.on_piece(xp.clip(piece, 0, len(breaks) - 2), at)
        return q, xp.where(moves, qd, 0.0), xp.where(moves, qdd, 0.0)

    def on_piece(self, k: int | Int[ArrayLike, "*t"], t: ArrayLike) -> State:
        """Return what a call returns, by the polynomial of piece k: at a break, the values on either side of it.

        Args:
            k: (*t) or () the piece, from 0.
            t: (*t) [s]; beyond the piece its polynomial goes on.

        Returns:
            q, qd, qdd: each (driven, *t) [rad, rad/s, rad/s^2]
        """
        xp, time, breaks, coefficients = self._arrays(t, k)
        piece = xp.broadcast_to(xp.asarray(k), time.shape)
        return _horner(xp, xp.moveaxis(coefficients[:, piece], -1, 1), xp.asarray(time - breaks[piece]))

    def _arrays(self, t: ArrayLike, *more: Any) -> tuple[Any, Any, Any, Any]:
        """Return NumPy, or jax where anything is traced, with times, breaks and coefficients as its arrays."""
        xp = library(t, self.breaks, self.coefficients, *more)
        return xp, xp.asarray(t, float), xp.asarray(self.breaks), xp.asarray(self.coefficients)

    def dwell(self, seconds: float) -> "Motion":
        """Return the motion held still at its end for some time; the arrival stays."""
        _check_seconds(seconds, "dwell")
        if seconds == 0:
            return self
        q, _, _ = self.on_piece(len(self.breaks) - 2, self.breaks[-1])
        xp, _, _, moving = self._arrays(0.0, q)
        still = xp.concatenate([xp.zeros_like(moving[:-1, :1]), q[None, None]])
        coefficients = xp.concatenate([moving, still], axis=1)
        return Motion(self.name, _append(self.breaks, self.breaks[-1:] + seconds), coefficients, self.arrival)

    def at_speed(self, percent: float) -> "Motion":
        """Return the same path on another clock: with s = percent / 100, t -> t/s, qd -> s qd, qdd -> s^2 qdd."""
        s = speed_factor(percent)
        powers = np.arange(len(self.coefficients))[::-1, None, None]
        return Motion(self.name, self.breaks / s, self.coefficients * s**powers, self.arrival / s)


def last_before(starts: Float[AnyArray, "n"], time: Float[AnyArray, "*t"]) -> Int[AnyArray, "*t"]:
    """Return the number of the last start that is not after each time; -1 where all are."""
    if library(starts, time) is np:
        return np.asarray(np.searchsorted(starts, time, side="right") - 1)
    method = "compare_all" if len(starts) <= FEW else "scan"
    return jnp.searchsorted(jnp.asarray(starts), time, side="right", method=method) - 1


def speed_factor(percent: float) -> float:
    """Return the factor of a speed override [%]."""
    if not 0 < percent <= FASTEST:
        remedy = "100 is full speed, 10 a tenth of it"
        raise InputError(Problem("", f"{percent:g} %", f"above 0 and at most {FASTEST:g} %", remedy, "percent"))
    return percent / 100


def _horner(
    xp: Any, c: Float[AnyArray, "powers driven *t"], x: Float[AnyArray, "*t"]
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return the polynomial with its first and second derivative."""
    p, d, half_dd = c[0], xp.zeros_like(c[0]), xp.zeros_like(c[0])
    for lower in c[1:]:
        half_dd = half_dd * x + d
        d = d * x + p
        p = p * x + lower
    return p + 0.0 * x, d, 2.0 * half_dd


def _kept(values: Any) -> Any:
    return values if isinstance(values, jax.Array) else np.asarray(values, float)


def _faults(
    breaks: Float[np.ndarray, " breaks"], c: Float[np.ndarray, "powers pieces driven"], arrival: float
) -> Iterator[tuple[str, str, str]]:
    """Yield what was got, what was expected and what to do, the most basic fault first."""
    if len(breaks) < 2 or c.shape[1] != len(breaks) - 1 or 0 in c.shape:
        shape = f"coefficients {c.shape}"
        yield f"{len(breaks)} breaks and {shape}", "one break more than pieces", "give (powers, pieces, driven)"
    if not (np.isfinite(breaks).all() and np.isfinite(c).all()):
        yield "a break or coefficient that is not finite", "finite numbers", "correct the motion"
    steps = np.diff(breaks)
    if (steps <= 0).any():
        back = int(np.argmax(steps <= 0))
        yield f"a break at {breaks[back + 1]:g} s after {breaks[back]:g} s", "breaks that increase", "sort the pieces"
    ends = reduce(lambda p, lower: p * steps[:, None] + lower, c)
    jumps = np.abs(ends[:-1] - c[-1, 1:])
    if (jumps > JOINED).any():
        k, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
        got = f"a jump of {jumps[k, joint]:.3g} rad of q{joint + 1} at {breaks[k + 1]:g} s"
        yield got, f"angles that join within {JOINED:g} rad", "correct the pieces"
    if not breaks[0] <= arrival <= breaks[-1]:
        yield f"arrival at {arrival:g} s", f"a time from {breaks[0]:g} to {breaks[-1]:g} s", "correct the arrival"


def _check_seconds(seconds: float, name: str) -> None:
    if not 0 <= seconds < math.inf:
        raise InputError(Problem("", f"{seconds:g} s", "a finite time of at least 0 s", "correct the time", name))


def _append(breaks: Any, more: Any) -> Any:
    library = jnp if isinstance(breaks, jax.Array) or isinstance(more, jax.Array) else np
    return library.concatenate([breaks, more])
