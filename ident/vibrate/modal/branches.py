"""Natural frequencies along a motion as branches, each followed by its shape through the crossings of others."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.labels import Label, labels_of_shares
from ident.errors import InputError, Problem
from ident.vibrate.modal.modes_along_path import ModesAlongPath, followed, nominal, path_of, tracked
from ident.vibrate.modal.tracking import ALIKE, Track
from ident.vibrate.motion.motion import Motion

SAMPLES = 1001
"""Times, unless asked otherwise."""
MORE = 3
"""Modes computed above those wanted, from which a branch may come down."""
MATCHED = 0.5
"""MAC of a draw's mode with the branch below which it can be taken for another."""
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
    """Branches that exchange their shapes more quickly than the postures resolve: what continues what is not known.

    Attributes:
        time: () [s]
        branches: those whose shapes do not continue.
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
        damping_ratio: (B, T, *batch) [-] for light damping.
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
        return _median(self.frequency)

    @property
    def median_damping_ratio(self) -> Float[np.ndarray, "B T"]:
        """Damping ratios, the median over the batch."""
        return _median(self.damping_ratio)

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
    path, computed = path_of(motion, time), min(count + MORE, 3 * len(arm.joints))
    along, track = tracked(nominal(arm), path, loads, count, computed)
    track = _lowest(track, count)
    if arm.batch:
        frequency, damping, mac = followed(arm, path, loads, along, track, computed)
        likeness = (mac > MATCHED).reshape(len(mac), -1).mean(1)
    else:
        frequency, damping = (np.take_along_axis(x, track.place, 0) for x in (along.frequency, along.damping_ratio))
        likeness = np.ones(len(frequency))
    labels, moments = _labels(along, track), path.when(along.s)
    here = np.interp(time, path.time, path.s)
    return Branches(
        time,
        np.asarray(motion(time)[0]),
        _interpolated(along.s, frequency, here),
        _interpolated(along.s, damping, here),
        tuple(row[-1] for row in labels),
        tuple(row[0] for row in labels),
        tuple(sorted(_changes(labels, moments), key=lambda change: change.time)),
        tuple(_veerings(track.mac, moments)),
        tuple(likeness.tolist()),
    )


def motion_times(motion: Motion, times: Any = None) -> Float[np.ndarray, "T"]:
    """Return the given times, checked, or 1001 over the motion."""
    if times is None:
        return np.linspace(float(motion.breaks[0]), float(motion.breaks[-1]), SAMPLES)
    time = np.asarray(times, float)
    if time.ndim != 1 or len(time) < 2 or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        got = f"an array of shape {time.shape}" if time.ndim != 1 else f"{len(time)} times"
        raise InputError(Problem("times", got, "two or more finite times that ascend", "give (T,) in seconds"))
    return time


def check(arm: Arm, motion: Motion, count: int = 1) -> None:
    """Refuse a motion of other joints than the arm's, an arm without a point and a count below 1."""
    driven = motion.coefficients.shape[-1]
    if driven != len(arm.driven):
        expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
        raise InputError(Problem(motion.name, f"{driven} joint angles", expected, "give every joint's angle"))
    if not arm.points:
        raise InputError(Problem(arm.name, "no named point", "an end point", "add a [[point]] to the arm file"))
    if count < 1:
        raise InputError(Problem("count", f"{count}", "at least 1", "ask for one or more natural frequencies"))


def _lowest(track: Track, count: int) -> Track:
    """Return the branches that are among the lowest anywhere, ascending at the last posture."""
    lowest = np.flatnonzero((track.place < count).any(1))
    lowest = lowest[np.argsort(track.place[lowest, -1])]
    return Track(track.place[lowest], track.mac[lowest], track.shape[:, lowest], track.mixed)


def _labels(along: ModesAlongPath, track: Track) -> list[list[Label]]:
    """Return the label of each branch at each posture; in the middle of a crossing, the one before it."""
    names = [labels_of_shares(along.torsion[:, k], along.vertical[:, k]) for k in range(len(along.s))]
    clean = np.maximum.accumulate(np.where(track.mixed, 0, np.arange(len(names)))).tolist()
    return [[names[k][row[k]] for k in clean] for row in track.place.tolist()]


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
    """Return values at other lengths of the path by a curve that keeps their ups and downs."""
    from scipy.interpolate import PchipInterpolator  # long to import, and seldom needed

    if len(s) == 1:
        return np.repeat(values, len(at), axis=1)
    return np.asarray(PchipInterpolator(s, values, axis=1)(at))


def _median(values: Float[np.ndarray, "B T *batch"]) -> Float[np.ndarray, "B T"]:
    return np.median(values.reshape((*values.shape[:2], -1)), axis=2)
