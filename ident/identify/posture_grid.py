"""The postures that an arm's limits and workspace admit: a grid over the driven joints, thinned out where too large."""

import math
from collections.abc import Sequence
from itertools import product

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import forward_kinematics, point_positions
from ident.errors import InputError, Problem
from ident.jit import jit

STEP = math.radians(30.0)
SLACK = 1e-9
"""Rounding [rad] that is forgiven at a limit."""
MOST = 2048
"""Postures at most; a power of two, as Sobol's sequence likes."""


def ranges(arm: Arm) -> list[tuple[float, float]]:
    """Return for each driven joint the angles [rad] worth looking at: its limits, or one full turn."""
    return [(max(low, -math.pi), min(high, math.pi)) for low, high in (joint.limits for joint in arm.driven)]


def posture_grid(arm: Arm, step: float = STEP, *, seed: int = 0) -> tuple[Float[np.ndarray, "G joints"], bool]:
    """Return postures [rad] that may be held, and whether they are a sample of a grid that would be too large.

    The angles of a joint, or the factor of a line of postures, are the multiples of `step` within the limits. Where
    that makes more than `MOST` postures, as many are drawn from Sobol's sequence and rounded to whole degrees; a first
    joint about the vertical, which makes no difference to weights, is held near zero in these.

    Raises:
        InputError: the step is none, a joint's limits are beyond a full turn altogether, or no posture may be held.
    """
    postures, sampled = all_postures(arm, step, seed)
    admitted = postures[may_be_held(arm, postures)]
    if not len(admitted):
        expected, remedy = "one posture at least", "check limits and [workspace], or take a smaller step (`step`)"
        raise InputError(Problem(arm.name, "no posture that may be held", expected, remedy, "workspace"))
    return admitted, sampled


def all_postures(arm: Arm, step: float, seed: int) -> tuple[Float[np.ndarray, "G joints"], bool]:
    """Return the postures [rad] of `posture_grid` before the workspace thins them out; nothing is compiled for it.

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
    listed, line = arm.workspace.postures, arm.workspace.line
    if listed:
        return np.array(listed), False
    if line is not None:
        return np.outer(_on_line(spans, line, step), line) + 0.0, False
    if math.prod(max((high - low) / step - 1, 1.0) for low, high in spans) <= MOST:
        axes = [_multiples(low, high, step) for low, high in spans]
        if math.prod(map(len, axes)) <= MOST:
            return np.array(list(product(*axes))), False
    from scipy.stats import qmc  # long to import, and seldom needed

    low, high = np.array(spans).T
    u = qmc.Sobol(len(spans), rng=np.random.default_rng(seed)).random(MOST)
    postures = np.clip(np.deg2rad(np.round(np.rad2deg(low + u * (high - low)))), low, high)
    if _turns_about_vertical(arm):
        postures[:, 0] = np.clip(0.0, low[0], high[0])
    return postures, True


def _turns_about_vertical(arm: Arm) -> bool:
    """Tell whether the first joint of all turns the whole arm about the vertical."""
    first, gravity = arm.joints[0], np.asarray(arm.gravity)
    return first.driven and not np.cross(np.asarray(first.axis), gravity).any()


def _on_line(spans: Sequence[tuple[float, float]], line: Sequence[float], step: float) -> list[float]:
    """Return the multiples of a step by which a line's shares stay within the limits."""
    pairs = [sorted((low / share, high / share)) for (low, high), share in zip(spans, line, strict=True) if share]
    low, high = max(low for low, _ in pairs), min(high for _, high in pairs)
    if high - low > MOST * step:
        got = f"a step of {math.degrees(step):g} deg, {(high - low) / step:.3g} postures on the line"
        raise InputError(Problem("", got, f"{MOST} postures at most", "give a larger step", "step"))
    return _multiples(low, high, step)


def may_be_held(arm: Arm, postures: Float[np.ndarray, "G joints"]) -> Bool[np.ndarray, "G"]:
    """Tell in which postures an arm is within its limits and keeps above its lowest height, were it rigid."""
    low, high = np.array([joint.limits for joint in arm.driven]).T
    within = np.logical_and(low - SLACK <= postures, postures <= high + SLACK).all(1)
    if not math.isfinite(arm.workspace.lowest):
        return np.asarray(within)
    return np.logical_and(within, np.asarray(_least_height(arm, jnp.asarray(postures.T))) >= arm.workspace.lowest)


@jit
def _least_height(arm: Arm, posture: Float[Array, "driven G"]) -> Float[Array, "G"]:
    """Return the height of the lowest bushing or named point of the rigid arm [m]."""
    chain = at_posture(arm, posture)
    phi = jnp.zeros((3, len(arm.joints), posture.shape[1]))
    return jnp.concatenate([forward_kinematics(chain, phi).centre[2], point_positions(chain, phi)[2]]).min(0)


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
