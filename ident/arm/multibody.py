"""The multibody model of an arm: moments of mass, bushings, drives and belts, as the equations of motion need them.

Elastic belts between pulleys: stretch, tension, and what they do to bushings and pins.

    upper span  T_u = max(0, T0 + k (e_u + tau de_u/dt)),   lower span likewise
    e_u = L(D) - L(D0) + s,   e_l = L(D) - L(D0) - s,   s = r1 (theta1 - gamma) - r2 (theta2 - gamma)

D is the distance of the pulleys' centres across the axis and gamma the turn of the line between them; both change as
the driven shaft tilts under the belt. L(D) = sqrt(D^2 - d^2) + d asin(d/D), d = r1 - r2, is the length of a span with
its share of the arcs, so that dL/dD = cos(beta), sin(beta) = d/D. By virtual work, torque T_u - T_l times radius on
each pulley, (T_u + T_l) cos(beta) along the line of centres and (T_u - T_l) sin(beta) across it follow. Angles are
counted from the command, on which the belts run without stretch, and forces from the assembled arm: the bushings were
aligned under pretension.

Rigid belts (xi = 0) are not the limit of stiff ones. Those force s to zero: with gamma = 0 and no error

    r2 (N2 xi2 + phi2) = r1 (N1 - 1) xi1

phi along the axis: the pulley is held in space, not on its shaft. Behind a driver at rest xi = -phi / N, the link turns
by phi (1 - 1/N), and a frequency of torsion is higher by about 1/N. Stiff belts also hold their driven shafts from
tilting, by 2 k height^2. With a stretch a torque at the link sees the compliance

    (1 - 1/N)^2 / k_tors + 1 / (2 k (N r2)^2)

References:
    Ours, after the paper's Figure 3; its printed equations are lost.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import (
    Loads,
    Moments,
    axes,
    bushings,
    carriers,
    curved_springs,
    losses,
    moments,
    no_loads,
    offsets,
    positions,
    rigid_directions,
    stack,
)
from ident.arm.mechanics import Phi, elastic, flat, inboard, unflatten
from ident.arm.parts import CurvedSprings, Drive, ErrorOrder
from ident.arm.rotations import (
    acceleration_map,
    axial,
    cross,
    left_jacobian,
    left_jacobian_rate,
    matmul,
    matvec,
    rotated,
    rotation,
    rotation_by,
    skew,
    total,
    transpose,
    turn_about,
    turned,
)
from ident.errors import require
from ident.programs import AnyArray

# -------- Multibody


class Drives(eqx.Module):
    """Harmonic drives of all joints; a joint without one has ratio 1 and nothing that turns. See `ident.arm.parts`.

    Attributes:
        ratio: (N, *batch) [-]
        rotor: (N, *batch) [kg m^2] inertia of pulley and wave generator, a part of the shaft's.
        imbalance: (N, *batch) [kg m] eccentric mass times its distance from the axis.
        reach: (N, *batch) [m] that distance.
        height: (N, *batch) [m] of the eccentric mass above the bushing.
        phase: (N, *batch) [rad]
        orders: of the transmission errors that some drive has, 2 first.
        error: (N, *batch) [rad] amplitude of the transmission error at each of them.
        error_phase: (N, *batch) [rad] likewise.
        across: (3, 2, N, *batch) unit vectors across the axis; the phase counts from the first.
    """

    ratio: Float[Array, "N *#batch"]
    rotor: Float[Array, "N *#batch"]
    imbalance: Float[Array, "N *#batch"]
    reach: Float[Array, "N *#batch"]
    height: Float[Array, "N *#batch"]
    phase: Float[Array, "N *#batch"]
    orders: tuple[float, ...] = eqx.field(static=True)
    error: tuple[Float[Array, "N *#batch"], ...]
    error_phase: tuple[Float[Array, "N *#batch"], ...]
    across: Float[Array, "3 2 N *#batch"]


class Belts(eqx.Module):
    """Belts between neighbouring pulleys.

    Attributes:
        radius: (2, B, *batch) [m] of the driving and of the driven pulley.
        pretension: (B, *batch) [N] of each span.
        stiffness: (B, *batch) [N/m] of each span.
        tau: (B, *batch) [s] damping per stiffness.
        height: (B, *batch) [m] of the belt's plane above the driven joint's bushing.
        ends: joints of the driving and of the driven pulley.
    """

    radius: Float[Array, "2 B *#batch"]
    pretension: Float[Array, "B *#batch"]
    stiffness: Float[Array, "B *#batch"]
    tau: Float[Array, "B *#batch"]
    height: Float[Array, "B *#batch"]
    ends: tuple[tuple[int, int], ...] = eqx.field(static=True)


class Multibody(eqx.Module):
    """An arm under a load, in the axes of its shafts and links, which do not change with the posture.

    Attributes:
        axis: (3, N, *batch) unit vectors of the pins.
        offset: (3, N, *batch) [m] of each bushing in the axes of the link before.
        shaft: moments of all bodies before the pin, along the shaft's axes.
        link: moments of all bodies behind the pin, loads included, along the link's axes.
        stiffness: (3, 3, N, *batch) [N m/rad] of the bushings, along the shaft's axes.
        damping: (3, 3, N, *batch) [N m s/rad] by the damping times.
        loss: (3, 3, N, *batch) [N m/rad] what they lose by their loss factors, see `ident.arm.structural`; None
            without any.
        alpha: (*batch) [1/s] damping per mass; None without any.
        position: (3, P, *batch) [m] named points along the axes of their link.
        force: (3, P, *batch) [N] on them, in base axes.
        gravity: (3,) [m/s^2]
        drives: what turns on the shafts.
        belts: what ties the pulleys.
        curved: where springs are no straight lines, along the shaft's axes; None where all are.
        rigid: (3, 3, N, *batch) projectors on the directions in which bushings are rigid, likewise; None where all
            give. Coordinates in them stay zero, as of springs of mass and stiffness 1 that nothing moves.
        carrier: joint that carries each named point.
        driven: joints that have a pin.
        elastic: whether the belts stretch, so that the pins that they drive deviate from the command.
        transmission_error: whether some drive may have one; if not, none is computed, whatever `drives`.
    """

    axis: Float[Array, "3 N *#batch"]
    offset: Float[Array, "3 N *#batch"]
    shaft: Moments
    link: Moments
    stiffness: Float[Array, "3 3 N *#batch"]
    damping: Float[Array, "3 3 N *#batch"]
    loss: Float[Array, "3 3 N *#batch"] | None
    alpha: Float[Array, "*#batch"] | None
    position: Float[Array, "3 P *#batch"]
    force: Float[Array, "3 P *#batch"]
    gravity: Float[Array, "3"]
    drives: Drives
    belts: Belts
    curved: CurvedSprings | None
    rigid: Float[Array, "3 3 N *#batch"] | None
    carrier: tuple[int, ...] = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    elastic: bool = eqx.field(static=True)
    transmission_error: bool = eqx.field(static=True)

    @property
    def joints(self) -> int:
        """Number N of joints."""
        return self.offset.shape[1]

    @property
    def belt_driven(self) -> tuple[int, ...]:
        """Joints that an elastic belt drives, so that their pins deviate from the command."""
        return tuple(driven for _, driven in self.belts.ends) if self.elastic else ()

    @property
    def size(self) -> int:
        """Number n of coordinates: three of each bushing, one of each elastic belt."""
        return 3 * self.joints + len(self.belt_driven)


IMBALANCE, ERROR = "imbalance", "transmission error"


class ExcitingOrder(NamedTuple):
    """What excites at a multiple of the turning frequency of a drive's pulley.

    Attributes:
        drive: its name.
        kind: IMBALANCE or ERROR.
        order: the multiple.
        amplitude: path of the eccentricity [m], or of the error's amplitude [rad].
        phase: path of the phase.
    """

    drive: str
    kind: str
    order: float
    amplitude: str
    phase: str

    @property
    def of_error(self) -> bool:
        """Whether it is a transmission error."""
        return self.kind == ERROR


def possible_orders(arm: Arm) -> list[ExcitingOrder]:
    """Return what may excite an arm: imbalances of all drives, then their `error`, then their further errors."""
    return [each for each, _ in _with_amplitudes(arm)]


def exciting_orders(arm: Arm) -> list[ExcitingOrder]:
    """Return those whose amplitude may differ from zero; under `jit` or `grad` any may."""
    every = _with_amplitudes(arm)
    return [each for each, x in every if isinstance(x, jax.core.Tracer) or np.any(np.asarray(x) != 0)]


def _with_amplitudes(arm: Arm) -> Iterator[tuple[ExcitingOrder, Array]]:
    for d in arm.drives:
        yield ExcitingOrder(d.name, IMBALANCE, 1, f"{d.name}.eccentricity", f"{d.name}.phase"), d.eccentricity
    for d in arm.drives:
        yield ExcitingOrder(d.name, ERROR, 2, f"{d.name}.error", f"{d.name}.error_phase"), d.error
    for d in arm.drives:
        for e in d.errors:
            yield ExcitingOrder(d.name, ERROR, e.order, f"{e.name}.amplitude", f"{e.name}.phase"), e.amplitude


def orders_of(arm: Arm) -> dict[str, list[float]]:
    """Return the orders at which each drive excites its arm: 1 in any case, and those of its transmission errors."""
    errors = [each for each in exciting_orders(arm) if each.of_error]
    return {d.name: sorted({1, *(each.order for each in errors if each.drive == d.name)}) for d in arm.drives}


def has_transmission_error(arm: Arm) -> bool:
    """Tell whether some drive may have a transmission error."""
    return any(each.of_error for each in exciting_orders(arm))


def refuse_moments(loads: Loads) -> None:
    """Refuse a load case with a moment: the equations of motion have forces alone."""
    remedy = "take two forces at two points of the body"
    require(loads.moment is None, "", "a moment", "payloads, masses and forces in motion", remedy, "load")


def multibody(
    arm: Arm,
    loads: Loads | None = None,
    *,
    rank: int = 0,
    elastic_belts: bool = False,
    transmission_error: bool | None = None,
) -> Multibody:
    """Gather an arm under a load.

    Args:
        arm: the arm; its numbers may be arrays `(*batch)` (see `Arm.replace`).
        loads: the load case; its own weight when None.
        rank: number of batch axes of times and states; those of the arm's numbers come last among them.
        elastic_belts: whether belts stretch.
        transmission_error: whether some drive may have a transmission error; by the arm's numbers when None.

    Raises:
        ModelError: the arm has more batch axes than `rank`.
        InputError: a load with a moment.
    """
    loads = (no_loads(arm) if loads is None else loads).lifted(rank)
    refuse_moments(loads)
    axis, (shaft, link) = axes(arm, rank), moments(arm, loads, rank)
    bend, tors, damping = bushings(arm, axis)
    return Multibody(
        axis=axis,
        offset=offsets(arm, rank),
        shaft=shaft,
        link=link,
        stiffness=bend + tors,
        damping=damping,
        loss=losses(arm, bend, tors),
        alpha=arm.damping.alpha,
        position=positions(arm, rank),
        force=loads.force,
        gravity=arm.gravity,
        drives=_drives(arm, axis, rank),
        belts=_belts(arm, rank),
        curved=curved_springs(arm, axis),
        rigid=rigid_directions(arm, axis),
        carrier=carriers(arm),
        driven=tuple(n for n, joint in enumerate(arm.joints) if joint.driven),
        elastic=elastic_belts and bool(arm.belts),
        transmission_error=has_transmission_error(arm) if transmission_error is None else transmission_error,
    )


def balanced(multibody: Multibody) -> Multibody:
    """Return the model with all eccentric masses on their axes and without transmission error: nothing excites it."""
    drives = replace(multibody.drives, imbalance=jnp.zeros_like(multibody.drives.imbalance))
    return replace(multibody, drives=drives, transmission_error=False)


def _drives(arm: Arm, axis: Array, rank: int) -> Drives:
    def column(parts: Mapping[str, Drive | ErrorOrder], field: str, absent: float = 0.0) -> Array:
        numbers = [getattr(parts[j.name], field) if j.name in parts else absent for j in arm.joints]
        return stack(numbers, 0, rank)

    drives, errors = {drive.joint: drive for drive in arm.drives}, dict[float, dict[str, ErrorOrder]]()
    for drive in arm.drives:
        for error in drive.errors:
            errors.setdefault(error.order, {})[drive.joint] = error
    return Drives(
        ratio=column(drives, "ratio", 1.0),
        rotor=column(drives, "rotor_inertia"),
        imbalance=column(drives, "eccentric_mass") * column(drives, "eccentricity"),
        reach=column(drives, "eccentricity"),
        height=column(drives, "height"),
        phase=column(drives, "phase"),
        orders=(2, *errors),
        error=(column(drives, "error"), *(column(parts, "amplitude") for parts in errors.values())),
        error_phase=(column(drives, "error_phase"), *(column(parts, "phase") for parts in errors.values())),
        across=_across(axis),
    )


def _across(axis: Float[Array, "3 N *#batch"]) -> Float[Array, "3 2 N *#batch"]:
    """Return two unit vectors across each axis: x made perpendicular to it (y where the axis is x), and axis x that."""
    shape = (3, 1) + (1,) * (axis.ndim - 2)
    x, y = (jnp.asarray(np.eye(3)[k]).reshape(shape) for k in (0, 1))
    start = jnp.where(jnp.abs(axis[:1]) > 1 - 1e-9, y, x)
    first = start - axis * (axis * start).sum(0)
    first = first / jnp.sqrt((first * first).sum(0))
    return jnp.stack([first, (skew(axis) * first[None]).sum(1)], 1)


def _belts(arm: Arm, rank: int) -> Belts:
    names = [joint.name for joint in arm.joints]

    def column(field: str) -> Array:
        numbers = [getattr(belt, field) for belt in arm.belts]
        return stack(numbers, 0, rank) if numbers else jnp.zeros((0,) + (1,) * rank)

    return Belts(
        radius=jnp.stack([column("driver_radius"), column("driven_radius")]),
        pretension=column("pretension"),
        stiffness=column("stiffness"),
        tau=column("tau"),
        height=column("height"),
        ends=tuple((names.index(belt.driver), names.index(belt.driven)) for belt in arm.belts),
    )


# -------- Belts
# Stretch and tension of elastic belts, and what they do to bushings and pins: the equations stand at the file's head.

Spans = Float[Array, "2 B *#batch"]


def stretch(model: "Multibody", phi: Array, xi: Array, error: Array) -> Spans:
    """Return by how much upper and lower span of each belt are longer than unloaded [m].

    Args:
        model: the multibody model.
        phi: (3, N, *batch) [rad] rotation vectors of the bushings.
        xi: (N, *batch) [rad] deviation of each pin from its command.
        error: (N, *batch) [rad] transmission error of each drive.
    """
    belts = model.belts
    driver, driven = (np.asarray(ends, int) for ends in zip(*belts.ends, strict=True))
    axis, offset = model.axis[:, driven], model.offset[:, driven]
    start = offset - axis * (axis * offset).sum(0)
    tilt = matvec(rotation(phi[:, driven]), axis) - axis
    line = start + belts.height * (tilt - axis * (axis * tilt).sum(0))
    D0, D = (jnp.sqrt((x * x).sum(0)) for x in (start, line))
    gamma = jnp.arctan2((axis * jnp.cross(start, line, axis=0)).sum(0), (start * line).sum(0))

    first = (model.drives.ratio[driver] - 1) * xi[driver] - error[driver]
    second = model.drives.ratio[driven] * xi[driven] + (axis * phi[:, driven]).sum(0)
    s = belts.radius[0] * (first - gamma) - belts.radius[1] * (second - gamma)
    longer = _span(D, belts.radius) - _span(D0, belts.radius)
    return jnp.stack([longer + s, longer - s])


def tensions(model: "Multibody", e: Spans, e_dot: Spans) -> Spans:
    """Return the tension of upper and lower span [N]; a slack span pulls with zero."""
    belts = model.belts
    return jnp.maximum(0.0, belts.pretension + belts.stiffness * (e + belts.tau * e_dot))


def belt_forces(
    model: "Multibody", position: tuple[Array, Array, Array], rate: tuple[Array, Array, Array]
) -> tuple[Float[Array, "3 N *#batch"], Float[Array, "N *#batch"], Float[Array, "N *#batch"]]:
    """Return the moments [N m] on bushings, wave generators and transmission errors that the belts ask for.

    Args:
        model: the multibody model.
        position: phi (3, N, *batch), xi and error (N, *batch) [rad], as in `stretch`.
        rate: their rates [rad/s].
    """
    length = partial(stretch, model)
    e, pullback = jax.vjp(length, *position)
    e_dot = jax.jvp(length, position, rate)[1]
    pullback_assembled = jax.vjp(length, jnp.zeros_like(position[0]), *position[1:])[1]
    now = pullback(tensions(model, e, e_dot))
    assembled = pullback_assembled(jnp.broadcast_to(model.belts.pretension, e.shape))
    on_bushings, on_pins, on_errors = (a - b for a, b in zip(now, assembled, strict=True))
    return on_bushings, on_pins, on_errors


def _span(D: Array, radius: Array) -> Array:
    d = radius[0] - radius[1]
    return jnp.sqrt(D * D - d * d) + d * jnp.arcsin(d / D)


# -------- Multibody kinematics
# Kinematics of an arm whose pins are driven: the motors' command, how pins and pulleys turn, where bodies are.
#
# Coordinates y are flat: joint by joint the rotation vector phi_j of its bushing along the axes of its shaft, then
# for each elastic belt the deviation xi of the pin that it drives from its command. No angle is taken as small.

Joints = Float[Array, "N *#batch"]


class Command(NamedTuple):
    """The command of the motors: angles of the driven joints and their rates.

    Attributes:
        q: (driven, *batch) [rad]
        qd: (driven, *batch) [rad/s]
        qdd: (driven, *batch) [rad/s^2]
    """

    q: Float[AnyArray, "driven *#batch"]
    qd: Float[AnyArray, "driven *#batch"]
    qdd: Float[AnyArray, "driven *#batch"]


class Turning(NamedTuple):
    """An angle and its rates at each joint, `(N, *batch)` [rad, rad/s, rad/s^2]."""

    angle: Joints
    rate: Joints
    acceleration: Joints


def at_rest(angle: Joints) -> Turning:
    """Return angles that do not change."""
    return Turning(angle, jnp.zeros_like(angle), jnp.zeros_like(angle))


class Pins(eqx.Module):
    """How pins and pulleys turn.

    Attributes:
        pin: of the link against the shaft, transmission error included.
        pulley: of the pulley against the shaft.
        slope: (N, *batch) [-] turn of the pin for one of the wave generator divided by the ratio.
        error: (N, *batch) [rad] transmission error.
    """

    pin: Turning
    pulley: Turning
    slope: Joints
    error: Joints


def pins(model: Multibody, command: Command, xi: Turning) -> Pins:
    """Turn pins and pulleys by the command and the deviations xi from it.

    With amplitudes A and phases chi at the orders o, theta = ratio q: error = sum of A sin(o theta + chi), slope = 1 +
    ratio sum of o A cos(o theta + chi); the pin accelerates by slope d2q/dt2 - (ratio dq/dt)^2 sum of o^2 A sin(...).
    """
    q, qd, qdd = (of_joints(model, part) + own for part, own in zip(command, xi, strict=True))
    drives, error, slope, curve = model.drives, jnp.zeros_like(q), jnp.ones_like(q), jnp.zeros_like(q)
    if model.transmission_error:
        waves = [
            (order, amplitude, order * drives.ratio * q + phase)
            for order, amplitude, phase in zip(drives.orders, drives.error, drives.error_phase, strict=True)
        ]
        errors = [amplitude * jnp.sin(argument) for _, amplitude, argument in waves]
        slopes = [order * drives.ratio * amplitude * jnp.cos(argument) for order, amplitude, argument in waves]
        curves = [order**2 * drives.ratio**2 * each for (order, *_), each in zip(waves, errors, strict=True)]
        error, slope, curve = sum(errors[1:], errors[0]), 1 + sum(slopes[1:], slopes[0]), sum(curves[1:], curves[0])
    pin = Turning(q + error, slope * qd, slope * qdd - curve * qd * qd)
    return Pins(pin, Turning(drives.ratio * q, drives.ratio * qd, drives.ratio * qdd), slope, error)


def transmission_error(model: Multibody, turning: Pins) -> Turning:
    """Return by how much the pins deviate from their wave generators: the transmission error and its rates."""
    exact = [part / model.drives.ratio for part in turning.pulley]
    return Turning(*(pin - wave for pin, wave in zip(turning.pin, exact, strict=True)))


def bushing_rotations(model: Multibody, y: Array) -> Phi:
    """Return the bushings' part of the coordinates as `(3, N, *batch)`."""
    return elastic(model.rigid, unflatten(y[: 3 * model.joints]))


def deviations(model: Multibody, y: Array) -> Joints:
    """Return how far each pin deviates from its command, `(N, *batch)`."""
    none = jnp.zeros_like(y[0])
    own = {joint: y[3 * model.joints + k] for k, joint in enumerate(model.belt_driven)}
    return jnp.stack([own.get(joint, none) for joint in range(model.joints)])


def end_point(
    model: Multibody, q: Joints, phi: Phi | None = None, turn: tuple[Joints, Joints] | None = None
) -> Float[Array, "3 *#batch"]:
    """Return the last named point in the base frame [m], from it inwards joint by joint.

    Args:
        model: the multibody model of the arm under its load.
        q: (N, *batch) [rad] angles of all pins.
        phi: (3, N, *batch) [rad] rotations of all bushings; none when None.
        turn: cosine and sine of q, where they are known.
    """
    cosine, sine = turn or (jnp.cos(q), jnp.sin(q))
    r = tuple(model.position[:, -1])
    for joint in range(model.carrier[-1], -1, -1):
        r = turned(r, model.axis[:, joint], cosine[joint], sine[joint])
        r = r if phi is None else rotated(r, phi[:, joint])
        r = tuple(x + start for x, start in zip(r, model.offset[:, joint], strict=True))
    return jnp.stack(jnp.broadcast_arrays(*r))


def of_joints(model: Multibody, driven: Float[AnyArray, "driven *#batch"], still: float = 0.0) -> Joints:
    """Return what driven joints have of all joints, `still` of the others."""
    none = jnp.full_like(driven[0], still)
    return jnp.stack([driven[model.driven.index(j)] if j in model.driven else none for j in range(model.joints)])


def _frames(model: Multibody, q: Joints, phi: Phi, J: Array) -> tuple[Array, Array, Array, Array]:
    """Return axes before each bushing, of each shaft, of each link `(3, 3, N, *batch)`, and the bushings' centres."""
    turn, pin = rotation_by(phi, J), turn_about(model.axis, q)
    turn, pin = jnp.broadcast_arrays(turn, pin)
    shaft, link = [turn[:, :, 0]], [matmul(turn[:, :, 0], pin[:, :, 0])]
    for j in range(1, model.joints):
        shaft.append(matmul(link[-1], turn[:, :, j]))
        link.append(matmul(shaft[-1], pin[:, :, j]))
    unit = jnp.broadcast_to(jnp.eye(3).reshape((3, 3) + (1,) * (turn.ndim - 3)), shaft[0].shape)
    before, after = jnp.stack([unit, *link[:-1]], 2), jnp.stack(link, 2)
    return before, jnp.stack(shaft, 2), after, total(inboard(model.joints), matvec(before, model.offset), 1)


class Kinematics(NamedTuple):
    """Where shafts and links are and how they move, in base axes.

    Attributes:
        shaft: (3, 3, N, *batch) axes of the shafts.
        link: (3, 3, N, *batch) axes of the links.
        project: (3, 3, N, *batch) map from a moment about a bushing to the bushing's coordinates, by virtual work.
        axis: (3, N, *batch) axes of the pins.
        centre: (3, N, *batch) [m] bushing centres.
        acceleration: (3, N, *batch) [m/s^2] of the centres, against free fall.
        w: (3, N, *batch) [rad/s] angular velocities of the shafts.
        alpha: (3, N, *batch) [rad/s^2] angular accelerations of the shafts.
        w_link: (3, N, *batch) [rad/s] angular velocities of the links.
        alpha_link: (3, N, *batch) [rad/s^2] angular accelerations of the links.
    """

    shaft: Array
    link: Array
    project: Array
    axis: Array
    centre: Array
    acceleration: Array
    w: Array
    alpha: Array
    w_link: Array
    alpha_link: Array


def kinematics(model: Multibody, pin: Turning, phi: Phi, v: Phi, a: Phi) -> Kinematics:
    """Return how the bodies move, from the base outwards; phi, v, a `(3, N, *batch)` move the bushings."""
    inward = inboard(model.joints)
    J = left_jacobian(phi)
    rate, change = left_jacobian_rate(phi, v)
    before, shaft, link, centre = _frames(model, pin.angle, phi, J)

    u, axis = matvec(before, rate), matvec(shaft, model.axis)
    turn = axis * pin.rate
    w_link = total(inward, u + turn, 1)
    w = w_link - turn
    bend = matvec(before, change + matvec(J, a)) + cross(w - u, u)
    twist = axis * pin.acceleration + cross(w, turn)
    alpha_link = total(inward, bend + twist, 1)

    reach = matvec(before, model.offset)[:, 1:]
    gravity = model.gravity.reshape((3,) + (1,) * (centre.ndim - 1))
    steps = matvec(acceleration_map(w_link, alpha_link)[:, :, :-1], reach)
    steps = jnp.concatenate([jnp.zeros((3, 1, *steps.shape[2:])), steps], 1)
    return Kinematics(
        shaft=shaft,
        link=link,
        project=matmul(transpose(J), transpose(before)),
        axis=axis,
        centre=centre,
        acceleration=total(inward, steps, 1) - gravity,
        w=w,
        alpha=alpha_link - twist,
        w_link=w_link,
        alpha_link=alpha_link,
    )


# -------- Multibody dynamics
# Exact equations of motion of an arm whose pins are driven, no angle taken as small; coordinates: see `kinematics`.


def residual(model: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return M(y) d2y/dt2 + h(y, dy/dt, t): zero where the equations of motion hold [N m].

    By Newton and Euler's equations of every body, from the base outwards and back. Differentiable.

    Args:
        model: the multibody model of the arm under its load.
        command: of the motors at this moment.
        y: (n, *batch) coordinates [rad]
        yd: (n, *batch) their rates [rad/s]
        ydd: (n, *batch) their accelerations [rad/s^2]

    References:
        Featherstone, "Rigid Body Dynamics Algorithms", 2008, section 5.3 (recursive Newton-Euler).
    """
    xi = Turning(*(deviations(model, part) for part in (y, yd, ydd)))
    return residual_of(model, pins(model, command, xi), y, yd, ydd)


def mass_and_forces(
    model: Multibody, command: Command, y: Array, yd: Array
) -> tuple[Float[Array, "n n"], Float[Array, "n"]]:
    """Return M and h of M(y) d2y/dt2 + h(y, dy/dt, t), in which the residual is affine in the accelerations.

    Args:
        model: gathered with `rank=1`.
        command: of the motors, (driven,) each.
        y: (n,) coordinates.
        yd: (n,) their rates.
    """
    wide = Command(*(part[:, None] for part in command))
    accelerations = jnp.concatenate([jnp.zeros((len(y), 1)), jnp.eye(len(y))], 1)
    R = residual(model, wide, y[:, None], yd[:, None], accelerations)
    return R[:, 1:] - R[:, :1], R[:, 0]


def residual_of(model: Multibody, turning: Pins, y: Array, yd: Array, ydd: Array) -> Float[Array, "n *#batch"]:
    """Return the residual where it is known how pins and pulleys turn; see `residual`."""
    at = kinematics(model, turning.pin, *(bushing_rotations(model, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(model, at, turning.pulley), imbalance(model, at, turning.pulley))
    moved = equations(model, at, turning.slope, forces)
    phi, v = bushing_rotations(model, y), bushing_rotations(model, yd)
    spring = spring_moments(model, phi) + matvec(model.damping, v)
    if model.rigid is not None:
        own = matvec(model.rigid, unflatten((y + ydd)[: 3 * model.joints]))
        moved = moved.at[: 3 * model.joints].add(flat(own))
    if not model.belt_driven:
        return moved + flat(spring)
    error = transmission_error(model, turning)
    position, rate = (phi, deviations(model, y), error.angle), (v, deviations(model, yd), error.rate)
    on_bushings, on_pins, on_errors = belt_forces(model, *(_alike(*parts) for parts in (position, rate)))
    on_pins = on_pins + (turning.slope - 1) * on_errors
    on_bushings = elastic(model.rigid, on_bushings)
    return moved + jnp.concatenate([flat(spring + on_bushings), on_pins[np.asarray(model.belt_driven)]])


def spring_moments(model: Multibody, phi: Phi) -> Phi:
    """Return the moments of the bushings' springs [N m], along the shafts' axes."""
    moment = matvec(model.stiffness, phi)
    return moment if model.curved is None else moment + model.curved.torque(phi)


def beyond_tangent(model: Multibody, rest: Phi, phi: Phi) -> tuple[Joints, Joints]:
    """Return by how much the springs' moments miss their tangents at rest, and those moments' change by them [N m].

    Each is the size of a vector of each bushing (N, *batch).
    """
    K = model.stiffness if model.curved is None else model.stiffness + sum(model.curved.tangents(rest))
    by_tangent = matvec(K, phi - rest)
    missed = spring_moments(model, phi) - spring_moments(model, rest) - by_tangent
    missed, by_tangent = (jnp.sqrt((x * x).sum(0)) for x in (missed, by_tangent))
    return missed, by_tangent


def drive_torques(model: Multibody, command: Command, y: Array, yd: Array, ydd: Array) -> Joints:
    """Return the torque [N m] of motors and belts at each pin that makes the arm follow its command.

    It is the torque at the wave generator times the ratio; zero where there is no pin.
    """
    turning = pins(model, command, Turning(*(deviations(model, part) for part in (y, yd, ydd))))
    at = kinematics(model, turning.pin, *(bushing_rotations(model, part) for part in (y, yd, ydd)))
    forces = _sum(_of_bodies(model, at, turning.pulley), imbalance(model, at, turning.pulley))
    torque = _on_pins(model, at, turning.slope, forces, _outboard_moment(model, at, forces))
    driven = np.isin(np.arange(model.joints), model.driven)
    return jnp.where(driven.reshape((-1,) + (1,) * (torque.ndim - 1)), torque, 0.0)


class Forces(NamedTuple):
    """What accelerating and holding up bodies asks for.

    Attributes:
        force: (3, N, *batch) [N]
        on_link: (3, N, *batch) [N m] moment about the bushing from everything beyond the pin.
        on_shaft: (3, N, *batch) [N m] moment about the bushing, for shaft and pulley.
        on_pulley: (N, *batch) [N m] torque of the pulley about the axis.
    """

    force: Array
    on_link: Array
    on_shaft: Array
    on_pulley: Array


def equations(model: Multibody, at: Kinematics, slope: Joints, forces: Forces) -> Float[Array, "n *#batch"]:
    """Return what forces on the bodies ask of bushings and of the pins that elastic belts drive [N m]."""
    moment = _outboard_moment(model, at, forces)
    on_bushings = flat(elastic(model.rigid, matvec(at.project, moment)))
    if not model.belt_driven:
        return on_bushings
    on_pins = _on_pins(model, at, slope, forces, moment)
    return jnp.concatenate([on_bushings, on_pins[np.asarray(model.belt_driven)]])


def _outboard_moment(model: Multibody, at: Kinematics, forces: Forces) -> Phi:
    """Return the moment about each bushing for all bodies beyond it."""
    outboard = inboard(model.joints).T
    moment = forces.on_link + forces.on_shaft + cross(at.centre, forces.force)
    return total(outboard, moment, 1) - cross(at.centre, total(outboard, forces.force, 1))


def _on_pins(model: Multibody, at: Kinematics, slope: Joints, forces: Forces, moment: Phi) -> Joints:
    pin = (at.axis * (moment - forces.on_shaft)).sum(0)
    return slope * pin + model.drives.ratio * forces.on_pulley


def _of_bodies(model: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of shafts, links, loads and balanced rotors."""
    f_shaft, n_shaft = _newton_euler(model.shaft, at.shaft, acceleration_map(at.w, at.alpha), at.acceleration)
    f_link, n_link = _newton_euler(model.link, at.link, acceleration_map(at.w_link, at.alpha_link), at.acceleration)
    f_points, n_points = _points(model, at.link)
    on_rotor = model.drives.rotor * (at.axis * pulley.acceleration + cross(at.w, at.axis * pulley.rate))
    on_pulley = model.drives.rotor * (pulley.acceleration + (at.axis * at.alpha).sum(0))
    return Forces(f_shaft + f_link + f_points, n_link + n_points, n_shaft + on_rotor, on_pulley)


def _newton_euler(moments: Moments, axes: Array, A: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return force and moment about the bushing (3, N, *batch) that accelerate the bodies.

    The point at r accelerates by acceleration + A r.
    """
    first = matvec(axes, moments.first)
    second = matmul(matmul(axes, moments.second), transpose(axes))
    force = moments.mass * acceleration + matvec(A, first)
    return force, cross(first, acceleration) + axial(matmul(second, transpose(A)))


def imbalance(model: Multibody, at: Kinematics, pulley: Turning) -> Forces:
    """Return the forces of the eccentric masses, in excess of the same masses centred on their axes.

    The eccentric mass at h axis + e u turns, the same mass at h axis is taken away from the shaft, whose mass has it.
    """
    drives = model.drives
    angle = pulley.angle + drives.phase
    u = matvec(at.shaft, drives.across[:, 0] * jnp.cos(angle) + drives.across[:, 1] * jnp.sin(angle))
    w = at.axis * pulley.rate
    A = acceleration_map(at.w + w, at.alpha + at.axis * pulley.acceleration + cross(at.w, w))
    first = drives.imbalance * u
    # the integral of r x (A r) with r r' = h (axis u' + u axis') + e u u'
    bob = matvec(A, drives.height * at.axis + drives.reach * u)
    moment = cross(first, at.acceleration + bob) + cross(drives.height * at.axis, matvec(A, first))
    return Forces(matvec(A, first), jnp.zeros_like(moment), moment, (at.axis * moment).sum(0))


def _points(model: Multibody, link: Array) -> tuple[Array, Array]:
    """Return the reaction (3, N, *batch) to the forces on the named points."""
    body = np.asarray(model.carrier, dtype=int)
    at = np.equal.outer(np.arange(model.joints), body)
    arm = matvec(link[:, :, body], model.position)
    force = jnp.broadcast_to(model.force, arm.shape)
    return -total(at, force, 1), -total(at, cross(arm, force), 1)


def _alike(phi: Phi, *joints: Joints) -> tuple[Phi, Joints, Joints]:
    """Give all the same batch."""
    batch = jnp.broadcast_shapes(phi.shape[2:], *(part.shape[1:] for part in joints))
    xi, error = (jnp.broadcast_to(part, (part.shape[0], *batch)) for part in joints)
    return jnp.broadcast_to(phi, (*phi.shape[:2], *batch)), xi, error


def _sum(one: Forces, other: Forces) -> Forces:
    return Forces(*(a + b for a, b in zip(one, other, strict=True)))
