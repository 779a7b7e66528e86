"""Modes of the arm at postures along the path of a motion, near enough to each other to be followed."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.equilibrium import static_equilibrium
from ident.arm.fields import FIELDS
from ident.arm.labels import torsion_share, vertical_share
from ident.arm.mechanics import flat, mass_matrix, unflatten
from ident.arm.modes import in_shaft_axes, modes_about
from ident.arm.rotations import matvec
from ident.errors import ModelError
from ident.jit import jit, library
from ident.vibrate.modal.tracking import ALIKE, Track, follow, track
from ident.vibrate.motion.motion import Motion

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
        damping_ratio: (m, K) [-] for light damping.
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
    steps = np.linalg.norm(np.diff(posture, axis=1), axis=0)
    return Path(fine, np.concatenate([[0.0], np.cumsum(steps)]), posture)


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
        new = _between(along, _track(along, path, count), count)
        if not len(new):
            break
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
        columns.append(
            (*(np.take_along_axis(x, place, 0) for x in (frequency, damping)), mac.reshape(place.shape)),
        )
        start = here.stop
    frequency, damping, mac = (np.concatenate(parts, 1) for parts in zip(*columns, strict=True))
    return frequency, damping, mac


def nominal(arm: Arm) -> Arm:
    """Return the arm of the medians of its numbers over their batch."""
    ranks = {field.name: field.rank for field in FIELDS} | {"axis": 1, "gravity": 1, "direction": 1}

    def middle(path: Any, leaf: Any) -> Any:
        batch = tuple(range(ranks.get(getattr(path[-1], "name", ""), 0), np.ndim(leaf)))
        return library(leaf).median(leaf, axis=batch) if batch else leaf

    return jax.tree_util.tree_map_with_path(middle, arm)


def _track(along: ModesAlongPath, path: Path, count: int) -> Track:
    reach = BRIDGE * path.s[-1] / (POSTURES - 1)
    return track(along.s, along.frequency, along.shape, along.mass, count=count, reach=reach)


def _between(along: ModesAlongPath, track: Track, count: int) -> Float[np.ndarray, "G"]:
    """Return the middles of neighbours between which one of the lowest modes is not followed with certainty."""
    low = (track.place[:, :-1] < count) | (track.place[:, 1:] < count)
    doubtful = ((track.mac < ALIKE) & low).any(0)
    return ((along.s[:-1] + along.s[1:]) / 2)[doubtful]


def _along(arm: Arm, path: Path, loads: Loads | None, computed: int, s: np.ndarray) -> ModesAlongPath:
    parts = zip(*_chunks(arm, path.postures(s), loads, computed), strict=True)
    return ModesAlongPath(s, *(np.concatenate(part, -1) for part in parts))


def _chunks(
    arm: Arm, postures: Float[np.ndarray, "driven K"], loads: Loads | None, computed: int
) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield what `_modes` returns, some postures at a time, always as many to the compiled function."""
    batch = arm.batch
    size = max(1, TOGETHER // int(np.prod(batch))) if batch else TOGETHER // 64
    for start in range(0, postures.shape[1], size):
        some = postures[:, start : start + size]
        padded = np.pad(some, ((0, 0), (0, size - some.shape[1])), mode="edge")
        spread = jnp.asarray(padded.reshape(padded.shape + (1,) * len(batch)))
        parts = tuple(np.asarray(x) for x in _modes(arm, spread, loads, computed))
        cut = [part[:, : some.shape[1]] for part in parts[:4]] + [part[:, :, : some.shape[1]] for part in parts[4:]]
        _refuse_collapse(arm, some, cut[0])
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
    loss = (shape * matvec(chain.damping[..., None], shape)).sum((0, 1))
    ratio = jnp.moveaxis(loss, -1, 0) / (4 * jnp.pi * modes.frequency)
    turned = jax.vmap(lambda x: flat(in_shaft_axes(chain, x)), -1, 1)(shape)
    M = jnp.broadcast_to(mass_matrix(chain, at.phi), (*modes.shape.shape[:1] * 2, *batch))
    half = jax.vmap(lambda row: flat(in_shaft_axes(chain, unflatten(row))))(M)
    whole = jax.vmap(lambda column: flat(in_shaft_axes(chain, unflatten(column))), 1, 1)(half)
    return modes.frequency, ratio, torsion_share(modes), vertical_share(modes), turned, whole


def _refuse_collapse(arm: Arm, postures: np.ndarray, frequency: np.ndarray) -> None:
    lost = ~np.isfinite(frequency).all(0)
    if lost.any():
        k = int(np.argwhere(lost)[0, 0])
        angles = ", ".join(f"{angle:.4g}" for angle in np.degrees(postures[:, k]))
        share = f" with {np.count_nonzero(lost[k])} of {lost[k].size} sets of numbers" if lost.ndim > 1 else ""
        raise ModelError(f"{arm.name} has no stable equilibrium at ({angles}) deg{share}: raise the stiffnesses")
