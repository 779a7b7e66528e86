"""The parts of an arm: rigid bodies, joints of pin and elastic bushing, named points, payloads.

All numbers are SI (m, kg, s, rad, N).

Springs that are no straight line: what a bushing's torque adds to stiffness times angle.

A bushing's torque in bending, or in torsion, is a function of the angle x alone; in bending x is the size of the
bending part of its rotation vector, so that it gives alike in all directions. With K1 its `k_bend` or `k_tors`:

    Spring:       T = K1 x + (K2 - K1) ramp(x - x1) + (K3 - K2) ramp(x - x2),   x1 = T1/K1,  x2 = x1 + (T2 - T1)/K2
    CubicSpring:  T = K1 x + c x^3

and T(-x) = -T(x). The ramp's slope goes from 0 to 1, as a cubic polynomial, over `WIDTH` of the angle x1 (x2) on either
side of it: beyond that the torque is the catalogue's broken line itself, and the tangent has a derivative everywhere.

References:
    The broken line is that of the makers' catalogues: Harmonic Drive AG, "Engineering Data", torsional stiffness. The
    smoothing is ours.
"""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.fields import names_of
from ident.arm.rotations import identity, outer
from ident.errors import Problem, refuse


class Body(eqx.Module):
    """A rigid body.

    Attributes:
        name: unique in its arm.
        mass: () [kg]
        com: (3,) [m] mass centre in the frame of the joint that carries the body.
        inertia: (3, 3) [kg m^2] about the mass centre, along the same frame's axes.
    """

    name: str = eqx.field(static=True)
    mass: Float[Array, ""]
    com: Float[Array, "3"]
    inertia: Float[Array, "3 3"]

    def __init__(self, name: str, mass: Any, com: Any = (0.0, 0.0, 0.0), inertia: Any = ((0.0,) * 3,) * 3):
        self.name = name
        self.mass, self.com, self.inertia = (jnp.asarray(x, float) for x in (mass, com, inertia))

    def __check_init__(self) -> None:
        refuse(inertia_problems(self.name, self.mass, self.inertia))


class Joint(eqx.Module):
    """A bushing (spherical, elastic), the shaft on it, and the pin about which the link turns.

    The bushing's moment is K phi with K = k_bend (1 - a a') + k_tors a a', a the axis, phi the rotation vector;
    its damping moment is C dphi/dt with the coefficients c = tau k. With loss factors eta it also loses, in harmonic
    motion at any frequency, 2 pi eta times its largest strain energy in a cycle: a moment i eta k phi (structural, or
    hysteretic, damping). In time: see `ident.arm.structural`.

    Attributes:
        name: unique in its arm.
        axis: (3,) unit vector of the pin.
        offset: (3,) [m] bushing centre in the frame of the link before (the base frame for the first joint).
        k_bend: () [N m/rad] bushing stiffness across the axis; None where it is rigid.
        k_tors: () [N m/rad] bushing stiffness about the axis; None where it is rigid.
        tau_bend: () [s] damping per stiffness across the axis; None where it is rigid.
        tau_tors: () [s] damping per stiffness about the axis; None where it is rigid.
        loss_bend: () [-] loss factor across the axis; None, as most arms have it, for none.
        loss_tors: () [-] loss factor about the axis; None for none.
        shaft: bodies before the pin.
        link: bodies after the pin.
        driven: False for an extra bushing that has no pin (flexibility of a link, the base or the fingers).
        limits: (lower, upper) [rad] of the pin angle.
        rates: largest speed [rad/s], acceleration [rad/s^2] and jerk [rad/s^3] of the pin.
    """

    name: str = eqx.field(static=True)
    axis: Float[Array, "3"]
    offset: Float[Array, "3"]
    k_bend: Float[Array, ""] | None
    k_tors: Float[Array, ""] | None
    tau_bend: Float[Array, ""] | None
    tau_tors: Float[Array, ""] | None
    loss_bend: Float[Array, ""] | None
    loss_tors: Float[Array, ""] | None
    shaft: tuple[Body, ...]
    link: tuple[Body, ...]
    driven: bool = eqx.field(static=True)
    limits: tuple[float, float] = eqx.field(static=True)
    rates: tuple[float, float, float] = eqx.field(static=True)

    def __init__(
        self,
        name: str,
        *,
        k_bend: Any,
        k_tors: Any,
        axis: Any = (0.0, 0.0, 1.0),
        offset: Any = (0.0, 0.0, 0.0),
        tau_bend: Any = 0.0,
        tau_tors: Any = 0.0,
        loss_bend: Any = None,
        loss_tors: Any = None,
        shaft: tuple[Body, ...] = (),
        link: tuple[Body, ...] = (),
        driven: bool = True,
        limits: tuple[float, float] = (-np.inf, np.inf),
        rates: tuple[float, float, float] = (np.inf, np.inf, np.inf),
    ):
        self.name, self.driven, self.limits, self.rates = name, driven, limits, rates
        self.axis, self.offset = jnp.asarray(axis, float), jnp.asarray(offset, float)
        across, about = (k_bend, tau_bend, loss_bend), (k_tors, tau_tors, loss_tors)
        (self.k_bend, self.tau_bend, self.loss_bend), (self.k_tors, self.tau_tors, self.loss_tors) = (
            tuple(None if x is None or k is None else jnp.asarray(x, float) for x in (k, *lost))
            for k, *lost in (across, about)
        )
        self.shaft, self.link = tuple(shaft), tuple(link)


class Point(eqx.Module):
    """A named point fixed to a link, where deflection is read and loads act.

    Attributes:
        name: unique in its arm.
        joint: name of the joint whose link carries the point.
        position: (3,) [m] in that link's frame.
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    position: Float[Array, "3"]

    def __init__(self, name: str, joint: str, position: Any):
        self.name, self.joint, self.position = name, joint, jnp.asarray(position, float)


class Payload(eqx.Module):
    """A rigid body that a load case may fix to a link, such as the glass.

    Attributes:
        joint: name of the joint whose link carries the payload.
        body: the body, in that link's frame; its name is the payload's.
    """

    joint: str = eqx.field(static=True)
    body: Body


def inertia_problems(name: str, mass: Any, inertia: Any) -> Iterator[Problem]:
    """Yield the problems of a mass or inertia tensor impossible for any body.

    A body's second moment tr(I)/2 - I of mass is positive semi-definite; this is the triangle inequality of its
    principal moments. Abstract values (under `jit` or `grad`) are not checked.

    References:
        Wensing, Kim, Slotine, "Linear matrix inequalities for physically consistent inertial parameter
        identification", IEEE RA-L 3(1), 2018, eq. 12.
    """
    if isinstance(mass, jax.core.Tracer) or isinstance(inertia, jax.core.Tracer):
        return
    m, tensor = np.asarray(mass), np.asarray(inertia)
    if m.shape != () or tensor.shape != (3, 3):
        return
    if not (np.isfinite(m) and m >= 0):
        yield Problem(name, f"mass {m}", "a mass >= 0 kg", "correct it", "mass")
        return
    size = max(np.abs(tensor).max(), 1e-300)
    if not np.isfinite(tensor).all() or np.abs(tensor - tensor.T).max() > 1e-9 * size:
        yield Problem(name, "an asymmetric inertia", "a symmetric tensor", "correct it", "inertia")
        return
    principal = np.linalg.eigvalsh(tensor)
    if principal[0] < -1e-9 * size or principal[2] > (principal[0] + principal[1]) * (1 + 1e-9) + 1e-12 * size:
        got = f"principal moments {', '.join(f'{p:.4g}' for p in principal)} kg m^2"
        expected = "positive moments, none above the sum of the other two"
        yield Problem(name, got, expected, "check units, signs and the reference point (the mass centre)", "inertia")


# -------- Drive
# What moves an arm and excites it: harmonic drives, belts between them, servos, and the stroke that they drive.

ORDER_MAX = 1000
"""Highest multiple of a pulley's frequency: time and memory grow with it. Teeth are fewer."""


def order_name(drive: str, order: float) -> str:
    """Return the name of a drive's transmission error at an order, `drive1_order0p5`: a name has no point."""
    return f"{drive}_order{f'{order:g}'.replace('.', 'p')}"


def order_problems(name: str, order: float) -> Iterator[Problem]:
    """Yield problems of the order of a further transmission error."""
    if not 0 < order <= ORDER_MAX:
        remedy = "give the periods of the error in a turn of the wave generator"
        yield Problem(name, f"{order:g}", f"an order above 0, {ORDER_MAX} at most", remedy, "order")
    elif f"{order:g}" == "2":
        remedy = "order 2 is the drive's error and error_phase: give it there"
        yield Problem(name, "2", "another order", remedy, "order")


class ErrorOrder(eqx.Module):
    """A further transmission error of a drive at its pin: amplitude sin(order theta + phase), theta the pulley's angle.

    Attributes:
        name: made of the drive's and the order, see `order_name`.
        order: periods in a turn of the pulley, which may be a fraction.
        amplitude: () [rad] half of peak to peak.
        phase: () [rad]
    """

    name: str = eqx.field(static=True)
    order: float = eqx.field(static=True)
    amplitude: Float[Array, ""]
    phase: Float[Array, ""]

    def __init__(self, drive: str, order: float, **numbers: Any):
        self.name, self.order = order_name(drive, order), int(order) if float(order).is_integer() else order
        _set_numbers(self, **numbers)

    def __check_init__(self) -> None:
        refuse(order_problems(self.name, self.order))


class Drive(eqx.Module):
    """A harmonic drive on the shaft of a joint, its wave generator turned by a pulley.

    The pulley turns by theta = ratio * q about the joint's axis, seen from the shaft, while the pin turns by q. A
    eccentric mass of the drive has its centre off the axis: at theta = 0 in the direction `phase`, about the axis from
    the shaft's x axis (from y where the joint's axis is x). That mass is part of the shaft's. The pin deviates
    from the wave generator by the transmission error, `error` sin(2 theta + error_phase): twice a turn, since the wave
    generator is an ellipse. `errors` add to it at other orders.

    Attributes:
        name: unique in its arm.
        joint: name of the joint on whose shaft it sits.
        ratio: () [-] turns of the wave generator for one of the joint; negative where it turns the other way.
        rotor_inertia: () [kg m^2] of pulley and wave generator about the axis; a part of the shaft's inertia, never
            added to it: the shaft's bodies weigh and turn with it, and it counts on its own only as it turns faster.
        eccentric_mass: () [kg] the rotating mass that is off its axis.
        eccentricity: () [m] distance of its centre from the axis.
        height: () [m] of that centre above the bushing, along the axis.
        phase: () [rad] direction of that centre at pulley angle zero.
        error: () [rad] amplitude of the transmission error at the pin.
        error_phase: () [rad] phase of the transmission error.
        errors: further transmission errors, at other orders than 2.

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
    errors: tuple[ErrorOrder, ...]

    def __init__(self, name: str, joint: str, *, ratio: Any, errors: tuple[ErrorOrder, ...] = (), **numbers: Any):
        self.name, self.joint, self.errors = name, joint, tuple(errors)
        _set_numbers(self, ratio=ratio, **numbers)

    def __check_init__(self) -> None:
        names = [each.name for each in self.errors]
        twice = [each for n, each in enumerate(self.errors) if each.name in names[:n]]
        expected, remedy = "each order once in a drive", "remove one of them"
        refuse(Problem(e.name, f"order {e.order:g} a second time", expected, remedy, "order") for e in twice)


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
        _set_numbers(self, **numbers)


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
        _set_numbers(self, **numbers)


PROFILES = ("s-curve", "trapezoid", "cycloid", "minimum-jerk")
"""How alpha may go from one end of a stroke to the other; see `ident.vibrate.motion`."""


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
        _set_numbers(self, default=None, **numbers)


def _set_numbers(part: eqx.Module, default: float | None = 0.0, **numbers: Any) -> None:
    """Set the numbers of a part that its constructor was given, the others to a default; None where all are needed."""
    names = names_of(type(part).__name__)
    wrong = [name for name in numbers if name not in names]
    wrong += [name for name in names if default is None and name not in numbers]
    if wrong:
        raise TypeError(f"unknown or missing: {', '.join(wrong)}")
    for name in names:
        setattr(part, name, jnp.asarray(numbers.get(name, default), float))


class MassDamping(eqx.Module):
    """Damping of what moves against the surroundings, alpha M: a light mode's ratio alpha / 2w falls with frequency.

    Attributes:
        name: `damping`, so that its path is `damping.alpha`.
        alpha: () [1/s] times the mass matrix of the bushings' rotations; None for none.
    """

    name: str = eqx.field(static=True, default="damping")
    alpha: Float[Array, ""] | None = eqx.field(
        converter=lambda x: None if x is None else jnp.asarray(x, float), default=None
    )


# -------- Springs
# What a bushing's torque adds to stiffness times angle: the curves stand at the file's head.

WIDTH = 0.25
"""Half the width of a transition, as a share of the angle at which the broken line bends."""
DIRECTIONS = ("bending", "torsion")
STIFFNESS_OF = {"bending": "k_bend", "torsion": "k_tors"}
"""The stiffness of a joint that is a spring's K1."""

Angle = Float[Array, "N *#batch"]
Vectors = Float[Array, "3 N *#batch"]
Squares = Float[Array, "3 3 N *#batch"]


class Spring(eqx.Module):
    """How a bushing stiffens, or softens, with load: a broken line of three pieces, as drive makers print it.

    Attributes:
        name: unique in its arm.
        joint: name of the joint whose bushing it is; its `k_bend` or `k_tors` is K1.
        direction: `bending` or `torsion`.
        ratio2: () [-] K2/K1.
        ratio3: () [-] K3/K1.
        torque1: () [N m] T1, at which K1 ends.
        torque2: () [N m] T2, at which K3 begins.
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    direction: str = eqx.field(static=True)
    ratio2: Float[Array, ""]
    ratio3: Float[Array, ""]
    torque1: Float[Array, ""]
    torque2: Float[Array, ""]

    def __init__(self, name: str, joint: str, direction: str, **numbers: Any):
        self.name, self.joint, self.direction = name, joint, direction
        _set_numbers(self, default=None, **numbers)


class CubicSpring(eqx.Module):
    """How a bushing stiffens with the cube of its angle.

    Attributes:
        name: unique in its arm.
        joint: name of the joint whose bushing it is; its `k_bend` or `k_tors` is the stiffness at no load.
        direction: `bending` or `torsion`.
        cubic: () [N m/rad^3] torque per cube of the angle.
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    direction: str = eqx.field(static=True)
    cubic: Float[Array, ""]

    def __init__(self, name: str, joint: str, direction: str, cubic: Any):
        self.name, self.joint, self.direction, self.cubic = name, joint, direction, jnp.asarray(cubic, float)


NamedPart = Joint | Body | Point | Drive | ErrorOrder | Belt | Servo | Spring | CubicSpring | Stroke | MassDamping
"""What of an arm has a name and numbers."""


class Curves(eqx.Module):
    """What the bushings' torques in one direction add to stiffness times angle x, as functions of s = x^2.

    Attributes:
        rise: (2, N, *batch) [N m/rad] K2 - K1 and K3 - K2.
        angle: (2, N, *batch) [rad] x1 and x2.
        cubic: (N, *batch) [N m/rad^3]
    """

    rise: Float[Array, "2 N *#batch"]
    angle: Float[Array, "2 N *#batch"]
    cubic: Float[Array, "N *#batch"]

    def secant(self, s: Angle) -> Angle:
        """Return the torque that is added, per angle [N m/rad]."""
        x, _, ramp = self._ramps(s)
        return (self.rise * ramp / x).sum(0) + self.cubic * s

    def steepening(self, s: Angle) -> Angle:
        """Return by how much the tangent is above the secant, per square of the angle [N m/rad^3]."""
        x, step, ramp = self._ramps(s)
        return (self.rise * (step - ramp / x) / x**2).sum(0) + 2 * self.cubic

    def _ramps(self, s: Angle) -> tuple[Array, Array, Array]:
        """Return the angle, slope and height of both ramps there.

        Far below a ramp the angle stands still: nothing depends on it there, and it may be zero.
        """
        x = jnp.sqrt(jnp.maximum(s, (self.angle / 2) ** 2))
        half = WIDTH * self.angle
        u = x / half - 1 / WIDTH
        beyond, u = jnp.maximum(u - 1, 0.0), jnp.clip(u, -1.0, 1.0)
        step = (2 + 3 * u - u**3) / 4
        ramp = (3 + 8 * u + 6 * u**2 - u**4) / 16
        return x, step, half * (ramp + beyond)


class CurvedSprings(eqx.Module):
    """Where an arm's springs are no straight lines.

    Attributes:
        axis: (3, N, *batch) axes of the pins, along the axes that the rotation vectors have.
        bend: across the axis; None where all are straight.
        tors: about it.
    """

    axis: Float[Array, "3 N *#batch"]
    bend: Curves | None
    tors: Curves | None

    def torque(self, phi: Vectors) -> Vectors:
        """Return the torque of each bushing beyond stiffness times angle [N m]: the energy's gradient."""
        across, along = self._parts(phi)
        torque = jnp.zeros_like(across)
        if self.bend is not None:
            torque = torque + self.bend.secant((across * across).sum(0)) * across
        return torque if self.tors is None else torque + self.tors.secant(along * along) * along * self.axis

    def tangents(self, phi: Vectors) -> tuple[Squares, Squares]:
        """Return what bending and torsion add to the tangent of each bushing [N m/rad]: the energy's Hessian.

        In bending it is dT/dx along the bending angle and T/x across it; the same at x = 0.
        """
        across, along = self._parts(phi)
        straight = outer(self.axis, self.axis)
        bend = tors = jnp.zeros_like(straight)
        if self.bend is not None:
            s = (across * across).sum(0)
            plane = -straight + identity(3, straight.ndim - 2)
            bend = self.bend.secant(s) * plane + self.bend.steepening(s) * outer(across, across)
        if self.tors is not None:
            s = along * along
            tors = (self.tors.secant(s) + self.tors.steepening(s) * s) * straight
        return bend, tors

    def _parts(self, phi: Vectors) -> tuple[Vectors, Angle]:
        along = (self.axis * phi).sum(0)
        return phi - self.axis * along, along


def bends(spring: Spring, k: Any) -> tuple[Any, Any]:
    """Return the angles at which a spring's line bends [rad], K1 [N m/rad] given; T2 below T1 counts as T1."""
    first = spring.torque1 / k
    return first, first + jnp.maximum(spring.torque2 - spring.torque1, 0.0) / (k * spring.ratio2)
