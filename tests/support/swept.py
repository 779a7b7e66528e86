"""Axes of sweeps at given values."""

from collections.abc import Sequence

import numpy as np

from ident.arm.arm import Arm
from ident.vibrate.sweep import Axis


def axis(arm: Arm, paths: Sequence[str], values: np.ndarray, percent: float) -> Axis:
    """Return an axis; its present value is the arm's, or the percentage of the motion at hand."""
    present = percent if "speed" in paths else float(arm.get(paths[0]))
    return Axis(tuple(paths), np.unique(values), present)
