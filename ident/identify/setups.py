"""Frames of setups, such as a laser tracker's: where they are taken to be first, and what of them is unknown."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.arm.rotations import matmul, matvec, rotation
from ident.errors import InputError, Problem
from ident.identify.conditions import Conditions
from ident.identify.loops import is_of_loop
from ident.inference.parameters import AnyArray, Parameter
from ident.measure import Campaign, Measurement
from ident.measure.kinds import POSITIONS
from ident.measure.setups import Setup

PREFIX = "setup:"
"""What the names of their parameters begin with; then the name, then `.x` to `.z` or `.turn.x` to `.turn.z`."""
STEP = 1e-3
"""Size of theta: 1 mm of a frame's place, 1 mrad of its orientation."""
FREE_RANK = 1e-6
"""Share of the largest singular value below which readings do not tell how a frame is turned or placed."""
AXES = "xyz"


class Frames(eqx.Module):
    """Where the frames of setups are, in the base frame.

    Attributes:
        names: of the setups.
        origin: (3, K) [m]
        axes: (3, 3, K) their axes, columns.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    origin: Float[AnyArray, "3 K"]
    axes: Float[AnyArray, "3 3 K"]

    def at(self, parameters: Mapping[str, Any]) -> tuple[Float[Array, "3 K *batch"], Float[Array, "3 3 K *batch"]]:
        """Return origins and axes with these parameters: places as they are, orientations by a further small turn."""
        rank = max((jnp.ndim(value) for value in parameters.values()), default=0)
        origin, axes = (jnp.asarray(x).reshape(x.shape + (1,) * rank) for x in (self.origin, self.axes))
        zero = jnp.zeros_like(origin)
        place = _stacked(parameters, self.names, "", origin)
        return place, matmul(rotation(_stacked(parameters, self.names, "turn.", zero)), axes)


def vector_of(m: Measurement) -> Hashable | None:
    """Return what all rows share that are components of one reading with a setup; None for any other row."""
    if m.direction is None or not m.setup:
        return None
    return m.kind, m.posture, m.point, m.setup, m.load, m.reference_load, m.ramp, m.drives, m.repeat


def vectors_of(campaign: Campaign) -> Int[np.ndarray, "D"] | None:
    """Return the number of each row's vector, see `InverseProblem`; None where no vector has several rows."""
    numbers: dict[Hashable, int] = {}
    shared = [vector_of(m) for m in campaign]
    found = [numbers.setdefault(row if each is None else each, len(numbers)) for row, each in enumerate(shared)]
    return np.array(found) if len(numbers) < len(found) else None


def _stacked(parameters: Mapping[str, Any], names: Sequence[str], part: str, known: Array) -> Array:
    """Return each setup's three numbers, those that are no parameters as they are known."""
    rows = [
        jnp.stack(
            jnp.broadcast_arrays(
                *(jnp.asarray(parameters.get(f"{PREFIX}{n}.{part}{a}", known[i, k])) for k, n in enumerate(names))
            )
        )
        for i, a in enumerate(AXES)
    ]
    return jnp.stack(jnp.broadcast_arrays(*rows))


def is_of_setup(name: str) -> bool:
    """Tell whether a parameter says where a setup's frame is."""
    return name.startswith(PREFIX)


def is_of_readings(name: str) -> bool:
    """Tell whether a parameter says how something was read: where a setup's frame is, or how wide a ramp's loop."""
    return is_of_setup(name) or is_of_loop(name)


def without_frames(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of the arm alone."""
    return {path: value for path, value in parameters.items() if not is_of_setup(path)}


def in_base_frame(conditions: Conditions, frames: Frames | None, parameters: Mapping[str, Any]) -> Conditions:
    """Return the conditions with all readings in the base frame, that of each setup being where these numbers say."""
    readings = conditions.readings
    if frames is None or readings.setup is None:
        return conditions
    origin, axes = frames.at(parameters)
    rank, k = origin.ndim - 2, jnp.maximum(jnp.asarray(readings.setup), 0)
    own = jnp.asarray(readings.direction).reshape(*readings.direction.shape, *(1,) * rank)
    outside = (jnp.asarray(readings.setup) < 0).reshape(-1, *(1,) * rank)
    direction = jnp.where(outside, own, matvec(axes[:, :, k], own))
    datum = jnp.where(outside, 0.0, (origin[:, k] * direction).sum(0))
    return replace(conditions, readings=replace(readings, direction=direction, datum=datum, setup=None))


def setup_parameters(campaign: Campaign, frames: Frames) -> tuple[Parameter, ...]:
    """Return what is not known of the frames: nuisances, flat where a frame is free.

    Differences and rotations tell nothing of where a frame is, only of how it is turned; so that is no unknown then.
    """
    return tuple(
        parameter
        for k, name in enumerate(frames.names)
        for parameter in _unknown(campaign.setups[name], np.asarray(frames.origin)[:, k], _places(campaign, name))
    )


def _places(campaign: Campaign, name: str) -> bool:
    return any(m.setup == name and m.kind in POSITIONS for m in campaign)


def _unknown(setup: Setup, origin: np.ndarray, placed: bool) -> Iterator[Parameter]:
    """Yield the unknown numbers of a frame: theta counts mm and mrad, or standard deviations."""
    for part, sigma, start in (("turn.", setup.turn_sigma, np.zeros(3)), ("", setup.sigma, origin)):
        if not sigma or (not part and not placed):
            continue
        scale, sd = (sigma, 1.0) if np.isfinite(sigma) else (STEP, np.inf)
        for axis, value in zip(AXES, start, strict=True):
            path = f"{PREFIX}{setup.name}.{part}{axis}"
            yield Parameter((path,), False, value, value, sd, scale, nuisance=True)


def frames_of(campaign: Campaign, expected: Sequence[np.ndarray]) -> Frames | None:
    """Return where the campaign's frames are, or else seem to be first; None without setups.

    What is not said of a frame is found from triads, what was read of one thing along three directions: the rotation
    that turns them best into what the arm file expects of them (Kabsch, "A solution for the best rotation to relate
    two sets of vectors", Acta Cryst. A32, 1976), and then the place. The fit goes on from there.

    Args:
        campaign: the measurements.
        expected: (3,) for each row that has a setup what the arm file expects, as a vector in the base frame: where
            the point is, or by how much it moves, or its body turns.

    Raises:
        InputError: triads that do not tell how a frame is turned, nor anything else.
    """
    names = tuple(dict.fromkeys(m.setup for m in campaign if m.setup))
    if not names:
        return None
    rows = [(m, vector) for m, vector in zip(campaign, expected, strict=True) if m.setup]
    found = [_frame(campaign, name, [row for row in rows if row[0].setup == name]) for name in names]
    return Frames(names, np.array([place for place, _ in found]).T, np.moveaxis(np.array([R for _, R in found]), 0, 2))


def _frame(
    campaign: Campaign, name: str, rows: Sequence[tuple[Measurement, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return origin and axes of one frame."""
    setup = campaign.setups[name]
    triads = list(_triads(rows))
    at = np.array([m.kind in POSITIONS for m, _, _ in triads], bool)
    R = _aligned(campaign, name, triads, at) if setup.turn is None else _turned(setup.turn)
    if setup.origin is not None or not at.any():
        return np.array(setup.origin or (0.0, 0.0, 0.0)), R
    own, base = (np.array([each[i] for each in triads])[at] for i in (1, 2))
    return (base - own @ R.T).mean(0), R


def _turned(vector: Sequence[float]) -> np.ndarray:
    from scipy.spatial.transform import Rotation  # takes a tenth of a second, which campaigns without setups can spare

    return Rotation.from_rotvec(vector).as_matrix()


def _aligned(
    campaign: Campaign, name: str, triads: Sequence[tuple[Measurement, np.ndarray, np.ndarray]], at: np.ndarray
) -> np.ndarray:
    """Return the axes by which what was read agrees best with what is expected."""
    from scipy.spatial.transform import Rotation

    own, base = (np.array([each[i] for each in triads]).reshape(-1, 3) for i in (1, 2))
    if at.any():  # where points are tells how they lie to one another
        own[at] -= own[at].mean(0)
        base[at] -= base[at].mean(0)
    size = np.maximum(np.linalg.norm(base, axis=1, keepdims=True), 1e-300)
    spread = np.linalg.svd(base, compute_uv=False) if len(base) else np.zeros(3)
    if len(spread) < 2 or spread[1] <= FREE_RANK * spread[0]:
        got = f"the setup {name}, of which it is not known how it is turned, and rows that do not tell"
        expected = "two different vectors at least, each read along three directions"
        where = campaign.setups.path or campaign.path
        raise InputError(Problem(where, got, expected, "say how it is turned (data/README.md), or measure more"))
    weight = np.where(at, size.ravel() / size.max(), 1.0)
    own, base = (np.where(at[:, None], x, x / size) for x in (own, base))
    return Rotation.align_vectors(base, own, weights=np.maximum(weight, 1e-12))[0].as_matrix()


def _triads(
    rows: Sequence[tuple[Measurement, np.ndarray]],
) -> Iterator[tuple[Measurement, np.ndarray, np.ndarray]]:
    """Yield what was read along three directions, as a vector in the setup's frame, with the one that is expected."""
    same: dict[Measurement, list[tuple[Measurement, np.ndarray]]] = {}
    for m, vector in rows:
        blank = replace(m, value=0.0, sigma=1.0, direction=(1.0, 0.0, 0.0), resolution=0.0, group="", member=0, note="")
        same.setdefault(blank, []).append((m, vector))
    for each in same.values():
        directions = np.array([m.direction for m, _ in each])
        if np.linalg.matrix_rank(directions, tol=0.1) == 3:
            values = np.array([m.value for m, _ in each])
            yield each[0][0], np.linalg.lstsq(directions, values, rcond=None)[0], each[0][1]
