"""The command of the motors at given times: a motion as the equations of motion take it."""

from jaxtyping import Float

from ident.arm.multibody import Multibody
from ident.arm.multibody_kinematics import Command
from ident.jit import AnyArray, library
from ident.vibrate.motion.motion import Motion


def command(model: Multibody, motion: Motion, times: Float[AnyArray, "T"]) -> Command:
    """Return the command of the motors at times [s], with singleton axes for the model's batch."""
    ones = tuple(range(2, model.offset.ndim - 1))
    return Command(*(library(part).expand_dims(part, ones) for part in motion(times)))
