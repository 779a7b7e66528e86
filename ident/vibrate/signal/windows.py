"""Windows by name, with the two numbers that a reader of a spectrum needs: gain and noise bandwidth."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ident.errors import Problem
from ident.text import did_you_mean, quoted
from ident.vibrate.signal.series import refuse

WINDOWS = {
    "boxcar": "rectangular",
    "hann": "Hann",
    "hamming": "Hamming",
    "blackmanharris": "Blackman-Harris",
    "flattop": "flat-top",
}
"""SciPy's names of the windows, and how people write them."""


def window_samples(window: str, count: int) -> Float[np.ndarray, "N"]:
    """Return the periodic (DFT-even) form of a window, (N,) [-]."""
    from scipy.signal import get_window

    refuse(_window_problems(window))
    return np.asarray(get_window(window, count, fftbins=True))


def noise_bandwidth(weights: Float[np.ndarray, "N"]) -> float:
    """Return a window's equivalent noise bandwidth in bins, N sum(w^2) / sum(w)^2: 1 for boxcar, 1.5 for Hann.

    References:
        Harris, "On the use of windows for harmonic analysis with the DFT", Proc. IEEE 66 (1978), eq. (11).
    """
    return len(weights) * float(np.sum(weights**2)) / float(np.sum(weights)) ** 2


def overlap_problems(overlap: float) -> Iterator[Problem]:
    """Yield what is wrong with the share by which segments overlap."""
    if not 0 <= overlap < 1:
        yield Problem("overlap", f"{overlap:g}", "a share from 0 to below 1", "0.5 suits the Hann window")


def averaging_words(window: str, segments: str, overlap: float, resolution: float, bandwidth: float) -> str:
    """Say window, segments and resolution on one line, for a figure."""
    overlapping = f", {100 * overlap:.0f} % overlap" if overlap else ""
    widths = f"resolution {_digits(resolution, 2)} Hz, ENBW {_digits(bandwidth, 2)} Hz"
    return f"{WINDOWS[window]} window, {segments} of {_digits(1 / resolution, 3)} s{overlapping}, {widths}"


def _digits(value: float, count: int) -> str:
    return f"{value:#.{count}g}".rstrip(".")


def _window_problems(window: str) -> Iterator[Problem]:
    if window not in WINDOWS:
        remedy = did_you_mean(window, WINDOWS, "hann suits most traces")
        yield Problem("window", quoted(window), f"one of {', '.join(WINDOWS)}", remedy)
