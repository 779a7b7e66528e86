"""Windows of a hammer test: about the pulse for the force, and one that fades all of it out.

The window exp(-sigma t) on force and response alike makes of the response function H(s) the same function on
another line of the complex plane, H(sigma + i omega): each pole p becomes p - sigma, exactly.

References:
    Ewins, "Modal Testing", 2nd ed. 2000, section 3.7.4 (exponential window and its correction).
"""

import math

import numpy as np

MARGIN = 3.0
"""Duration of the force window's flat part behind the pulse and of its fall, each, in durations of the pulse."""


def exponential_decay(duration: float, end: float, applied: float = 0.0) -> float:
    """Return by how much a window is still to fade a record [1/s] so that it ends at a share of its start.

    Args:
        duration: [s] of the record.
        end: [-] the share; 1 for no window.
        applied: [1/s] what the analyser's own window has faded already.
    """
    return max(-math.log(end) / duration - applied, 0.0)


def exponential_window(count: int, step: float, decay: float) -> np.ndarray:
    """Return exp(-decay t) at samples of a record, (T,) [-]."""
    return np.exp(-decay * step * np.arange(count))


def force_window(count: int, begin: int, end: int) -> np.ndarray:
    """Return a window (T,) [-] that is one up to some time behind a pulse, from there on falls as a cosine to zero.

    Args:
        count: samples T.
        begin: first sample of the pulse.
        end: first sample after it.
    """
    width = max(math.ceil(MARGIN * (end - begin)), 2)
    window = np.zeros(count)
    flat = min(end + width, count)
    window[:flat] = 1.0
    fall = np.cos(np.linspace(0.0, np.pi / 2, width)) ** 2
    window[flat : flat + width] = fall[: count - flat]
    return window
