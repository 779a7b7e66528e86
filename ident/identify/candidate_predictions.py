"""What an arm would show at many postures and loads, for several sets of its numbers: values, Jacobians, shares."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.equilibrium import deflection, static_equilibrium
from ident.arm.labels import AMBIGUOUS, Label, labels_of_shares, torsion_share, vertical_share
from ident.arm.modes import modes_about
from ident.errors import ModelError
from ident.identify.loads import bind_loads
from ident.identify.uncertain import LOAD, scaled_bodies, scaled_inertia, scaled_loads
from ident.inference.discrepancy import Discrepant
from ident.inference.parameters import Parameters
from ident.jit import jit
from ident.measure import Load

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
        names = ("frequency", "deflection", "jacobian", "torsion", "vertical", "gap")
        cut = {name: getattr(self, name)[..., g, :, :][..., t] for name in names}
        return replace(self, postures=self.postures[g], **cut)


def candidate_predictions(
    arm: Arm,
    parameters: Parameters,
    points: Float[np.ndarray, "T P"],
    postures: Float[np.ndarray, "G joints"],
    loads: tuple[Load, ...],
    modes: int,
) -> CandidatePredictions:
    """Compute what an arm would show.

    Raises:
        InputError: a payload or point that the arm has not.
    """
    shape = len(postures), len(loads), len(points)
    load_columns = _load_columns(arm, loads)
    count = min(modes, 3 * len(arm.joints))
    g, s, t = (index.ravel() for index in np.indices(shape))
    columns = np.concatenate([points.T[:, t], postures.T[:, g], load_columns[:, s]])
    missing = -columns.shape[1] % CHUNK
    columns = np.concatenate([columns, np.repeat(columns[:, -1:], missing, 1)], 1)
    values, jacobians = [], []
    for chunk in np.split(columns, columns.shape[1] // CHUNK, 1):
        seen = _observe(arm, parameters, count, jnp.asarray(chunk))
        values.append(np.asarray(seen[0]))
        jacobians.append(np.asarray(seen[1]))
    size = g.size
    value = np.concatenate(values, -1)[:, :size].reshape(-1, *shape)
    jacobian = np.concatenate(jacobians, -1)[..., :size]
    m = (value.shape[0] - 1) // 3
    frequency, down, torsion, vertical = np.split(value, [m, m + 1, 2 * m + 1])
    rows = [*range(count), m]
    return CandidatePredictions(
        postures,
        frequency[:count],
        down[0],
        jacobian[rows].reshape(len(rows), -1, *shape),
        torsion[:count],
        vertical[:count],
        _gaps(frequency)[:count],
    )


def distinct_predictions(
    arm: Arm,
    parameters: Parameters,
    points: Float[np.ndarray, "T P"],
    postures: Float[np.ndarray, "G joints"],
    measured: Float[np.ndarray, "M joints"],
    loads: tuple[Load, ...],
    modes: int,
) -> tuple[CandidatePredictions, Int[np.ndarray, "G"], Bool[np.ndarray, "V"]]:
    """Compute what an arm would show in one of each group of equivalent postures, where it stands.

    Args:
        arm: the arm.
        parameters: the unknowns.
        points: where they may lie; the first is the best estimate.
        postures: to choose from, those that were measured among them.
        measured: postures that stand for those equivalent to them.
        loads: the load cases.
        modes: number of frequencies.

    Returns:
        The predictions; for each posture its place among them, -1 for none; which of them were measured.

    Raises:
        InputError: a payload or point that the arm has not.
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
    first = np.array(sorted(range(len(mark)), key=lambda i: favoured[i]))
    leader: dict[int, int] = {}
    for i in first:
        leader.setdefault(int(group[i]), int(i))
    return np.array([leader[int(k)] for k in group])


def _load_columns(arm: Arm, loads: tuple[Load, ...]) -> np.ndarray:
    """Return the load cases as columns, as `_loads_of` takes them apart."""
    bound = bind_loads(arm, loads)
    return np.concatenate([np.asarray(part).reshape(-1, len(loads)) for part in jax.tree.leaves(bound)])


def _loads_of(arm: Arm, columns: Array) -> Loads:
    payloads, points = len(arm.payloads), len(arm.points)
    share, mass, force, moment = jnp.split(columns, [payloads, payloads + points, payloads + 4 * points])
    moments = moment.reshape(3, points, -1) if len(moment) else None
    return Loads(share, mass, force.reshape(3, points, -1), moments)


@jit
def _observe(
    arm: Arm, parameters: Parameters, count: int, columns: Float[Array, "n B"]
) -> tuple[Float[Array, "R B"], Float[Array, "R P B"]]:
    """Return frequencies (one more than `count`), deflection and shares of the modes, and the Jacobian by theta."""
    unknown, driven = len(parameters.items), len(arm.driven)
    theta, posture, load_columns = jnp.split(columns, [unknown, unknown + driven])
    m = min(count + 1, 3 * len(arm.joints))
    kinds = ("frequency",) * m + ("deflection",) + ("share",) * (2 * m)

    scaled = scaled_bodies(arm, [item.name for item in parameters.items if item.nuisance])

    def shown(numbers: Mapping[str, Any]) -> Array:
        own = {path: x for path, x in numbers.items() if path != LOAD}
        loads = scaled_loads(_loads_of(arm, load_columns), numbers.get(LOAD, 1.0))
        chain = at_posture(scaled_inertia(arm, numbers, scaled).replace(own), posture, loads)
        at = static_equilibrium(chain)
        modes = modes_about(chain, at, m)
        down = -deflection(chain, at.phi)[2, -1:]
        return jnp.concatenate([modes.frequency, down, torsion_share(modes), vertical_share(modes)])

    def predict(theta: Array) -> Array:
        return Discrepant(shown, kinds)(parameters.by_path(parameters.values(theta)))

    def along(direction: Array) -> tuple[Array, Array]:
        return jax.jvp(predict, (theta,), (jnp.broadcast_to(direction[:, None], theta.shape),))

    return eqx.filter_vmap(along, out_axes=(None, 1))(jnp.eye(unknown))


def _gaps(frequency: np.ndarray) -> np.ndarray:
    apart = np.diff(frequency, axis=0)
    far = np.full_like(frequency[:1], np.inf)
    return np.minimum(np.concatenate([far, apart]), np.concatenate([apart, far])) / frequency
