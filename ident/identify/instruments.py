"""Available instruments with their accuracy and cost, and the postures that an arm can hold."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import forward_kinematics, point_positions
from ident.errors import refusal, require
from ident.measure import OWN_WEIGHT, Campaign, Load
from ident.measure.covariance import COMMON
from ident.programs import jit
from ident.text import no_such

# -------- Instruments

SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Default standard deviations as shares of the value; assumed."""
RESOLUTION = 1e-5
"""Least standard deviation [m] of a dial gauge, for any deflection; assumed."""
COSTS = {"posture": 10.0, "hammer": 10.0, "labels": 10.0, "dial": 10.0, "load": 20.0}
"""Minutes for each part of an experiment; assumed."""
MOST_COMMON = 0.99
"""Largest common share of a variance: the rest is noise, which every reading has."""


@dataclass(frozen=True)
class Instruments:
    """Available instruments.

    Attributes:
        modes: number of frequencies from a hammer test, from the lowest.
        loads: the load cases.
        sigma: by kind, the standard deviation as a share of the value.
        costs: of the parts of an experiment, in one unit, see `COSTS`.
        common: share of the variance common to all readings of a value in one state: a repeat does not reduce it.
    """

    modes: int = 4
    loads: tuple[Load, ...] = (OWN_WEIGHT,)
    sigma: Mapping[str, float] = field(default_factory=lambda: SIGMA)
    costs: Mapping[str, float] = field(default_factory=lambda: COSTS)
    common: float = COMMON

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", _complete("sigma", self.sigma, SIGMA, above=0.0))
        object.__setattr__(self, "costs", _complete("cost", self.costs, COSTS))
        object.__setattr__(self, "loads", tuple(dict.fromkeys(self.loads)))
        if not 0 <= self.common <= MOST_COMMON:
            expected = f"a share from 0 to {MOST_COMMON:g}"
            raise refusal("common_share", f"{self.common:g}", expected, "0.5 for half of the variance")
        require(self.modes >= 1, "modes", f"{self.modes}", "at least one", "ask for more")


def relative_sigma(campaign: Campaign, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the relative standard deviation by kind: as given, or as in the campaign (the median), or as assumed."""
    measured = {}
    for kind in SIGMA:
        shares = [m.sigma / abs(m.value) for m in campaign.of_kind(kind) if m.value]
        if shares:
            measured[kind] = float(np.median(shares))
    return SIGMA | measured | dict(given or {})


def common_share(campaign: Campaign, given: float | None = None) -> float:
    """Return the common share of the frequencies' variance: as given, as in the campaign (the median), or assumed."""
    if given is not None:
        return given
    shares: list[float] = []
    for places, matrix in campaign.correlated:
        own = [i for i, row in enumerate(places) if campaign.measurements[row].kind == "frequency"]
        shares += [matrix[i][j] for j, i in combinations(own, 2)]
    return float(np.clip(np.median(shares), 0.0, MOST_COMMON)) if shares else COMMON


def _complete(what: str, given: Mapping[str, float], known: Mapping[str, float], above: float = -1e-300) -> dict:
    for name, value in given.items():
        if name not in known:
            raise no_such(what, name, known, "name one of them")
        expected = "a finite number above 0" if above == 0 else "a finite number >= 0"
        require(above < value < np.inf, what, f"{name}={value:g}", expected, "correct it")
    return {**known, **given}


# -------- Posture grid
# Postures within an arm's limits and workspace: a grid over the driven joints, thinned out if too large.

STEP = math.radians(30.0)
SLACK = 1e-9
"""Rounding [rad] accepted at a limit."""
MARGIN = math.radians(2.0)
"""Distance of planned postures from a joint's limit, as controllers stop before it; assumed."""
MOST = 2048
"""Most postures; a power of two, for Sobol's sequence."""


def posture_grid(arm: Arm, step: float = STEP, *, seed: int = 0) -> tuple[Float[np.ndarray, "G joints"], bool]:
    """Return holdable postures [rad], and whether they are a sample, as the full grid would be too large.

    The angles of a joint, or the factor of a line of postures, are the multiples of `step` within the limits. If that
    makes more than `MOST` postures, `MOST` are drawn from Sobol's sequence and rounded to whole degrees; in these a
    first joint about the vertical stays near zero, as it does not affect gravity loads.

    Raises:
        InputError: an invalid step, a joint's limits entirely beyond a full turn, or no holdable posture.
    """
    postures, sampled = all_postures(arm, step, seed)
    admitted = postures[may_be_held(arm, postures)]
    expected, remedy = "one posture at least", "check limits and [workspace], or take a smaller step (`step`)"
    require(len(admitted), arm.name, "no posture that may be held", expected, remedy, "workspace")
    return admitted, sampled


def all_postures(arm: Arm, step: float, seed: int) -> tuple[Float[np.ndarray, "G joints"], bool]:
    """Return the postures [rad] of `posture_grid` before the workspace check, without any compilation.

    Raises:
        InputError: an invalid step, or a joint's limits entirely beyond a full turn.
    """
    got = f"a step of {math.degrees(step):g} deg"
    require(0 < step <= 2 * math.pi, "", got, "a step above 0 and up to 360 deg", "give another step")
    # the angles worth looking at: within the limits, one full turn at most
    spans = [(max(low, -math.pi), min(high, math.pi)) for low, high in (joint.limits for joint in arm.driven)]
    for joint, (low, high) in zip(arm.driven, spans, strict=True):
        got = f"limits of {joint.name} that leave -180 to 180 deg out"
        require(low <= high, arm.name, got, "limits about zero", "shift the zero of the joint", "limits")
    # margin at each limit: at most a quarter of the range
    margins = [(joint.limits, min(MARGIN, (joint.limits[1] - joint.limits[0]) / 4)) for joint in arm.driven]
    inner = [(low + margin, high - margin) for (low, high), margin in margins]
    listed, line = arm.workspace.postures, arm.workspace.line
    if listed:
        return np.array(listed), False
    if line is not None:
        low, high = _shares(spans, line)
        got = f"a step of {math.degrees(step):g} deg, {(high - low) / step:.3g} postures on the line"
        require(high - low <= MOST * step, "", got, f"{MOST} postures at most", "give a larger step", "step")
        return np.outer(np.clip(_multiples(low, high, step), *_shares(inner, line)), line) + 0.0, False
    if math.prod(max((high - low) / step - 1, 1.0) for low, high in spans) <= MOST:
        axes = [_multiples(low, high, step) for low, high in spans]
        if math.prod(map(len, axes)) <= MOST:
            return np.clip(np.array(list(product(*axes))), *np.array(inner).T), False
    from scipy.stats import qmc  # slow to import, and seldom needed

    low, high = np.array(spans).T
    u = qmc.Sobol(len(spans), rng=np.random.default_rng(seed)).random(MOST)
    postures = np.clip(np.deg2rad(np.round(np.rad2deg(low + u * (high - low)))), *np.array(inner).T)
    first = arm.joints[0]
    if first.driven and not np.cross(np.asarray(first.axis), np.asarray(arm.gravity)).any():  # about the vertical
        postures[:, 0] = np.clip(0.0, low[0], high[0])
    return postures, True


def _shares(spans: Sequence[tuple[float, float]], line: Sequence[float]) -> tuple[float, float]:
    """Return the range of a line's factor within the limits."""
    pairs = [sorted((low / share, high / share)) for (low, high), share in zip(spans, line, strict=True) if share]
    return max(low for low, _ in pairs), min(high for _, high in pairs)


def may_be_held(arm: Arm, postures: Float[np.ndarray, "G joints"]) -> Bool[np.ndarray, "G"]:
    """Return the postures in which the rigid arm is within its limits and above its lowest height."""
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


def _multiples(low: float, high: float, step: float) -> list[float]:
    """Return the multiples of a step between two limits, the middle if there is none; a full turn only once."""
    first, last = math.ceil((low - SLACK) / step), math.floor((high + SLACK) / step)
    angles = [i * step for i in range(first, last + 1)] or [(low + high) / 2]
    return angles[1:] if len(angles) > 1 and angles[-1] - angles[0] > 2 * math.pi - SLACK else angles
