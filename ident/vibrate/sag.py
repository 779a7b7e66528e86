"""How an arm hangs at rest along its motion: the line about which it vibrates."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, hold
from ident.arm.equilibrium import equilibrium
from ident.arm.linalg import solve_positive
from ident.arm.mechanics import flat
from ident.arm.modes import in_shaft_axes
from ident.vibrate.dynamics import residual
from ident.vibrate.kinematics import Command, command
from ident.vibrate.machine import Machine, balanced
from ident.vibrate.motion import Motion
from ident.vibrate.panels import NODE_PLACES, Panels, interpolate, joined, weights

BELT_STEPS = 3
"""Newton steps that take the stretch of belts into account; it moves an arm at rest by less than a thousandth."""


def sag(arm: Arm, machine: Machine, posture: Array, loads: Loads | None = None) -> Float[Array, "n *#batch"]:
    """Return the coordinates at which the arm rests at a posture (driven, *batch) [rad]; see `kinematics`.

    Differentiable. The turning masses are on their axes here: they shake the arm and do not bend it.

    Raises:
        ModelError: the posture does not fit the arm.
    """
    chain = hold(arm, posture, loads)
    y = flat(in_shaft_axes(chain, equilibrium(chain)))
    if not machine.loose:
        return y
    machine = balanced(machine)
    still = Command(posture, *(jnp.zeros_like(posture),) * 2)

    def improve(_: Array, y: Array) -> Array:
        none = jnp.zeros_like(y)
        K = slope(lambda y: residual(machine, still, y, none, none), y)
        return y - solve_positive(K, residual(machine, still, y, none, none))

    taut = jnp.zeros((len(machine.loose), *y.shape[1:]))
    return jax.lax.fori_loop(0, BELT_STEPS, improve, jnp.concatenate([y, taut]))


def slope(function: Any, at: Float[Array, "n *batch"]) -> Float[Array, "m n *batch"]:
    """Return the Jacobian of a function of one flat vector, whose entries are independent over the batch."""

    def column(k: Array) -> Array:
        direction = jnp.zeros_like(at).at[k].set(1.0)
        return jax.jvp(function, (at,), (direction,))[1]

    return jax.vmap(column, out_axes=1)(jnp.arange(at.shape[0]))


def sag_along(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, grid: Panels
) -> tuple[Float[Array, "n E"], Float[Array, "n E"]]:
    """Return the coordinates at rest at the ends of all steps of the panels, and their rates."""
    length = grid.step * grid.steps
    times = (grid.start[:, None] + length[:, None] * NODE_PLACES).ravel()
    rest = sag(arm, machine, command(machine, motion, times).q, loads)
    rest = rest.reshape((rest.shape[0], -1, len(NODE_PLACES)))
    values, slopes, _ = weights(np.arange(grid.steps + 1) / grid.steps)
    lines = interpolate(rest, values, 2), interpolate(rest, slopes, 2) / length[:, None]
    y, yd = (jax.vmap(joined)(line) for line in lines)
    return y, yd
