"""Arrays of few sizes, so that one compiled program serves many lengths: no steps are made where one is filled up."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ident.jit import library
from ident.vibrate.motion.motion import Motion

PIECES, POWERS = 32, 14
"""Least number of pieces and of powers of a motion: a stroke has no more, whatever its profile."""
AFTER = 1e6
"""When a motion's pieces begin that are none [s]; each lasts as long."""


def ladder(count: int, least: int, growth: int = 4) -> int:
    """Return the size for so many: the least one, or that times a power of the growth."""
    size = least
    while size < count:
        size *= growth
    return size


def where(
    real: Callable[[Any], Array], body: Callable[[Any, Any], tuple], *shapes: tuple[int, ...]
) -> Callable[[Any, Any], tuple]:
    """Return a body of `jax.lax.scan` that does nothing where what is given is not real.

    There its results, arrays of these shapes, are zeros.
    """

    def guarded(state: Any, given: Any) -> tuple:
        def nothing(state: Any) -> tuple:
            return state, tuple(jnp.zeros(shape) for shape in shapes)

        return jax.lax.cond(real(given), lambda state: body(state, given), nothing, state)

    return guarded


def filled_up(motion: Motion) -> Motion:
    """Return the same motion with pieces long after its end, and powers of nothing; without name and arrival.

    Traced pieces stay as they are.
    """
    breaks, c = motion.breaks, motion.coefficients
    if library(breaks, c) is np:
        breaks, c = _filled_up(motion, np.asarray(breaks), np.asarray(c))
    return Motion("motion", breaks, c, arrival=float(motion.breaks[0]))


def _filled_up(motion: Motion, breaks: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    powers, pieces = (ladder(count, least) - count for count, least in zip(c.shape, (POWERS, PIECES), strict=False))
    q = np.asarray(motion.on_piece(c.shape[1] - 1, breaks[-1])[0])
    still = np.concatenate([np.zeros((c.shape[0] - 1, pieces, c.shape[2])), np.tile(q, (1, pieces, 1))])
    whole = np.pad(np.concatenate([c, still], 1), ((powers, 0), (0, 0), (0, 0)))
    return np.concatenate([breaks, breaks[-1] + AFTER * np.arange(1, pieces + 1)]), whole
