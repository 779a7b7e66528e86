"""How large a vibration is, as one number a direction, and as the largest of many: what sweeps and designs compare."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem
from ident.text import did_you_mean, quoted
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.response import Vibration, peak, rms
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
        window: samples of a window.
    """

    measure: str = eqx.field(static=True)
    first: int = eqx.field(static=True)
    window: int = eqx.field(static=True)

    def __call__(self, vibration: Vibration) -> Float[Array, "3 *batch"]:
        """Return the amplitude in each direction [m]."""
        late = vibration[:, self.first :]
        return rms(late) if self.measure == "rms" else peak(late)

    def parts(self, vibration: Float[Array, "3 T"]) -> Float[Array, "3 W"]:
        """Return the maxima of the windows, smooth where one sample of each is the largest; of an RMS itself."""
        late = vibration[:, self.first :]
        if self.measure == "rms":
            return rms(late)[:, None]
        count = -(-late.shape[1] // self.window)
        padded = jnp.pad(jnp.abs(late), ((0, 0), (0, count * self.window - late.shape[1])))
        return padded.reshape((3, count, self.window)).max(2)


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
    return Amplitude(measure, first, max(1, round(WINDOW * rate)))


def largest(parts: Any) -> Any:
    """Return the largest over directions and windows."""
    return parts.max((0, 1))
