"""Natural frequencies along a motion as branches, each followed by its shape through the crossings of others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import Arm, nominal
from ident.arm.chain import Chain, Loads, at_posture
from ident.arm.mechanics import flat, mass_matrix, static_equilibrium, unflatten
from ident.arm.modes import (
    Label,
    Linearized,
    assigned,
    damped_eigenvalues,
    follow,
    in_shaft_axes,
    labels_of_shares,
    modes_about,
    torsion_share,
    vertical_share,
)
from ident.arm.rotations import identity, matvec
from ident.errors import ModelError, refusal
from ident.programs import jit
from ident.vibrate.motion import Motion, check_joints, lengths

# -------- Tracking
# Which mode at one posture is which at the next: matching by mass-weighted MAC, never by order of frequency.

ALIKE = 0.9
"""MAC of successive postures below which a mode is not followed with certainty; assumed."""
BACK = 4
"""Postures before a failure in which modes may have begun to mix; assumed."""
REPEATED = 1e-6
"""Relative distance of frequencies below which the shapes of two modes are any basis of their plane."""


class Track(NamedTuple):
    """How modes continue from posture to posture.

    Attributes:
        place: (m, K) mode, in ascending order at its posture, that belongs to each branch.
        mac: (m, K - 1) [-] MAC of each branch's shapes at successive postures, or across mixed ones.
        shape: (n, m, K) shapes, branch by branch; where they are mixed, those before.
        mixed: (K,) postures in the middle of a crossing, at which two modes have parts of both shapes.
    """

    place: Int[np.ndarray, "m K"]
    mac: Float[np.ndarray, "m gaps"]
    shape: Float[np.ndarray, "n m K"]
    mixed: Bool[np.ndarray, "K"]


def track(
    s: Float[np.ndarray, "K"],
    frequency: Float[np.ndarray, "m K"],
    shape: Float[np.ndarray, "n m K"],
    mass: Float[np.ndarray, "n n K"],
    *,
    count: int,
    reach: float,
) -> Track:
    """Follow modes from posture to posture so that the sum of the MAC of successive shapes is largest.

    The MAC is weighted by the mean of both mass matrices. Where frequencies repeat, shapes are turned within their
    plane to those before. Where one of the lowest modes is not recognised, MAC < 0.9, but is within `reach` further
    on, the postures between are the middle of a crossing, whose shapes mean nothing, and are left out.

    Args:
        s: (K,) [rad] length of the path at each posture, ascending.
        frequency: (m, K) [Hz] ascending at each posture.
        shape: (n, m, K) shapes in axes that do not turn with the posture.
        mass: (n, n, K) [kg m^2] mass matrices in the same axes.
        count: lowest modes that must be recognised.
        reach: () [rad] longest part of the path that is left out.

    References:
        Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration, 2003. Kuhn, "The
        Hungarian method for the assignment problem", Naval Research Logistics Quarterly 2, 1955.
    """
    modes, postures = frequency.shape
    place, followed = np.zeros((modes, postures), int), np.array(shape)
    place[:, 0], likeness = np.arange(modes), np.ones((modes, postures - 1))
    mixed = np.zeros(postures, bool)

    def step(a: int, b: int) -> _Step:
        before, weight = followed[..., a], (mass[..., a] + mass[..., b]) / 2
        here = _turned(frequency[:, b], shape[..., b], weight @ before)
        norms = [np.einsum("ni,nk,ki->i", x, weight, x) for x in (before, here)]
        mac = (before.T @ weight @ here) ** 2 / np.multiply.outer(*norms)
        own = assigned(mac)
        return _Step(own, here[:, own], mac[np.arange(modes), own])

    k = 0
    while k < postures - 1:
        start, end, match = k, k + 1, step(k, k + 1)
        if match.weakest(place[:, k], count) < ALIKE:
            across = (
                (a, b, step(a, b))
                for a in range(k, max(k - BACK, 0) - 1, -1)
                for b in range(k + 2, postures)
                if s[b] - s[a] <= reach and not mixed[a]
            )
            again = (t for t in across if t[2].weakest(place[:, t[0]], count) >= ALIKE)
            start, end, match = next(again, (start, end, match))
        for b in range(start + 1, end):
            place[:, b], followed[..., b], mixed[b] = step(start, b).place, followed[..., start], True
        place[:, end], followed[..., end] = match.place, match.shape
        likeness[:, start:end] = match.mac[:, None]
        k = end
    return Track(place, likeness, followed, mixed)


class _Step(NamedTuple):
    """Modes at a posture in the order of the branches: places (m,), shapes (n, m) and MAC (m,) with those before."""

    place: np.ndarray
    shape: np.ndarray
    mac: np.ndarray

    def weakest(self, before: np.ndarray, count: int) -> float:
        """Return the least MAC of modes that are among the lowest ones before or after."""
        return float(self.mac[(before < count) | (self.place < count)].min())


def _turned(frequency: np.ndarray, shape: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return shapes (n, m), those of a repeated frequency turned to what was there before, M-weighted (n, m)."""
    starts = np.flatnonzero(np.diff(frequency, prepend=0.0) > REPEATED * frequency)
    turned = shape.copy()
    for cluster in np.split(np.arange(len(frequency)), starts[1:]):
        if len(cluster) > 1:
            cross = shape[:, cluster].T @ wanted
            nearest = np.sort(np.argsort(-(cross**2).sum(0))[: len(cluster)])
            left, _, right = np.linalg.svd(cross[:, nearest])
            turned[:, cluster] = shape[:, cluster] @ (left @ right)
    return turned


# -------- Modes along path
# Modes of the arm at postures along the path of a motion, near enough to each other to be followed.

FINE = 4001
"""Times at which the length of the path is taken."""
POSTURES = 121
"""Postures along the path at which modes are computed, before refinement."""
BRIDGE = 10.5
"""Longest middle of a crossing, in distances of these postures."""
ROUNDS = 6
"""Halvings of the distance of two postures between which a mode is not followed with certainty."""
TOGETHER = 4096
"""Chains that are solved at a time, at most; for a single arm, a sixty-fourth of it."""


class Path(NamedTuple):
    """The path of the joint angles; the arm may pause on it.

    Attributes:
        time: (F,) [s] ascending.
        s: (F,) [rad] its length until then.
        posture: (driven, F) [rad]
    """

    time: Float[np.ndarray, "F"]
    s: Float[np.ndarray, "F"]
    posture: Float[np.ndarray, "driven F"]

    def when(self, s: Float[np.ndarray, "K"]) -> Float[np.ndarray, "K"]:
        """Return the times [s] at which lengths s are reached first."""
        moves = self._moves()
        return np.interp(s, self.s[moves], self.time[moves])

    def postures(self, s: Float[np.ndarray, "K"]) -> Float[np.ndarray, "driven K"]:
        """Return the angles [rad] at lengths s."""
        moves = self._moves()
        return np.stack([np.interp(s, self.s[moves], angle[moves]) for angle in self.posture])

    def _moves(self) -> np.ndarray:
        return np.append(True, np.diff(self.s) > 0)


class ModesAlongPath(NamedTuple):
    """The lowest modes of one arm at K postures along its path.

    Attributes:
        s: (K,) [rad] length of the path, ascending.
        frequency: (m, K) [Hz] ascending at each posture.
        damping_ratio: (m, K) [-] of the poles, see `_damping_ratios`.
        torsion: (m, K) [-] share of torsion in the strain energy.
        vertical: (m, K) [-] share of vertical motion of the end point.
        shape: (n, m, K) [rad/sqrt(kg m^2)] along the shafts' axes.
        mass: (n, n, K) [kg m^2] mass matrix along the shafts' axes.
    """

    s: Float[np.ndarray, "K"]
    frequency: Float[np.ndarray, "m K"]
    damping_ratio: Float[np.ndarray, "m K"]
    torsion: Float[np.ndarray, "m K"]
    vertical: Float[np.ndarray, "m K"]
    shape: Float[np.ndarray, "n m K"]
    mass: Float[np.ndarray, "n n K"]


def path_of(motion: Motion, time: Float[np.ndarray, "T"]) -> Path:
    """Return the path of a motion from the first of some times to the last."""
    breaks = np.asarray(motion.breaks)
    inside = breaks[(breaks > time[0]) & (breaks < time[-1])]
    fine = np.unique(np.concatenate([np.linspace(time[0], time[-1], FINE), time, inside]))
    posture = np.asarray(motion(fine)[0])
    return Path(fine, lengths(posture), posture)


def tracked(arm: Arm, path: Path, loads: Loads | None, count: int, computed: int) -> tuple[ModesAlongPath, Track]:
    """Return modes at postures so near to each other that the lowest ones are followed, if they can be.

    Args:
        arm: of plain numbers.
        path: of its joint angles.
        loads: the load case.
        count: lowest modes that are to be followed.
        computed: lowest modes that are computed and matched, at least as many.

    Raises:
        ModelError: the arm has no stable equilibrium at some posture.
    """
    along = _along(arm, path, loads, computed, np.unique(np.linspace(0.0, path.s[-1], POSTURES)))
    for _ in range(ROUNDS):
        track = _track(along, path, count)
        low = (track.place[:, :-1] < count) | (track.place[:, 1:] < count)
        doubtful = ((track.mac < ALIKE) & low).any(0)  # one of the lowest modes is not followed with certainty
        if not doubtful.any():
            return along, track
        new = ((along.s[:-1] + along.s[1:]) / 2)[doubtful]
        more = _along(arm, path, loads, computed, new)
        order = np.argsort(np.concatenate([along.s, new]))
        along = ModesAlongPath(*(np.concatenate(pair, -1)[..., order] for pair in zip(along, more, strict=True)))
    return along, _track(along, path, count)


def followed(
    arm: Arm, path: Path, loads: Loads | None, along: ModesAlongPath, track: Track, computed: int
) -> tuple[Float[np.ndarray, "B K *batch"], Float[np.ndarray, "B K *batch"], Float[np.ndarray, "B K *batch"]]:
    """Follow the branches of the medians in a batch of arms, each by its own shapes.

    Returns:
        Frequencies [Hz], damping ratios, and MAC of each arm's shape with the branch's.

    Raises:
        ModelError: an arm has no stable equilibrium at some posture.
    """
    batch, columns, start = arm.batch, [], 0
    for frequency, damping, _, _, shape, _ in _chunks(arm, path.postures(along.s), loads, computed):
        here = slice(start, start + frequency.shape[1])
        flat_shape = shape.reshape((*shape.shape[:3], -1))
        place, mac = follow(track.shape[..., here], along.mass[..., here], flat_shape)
        place = place.reshape((*place.shape[:2], *batch))
        taken = (np.take_along_axis(x, place, 0) for x in (frequency, damping))
        columns.append((*taken, mac.reshape(place.shape)))
        start = here.stop
    frequency, damping, mac = (np.concatenate(parts, 1) for parts in zip(*columns, strict=True))
    return frequency, damping, mac


def _track(along: ModesAlongPath, path: Path, count: int) -> Track:
    reach = BRIDGE * path.s[-1] / (POSTURES - 1)
    return track(along.s, along.frequency, along.shape, along.mass, count=count, reach=reach)


def _along(arm: Arm, path: Path, loads: Loads | None, computed: int, s: np.ndarray) -> ModesAlongPath:
    parts = zip(*_chunks(arm, path.postures(s), loads, computed), strict=True)
    return ModesAlongPath(s, *(np.concatenate(part, -1) for part in parts))


def _chunks(
    arm: Arm, postures: Float[np.ndarray, "driven K"], loads: Loads | None, computed: int
) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield what `_modes` returns, some postures (driven, K) at a time, always as many to the compiled function."""
    batch = arm.batch
    size = max(1, TOGETHER // int(np.prod(batch))) if batch else TOGETHER // 64
    for start in range(0, postures.shape[1], size):
        some = postures[:, start : start + size]
        padded = np.pad(some, ((0, 0), (0, size - some.shape[1])), mode="edge")
        spread = jnp.asarray(padded.reshape(padded.shape + (1,) * len(batch)))
        parts = tuple(np.asarray(x) for x in _modes(arm, spread, loads, computed))
        cut = [part[:, : some.shape[1]] for part in parts[:4]] + [part[:, :, : some.shape[1]] for part in parts[4:]]
        lost = ~np.isfinite(cut[0]).all(0)
        if lost.any():
            k = int(np.argwhere(lost)[0, 0])
            angles = ", ".join(f"{angle:.4g}" for angle in np.degrees(some[:, k]))
            share = f" with {np.count_nonzero(lost[k])} of {lost[k].size} sets of numbers" if lost.ndim > 1 else ""
            raise ModelError(f"{arm.name} has no stable equilibrium at ({angles}) deg{share}: raise the stiffnesses")
        yield tuple(cut)


@jit
def _modes(
    arm: Arm, posture: Float[Array, "driven K *one"], loads: Loads | None, count: int
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return the fields of `ModesAlongPath` after the first, each with the batch behind the postures."""
    chain = at_posture(arm, posture, loads)
    at = static_equilibrium(chain)
    modes = modes_about(chain, at, count)
    batch = modes.frequency.shape[1:]
    shape = unflatten(jnp.moveaxis(modes.shape, 1, -1))
    ratio = _damping_ratios(chain, shape, 2 * jnp.pi * modes.frequency)
    turned = jax.vmap(lambda x: flat(in_shaft_axes(chain, x)), -1, 1)(shape)
    M = jnp.broadcast_to(mass_matrix(chain, at.phi), (*modes.shape.shape[:1] * 2, *batch))
    half = jax.vmap(lambda row: flat(in_shaft_axes(chain, unflatten(row))))(M)
    whole = jax.vmap(lambda column: flat(in_shaft_axes(chain, unflatten(column))), 1, 1)(half)
    return modes.frequency, ratio, torsion_share(modes), vertical_share(modes), turned, whole


def _damping_ratios(
    chain: Chain, shape: Float[Array, "3 N *batch m"], omega: Float[Array, "m *batch"]
) -> Float[Array, "m *batch"]:
    """Return the damping ratios of some modes; damping couples close modes: see `structural`."""

    def between(lost: Array) -> Float[Array, "m m *batch"]:
        moment = matvec(lost[..., None], shape)
        return jnp.moveaxis((shape[..., None] * moment[..., None, :]).sum((0, 1)), (-2, -1), (0, 1))

    unit = jnp.broadcast_to(identity(len(omega), omega.ndim - 1), (len(omega), *omega.shape))
    C = between(chain.damping)
    C = C if chain.loss is None else C + 2 * between(chain.loss) / (omega[:, None] + omega[None])
    C = C if chain.alpha is None else C + chain.alpha * unit
    s = damped_eigenvalues(Linearized(unit[:0], unit, C, unit * omega**2))
    return -s.real / jnp.abs(s)


# -------- Branches

SAMPLES = 1001
"""Times, unless asked otherwise."""
MORE = 3
"""Modes computed above those wanted, from which a branch may come down."""
MATCHED = 0.5
"""MAC of a draw's mode with the branch below which it can be taken for another;
of shapes that are orthogonal at most one has more."""
BAND = (5.0, 95.0)
"""Ends of a band [%]."""


@dataclass(frozen=True)
class LabelChange:
    """A branch changes its name on the way, as its shape changes.

    Attributes:
        branch: which one.
        time: () [s] of the change.
        before: its label until then.
        after: its label from then on.
    """

    branch: int
    time: float
    before: Label
    after: Label


@dataclass(frozen=True)
class Veering:
    """Branches that exchange their shapes faster than the postures resolve, so that their continuation is unknown.

    Attributes:
        time: () [s]
        branches: branches whose shapes do not continue.
        mac: () [-] least MAC of successive shapes.
    """

    time: float
    branches: tuple[int, ...]
    mac: float


@dataclass(frozen=True)
class Branches:
    """Natural frequencies of the arm at the postures of a motion, in ascending order at its last posture.

    Attributes:
        time: (T,) [s]
        posture: (driven, T) [rad]
        frequency: (B, T, *batch) [Hz] of each branch.
        damping_ratio: (B, T, *batch) [-] of the poles, see `_damping_ratios`.
        labels: of each branch at the last posture, for the median of the batch.
        first_labels: of each branch at the first posture.
        changes: where a label changes, in time.
        veerings: where a branch was not followed with certainty.
        likeness: (B,) [-] share of draws and postures at which a draw's shape is clearly the branch's, MAC > 0.5; 1
            without a batch.
    """

    time: Float[np.ndarray, "T"]
    posture: Float[np.ndarray, "driven T"]
    frequency: Float[np.ndarray, "B T *batch"]
    damping_ratio: Float[np.ndarray, "B T *batch"]
    labels: tuple[Label, ...]
    first_labels: tuple[Label, ...] = ()
    changes: tuple[LabelChange, ...] = ()
    veerings: tuple[Veering, ...] = ()
    likeness: tuple[float, ...] = ()

    @property
    def batch_size(self) -> int:
        """Number of arms in the batch; 0 when the arm's numbers are plain ones."""
        return int(np.prod(self.frequency.shape[2:])) if self.frequency.ndim > 2 else 0

    @property
    def median(self) -> Float[np.ndarray, "B T"]:
        """Frequencies [Hz], the median over the batch."""
        return np.median(self.draws, axis=2)

    @property
    def median_damping_ratio(self) -> Float[np.ndarray, "B T"]:
        """Damping ratios, the median over the batch."""
        return np.median(self.damping_ratio.reshape(self.draws.shape), axis=2)

    @property
    def draws(self) -> Float[np.ndarray, "B T S"]:
        """Frequencies [Hz] with the batch on one axis, of length 1 without one."""
        return self.frequency.reshape((*self.frequency.shape[:2], -1))

    def label(self, branch: int, time: float) -> Label:
        """Return the label that a branch has at a time [s]."""
        label = self.first_labels[branch] if self.first_labels else self.labels[branch]
        for change in self.changes:
            label = change.after if change.branch == branch and change.time <= time else label
        return label

    def band(self) -> Float[np.ndarray, "2 B T"]:
        """Return the 5 % and 95 % quantiles over the batch [Hz]."""
        return np.percentile(self.draws, BAND, axis=2)


def branches(arm: Arm, motion: Motion, *, count: int = 3, times: Any = None, loads: Loads | None = None) -> Branches:
    """Return the lowest natural frequencies of the arm along a motion, followed by the shapes of its modes.

    Modes are computed at postures equally spaced along the path of joint angles and matched from one to the next by
    the mass-weighted MAC of their shapes in the axes of the shafts, which do not turn with the posture. Where shapes
    are mixed over less than a twelfth of the path and go on behind it (MAC of at least 0.9), that is a crossing:
    coupling as weak as this hardly exchanges energy while the arm moves through. Elsewhere the path is halved between
    postures of a MAC below 0.9, at most six times; if that does not help a veering is reported. Through a wider
    veering a branch changes its shape, and its label. Frequencies at the given times are interpolated (monotone
    cubic) along the path.

    The arms of a batch are followed by the likeness of their own shapes to those of the medians of all numbers.

    Args:
        arm: the arm; its numbers may be arrays `(*batch)` (see `Arm.replace`).
        motion: of the arm's driven joints.
        count: every branch is returned that is among this many lowest ones anywhere, so these or more.
        times: (T,) [s] ascending; 1001 over the motion when None.
        loads: what hangs on the arm, without batch axes.

    Raises:
        InputError: times or count can't be, the motion has other joints than the arm, or the arm has no point.
        ModelError: the arm has no stable equilibrium at some posture.

    References:
        Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration, 2003. Leissa,
        "On a curve veering aberration", ZAMP 25, 1974.
    """
    time = motion_times(motion, times)
    check(arm, motion, count)
    path, computed = path_of(motion, time), min(count + MORE, arm.degrees_of_freedom)
    along, track = tracked(nominal(arm), path, loads, count, computed)
    # the branches that are among the lowest anywhere, ascending at the last posture
    lowest = np.flatnonzero((track.place < count).any(1))
    lowest = lowest[np.argsort(track.place[lowest, -1])]
    track = Track(track.place[lowest], track.mac[lowest], track.shape[:, lowest], track.mixed)
    if arm.batch:
        frequency, damping, mac = followed(arm, path, loads, along, track, computed)
        likeness = (mac > MATCHED).reshape(len(mac), -1).mean(1)
    else:
        frequency, damping = (np.take_along_axis(x, track.place, 0) for x in (along.frequency, along.damping_ratio))
        likeness = np.ones(len(frequency))
    # in the middle of a crossing a branch has the name before it
    names = [labels_of_shares(along.torsion[:, k], along.vertical[:, k]) for k in range(len(along.s))]
    clean = np.maximum.accumulate(np.where(track.mixed, 0, np.arange(len(names)))).tolist()
    labels, moments = [[names[k][row[k]] for k in clean] for row in track.place.tolist()], path.when(along.s)
    here = np.interp(time, path.time, path.s)
    posture, likeness = np.asarray(motion(time)[0]), tuple(likeness.tolist())
    hertz, ratio = (_interpolated(along.s, x, here) for x in (frequency, damping))
    last, first = (tuple(row[k] for row in labels) for k in (-1, 0))
    changes = tuple(sorted(_changes(labels, moments), key=lambda change: change.time))
    veerings = tuple(_veerings(track.mac, moments))
    return Branches(time, posture, hertz, ratio, last, first, changes, veerings, likeness)


def motion_times(motion: Motion, times: Any = None) -> Float[np.ndarray, "T"]:
    """Return the given times, checked, or 1001 over the motion."""
    if times is None:
        return np.linspace(float(motion.breaks[0]), float(motion.breaks[-1]), SAMPLES)
    time = np.asarray(times, float)
    if time.ndim != 1 or len(time) < 2 or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        got = f"an array of shape {time.shape}" if time.ndim != 1 else f"{len(time)} times"
        raise refusal("times", got, "two or more finite times that ascend", "give (T,) in seconds")
    return time


def check(arm: Arm, motion: Motion, count: int = 1) -> None:
    """Refuse a motion of other joints than the arm's, an arm without a point and a count below 1."""
    check_joints(arm, motion)
    if not arm.points:
        raise refusal(arm.name, "no named point", "an end point", "add a [[point]] to the arm file")
    if count < 1:
        raise refusal("count", f"{count}", "at least 1", "ask for one or more natural frequencies")


def _changes(labels: Sequence[Sequence[Label]], moments: Float[np.ndarray, "K"]) -> Iterator[LabelChange]:
    for branch, row in enumerate(labels):
        for k in range(len(row) - 1):
            if row[k] != row[k + 1]:
                yield LabelChange(branch, float(moments[k] + moments[k + 1]) / 2, row[k], row[k + 1])


def _veerings(mac: Float[np.ndarray, "B gaps"], moments: Float[np.ndarray, "K"]) -> Iterator[Veering]:
    for k in np.flatnonzero((mac < ALIKE).any(0)).tolist():
        branches = tuple(np.flatnonzero(mac[:, k] < ALIKE).tolist())
        yield Veering(float(moments[k] + moments[k + 1]) / 2, branches, float(mac[:, k].min()))


def _interpolated(
    s: Float[np.ndarray, "K"], values: Float[np.ndarray, "B K *batch"], at: Float[np.ndarray, "T"]
) -> Float[np.ndarray, "B T *batch"]:
    """Return values (B, K, *batch) at other lengths of the path by a curve that keeps their ups and downs."""
    from scipy.interpolate import PchipInterpolator  # long to import, and seldom needed

    if len(s) == 1:
        return np.repeat(values, len(at), axis=1)
    return np.asarray(PchipInterpolator(s, values, axis=1)(at))
