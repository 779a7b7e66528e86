"""Sampled traces as they come in: what every spectrum demands of them, checked once."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ident.errors import InputError, Problem

UNIFORM = 1e-2
"""Largest deviation of a time step from the mean step, relative to it.

Times written with six digits deviate by 0.5 % at 500 samples a second for 10 s, and `ident.measure` admits as much.
As jitter it is noise of 1 % of a sine at a quarter of the sampling rate; as drift it spreads a peak over 1 % of its
frequency.
"""
SHORTEST = 16
"""Samples below which a trace or a segment is too short for a spectrum."""


@dataclass(frozen=True)
class Samples:
    """A trace that is uniformly sampled and has no gaps.

    Attributes:
        time: (T,) [s] ascending, uniform within UNIFORM.
        values: (T, ...) [any] finite.
    """

    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T *D"]

    @property
    def step(self) -> float:
        """Mean time step [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.step


def samples(time: ArrayLike, values: ArrayLike) -> Samples:
    """Check a trace.

    Args:
        time: (T,) [s].
        values: (T, ...) [any] one row for each time.

    Returns:
        The trace in double precision.
    """
    t, x = np.asarray(time, float), np.asarray(values, float)
    refuse(_shape_problems(t, x))
    refuse(_gaps(t, x))
    refuse(_uneven(t))
    return Samples(t, x)


def refuse(problems: Iterable[Problem]) -> None:
    """Raise an InputError if there is any problem."""
    if problems := tuple(problems):
        raise InputError(problems)


def band_problems(low: float, high: float) -> Iterator[Problem]:
    """Yield what is wrong with a band of frequencies [Hz]."""
    if not 0 <= low < high:
        got = f"{low:g} to {high:g} Hz"
        yield Problem("band", got, "0 <= low < high", "give the lower frequency first")


def _shape_problems(time: np.ndarray, values: np.ndarray) -> Iterator[Problem]:
    if time.ndim != 1:
        yield Problem("time", f"an array of shape {time.shape}", "one dimension", "give one time for each sample")
    elif values.shape[:1] != time.shape:
        got, expected = f"an array of shape {values.shape}", f"{len(time)} samples along the first axis, as in time"
        yield Problem("values", got, expected, "transpose it, or give times and values of the same samples")
    elif len(time) < SHORTEST:
        yield Problem("time", f"{len(time)} samples", f"at least {SHORTEST}", "give a longer trace")


def _gaps(time: np.ndarray, values: np.ndarray) -> Iterator[Problem]:
    for name, array in (("time", time), ("values", values)):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            got = f"{array[tuple(bad[0])]} at sample {bad[0][0]}, {len(bad)} such in all"
            yield Problem(name, got, "finite numbers", "cut the trace where it has a gap, or fill the gap yourself")


def _uneven(time: np.ndarray) -> Iterator[Problem]:
    steps, mean = np.diff(time), (time[-1] - time[0]) / (len(time) - 1)
    worst = int(np.argmax(np.abs(steps - mean)))
    if mean <= 0:
        yield Problem("time", f"a mean step of {mean:.4g} s", "ascending times", "sort the samples by time")
    elif abs(steps[worst] - mean) > UNIFORM * mean:
        got = f"a step of {steps[worst]:.6g} s after sample {worst}"
        yield Problem("time", got, f"uniform steps of {mean:.6g} s", "resample the trace to uniform steps")
