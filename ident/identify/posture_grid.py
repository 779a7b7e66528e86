"""The postures that an arm's limits admit: a grid over the driven joints, thinned out where it is too large."""

import math
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from ident.arm.arm import Arm
from ident.errors import InputError, Problem

STEP = math.radians(30.0)
MOST = 2048
"""Postures at most; a power of two, as Sobol's sequence likes."""
SLACK = 1e-9
"""Rounding [rad] that is forgiven at a limit."""


def ranges(arm: Arm) -> list[tuple[float, float]]:
    """Return for each driven joint the angles [rad] worth looking at: its limits, or one full turn."""
    return [(max(low, -math.pi), min(high, math.pi)) for low, high in (joint.limits for joint in arm.driven)]


def posture_grid(arm: Arm, step: float = STEP, *, seed: int = 0) -> tuple[Float[np.ndarray, "G joints"], bool]:
    """Return postures [rad] within the limits, and whether they are a sample of a grid that would be too large.

    The angles of a joint are the multiples of `step` within its limits. Where that makes more than `MOST` postures,
    as many are drawn from Sobol's sequence and rounded to whole degrees.

    Raises:
        InputError: the step is none, or a joint's limits are beyond a full turn altogether.
    """
    if not 0 < step <= 2 * math.pi:
        got = f"a step of {math.degrees(step):g} deg"
        raise InputError(Problem("", got, "a step above 0 and up to 360 deg", "give another step"))
    spans = ranges(arm)
    for joint, (low, high) in zip(arm.driven, spans, strict=True):
        if low > high:
            got = f"limits of {joint.name} that leave -180 to 180 deg out"
            raise InputError(Problem(arm.name, got, "limits about zero", "shift the zero of the joint", "limits"))
    if math.prod(max((high - low) / step - 1, 1.0) for low, high in spans) <= MOST:
        axes = [_multiples(low, high, step) for low, high in spans]
        if math.prod(map(len, axes)) <= MOST:
            return np.array(list(product(*axes))), False
    low, high = np.array(spans).T
    u = qmc.Sobol(len(spans), rng=np.random.default_rng(seed)).random(MOST)
    return np.clip(np.deg2rad(np.round(np.rad2deg(low + u * (high - low)))), low, high), True


def main_joints(postures: Float[np.ndarray, "G joints"], gain: Float[np.ndarray, "G"]) -> list[int]:
    """Return the one or two joints on whose angle the gain depends most, in their order along the arm.

    By the variance of the gain that is left when all other angles are held, averaged; of a sample that is no grid,
    by the variance of the means at each angle.
    """
    effects = []
    for joint in range(postures.shape[1]):
        others = np.delete(postures, joint, 1).round(9)
        groups = np.unique(others, axis=0, return_inverse=True)[1].ravel()
        if len(np.unique(groups)) > 0.9 * len(postures) and postures.shape[1] > 1:
            groups = np.zeros(len(postures), int)
            tenths = np.digitize(postures[:, joint], np.quantile(postures[:, joint], np.linspace(0, 1, 9)[1:-1]))
            effects.append(float(np.nanvar([np.nanmean(gain[tenths == k]) for k in np.unique(tenths)])))
            continue
        count = np.bincount(groups)
        level = np.bincount(groups, gain) / count
        effects.append(float(np.nanmean((gain - level[groups]) ** 2)))
    return sorted(np.argsort(effects)[::-1][:2].tolist())


def _multiples(low: float, high: float, step: float) -> list[float]:
    """Return the multiples of a step between two limits, the middle if there is none; a full turn only once."""
    first, last = math.ceil((low - SLACK) / step), math.floor((high + SLACK) / step)
    angles = [i * step for i in range(first, last + 1)] or [(low + high) / 2]
    return angles[1:] if len(angles) > 1 and angles[-1] - angles[0] > 2 * math.pi - SLACK else angles
