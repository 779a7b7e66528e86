"""Whether times are evenly spaced, and by how much."""

import numpy as np

from ident.errors import InputError, Problem

UNEVEN = 0.01
"""Largest deviation of a sampling interval from the mean one, as a fraction of it."""


def even_step(time: np.ndarray, file: str, column: str = "time") -> float:
    """Return the mean interval of times [s].

    Raises:
        InputError: they are no numbers, do not increase, or are not even within 1 %.
    """
    steps = np.diff(time)
    remedy = "resample the recording at even intervals; if only its times are rounded, write more digits"
    if not np.isfinite(time).all():
        raise InputError(Problem(file, "times that are no numbers", "times that increase", "export it anew", column))
    mean = float(steps.mean())
    worst = int(np.argmax(abs(steps - mean)))
    if not mean > 0 or abs(steps[worst] - mean) > UNEVEN * mean:
        got = f"an interval of {steps[worst]:.6g} s before sample {worst + 2}"
        raise InputError(Problem(file, got, f"{mean:.6g} s within 1 %, the mean interval", remedy, column))
    return mean
