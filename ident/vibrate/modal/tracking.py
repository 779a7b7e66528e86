"""Which mode at one posture is which at the next: matching by mass-weighted MAC, never by order of frequency."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

ALIKE = 0.9
"""MAC of successive postures below which a mode is not followed with certainty."""
BACK = 4
"""Postures before a failure in which modes may have begun to mix."""
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
        return _matched(frequency[:, b], followed[..., a], shape[..., b], (mass[..., a] + mass[..., b]) / 2)

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
        """Return the least MAC of what is among the lowest modes before or after."""
        return float(self.mac[(before < count) | (self.place < count)].min())


def _matched(frequency: np.ndarray, before: np.ndarray, shape: np.ndarray, weight: np.ndarray) -> _Step:
    here = _turned(frequency, shape, weight @ before)
    mac = weighted_mac(before, here, weight)
    place = _assigned(mac)
    return _Step(place, here[:, place], mac[np.arange(len(place)), place])


def _assigned(likeness: np.ndarray) -> np.ndarray:
    """Return for each row the column that is its own, so that they are most alike in all."""
    from scipy.optimize import linear_sum_assignment  # takes longer to import than a prediction to compute

    columns: np.ndarray = linear_sum_assignment(likeness, maximize=True)[1]
    return columns


def weighted_mac(
    a: Float[np.ndarray, "n i"], b: Float[np.ndarray, "n j"], weight: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "i j"]:
    """Return (a' M b)^2 / (a' M a b' M b) of each shape in a with each in b, between 0 and 1."""
    norms = [np.einsum("ni,nk,ki->i", x, weight, x) for x in (a, b)]
    return (a.T @ weight @ b) ** 2 / np.multiply.outer(*norms)


def follow(
    reference: Float[np.ndarray, "n B K"], mass: Float[np.ndarray, "n n K"], shape: Float[np.ndarray, "n m K S"]
) -> tuple[Int[np.ndarray, "B K S"], Float[np.ndarray, "B K S"]]:
    """Tell which mode of each arm is which branch, by the likeness of its own shapes to the branch's at each posture.

    Args:
        reference: (n, B, K) shapes of the branches.
        mass: (n, n, K) [kg m^2] the weight of the MAC.
        shape: (n, m, K, S) shapes of the batch's modes in the same axes, m >= B.

    Returns:
        Modes of the batch and their MAC with the branch.
    """
    weighted = np.einsum("nok,obk->nbk", mass, reference)
    cross = np.einsum("nbk,nmks->bmks", weighted, shape) ** 2
    own = np.einsum("nmks,nok,omks->mks", shape, mass, shape, optimize=True)
    likeness = cross / own / np.einsum("nbk,nbk->bk", weighted, reference)[:, None, :, None]
    place = likeness.argmax(1)
    for k, s in np.argwhere(_shared(place)):
        place[:, k, s] = _assigned(likeness[:, :, k, s])
    return place, np.take_along_axis(likeness, place[:, None], 1)[:, 0]


def _shared(place: Int[np.ndarray, "B K S"]) -> np.ndarray:
    """Tell where two branches are most like the same mode."""
    return (np.diff(np.sort(place, axis=0), axis=0) == 0).any(0)


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
