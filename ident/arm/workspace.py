"""Where an arm may be held, besides its joint limits: on a line, in listed postures, above a height."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import forward_kinematics, point_positions
from ident.errors import InputError, Problem
from ident.jit import jit

SLACK = 1e-9
"""Rounding [rad] that is forgiven at a limit."""


@dataclass(frozen=True)
class Workspace:
    """The postures in which an arm can be measured.

    Attributes:
        line: (driven,) shares of the pins in the one motion that belts or couplings allow; None where all turn freely.
        postures: (driven,) [rad] each, where no others can be held; empty for all.
        lowest: [m] height in the base frame below which no bushing and no named point may come.
    """

    line: tuple[float, ...] | None = None
    postures: tuple[tuple[float, ...], ...] = ()
    lowest: float = -np.inf

    def check(self, arm: Arm) -> None:
        """Refuse a workspace that is none of an arm.

        Raises:
            InputError: a line and a list at once, or one of another number of joints; a listed posture off the limits.
        """
        count = len(arm.driven)
        if self.line is not None and self.postures:
            raise InputError(Problem("workspace", "line and postures", "one of them", "drop one", "postures"))
        given = [("line", self.line)] if self.line is not None else [("postures", angles) for angles in self.postures]
        for column, angles in given:
            if len(angles) != count:
                got, expected = f"{len(angles)} numbers", f"{count}, one for each driven joint"
                raise InputError(Problem("workspace", got, expected, "give one for each joint", column))
        outside = ~within_limits(arm, np.array(self.postures).reshape(-1, count))
        if outside.any():
            degrees = ", ".join(f"{angle:.4g}" for angle in np.degrees(self.postures[int(np.argmax(outside))]))
            remedy = "correct the posture or the limits"
            raise InputError(
                Problem("workspace", f"({degrees}) deg", "a posture within the limits", remedy, "postures")
            )

    def admits(self, arm: Arm, postures: Float[np.ndarray, "G driven"]) -> Bool[np.ndarray, "G"]:
        """Tell in which postures an arm is within its limits and keeps above the lowest height, were it rigid."""
        within = within_limits(arm, postures)
        if not np.isfinite(self.lowest) or not len(postures):
            return within
        return np.logical_and(within, np.asarray(_least_height(arm, jnp.asarray(postures.T))) >= self.lowest)


ANYWHERE = Workspace()
"""Within the joint limits only."""


def within_limits(arm: Arm, postures: Float[np.ndarray, "G driven"]) -> Bool[np.ndarray, "G"]:
    """Tell which postures [rad] are within the joint limits."""
    low, high = np.array([joint.limits for joint in arm.driven]).reshape(-1, 2).T
    inside: np.ndarray = np.all((low - SLACK <= postures) & (postures <= high + SLACK), axis=1)
    return inside


@jit
def _least_height(arm: Arm, posture: Float[jnp.ndarray, "driven G"]) -> Float[jnp.ndarray, "G"]:
    """Return the height of the lowest bushing or named point of the rigid arm [m]."""
    chain = at_posture(arm, posture)
    phi = jnp.zeros((3, len(arm.joints), posture.shape[1]))
    return jnp.concatenate([forward_kinematics(chain, phi).centre[2], point_positions(chain, phi)[2]]).min(0)
