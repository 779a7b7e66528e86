"""Experiments that could be made: postures, sensors and loads, what an arm would show, and what that would tell."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.mechanics import deflection, static_equilibrium
from ident.arm.modes import AMBIGUOUS, Label, labels_of_shares, modes_about, torsion_share, vertical_share
from ident.arm.parts import Point
from ident.errors import ModelError, require
from ident.identify.instruments import RESOLUTION, Instruments
from ident.identify.modal_analysis import modal_analysis
from ident.identify.unknowns import scaled_bodies, with_numbers
from ident.inference.design import Experiments, fisher
from ident.inference.parameters import Parameters
from ident.inference.problem import Discrepant
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.programs import in_batches, jit

# -------- Candidate predictions
# What an arm would show at many postures and loads, for several sets of its numbers: values, Jacobians, shares.

CHUNK = 256
"""Columns (a posture, a load and a theta) that are computed together."""
SAME = 1e-7
"""Relative difference below which two postures show the same."""
ROUNDING = 1e-6
"""Share of the largest number below which a derivative may be rounding error."""


@dataclass(frozen=True)
class CandidatePredictions:
    """What would be seen in G postures under L loads at T points of the parameters.

    Attributes:
        postures: (G, joints) [rad]
        frequency: (m, G, L, T) [Hz] the lowest modes, ascending.
        deflection: (G, L, T) [m] of the end point, downwards.
        jacobian: (m+1, P, G, L, T) of the frequencies, then of the deflection, by theta.
        torsion: (m, G, L, T) [-] share of torsion in each mode's strain energy.
        vertical: (m, G, L, T) [-] share of vertical motion at the end point.
        gap: (m, G, L, T) [-] distance of each frequency from its nearest neighbour, as a share of itself.
    """

    postures: Float[np.ndarray, "G joints"]
    frequency: Float[np.ndarray, "m G L T"]
    deflection: Float[np.ndarray, "G L T"]
    jacobian: Float[np.ndarray, "r P G L T"]
    torsion: Float[np.ndarray, "m G L T"]
    vertical: Float[np.ndarray, "m G L T"]
    gap: Float[np.ndarray, "m G L T"]

    @property
    def stable(self) -> Bool[np.ndarray, "G T"]:
        """Where the arm has a stable equilibrium under every load."""
        return np.isfinite(self.jacobian).all((0, 1, 3)) & np.isfinite(self.frequency).all((0, 2))

    @property
    def named(self) -> Bool[np.ndarray, "m G L T"]:
        """Which modes' labels are clear, so that accelerometers would tell which mode it is."""
        return (np.abs(self.torsion - 0.5) >= AMBIGUOUS) & (np.abs(self.vertical - 0.5) >= AMBIGUOUS)

    def labels(self, posture: int, load: int) -> list[Label]:
        """Name the modes of a posture under a load at the first point."""
        return labels_of_shares(self.torsion[:, posture, load, 0], self.vertical[:, posture, load, 0])

    def at(self, *, postures: np.ndarray | None = None, points: np.ndarray | None = None) -> "CandidatePredictions":
        """Return some of the postures, or what holds at some of the points."""
        g = slice(None) if postures is None else postures
        t = slice(None) if points is None else points
        cut = {name: x[..., g, :, :][..., t] for name, x in vars(self).items() if name != "postures"}
        return replace(self, postures=self.postures[g], **cut)


def candidate_predictions(
    arm: Arm,
    parameters: Parameters,
    points: Float[np.ndarray, "T P"],
    postures: Float[np.ndarray, "G joints"],
    loads: Loads,
    modes: int,
) -> CandidatePredictions:
    """Compute what an arm would show under load cases, batch (L)."""
    shape = len(postures), loads.mass.shape[-1], len(points)
    count = min(modes, arm.degrees_of_freedom)

    def observed(at: Int[np.ndarray, "3 B"]) -> tuple[Array, Array]:
        cases = jax.tree.map(partial(_columns, columns=at[1]), loads)
        return _observe(arm, parameters, count, _columns(points.T, at[2]), _columns(postures.T, at[0]), cases)

    value, jacobian = in_batches(observed, np.indices(shape).reshape(3, -1), CHUNK)
    value = value.reshape(-1, *shape)
    m = (value.shape[0] - 1) // 3
    frequency, down, torsion, vertical = np.split(value, [m, m + 1, 2 * m + 1])
    rows = [*range(count), m]
    apart, far = np.diff(frequency, axis=0), np.full_like(frequency[:1], np.inf)
    gap = np.minimum(np.concatenate([far, apart]), np.concatenate([apart, far])) / frequency
    hertz, *shares = (x[:count] for x in (frequency, torsion, vertical, gap))
    slopes = jacobian[rows].reshape(len(rows), -1, *shape)
    return CandidatePredictions(postures, hertz, down[0], slopes, *shares)


def distinct_predictions(
    arm: Arm,
    parameters: Parameters,
    points: Float[np.ndarray, "T P"],
    postures: Float[np.ndarray, "G joints"],
    measured: Float[np.ndarray, "M joints"],
    loads: Loads,
    modes: int,
) -> tuple[CandidatePredictions, Int[np.ndarray, "G"], Bool[np.ndarray, "V"]]:
    """Compute what an arm would show in one of each group of equivalent postures, where it stands.

    Args:
        arm: the arm.
        parameters: the unknowns.
        points: where they may lie; the first is the best estimate.
        postures: to choose from, including the measured ones.
        measured: postures that stand for those equivalent to them.
        loads: the load cases, batch (L).
        modes: number of frequencies.

    Returns:
        The predictions; for each posture its place among them, -1 for none; which of them were measured.

    Raises:
        ModelError: the arm stands in no posture.
    """
    first = candidate_predictions(arm, parameters, points[:2], postures, loads, modes)
    if not first.stable[:, 0].any():
        raise ModelError(
            f"{arm.name} has no stable equilibrium in any of {len(postures)} postures: its bushings are too soft for"
            " what they carry; check stiffnesses, masses and their units"
        )
    stable = np.flatnonzero(first.stable[:, 0])
    fine = first.at(postures=stable, points=np.asarray(first.stable[stable].all(0)))
    before = (postures[stable, None] == measured[None]).all(-1).any(1)
    # where none was measured those of little turning stand for others, to the left rather than the right
    left = postures[stable].sum(1) + 0.01 * postures[stable, 0]
    turning = np.abs(postures[stable]).sum(1) - 1e-6 * left
    leader = equivalent_postures(fine, np.where(before, -1.0 / (1.0 + turning), turning))
    leaders = np.unique(leader)
    place = np.full(len(postures), -1)
    place[stable] = np.searchsorted(leaders, leader)
    predictions = candidate_predictions(arm, parameters, points, postures[stable[leaders]], loads, modes)
    return predictions, place, np.isin(np.arange(len(leaders)), place[stable[before]])


def equivalent_postures(predictions: CandidatePredictions, favoured: np.ndarray) -> np.ndarray:
    """Return for each posture the first one that shows just the same, such as one turned about a vertical axis.

    Args:
        predictions: what each shows, at points enough to tell postures apart.
        favoured: (G,) postures of least value stand for those equivalent to them.
    """
    shown = np.concatenate([predictions.frequency, predictions.deflection[None], *predictions.jacobian.swapaxes(0, 1)])
    shown = np.moveaxis(shown, 1, 0).reshape(len(predictions.postures), -1)
    scale = np.abs(shown).max(0)
    scale = np.maximum(scale, ROUNDING * scale.max())
    mark = (shown / scale) @ np.random.default_rng(0).standard_normal(shown.shape[1])
    order = np.argsort(mark)
    group = np.empty(len(mark), int)
    group[order] = np.cumsum(np.diff(mark[order], prepend=mark[order[:1]]) > SAME * np.abs(mark).max())
    leader: dict[int, int] = {}
    for i in np.argsort(favoured, kind="stable"):
        leader.setdefault(int(group[i]), int(i))
    return np.array([leader[int(k)] for k in group])


def _columns(x: Any, columns: Int[np.ndarray, "B"]) -> Float[Array, "*n B"]:
    return jnp.asarray(np.asarray(x)[..., columns])


@jit
def _observe(
    arm: Arm,
    parameters: Parameters,
    count: int,
    theta: Float[Array, "P B"],
    posture: Float[Array, "driven B"],
    loads: Loads,
) -> tuple[Float[Array, "R B"], Float[Array, "R P B"]]:
    """Return frequencies (one more than `count`), deflection and shares of the modes, and the Jacobian by theta."""
    m = min(count + 1, arm.degrees_of_freedom)
    kinds = ("frequency",) * m + ("deflection",) + ("share",) * (2 * m)

    scaled = scaled_bodies(arm, [item.name for item in parameters.items if item.nuisance])

    def shown(numbers: Mapping[str, Any]) -> Array:
        altered, cases = with_numbers(arm, loads, numbers, scaled)
        chain = at_posture(altered, posture, cases)
        at = static_equilibrium(chain)
        modes = modes_about(chain, at, m)
        down = -deflection(chain, at.phi)[2, -1:]
        return jnp.concatenate([modes.frequency, down, torsion_share(modes), vertical_share(modes)])

    def predict(theta: Array) -> Array:
        return Discrepant(shown, kinds)(parameters.by_path(parameters.values(theta)))

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(predict, (theta,), (jnp.broadcast_to(direction[:, None], theta.shape),))

    return eqx.filter_vmap(along, out_axes=(None, 1))(jnp.eye(len(theta)))


# -------- Experiments
# What can be measured on an arm, how well, and at what cost: hammer, accelerometers, dial gauge, payload.

PARTS = {
    "posture": "a new posture",
    "hammer": "a hammer test",
    "labels": "a second accelerometer",
    "dial": "a dial gauge",
    "load": "a load",
}
CLOSE = 0.05
"""Frequencies nearer to each other than this share may come in another order on the arm than in the model."""


@dataclass(frozen=True)
class Experiment:
    """The arm goes to a posture, under a load, and is measured.

    Attributes:
        place: posture in the `CandidatePredictions`.
        case: load case there.
        posture: (joints,) [rad]
        load: the load.
        hammer: whether the frequencies are measured.
        labelled: whether a second accelerometer tells which mode is which.
        dial: whether the deflection of the end point is read.
    """

    place: int
    case: int
    posture: tuple[float, ...]
    load: Load
    hammer: bool
    labelled: bool
    dial: bool

    def cost(self, costs: Mapping[str, float]) -> float:
        """Return what it costs."""
        parts = {"hammer": self.hammer, "labels": self.labelled, "dial": self.dial, "load": bool(self.load)}
        return costs["posture"] + sum(costs[part] for part, included in parts.items() if included)


WAYS = ((True, False, False), (True, True, False), (False, False, True), (True, False, True), (True, True, True))
"""What may be done in an experiment: hammer, labels, dial."""


def candidate_experiments(
    predictions: CandidatePredictions, instruments: Instruments, before: Mapping[tuple[int, int, int], Sequence[int]]
) -> tuple[tuple[Experiment, ...], Experiments]:
    """Return all experiments, and what each would tell: less of a value that was measured before.

    Args:
        predictions: what the arm would show.
        instruments: how exact they are, and what they cost.
        before: by value (its place among those of a state), posture and load case, the rows that have measured it.
    """
    rows, counted = whole_information(predictions, instruments), counted_modes(predictions)
    by_way = []
    for hammer, labelled, dial in WAYS:
        modes = (rows[:-1] * counted[int(labelled)][..., None, None]).sum(0)
        by_way.append(modes * hammer + rows[-1] * dial)
    places = list(product(range(len(predictions.postures)), range(len(instruments.loads))))
    experiments = tuple(
        Experiment(g, s, tuple(map(float, predictions.postures[g])), instruments.loads[s], *way)
        for way in WAYS
        for g, s in places
    )
    whole = np.concatenate([part.reshape(len(places), *part.shape[2:]) for part in by_way])
    cost = np.array([experiment.cost(instruments.costs) for experiment in experiments])
    group = np.tile(np.arange(len(places)), len(WAYS))
    known: dict[int, Any] = {}
    for (row, g, s), read in before.items():
        known[places.index((g, s))] = known.get(places.index((g, s)), 0.0) + len(read) * rows[row, g, s]
    return experiments, Experiments(whole, predictions.jacobian.shape[1], group, cost, known)


def whole_information(predictions: CandidatePredictions, instruments: Instruments) -> Float[np.ndarray, "r G L T Q Q"]:
    """Return the information of each frequency, and last of the deflection, on the parameters and on lasting errors.

    A reading is wrong by sqrt(c) sigma u + sqrt(1 - c) sigma e with the common share c; u is one number for all
    readings of a value in one state, so that their mean has the variance sigma^2 (c + (1 - c) / n). The u of the values
    are the last r of the Q coordinates.
    """
    scaled = np.moveaxis(predictions.jacobian, 1, -1) / sigmas(predictions, instruments)[..., None]
    own = np.sqrt(instruments.common) * np.eye(len(scaled))[:, None, None, None]
    both = np.concatenate([scaled, np.broadcast_to(own, (*scaled.shape[:-1], len(scaled)))], -1)
    return fisher(both[..., None, :]) / (1 - instruments.common)


def sigmas(predictions: CandidatePredictions, instruments: Instruments) -> Float[np.ndarray, "r G L T"]:
    """Return the standard deviations [SI] that are to be expected."""
    read = np.hypot(instruments.sigma["deflection"] * predictions.deflection, RESOLUTION)
    return np.concatenate([instruments.sigma["frequency"] * predictions.frequency, read[None]])


def counted_modes(predictions: CandidatePredictions) -> tuple[Bool[np.ndarray, "m G L T"], Bool[np.ndarray, "m G L T"]]:
    """Return which frequencies count without and with a second accelerometer.

    Without one, those whose neighbours are far enough for a certain order. With one, also those with a clear label.
    """
    apart = predictions.gap >= CLOSE
    return apart, apart | predictions.named


def modes_of(predictions: CandidatePredictions, experiment: Experiment) -> list[tuple[Label, bool]]:
    """Return the modes of an experiment with their labels, and whether each counts."""
    counted = counted_modes(predictions)[int(experiment.labelled)][:, experiment.place, experiment.case, 0]
    return list(zip(predictions.labels(experiment.place, experiment.case), map(bool, counted), strict=True))


def expected_rows(
    predictions: CandidatePredictions, instruments: Instruments, experiment: Experiment, point: str
) -> tuple[Measurement, ...]:
    """Return an experiment's measurements with the values that are expected at the first point.

    All frequencies are there, so that those without label can be matched in ascending order.

    Args:
        predictions: what the arm would show.
        instruments: gives the standard deviations.
        experiment: the experiment.
        point: name of the arm's end point.
    """
    sigma = sigmas(predictions, instruments)[:, experiment.place, experiment.case, 0].tolist()
    held: dict[str, Any] = {"posture": experiment.posture, "load": experiment.load}
    clear = predictions.named[:, experiment.place, experiment.case, 0]
    rows = []
    for i, label in enumerate(predictions.labels(experiment.place, experiment.case) if experiment.hammer else ()):
        value = float(predictions.frequency[i, experiment.place, experiment.case, 0])
        mode = str(label) if experiment.labelled and clear[i] else None
        rows.append(Measurement(kind="frequency", value=value, sigma=sigma[i], mode=mode, **held))
    if experiment.dial:
        value = float(predictions.deflection[experiment.place, experiment.case, 0])
        rows.append(Measurement(kind="deflection", value=value, sigma=sigma[-1], point=point, **held))
    return tuple(rows)


def any_campaign(arm: Arm, loads: Iterable[Load]) -> Campaign:
    """Return a campaign of what can be planned, to pose a problem with before anything is measured."""
    still = (0.0,) * len(arm.driven)
    deflection = Measurement(kind="deflection", posture=still, value=1.0, sigma=1.0, point=arm.points[-1].name)
    frequency = Measurement(kind="frequency", posture=still, value=1.0, sigma=1.0)
    return Campaign(measurements=(deflection, *(replace(frequency, load=load) for load in loads)))


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


# -------- Sensor places
# Places of accelerometers and hits at which a hammer test excites and separates the modes.

ALIKE = 0.9
"""Auto-MAC above which two modes look alike at the measured places."""
MOVES = 0.05
"""Motion at the places, as a share of the mode's largest motion, below which the mode is not observable."""
HIT = 0.1
"""The same limit below which a hit does not excite the mode."""
FEWEST, PLACES_MOST = 5, 20
"""Hits at a place: from five on their scatter says what the covariance is; more than twenty are not made."""
APART = 6.0
"""Least difference of two modes in standard deviations of a shape: three for each."""
TRIED = 20000
"""Sets of places that are all tried."""
OVERSAMPLED, DECAYED, LONGEST = 8.0, 0.001, 60.0
"""Sampling rate over the highest expected mode: `modal` uses a quarter, and a mode may be twice as fast; share
to which a decay is recorded, that of `ident modal --window-end`; longest record of a hit [s]. Assumed."""


@dataclass(frozen=True)
class HammerPlan:
    """A hammer test at a posture: places, and how well they tell the modes apart.

    Attributes:
        posture: (joints,) [rad]
        load: the load case.
        labels: (m,) the modes.
        frequency: (m,) [Hz]
        damping_ratio: (m,) [-]
        sensors: places of accelerometers' channels, `tip z`; the pin of a joint is `JOINT_pin`.
        hits: places to hit, likewise.
        count: hits at each.
        auto_mac: (m, m) [-] of the modes at the sensors.
        coincide: pairs of modes within their resonances' widths of each other, which need two places to hit.
    """

    posture: tuple[float, ...]
    load: Load
    labels: tuple[Label, ...]
    frequency: Float[np.ndarray, "m"]
    damping_ratio: Float[np.ndarray, "m"]
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

    @property
    def rate(self) -> float:
        """Sampling rate [Hz] of 100, 200, 400, ...: at least `OVERSAMPLED` times the highest mode."""
        return 100 * 2.0 ** max(0, math.ceil(math.log2(OVERSAMPLED * float(self.frequency.max()) / 100)))

    @property
    def duration(self) -> int:
        """Length [s] of the record of a hit, in whole seconds, at most `LONGEST`.

        The slowest mode has decayed to `DECAYED` after ln(1 / DECAYED) / min(zeta omega). It may end earlier, after
        2 / (least distance of two frequencies), which separates these, but not before 20 periods of the lowest mode.
        """
        slowest = 2 * math.pi * float((self.damping_ratio * self.frequency).min())
        apart = float(np.diff(np.sort(self.frequency)).min(initial=math.inf))
        least = min(apart / 2, float(self.frequency.min()) / 20)
        return math.ceil(1 / max(slowest / -math.log(DECAYED), least, 1 / LONGEST))


def hammer_plans(
    arm: Arm, batch: Sequence[Experiment], modes: int, sensors: int, noise: float, two: bool = False
) -> tuple[HammerPlan, ...]:
    """Return where to measure and to hit in the hammer tests of a batch.

    Args:
        arm: the arm; its points and its joints' pins are the places.
        batch: the experiments; each posture and load of a hammer test counts once.
        modes: of each test, from the lowest.
        sensors: channels of accelerometers at hand, each at a place along x, y or z of the base.
        noise: [-] standard deviation of one hit's shape, as a share of its length.
        two: whether all are hit at two places; else only where one does not do.

    Raises:
        InputError: fewer than two channels.
    """
    require(sensors >= 2, "", f"{sensors}", "two channels or more", "one channel tells no modes apart", "sensors")
    placed = with_pins(arm)
    states = dict.fromkeys((each.posture, each.load) for each in batch if each.hammer)
    return tuple(hammer_plan(placed, *state, modes=modes, sensors=sensors, noise=noise, two=two) for state in states)


def with_pins(arm: Arm) -> Arm:
    """Return the arm with the pin of each joint as a further point, `JOINT_pin`, the end point last."""
    own = {point.name for point in arm.points}
    pins = [Point(f"{j.name}_pin", j.name, (0.0, 0.0, 0.0)) for j in arm.joints if f"{j.name}_pin" not in own]
    return eqx.tree_at(lambda a: a.points, arm, (*pins, *arm.points))


def hammer_plan(
    arm: Arm, posture: tuple[float, ...], load: Load = OWN_WEIGHT, *, modes: int, sensors: int, noise: float, two: bool
) -> HammerPlan:
    """Choose places by the least auto-MAC of all sets; of too many: the best pair, then what lowers it most.

    References:
        Carne, Dohrmann, "A modal test design strategy for model correlation", IMAC 13, 1995 (least auto-MAC).
    """
    known = modal_analysis(arm, posture, load, modes)
    names = [f"{point.name} {axis}" for point in arm.points for axis in "xyz"]
    moved = np.moveaxis(np.asarray(known.modes.motion), 0, 1).reshape(len(names), -1)
    chosen = _sensors(moved, min(sensors, len(names)))
    mac, hertz, damping = auto_mac(moved, chosen), np.asarray(known.modes.frequency), np.asarray(known.damping_ratio)
    close = coinciding(hertz, damping)
    places, hits = (tuple(names[i] for i in own) for own in (chosen, _hits(moved, two=two or bool(close))))
    return HammerPlan(posture, load, known.labels, hertz, damping, places, hits, hits_needed(mac, noise), mac, close)


def auto_mac(moved: Float[np.ndarray, "K m"], places: Sequence[int]) -> Float[np.ndarray, "m m"]:
    """Return how alike modes move at some places; one for a mode that is hardly seen there."""
    own = moved[list(places)]
    length = np.linalg.norm(own, axis=0)
    seen = length > MOVES * np.abs(moved).max(0)
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
