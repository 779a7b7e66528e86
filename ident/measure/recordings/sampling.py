"""Whether times are evenly spaced, and by how much."""

import numpy as np

from ident.errors import require

UNEVEN = 0.01
"""Largest deviation of a sampling interval from the mean one, as a fraction of it."""
COARSE = 0.2
"""Largest deviation from even times by rounding, as a fraction of their interval."""
GAP = 3.0
"""Intervals that a pause lasts at least for samples to be missing: interpolated, they would be invented; assumed."""
ROUNDED = 0.05
"""Largest error of an interval that a file states in few digits: 0.000020 s for 1 / 51.2 kHz has 2.4 %."""


def even_step(time: np.ndarray, file: str, column: str = "time") -> float:
    """Return the mean interval of times [s].

    Raises:
        InputError: they are no numbers, do not increase, or are even neither within 1 % nor within their last digit.
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
    """Return which interval of times [s] differs most from the median one, what was expected, and what to do."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    worst = int(np.argmax(abs(steps - usual)))
    remedy = "resample the recording at even intervals; if only its times are rounded, write more digits"
    if abs(np.delete(steps, worst) - usual).max(initial=0.0) <= UNEVEN * usual and steps[worst] > GAP * usual:
        remedy = "cut the recording there, or record it again"
    return worst, f"{usual:.6g} s within 1 %, the median interval", remedy


def last_digit(time: np.ndarray) -> float:
    """Return the largest power of ten that divides all times [s], as they were printed; nan for none above 1e-12 s."""
    for power in range(13):
        scaled = time * 10.0**power
        if (abs(scaled - np.rint(scaled)) <= 1e-9 * np.maximum(abs(scaled), 1.0)).all():
            return 10.0**-power
    return float("nan")


def rounded_step(time: np.ndarray, digit: float, said: float | None = None, fine: float = 0.0) -> float | None:
    """Return the step of times [s] that are even within their last printed digit, None where they are not.

    Args:
        time: (T,) [s]
        digit: [s] of the times, the last that was printed.
        said: [s] step that the file states: it is returned where the times agree with it.
        fine: [s] last digit of that.
    """
    number, passed = np.arange(len(time)), time - time[0]
    if said is not None and float(abs(passed - said * number).max()) <= digit:
        return said
    if len(time) < 2:
        return float("nan")
    mean = float(passed[-1]) / (len(time) - 1)
    agrees = said is None or abs(mean - said) <= min(fine / 2 + digit / (len(time) - 1), ROUNDED * said)
    return mean if agrees and float(abs(passed - mean * number).max()) <= min(digit, COARSE * mean) else None
