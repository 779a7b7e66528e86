"""Whether a motion stays within the joint limits, by the extrema of its polynomials."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.arm import Arm, Joint
from ident.errors import InputError, Problem
from ident.vibrate.motion.motion import JOINED, Motion


def beyond_limits(arm: Arm, motion: Motion) -> None:
    """Refuse a motion beyond the joint limits, between its breaks too: all extrema are looked at, not samples.

    Args:
        arm: the arm.
        motion: of as many joints as the arm drives.
    """
    driven = motion.coefficients.shape[-1]
    if driven != len(arm.driven):
        expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
        raise InputError(Problem(motion.name, f"{driven} joint angles", expected, "give every joint's angle"))
    problems = [problem for number, joint in enumerate(arm.driven) for problem in _beyond(motion, number, joint)]
    if problems:
        raise InputError(problems)


def _beyond(motion: Motion, number: int, joint: Joint) -> Iterator[Problem]:
    c, breaks = np.asarray(motion.coefficients)[..., number], np.asarray(motion.breaks)
    low, high = joint.limits
    doubtful = np.flatnonzero(_may_leave(c, np.diff(breaks), low, high)).tolist()
    times = np.concatenate([breaks, *(breaks[k] + _turning_points(c[:, k], np.diff(breaks)[k]) for k in doubtful)])
    angles = np.asarray(motion(times)[0])[number]
    excess = np.maximum(low - angles, angles - high)
    worst = int(np.argmax(excess))
    if excess[worst] > JOINED:
        angle = math.degrees(angles[worst])
        got = f"a motion beyond the joint limits: {joint.name} at {angle:.6g} deg at {times[worst]:.4g} s"
        expected = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits in the arm file"
        yield Problem(motion.name, got, expected, "shorten the path, or correct the limits")


def _may_leave(
    c: Float[np.ndarray, "powers pieces"], lengths: Float[np.ndarray, " pieces"], low: float, high: float
) -> Bool[np.ndarray, " pieces"]:
    """Tell which pieces may leave the limits: a polynomial stays within its Bernstein coefficients.

    b_j = sum over k <= j of C(j, k) / C(n, k) a_k, a_k the factor of the k-th power of the share of the piece. SciPy's
    are the same, and take longer to import than a simulation to compute.
    """
    n = len(c) - 1
    of_powers = np.array([[math.comb(j, k) / math.comb(n, k) for k in range(n + 1)] for j in range(n + 1)])
    bounds = of_powers @ (c[::-1] * lengths ** np.arange(n + 1)[:, None])
    return (bounds.min(axis=0) < low) | (bounds.max(axis=0) > high)


def _turning_points(c: Float[np.ndarray, " powers"], length: float) -> Float[np.ndarray, " times"]:
    """Return the times within a piece, from its start, at which the angle turns back."""
    roots = np.roots(np.polyder(c))
    within = (abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < length)
    return roots.real[within]
