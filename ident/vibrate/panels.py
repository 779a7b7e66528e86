"""Panels of time: what changes with the posture is computed at a few nodes of each and interpolated between them."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Polynomial

from ident.vibrate.motion import Motion

NODES = 6
"""Nodes of a panel: the slow quantities are polynomials of degree five in it."""
STEPS = 64
"""Time steps of a panel."""
NODE_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
"""The nodes within a panel, from 0 to 1."""


def panels(
    motion: Motion, start: float, end: float, step: float
) -> tuple[Float[np.ndarray, "P"], Float[np.ndarray, "P"]]:
    """Divide a span of time into panels of STEPS equal steps, none across a break.

    Args:
        motion: whose breaks are kept.
        start: first time [s].
        end: last time [s].
        step: longest step [s].

    Returns:
        Starts of the panels [s], and their steps [s].
    """
    breaks = np.asarray(motion.breaks)
    edges = np.unique(np.concatenate([[start, end], breaks[(breaks > start) & (breaks < end)]]))
    starts, steps = [], []
    for low, high in pairwise(edges):
        count = int(np.ceil((high - low) / (STEPS * step) - 1e-9))
        starts.append(low + (high - low) / count * np.arange(count))
        steps.append(np.full(count, (high - low) / (count * STEPS)))
    return np.concatenate(starts), np.concatenate(steps)


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
    ends: Float[np.ndarray, "E"],
    y: Float[Array, "n E"],
    yd: Float[Array, "n E"],
    time: Float[np.ndarray, "T"],
) -> tuple[Float[Array, "n T"], Float[Array, "n T"]]:
    """Return values and rates at other times, by cubic Hermite interpolation between the ends of steps."""
    k = np.clip(np.searchsorted(ends, time, side="right") - 1, 0, len(ends) - 2)
    h = ends[k + 1] - ends[k]
    s = (time - ends[k]) / h
    y0, d0, d1 = y[:, k], h * yd[:, k], h * yd[:, k + 1]
    rise = y[:, k + 1] - y0
    a, b = d0 + d1 - 2 * rise, 3 * rise - 2 * d0 - d1
    return y0 + s * (d0 + s * (b + s * a)), (d0 + s * (2 * b + s * 3 * a)) / h
