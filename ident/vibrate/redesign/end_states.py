"""The arm at both ends of a motion: what a change does to it besides its vibration."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.equilibrium import deflection, static_equilibrium
from ident.arm.modes import lowest_eigenpairs, to_hertz
from ident.jit import AnyArray, jit
from ident.vibrate.motion.motion import Motion


class EndState(NamedTuple):
    """First natural frequency and static deflection, the worse of both ends; NaN where the arm collapses.

    Attributes:
        frequency: (*batch) [Hz]
        deflection: (*batch) [m] how far the end point lies from its place on rigid joints.
    """

    frequency: Float[AnyArray, "*batch"]
    deflection: Float[AnyArray, "*batch"]


def end_states(arm: Arm, motion: Motion, loads: Loads | None = None) -> EndState:
    """Return the worse of the arm's states at the start and at the end of a motion. Differentiable once."""
    return worst_state(arm, ends(motion), loads)


def ends(motion: Motion) -> Float[AnyArray, "driven 2"]:
    """Return the postures [rad] at both ends of a motion."""
    return motion(motion.breaks[np.array([0, -1])])[0]


@jit
def worst_state(arm: Arm, posture: Float[AnyArray, "driven ends"], loads: Loads | None) -> EndState:
    """Return the worse of the arm's states at some postures [rad]."""
    chain = at_posture(arm, posture.reshape((*posture.shape, *(1,) * len(arm.batch))), loads)
    at = static_equilibrium(chain)
    frequency = to_hertz(lowest_eigenpairs(chain, at, count=1)[0])[0]
    moved = deflection(chain, at.phi)[:, -1]
    return EndState(frequency.min(0), jnp.sqrt((moved**2).sum(0)).max(0))
