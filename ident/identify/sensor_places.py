"""Where to put accelerometers and where to hit, so that the modes of a hammer test are excited and told apart."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.labels import Label
from ident.arm.parts import Point
from ident.errors import InputError, Problem
from ident.identify.experiments import Experiment
from ident.identify.modal_analysis import modal_analysis
from ident.measure import OWN_WEIGHT, Load

ALIKE = 0.9
"""Auto-MAC from which on two modes move alike where it is measured."""
SEEN = 0.05
"""Motion at the places below which a mode is not seen there, as a share of its largest one anywhere."""
HIT = 0.1
"""The same below which a hit does not excite it."""
FEWEST, PLACES_MOST = 5, 20
"""Hits at a place: from five on their scatter says what the covariance is; more than twenty are not made."""
APART = 6.0
"""Standard deviations of a shape by which two modes are to differ: three for each."""
TRIED = 20000
"""Sets of places that are all tried."""
AXES = (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0)))


@dataclass(frozen=True)
class HammerPlan:
    """A hammer test at a posture: places, and how well they tell the modes apart.

    Attributes:
        posture: (joints,) [rad]
        load: the load case.
        labels: (m,) the modes.
        frequency: (m,) [Hz]
        sensors: places of accelerometers' channels, `tip z`; the pin of a joint goes by the joint's name.
        hits: places to hit, likewise.
        count: hits at each.
        auto_mac: (m, m) [-] of the modes at the sensors.
        coincide: pairs of modes within their resonances' widths of each other, which need two places to hit.
    """

    posture: tuple[float, ...]
    load: Load
    labels: tuple[Label, ...]
    frequency: Float[np.ndarray, "m"]
    sensors: tuple[str, ...]
    hits: tuple[str, ...]
    count: int
    auto_mac: Float[np.ndarray, "m m"]
    coincide: tuple[tuple[int, int], ...]

    @property
    def most_alike(self) -> tuple[int, int]:
        """The two modes that are hardest to tell apart."""
        upper = np.triu(self.auto_mac, 1)
        i, j = np.unravel_index(int(np.argmax(upper)), upper.shape)
        return int(i), int(j)

    @property
    def alike(self) -> tuple[tuple[int, int], ...]:
        """Pairs of modes that these places do not tell apart."""
        return tuple((int(i), int(j)) for i, j in np.argwhere(np.triu(self.auto_mac, 1) > ALIKE))


def hammer_plans(
    arm: Arm, batch: Sequence[Experiment], modes: int, sensors: int, noise: float
) -> tuple[HammerPlan, ...]:
    """Return where to measure and to hit in the hammer tests of a batch.

    Args:
        arm: the arm; its points and its joints' pins are the places.
        batch: the experiments; each posture and load of a hammer test counts once.
        modes: of each test, from the lowest.
        sensors: channels of accelerometers at hand, each at a place along x, y or z of the base.
        noise: [-] standard deviation of one hit's shape, as a share of its length.

    Raises:
        InputError: fewer than two channels.
    """
    if sensors < 2:
        remedy = "one channel tells no modes apart"
        raise InputError(Problem("", f"{sensors}", "two channels or more", remedy, "sensors"))
    placed = with_pins(arm)
    states = dict.fromkeys((each.posture, each.load) for each in batch if each.hammer)
    return tuple(hammer_plan(placed, *state, modes=modes, sensors=sensors, noise=noise) for state in states)


def with_pins(arm: Arm) -> Arm:
    """Return the arm with the pin of each joint as a point beside its own, the end point last."""
    own = {point.name for point in arm.points}
    pins = [Point(j.name, j.name, (0.0, 0.0, 0.0)) for j in arm.joints if j.name not in own]
    return eqx.tree_at(lambda a: a.points, arm, (*pins, *arm.points))


def hammer_plan(
    arm: Arm, posture: tuple[float, ...], load: Load = OWN_WEIGHT, *, modes: int, sensors: int, noise: float
) -> HammerPlan:
    """Choose places by the least auto-MAC of all sets; of too many: the best pair, then what lowers it most.

    References:
        Carne, Dohrmann, "A modal test design strategy for model correlation", IMAC 13, 1995 (least auto-MAC).
    """
    known = modal_analysis(arm, posture, load, modes)
    motion = np.asarray(known.modes.motion)
    names = [f"{point.name} {axis}" for point in arm.points for axis, _ in AXES]
    moved = np.moveaxis(motion, 0, 1).reshape(len(names), -1)
    chosen = _sensors(moved, min(sensors, len(names)))
    mac = auto_mac(moved, chosen)
    frequency = np.asarray(known.modes.frequency)
    close = coinciding(frequency, np.asarray(known.damping_ratio))
    return HammerPlan(
        posture,
        load,
        known.labels,
        frequency,
        tuple(names[i] for i in chosen),
        tuple(names[i] for i in _hits(moved, two=bool(close))),
        hits_needed(mac, noise),
        mac,
        close,
    )


def auto_mac(moved: Float[np.ndarray, "K m"], places: Sequence[int]) -> Float[np.ndarray, "m m"]:
    """Return how alike modes move at some places; one for a mode that is hardly seen there."""
    own = moved[list(places)]
    length = np.linalg.norm(own, axis=0)
    seen = length > SEEN * np.abs(moved).max(0)
    unit = own / np.where(length > 0, length, 1.0)
    return np.where(seen & seen[:, None], (unit.T @ unit) ** 2, 1.0)


def coinciding(frequency: Float[np.ndarray, "m"], damping_ratio: Float[np.ndarray, "m"]) -> tuple[tuple[int, int], ...]:
    """Return the pairs of modes that are nearer than the half of both half-power bandwidths 2 zeta f."""
    half = damping_ratio * frequency
    pairs = combinations(range(len(frequency)), 2)
    return tuple((i, j) for i, j in pairs if abs(frequency[i] - frequency[j]) < half[i] + half[j])


def hits_needed(mac: Float[np.ndarray, "m m"], noise: float) -> int:
    """Return how many hits make the two modes that are most alike differ by `APART` standard deviations.

    Shapes of unit length are sqrt(1 - MAC) apart, and the mean of n hits scatters by noise / sqrt(n). Modes that
    no number of hits tells apart are left to other places.
    """
    upper = mac[np.triu_indices(len(mac), 1)]
    apart = 1 - max((value for value in upper.tolist() if value <= ALIKE), default=0.0)
    return min(max(FEWEST, math.ceil((APART * noise) ** 2 / apart)), PLACES_MOST)


def _sensors(moved: Float[np.ndarray, "K m"], count: int) -> list[int]:
    whole = math.comb(len(moved), count) <= TRIED
    sets = combinations(range(len(moved)), count if whole else 2)
    chosen = list(min(sets, key=lambda each: _worst(moved, list(each))))
    while len(chosen) < count:
        left = [i for i in range(len(moved)) if i not in chosen]
        chosen.append(min(left, key=lambda i: _worst(moved, [*chosen, i])))
    return sorted(chosen)


def _worst(moved: Float[np.ndarray, "K m"], places: Sequence[int]) -> tuple[float, float, float]:
    """Return the largest auto-MAC, the mean one where several are as large, and how little the places move."""
    upper = auto_mac(moved, places)[np.triu_indices(moved.shape[1], 1)]
    motion = np.linalg.norm(moved[list(places)] / np.abs(moved).max(0), axis=0)
    return round(float(upper.max(initial=0.0)), 3), round(float(upper.mean() if len(upper) else 0.0), 3), -motion.min()


def _hits(moved: Float[np.ndarray, "K m"], *, two: bool) -> list[int]:
    """Return the place that excites all modes best; two where one does not do, or two are asked for."""
    share = np.abs(moved) / np.abs(moved).max(0)
    one = int(np.argmax(share.min(1)))
    if share[one].min() >= HIT and not two:
        return [one]
    pairs = combinations(range(len(moved)), 2)
    return list(max(pairs, key=lambda pair: float(share[list(pair)].max(0).min())))
