"""What moves an arm and excites it: harmonic drives, belts between them, servos, and the stroke that they drive."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.fields import names_of


class Drive(eqx.Module):
    """A harmonic drive on the shaft of a joint, its wave generator turned by a pulley.

    The pulley turns by theta = ratio * q about the joint's axis, seen from the shaft, while the pin turns by q. A
    turning mass of the drive has its centre off the axis: at theta = 0 in the direction `phase`, counted about the axis
    from the shaft's x axis (from y where the joint's axis is x). That mass is part of the shaft's. The pin deviates
    from the wave generator by the kinematic error, `error` sin(2 theta + error_phase): twice a turn, since the wave
    generator is an ellipse.

    Attributes:
        name: unique in its arm.
        joint: name of the joint on whose shaft it sits.
        ratio: () [-] turns of the wave generator for one of the joint; negative where it turns the other way.
        rotor_inertia: () [kg m^2] of pulley and wave generator about the axis; a part of the shaft's inertia, never
            added to it: the shaft's bodies weigh and turn with it, and it counts on its own only as it turns faster.
        eccentric_mass: () [kg] the turning mass that is off its axis.
        eccentricity: () [m] distance of its centre from the axis.
        height: () [m] of that centre above the bushing, along the axis.
        phase: () [rad] direction of that centre at pulley angle zero.
        error: () [rad] amplitude of the kinematic error at the pin.
        error_phase: () [rad] phase of the kinematic error.

    References:
        Tuttle, Seering, "A nonlinear model of a harmonic drive gear transmission", IEEE T-RA 12(3), 1996 (kinematic
        error at twice the wave generator's frequency).
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    ratio: Float[Array, ""]
    rotor_inertia: Float[Array, ""]
    eccentric_mass: Float[Array, ""]
    eccentricity: Float[Array, ""]
    height: Float[Array, ""]
    phase: Float[Array, ""]
    error: Float[Array, ""]
    error_phase: Float[Array, ""]

    def __init__(self, name: str, joint: str, *, ratio: Any, **numbers: Any):
        self.name, self.joint = name, joint
        for field in names_of("Drive"):
            setattr(self, field, jnp.asarray(ratio if field == "ratio" else numbers.pop(field, 0.0), float))
        _no_more(numbers)


class Belt(eqx.Module):
    """A belt along a link, from the pulley of the joint before to the pulley of the joint behind it.

    Attributes:
        name: unique in its arm.
        driver: name of the joint whose pulley drives the belt.
        driven: name of the joint whose pulley it drives, the next one that has a pin.
        driver_radius: () [m]
        driven_radius: () [m]
        pretension: () [N] of each span of the unloaded belt.
        stiffness: () [N/m] of each span.
        tau: () [s] damping per stiffness.
        height: () [m] of the belt's plane above the bushing of the driven joint, along its axis.
    """

    name: str = eqx.field(static=True)
    driver: str = eqx.field(static=True)
    driven: str = eqx.field(static=True)
    driver_radius: Float[Array, ""]
    driven_radius: Float[Array, ""]
    pretension: Float[Array, ""]
    stiffness: Float[Array, ""]
    tau: Float[Array, ""]
    height: Float[Array, ""]

    def __init__(self, name: str, driver: str, driven: str, **numbers: Any):
        self.name, self.driver, self.driven = name, driver, driven
        for field in names_of("Belt"):
            setattr(self, field, jnp.asarray(numbers.pop(field, 0.0), float))
        _no_more(numbers)


class Servo(eqx.Module):
    """A servo that holds a motor: a spring and a damper between the motor's angle and its command.

    Its motor turns the pulley of a drive and, by belts, those of the drives that they tie to it. What it holds is all
    that turns with them: rotors (`rotor_inertia`, to which the motor's own belongs) and links. An integral action
    brings the motor back to its command, so that static deflections are those of held motors.

    Attributes:
        name: unique in its arm.
        joint: name of the joint on whose drive the motor sits.
        k_servo: () [N m/rad] stiffness at the motor, of its angle seen from the shaft that it sits on.
        tau: () [s] damping per stiffness.
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    k_servo: Float[Array, ""]
    tau: Float[Array, ""]

    def __init__(self, name: str, joint: str, **numbers: Any):
        self.name, self.joint = name, joint
        for field in names_of("Servo"):
            setattr(self, field, jnp.asarray(numbers.pop(field, 0.0), float))
        _no_more(numbers)


PROFILES = ("s-curve", "trapezoid", "cycloid")
"""How alpha may go from one end of a stroke to the other; see `ident.vibrate.motion.stroke`."""


class Stroke(eqx.Module):
    """The straight motion of the hand: joint angles alpha times `direction`, alpha from folded to unfolded.

    Attributes:
        name: always `stroke`.
        profile: one of `PROFILES`, how alpha goes from end to end unless a study asks for another.
        direction: (driven,) [-] share of each pin in alpha.
        folded: () [rad] alpha of the folded arm.
        unfolded: () [rad] alpha of the unfolded arm.
        speed: () [rad/s] limit of |d alpha/dt| at full speed.
        acceleration: () [rad/s^2] limit of the second derivative at full speed.
        jerk: () [rad/s^3] limit of the third derivative at full speed.
    """

    name: str = eqx.field(static=True)
    profile: str = eqx.field(static=True)
    direction: Float[Array, "driven"]
    folded: Float[Array, ""]
    unfolded: Float[Array, ""]
    speed: Float[Array, ""]
    acceleration: Float[Array, ""]
    jerk: Float[Array, ""]

    def __init__(self, direction: Any, *, profile: str = PROFILES[0], **numbers: Any):
        self.name, self.profile, self.direction = "stroke", profile, jnp.asarray(direction, float)
        for field in names_of("Stroke"):
            setattr(self, field, jnp.asarray(numbers.pop(field), float))
        _no_more(numbers)


def _no_more(numbers: dict[str, Any]) -> None:
    if numbers:
        raise TypeError(f"unknown: {', '.join(numbers)}")
