"""How an arm hangs at rest along its motion: the line about which it vibrates."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, hold
from ident.arm.equilibrium import equilibrium
from ident.arm.linalg import solve_positive
from ident.arm.mechanics import flat
from ident.arm.modes import in_shaft_axes
from ident.vibrate.dynamics import Command, residual
from ident.vibrate.machine import Machine, balanced

BELT_STEPS = 3
"""Newton steps that take a belt's stretch into account; it moves an arm at rest by less than a thousandth."""


def sag(arm: Arm, machine: Machine, posture: Array, loads: Loads | None = None) -> Float[Array, "n *#batch"]:
    """Return the coordinates at which the arm rests at a posture (driven, *batch) [rad]; see `dynamics`.

    Differentiable. The eccentric masses are on their axes here: they shake the arm and do not bend it.

    Raises:
        ModelError: the posture does not fit the arm.
    """
    chain = hold(arm, posture, loads)
    y = flat(in_shaft_axes(chain, equilibrium(chain)))
    if not machine.loose:
        return y
    machine = balanced(machine)
    y = jnp.concatenate([y, jnp.zeros((len(machine.loose), *y.shape[1:]))])
    still, none = Command(posture, *(jnp.zeros_like(posture),) * 2), jnp.zeros_like(y)
    for _ in range(BELT_STEPS):
        K = slope(lambda y: residual(machine, still, y, none, none), y)
        y = y - solve_positive(K, residual(machine, still, y, none, none))
    return y


def slope(function: Any, at: Float[Array, "n *batch"]) -> Float[Array, "n n *batch"]:
    """Return the Jacobian of a function of one flat vector, whose entries are independent over the batch."""

    def column(k: Array) -> Array:
        direction = jnp.zeros_like(at).at[k].set(1.0)
        return jax.jvp(function, (at,), (direction,))[1]

    return jax.vmap(column, out_axes=1)(jnp.arange(at.shape[0]))
