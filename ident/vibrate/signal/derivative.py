"""From displacement to acceleration: the second derivative of a sampled trace, by its spectrum."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from ident.vibrate.signal.series import samples


def second_derivative(time: ArrayLike, values: ArrayLike) -> Float[np.ndarray, "T *D"]:
    """Return the second time derivative of a trace: each sine of its series times -(2 pi f)^2.

    A sine series alone would bend the trace straight at both ends. So a cubic with the trace's ends and end curvatures
    is taken off first, and its own second derivative, a straight line, put back. Exact up to the Nyquist frequency
    away from the ends; at the ends as good as the curvature of a cubic spline there.

    Args:
        time: (T,) [s] uniform, see `series.samples`.
        values: (T, ...) [m].

    Returns:
        (T, ...) [m/s^2].

    References:
        Lanczos, "Discourse on Fourier Series", 1966, section 16. Brandt, 2nd ed., 2023, section 3.4.
    """
    from scipy.fft import dst, idst
    from scipy.interpolate import CubicSpline

    trace = samples(time, values)
    ends, duration = trace.time[[0, -1]], trace.time[-1] - trace.time[0]
    s = ((trace.time - ends[0]) / duration).reshape(-1, *[1] * (trace.values.ndim - 1))
    first, last = CubicSpline(trace.time, trace.values)(ends, 2)
    bent = duration**2 * (first * (s**2 / 2 - s**3 / 6) + last * s**3 / 6)
    rest = trace.values - bent
    rest = rest - rest[0] - s * (rest[-1] - rest[0])
    frequency = (np.arange(1, len(s) - 1) / (2 * duration)).reshape(-1, *[1] * (trace.values.ndim - 1))
    series = -((2 * np.pi * frequency) ** 2) * dst(rest[1:-1], type=1, axis=0)
    second = first * (1 - s) + last * s
    second[1:-1] += idst(series, type=1, axis=0)
    return second
