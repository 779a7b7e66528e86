"""Whether times are evenly spaced, and by how much."""

import numpy as np

from ident.errors import require

UNEVEN = 0.01
"""Largest deviation of a sampling interval from the mean one, as a fraction of it."""
COARSE = 0.2
"""Largest deviation from even times by rounding, as a fraction of their interval."""
GAP = 3.0
"""Pause, in intervals, from which samples count as missing: interpolation would invent them; assumed."""
ROUNDED = 0.05
"""Largest error of an interval stated with few digits: 0.000020 s for 1 / 51.2 kHz has 2.4 %."""


def even_step(time: np.ndarray, file: str, column: str = "time") -> float:
    """Return the mean interval of times [s].

    Raises:
        InputError: times are not numbers, do not increase, or are uneven by more than 1 % and by more than their last
            digit.
    """
    steps = np.diff(time)
    is_finite = np.isfinite(time).all()
    require(is_finite, file, "times that are no numbers", "times that increase", "export it again", column)
    mean = float(steps.mean())
    if not mean > 0 or abs(steps - mean).max() > UNEVEN * mean:
        digit, (worst, expected, remedy) = last_digit(time) + 4 * float(np.spacing(abs(time).max())), odd_interval(time)
        got = f"an interval of {steps[worst]:.6g} s before sample {worst + 2}, from {time[worst]:.6g} s"
        require(rounded_step(time, digit) is not None, file, got, expected, remedy, column)
    return mean


def odd_interval(time: np.ndarray) -> tuple[int, str, str]:
    """Return the interval of times [s] farthest from the median one, the expectation, and the remedy."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    worst = int(np.argmax(abs(steps - usual)))
    remedy = "resample the recording at even intervals; if only its times are rounded, write more digits"
    if abs(np.delete(steps, worst) - usual).max(initial=0.0) <= UNEVEN * usual and steps[worst] > GAP * usual:
        remedy = "cut the recording there, or record it again"
    return worst, f"{usual:.6g} s within 1 %, the median interval", remedy


def last_digit(time: np.ndarray) -> float:
    """Return the largest power of ten that divides all times [s] as printed; nan for none above 1e-12 s."""
    for power in range(13):
        scaled = time * 10.0**power
        if (abs(scaled - np.rint(scaled)) <= 1e-9 * np.maximum(abs(scaled), 1.0)).all():
            return 10.0**-power
    return float("nan")


def rounded_step(time: np.ndarray, digit: float, said: float | None = None, fine: float = 0.0) -> float | None:
    """Return the step of times [s] that are even within their last printed digit; None if they are not.

    Args:
        time: (T,) [s]
        digit: [s] last printed digit of the times.
        said: [s] step stated in the file, returned if the times agree with it.
        fine: [s] last digit of the stated step.
    """
    number, passed = np.arange(len(time)), time - time[0]
    if said is not None and float(abs(passed - said * number).max()) <= digit:
        return said
    if len(time) < 2:
        return float("nan")
    mean = float(passed[-1]) / (len(time) - 1)
    agrees = said is None or abs(mean - said) <= min(fine / 2 + digit / (len(time) - 1), ROUNDED * said)
    return mean if agrees and float(abs(passed - mean * number).max()) <= min(digit, COARSE * mean) else None
