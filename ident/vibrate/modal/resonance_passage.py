"""How far a mode builds up while an excitation passes its natural frequency."""

import numpy as np
from jaxtyping import Float

QUASI_STEADY = 3.6
"""Sweep number up to which a mode's response is nearly that to a steady excitation."""
STEPS = 20.0
"""Time steps in a cycle of the largest difference of frequencies."""
RATIO = 1e-12
"""Least damping ratio, so that nothing is divided by zero."""


def sweep_number(rate: Float[np.ndarray, ""] | float, frequency: float, damping_ratio: float) -> float:
    """Return eta = |rate| / (zeta f)^2 [-], the sweep rate over the square of half the half-power bandwidth.

    The bandwidth 2 zeta f is passed in 2 zeta f / rate, the mode builds up in 1 / (2 pi zeta f): in 4 pi / eta times
    its time constant. Up to 3.6 (a linear sweep of 216 f^2 zeta^2 Hz a minute) modal testing takes the response for
    steady; far above, the damping hardly matters and an undamped mode reaches 3.67 f / sqrt(rate) times the static
    response.

    Args:
        rate: () [Hz/s] of the excitation relative to the mode.
        frequency: () [Hz] natural frequency.
        damping_ratio: () [-]

    References:
        Lewis, "Vibration during acceleration through a critical speed", Trans. ASME 54, 1932. Ewins, "Modal Testing",
        2nd ed., 2000, 3.9 (the limit of ISO 7626-2).
    """
    return abs(float(rate)) / (max(damping_ratio, RATIO) * frequency) ** 2


def magnification(
    time: Float[np.ndarray, "T"],
    natural: Float[np.ndarray, "T"],
    damping_ratio: Float[np.ndarray, "T"],
    excitation: Float[np.ndarray, "T"],
) -> Float[np.ndarray, "T"]:
    """Return the amplitude of a mode over that of its static response to the same force, from rest at the start.

    One mode with the slowly varying envelope A of its response to a force of constant amplitude, near resonance:

        dA/dt = -2 pi f (zeta - i (1 - f_exc / f)) A + pi f

    so that steady excitation at resonance gives 1 / (2 zeta). Exact in each time step for constant frequencies.

    Args:
        time: (T,) [s] ascending.
        natural: (T,) [Hz]
        damping_ratio: (T,) [-]
        excitation: (T,) [Hz]

    References:
        Lewis, "Vibration during acceleration through a critical speed", Trans. ASME 54, 1932. Nayfeh, Mook, "Nonlinear
        Oscillations", 1979, 2.1 (slowly varying amplitude and phase).
    """
    apart = float(np.abs(natural - excitation).max()) + float(natural.max()) / STEPS
    fine = np.unique(np.concatenate([time, np.arange(time[0], time[-1], 1 / (STEPS * apart))]))
    middle, step = (fine[:-1] + fine[1:]) / 2, np.diff(fine)
    f, zeta, turning = (np.interp(middle, time, x) for x in (natural, damping_ratio, excitation))
    z = 2 * np.pi * (-np.maximum(zeta, RATIO) * f + 1j * (f - turning)) * step
    forced = np.pi * f * step * np.expm1(z) / z
    amplitudes = [0.0]
    state = 0j
    for factor, added in zip(np.exp(z).tolist(), forced.tolist(), strict=True):
        state = factor * state + added
        amplitudes.append(abs(state))
    return np.asarray(amplitudes)[np.searchsorted(fine, time)]
