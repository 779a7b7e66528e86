"""Panels of time: what changes with the posture is computed at a few nodes of each and interpolated between them."""

from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Polynomial
from scipy.interpolate import PPoly

from ident.vibrate.motion import Motion

NODES = 6
"""Nodes of a panel: the slow quantities are polynomials of degree five in it."""
NODE_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
"""The nodes within a panel, from 0 to 1."""
TURN = 0.35
"""Largest turn of a pin within a panel [rad]: polynomials of degree five follow its sine to 1e-7."""
JUMP = 1e-6
"""Jump of a derivative, against its largest value, that counts as one."""

Times = Float[Array | np.ndarray, "T"]


class Panels(NamedTuple):
    """A span of time in panels of as many equal steps each.

    Attributes:
        start: (P,) [s] where the panels start.
        step: (P,) [s] the steps of each.
        steps: number S of steps of a panel.
    """

    start: Float[Array | np.ndarray, "P"]
    step: Float[Array | np.ndarray, "P"]
    steps: int

    @property
    def ends(self) -> Float[Array | np.ndarray, "P ends"]:
        """Ends of all steps of each panel, its start first [s]."""
        return self.start[:, None] + self.step[:, None] * np.arange(self.steps + 1)


def panels(motion: Motion, end: float, step: float) -> Panels:
    """Divide the time from the first break of a motion, none of them across a jump of its derivatives.

    Args:
        motion: what the motors are told.
        end: last time [s].
        step: longest step [s].
    """
    jumps = _jumps(motion)
    edges = np.unique(np.concatenate([[float(motion.breaks[0]), end], jumps[jumps < end]]))
    speed = np.abs(np.asarray(motion(np.linspace(edges[0], end, 1000))[1])).max()
    longest = min(TURN / max(speed, 1e-9), 200 * step)
    counts = [int(np.ceil((high - low) / longest - 1e-9)) for low, high in pairwise(edges)]
    lengths = np.diff(edges) / counts
    start = np.concatenate([low + n * np.arange(c) for low, n, c in zip(edges, lengths, counts, strict=False)])
    length = np.repeat(lengths, counts)
    steps = max(1, int(np.ceil(length.max() / step - 1e-9)))
    return Panels(start, length / steps, steps)


def _jumps(motion: Motion) -> np.ndarray:
    """Return the breaks at which a derivative up to the third jumps: there a smooth method loses its order."""
    path = PPoly(np.asarray(motion.coefficients), np.asarray(motion.breaks))
    inner = path.x[1:-1]
    jumps = np.zeros(len(inner), bool)
    for order in range(1, 4):
        rate = path.derivative(order)
        before = np.stack([_at_end(rate, k) for k in range(len(inner))]) if len(inner) else np.zeros((0, 1))
        after = rate.c[-1, 1:]
        jumps |= (np.abs(after - before) > JUMP * max(np.abs(rate.c[-1]).max(), 1e-12)).any(1)
    return inner[jumps]


def _at_end(path: PPoly, k: int) -> np.ndarray:
    """Return the value of piece k at its end."""
    return np.polyval(path.c[:, k], path.x[k + 1] - path.x[k])


def weights(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights (NODES, places) by which values at the nodes give value, slope and curvature elsewhere.

    Places run from 0 to 1 over the panel; slope and curvature are by that coordinate.
    """
    basis = [Polynomial.fromroots(np.delete(NODE_PLACES, k)) for k in range(NODES)]
    basis = [p / p(x) for p, x in zip(basis, NODE_PLACES, strict=True)]
    values, slopes, curvatures = (np.stack([p.deriv(k)(places) for p in basis]) for k in range(3))
    return values, slopes, curvatures


def interpolate(x: Array, W: np.ndarray, axis: int) -> Array:
    """Return the sum over the nodes, on `axis` of x, of their values times their weights (NODES, places)."""
    lifted = W.reshape((1,) * axis + W.shape + (1,) * (x.ndim - axis - 1))
    return (jnp.expand_dims(x, axis + 1) * lifted).sum(axis)


def resample(
    ends: Float[Array, "E"], y: Float[Array, "n E"], yd: Float[Array, "n E"], time: Times
) -> tuple[Array, Array]:
    """Return values and rates at other times, (n, T) each, by cubic Hermite interpolation between the ends of steps."""
    k = jnp.clip(jnp.searchsorted(ends, time, side="right") - 1, 0, len(ends) - 2)
    h = ends[k + 1] - ends[k]
    s = (time - ends[k]) / h
    y0, d0, d1 = y[:, k], h * yd[:, k], h * yd[:, k + 1]
    rise = y[:, k + 1] - y0
    a, b = d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1
    return y0 + s * (d0 + s * (b + s * a)), (d0 + s * (2 * b + s * 3 * a)) / h


def joined(ends: Float[Array | np.ndarray, "P ends"]) -> Float[Array, "E"]:
    """Put values at the ends of each panel's steps one after another; the last of one is the first of the next."""
    return jnp.concatenate([ends[:1, 0], ends[:, 1:].ravel()])
