"""Structural damping (loss factors), of which motion in time knows nothing."""

from ident.arm.arm import Arm
from ident.arm.fields import LOSS
from ident.errors import InputError, Problem


def refuse_losses(arm: Arm) -> None:
    """Refuse an arm with loss factors where it moves in time.

    A complex stiffness is a law of harmonic motion alone: in time it is not causal (Crandall, "The role of damping in
    vibration theory", J. Sound Vib. 11(1), 1970). A damping time tau = eta / (2 pi f) loses as much at one frequency f.

    Raises:
        InputError: some joint has a loss factor.
    """
    given = [f"{joint.name}.{field}" for joint in arm.joints for field in LOSS if getattr(joint, field) is not None]
    if given:
        got = f"a loss factor ({given[0]})"
        expected = "damping times, as loss factors hold for harmonic motion only"
        time = given[0].replace("loss", "tau")
        remedy = f"take them out, and give {time} = loss factor / (2 pi f) instead, which is exact at one frequency f"
        raise InputError(Problem(arm.name, got, expected, remedy))
