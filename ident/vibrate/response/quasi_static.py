"""The quasi-static deflection of an arm along its motion, about which it vibrates."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.equilibrium import equilibrium
from ident.arm.linalg import solve_positive
from ident.arm.mechanics import flat
from ident.arm.modes import in_shaft_axes
from ident.arm.multibody import Multibody, balanced
from ident.arm.multibody_dynamics import residual
from ident.arm.multibody_kinematics import Command
from ident.jit import jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.time_intervals import TimeIntervals, Times, between_nodes

BELT_STEPS = 3
"""Newton steps that take the stretch of belts into account; it moves the equilibrium by less than a thousandth."""


def quasi_static_deflection(
    arm: Arm, model: Multibody, posture: Array, loads: Loads | None = None
) -> Float[Array, "n *#batch"]:
    """Return the coordinates of the static equilibrium at a posture (driven, *batch) [rad]; see `kinematics`.

    Differentiable. The turning masses are on their axes here: they excite the arm and do not bend it.

    Raises:
        ModelError: the posture does not fit the arm.
    """
    chain = at_posture(arm, posture, loads)
    y = flat(in_shaft_axes(chain, equilibrium(chain)))
    if not model.belt_driven:
        return y
    model = balanced(model)
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)

    def improve(_: Array, y: Array) -> Array:
        none = jnp.zeros_like(y)
        K = slope(lambda y: residual(model, still, y, none, none), y)
        return y - solve_positive(K, residual(model, still, y, none, none))

    taut = jnp.zeros((len(model.belt_driven), *y.shape[1:]))
    return jax.lax.fori_loop(0, BELT_STEPS, improve, jnp.concatenate([y, taut]))


def slope(function: Any, at: Float[Array, "n *batch"]) -> Float[Array, "k n *batch"]:
    """Return the Jacobian of a function of one flat vector, whose entries are independent over the batch."""

    def column(k: Array) -> Array:
        direction = jnp.zeros_like(at).at[k].set(1.0)
        return jax.jvp(function, (at,), (direction,))[1]

    return jax.vmap(column, out_axes=1)(jnp.arange(at.shape[0]))


@jit
def quasi_static_along(
    arm: Arm, model: Multibody, motion: Motion, loads: Loads | None, grid: TimeIntervals
) -> Float[Array, "P n m"]:
    """Return the coordinates of the static equilibrium at the nodes of the intervals."""
    y = quasi_static_deflection(arm, model, command(model, motion, grid.nodes.ravel()).q, loads)
    return jnp.moveaxis(y.reshape((y.shape[0], *grid.nodes.shape)), 1, 0)


@jit
def quasi_static_start(grid: TimeIntervals, nodes: Float[Array, "P n m"], time: Times) -> Float[Array, "n"]:
    """Return the coordinates of the static equilibrium at the first of some times, by those at the nodes."""
    return between_nodes(grid, nodes, time[:1])[0][:, 0]


@jit
def initial_equilibrium(model: Multibody, motion: Motion, balanced: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return the coordinates of the static equilibrium before a motion, the weight of the turning masses included.

    By one step of Newton's method from the equilibrium without them: they hardly bend the arm.

    Args:
        model: gathered with `rank=1`.
        motion: at whose start the arm is at rest.
        balanced: coordinates of the equilibrium with the turning masses on their axes.
    """
    posture = motion(motion.breaks[:1])[0]
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)
    y, none = balanced[:, None], jnp.zeros((len(balanced), 1))
    K = slope(lambda y: residual(model, still, y, none, none), y)
    return (y - solve_positive(K, residual(model, still, y, none, none)))[:, 0]
