"""What instruments read of an arm at rest: deflections, positions, rotations, twists, alone or against another load."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.chain import Chain
from ident.arm.equilibrium import deflection
from ident.arm.mechanics import point_positions, point_rotations
from ident.arm.rotations import identity, matmul, matvec, rotation_vector, transpose
from ident.identify.conditions import Readings
from ident.inference.parameters import AnyArray


def read(chain: Chain, phi: Float[Array, "3 N S *#batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return what is read of a chain whose bushings are turned by phi: deflections and positions [m], angles [rad].

    A rotation is the component d'log(R R0') of the rotation vector by which the point's body turns, R0 being its axes
    under the reference load, or at phi = 0 where there is none. So a difference is the turn that leads from one
    load case to the other; both are counted in the base frame, right-handed.

    A twist is the component of a bushing's rotation vector along its pin's axis, which is what the torsional stiffness
    acts on: by how much the link's angle exceeds the motor's over the ratio.

    What was read on a ramp of loads lags behind by half the width of its loop.
    """
    none = jnp.zeros((len(readings.states), *phi.shape[3:]))
    moved = _deflections(deflection(chain, phi), readings) if chain.carrier else none
    if readings.placing is not None:
        places = _positions(point_positions(chain, phi), readings)
        moved = jnp.where(_lifted(readings.placing, moved.ndim - 1), places, moved)
    if readings.turning is not None:
        turns = _rotations(point_rotations(chain, phi), readings)
        moved = jnp.where(_lifted(readings.turning, moved.ndim - 1), turns, moved)
    if readings.twisting is not None:
        moved = jnp.where(_lifted(readings.twisting, moved.ndim - 1), _twists(chain, phi, readings), moved)
    return moved if readings.lag is None else moved + _lifted(readings.lag, moved.ndim - jnp.ndim(readings.lag))


def _deflections(moved: Float[Array, "3 P S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return how far the points move along the directions."""
    rank = moved.ndim - 3
    start = moved[:, readings.points, jnp.maximum(readings.references, 0)]
    start = jnp.where(_lifted(readings.references >= 0, rank), start, 0.0)
    return ((moved[:, readings.points, readings.states] - start) * _along(readings, rank)).sum(0)


def _positions(at: Float[Array, "3 P S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return where the points are along the directions, counted from the origin of each one's frame."""
    rank = at.ndim - 3
    place = (at[:, readings.points, readings.states] * _along(readings, rank)).sum(0)
    return place if readings.datum is None else place - _lifted(readings.datum, rank + 1 - jnp.ndim(readings.datum))


def _rotations(axes: Float[Array, "3 3 P S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return how far the points' bodies turn about the directions."""
    rank = axes.ndim - 4
    start = axes[:, :, readings.points, jnp.maximum(readings.references, 0)]
    start = jnp.where(_lifted(readings.references >= 0, rank), start, identity(3, rank + 1))
    turn = rotation_vector(matmul(axes[:, :, readings.points, readings.states], transpose(start)))
    return (turn * _along(readings, rank)).sum(0)


def _twists(chain: Chain, phi: Float[Array, "3 N S *batch"], readings: Readings) -> Float[Array, "n *batch"]:
    """Return how far the bushings turn about their pins' axes."""
    own = matvec(transpose(chain.frame), phi)
    rank = own.ndim - 3
    start = own[:, readings.points, jnp.maximum(readings.references, 0)]
    start = jnp.where(_lifted(readings.references >= 0, rank), start, 0.0)
    return ((own[:, readings.points, readings.states] - start) * _along(readings, rank)).sum(0)


def _along(readings: Readings, rank: int) -> Float[AnyArray, "3 n *batch"]:
    """Return the directions with as many batch axes as the predictions have."""
    return _lifted(readings.direction, rank + 2 - jnp.ndim(readings.direction))


def _lifted(x: AnyArray, rank: int) -> AnyArray:
    """Give an array as many batch axes as the predictions have."""
    return x.reshape(x.shape + (1,) * rank)
