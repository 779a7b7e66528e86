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
from ident.jit import AnyArray
from ident.vibrate.motion.motion import Motion

START_STEPS = 3
"""Newton steps that take the weight of the turning masses into account."""
BELT_STEPS = 3
"""Newton steps that take the stretch of belts into account; it moves the equilibrium by less than a thousandth."""


def quasi_static_deflection(
    arm: Arm, model: Multibody, posture: AnyArray, loads: Loads | None = None
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


def initial_equilibrium(
    model: Multibody, motion: Motion, balanced: Float[Array, "n"], stiffness: Float[Array, "n n"]
) -> Float[Array, "n"]:
    """Return the coordinates of the static equilibrium before a motion, the weight of the turning masses included.

    By steps of Newton's method with the stiffness without them, which they change by less than a thousandth.

    Args:
        model: gathered with `rank=1`.
        motion: at whose start the arm is at rest.
        balanced: coordinates of the equilibrium with the turning masses on their axes.
        stiffness: of that equilibrium.
    """
    posture = jnp.asarray(motion(motion.breaks[:1])[0])
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)
    none, K = jnp.zeros((len(balanced), 1)), stiffness[..., None]

    def improve(_: Array, y: Array) -> Array:
        return y - solve_positive(K, residual(model, still, y, none, none))

    return jax.lax.fori_loop(0, START_STEPS, improve, balanced[:, None])[:, 0]
