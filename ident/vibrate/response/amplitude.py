"""How large a vibration is, as one number a direction, and as the largest of many: what sweeps and designs compare."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ident.errors import InputError, Problem
from ident.jit import AnyArray
from ident.text import did_you_mean, quoted
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.response import peak, rms
from ident.vibrate.response.simulate import sample_times

MEASURES = {
    "peak": "largest magnitude over the motion",
    "rms": "root mean square over the motion",
    "residual": "largest magnitude after arrival",
}
WINDOW = 0.1
"""Length [s] of the windows whose maxima a peak is the largest of; half a period of 4 to 5 Hz."""


class Amplitude(eqx.Module):
    """A measure of vibrations that are sampled at known times.

    Attributes:
        measure: a name in MEASURES.
        first: number of the sample from which on it counts.
        end: number of samples.
        window: samples of a window.
    """

    measure: str = eqx.field(static=True)
    first: Int[AnyArray, ""]
    end: Int[AnyArray, ""]
    window: int = eqx.field(static=True)

    def __call__(self, vibration: Float[np.ndarray, "3 T *batch"]) -> Float[np.ndarray, "3 *batch"]:
        """Return the amplitude in each direction [m]."""
        late = vibration[:, int(self.first) : int(self.end)]
        return np.asarray((rms if self.measure == "rms" else peak)(late))

    @property
    def count(self) -> int:
        """Number W of windows."""
        return 1 if self.measure == "rms" else -(-int(self.end - self.first) // self.window)

    def places(self, vibration: Float[AnyArray, "3 T"]) -> Int[AnyArray, "3 more"]:
        """Return the samples of which a peak is the largest: of each window and direction where it is farthest out.

        There may be more windows than `count`, of which the last ones mean nothing.
        """
        late = jnp.roll(vibration, -self.first, 1)
        counts = jnp.arange(late.shape[1]) < self.end - self.first
        whole = jnp.pad(jnp.where(counts, jnp.abs(late), 0.0), ((0, 0), (0, -late.shape[1] % self.window)))
        windows = whole.reshape((3, -1, self.window))
        within = jnp.arange(windows.shape[1]) * self.window + windows.argmax(2)
        return jnp.minimum(self.first + within, vibration.shape[1] - 1)

    def root_mean_square(self, vibration: Float[AnyArray, "3 T"]) -> Float[AnyArray, "3 1"]:
        """Return the RMS of each direction over the whole motion [m]; what is behind its end does not count."""
        counts = jnp.arange(vibration.shape[1]) < self.end
        return jnp.sqrt(jnp.where(counts, vibration**2, 0.0).sum(1) / self.end)[:, None]


def amplitude(measure: str, motion: Motion, rate: float) -> Amplitude:
    """Return a measure for a motion sampled at a rate."""
    if measure not in MEASURES:
        remedy = did_you_mean(measure, MEASURES, "choose one of them")
        raise InputError(Problem("", quoted(measure), f"one of {', '.join(MEASURES)}", remedy, "measure"))
    time, first = sample_times(motion, rate), 0
    if measure == "residual":
        first = int(np.searchsorted(time, motion.arrival - 1e-9))
        if first > len(time) - 2:
            got = "a motion that ends at its arrival"
            raise InputError(Problem("", got, "time after it", "hold the arm (`dwell`)", "measure"))
    return Amplitude(measure, np.asarray(first), np.asarray(len(time)), max(1, round(WINDOW * rate)))


def largest(parts: Any) -> Any:
    """Return the largest over directions and windows."""
    return parts.max((0, 1))
