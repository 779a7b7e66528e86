"""The multibody model of an arm: moments of mass, bushings, drives and belts, as the equations of motion need them."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.assembly import (
    Loads,
    Moments,
    axes,
    bushings,
    carriers,
    curved_springs,
    moments,
    no_loads,
    offsets,
    positions,
    stack,
)
from ident.arm.fields import names_of
from ident.arm.losses import refuse_losses
from ident.arm.rotations import skew
from ident.arm.springs import CurvedSprings
from ident.errors import InputError, Problem


class Drives(eqx.Module):
    """Harmonic drives of all joints; a joint without one has ratio 1 and nothing that turns. See `ident.arm.drive`.

    Attributes:
        ratio: (N, *batch) [-]
        rotor: (N, *batch) [kg m^2] inertia of pulley and wave generator, a part of the shaft's.
        imbalance: (N, *batch) [kg m] turning mass times its distance from the axis.
        reach: (N, *batch) [m] that distance.
        height: (N, *batch) [m] of the turning mass above the bushing.
        phase: (N, *batch) [rad]
        error: (N, *batch) [rad] amplitude of the kinematic error.
        error_phase: (N, *batch) [rad]
        across: (3, 2, N, *batch) unit vectors across the axis, from the first of which the phase counts.
    """

    ratio: Float[Array, "N *#batch"]
    rotor: Float[Array, "N *#batch"]
    imbalance: Float[Array, "N *#batch"]
    reach: Float[Array, "N *#batch"]
    height: Float[Array, "N *#batch"]
    phase: Float[Array, "N *#batch"]
    error: Float[Array, "N *#batch"]
    error_phase: Float[Array, "N *#batch"]
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
        damping: (3, 3, N, *batch) [N m s/rad]
        position: (3, P, *batch) [m] named points along the axes of their link.
        force: (3, P, *batch) [N] on them, in base axes.
        gravity: (3,) [m/s^2]
        drives: what turns on the shafts.
        belts: what ties the pulleys.
        curved: where springs are no straight lines, along the shaft's axes; None where all are.
        carrier: joint that carries each named point.
        driven: joints that have a pin.
        elastic: whether the belts stretch, so that the pins that they drive deviate from the command.
        transmission_error: whether some drive may have a kinematic error; if not, none is computed, whatever `drives`.
    """

    axis: Float[Array, "3 N *#batch"]
    offset: Float[Array, "3 N *#batch"]
    shaft: Moments
    link: Moments
    stiffness: Float[Array, "3 3 N *#batch"]
    damping: Float[Array, "3 3 N *#batch"]
    position: Float[Array, "3 P *#batch"]
    force: Float[Array, "3 P *#batch"]
    gravity: Float[Array, "3"]
    drives: Drives
    belts: Belts
    curved: CurvedSprings | None
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


def has_transmission_error(arm: Arm) -> bool:
    """Tell whether some drive may have a kinematic error."""
    return any(may_differ_from_zero(drive.error) for drive in arm.drives)


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
        transmission_error: whether some drive may have a kinematic error; by the arm's numbers when None.

    Raises:
        ModelError: the arm has more batch axes than `rank`.
        InputError: the arm has loss factors, see `refuse_losses`; a load with a moment.
    """
    refuse_losses(arm)
    loads = (no_loads(arm) if loads is None else loads).lifted(rank)
    if loads.moment is not None:
        remedy = "take two forces at two points of the body"
        raise InputError(Problem(arm.name, "a moment", "payloads, masses and forces in motion", remedy, "load"))
    axis, (shaft, link) = axes(arm, rank), moments(arm, loads, rank)
    bend, tors, damping = bushings(arm, axis)
    return Multibody(
        axis=axis,
        offset=offsets(arm, rank),
        shaft=shaft,
        link=link,
        stiffness=bend + tors,
        damping=damping,
        position=positions(arm, rank),
        force=loads.force,
        gravity=arm.gravity,
        drives=_drives(arm, axis, rank),
        belts=_belts(arm, rank),
        curved=curved_springs(arm, axis),
        carrier=carriers(arm),
        driven=tuple(n for n, joint in enumerate(arm.joints) if joint.driven),
        elastic=elastic_belts and bool(arm.belts),
        transmission_error=has_transmission_error(arm) if transmission_error is None else transmission_error,
    )


def balanced(multibody: Multibody) -> Multibody:
    """Return the model with all turning masses on their axes and without kinematic error: nothing excites it."""
    drives = replace(multibody.drives, imbalance=jnp.zeros_like(multibody.drives.imbalance))
    return replace(multibody, drives=drives, transmission_error=False)


def _drives(arm: Arm, axis: Array, rank: int) -> Drives:
    by_joint = {drive.joint: drive for drive in arm.drives}
    absent = dict.fromkeys(names_of("Drive"), 0.0) | {"ratio": 1.0}
    columns = {
        field: stack(
            [getattr(by_joint[j.name], field) if j.name in by_joint else absent[field] for j in arm.joints], 0, rank
        )
        for field in names_of("Drive")
    }
    return Drives(
        ratio=columns["ratio"],
        rotor=columns["rotor_inertia"],
        imbalance=columns["eccentric_mass"] * columns["eccentricity"],
        reach=columns["eccentricity"],
        height=columns["height"],
        phase=columns["phase"],
        error=columns["error"],
        error_phase=columns["error_phase"],
        across=_across(axis),
    )


def may_differ_from_zero(number: Array) -> bool:
    """Tell whether a number may be other than zero; under `jit` or `grad` any may."""
    return isinstance(number, jax.core.Tracer) or bool(np.any(np.asarray(number) != 0))


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
        return (
            stack([getattr(belt, field) for belt in arm.belts], 0, rank) if arm.belts else jnp.zeros((0,) + (1,) * rank)
        )

    return Belts(
        radius=jnp.stack([column("driver_radius"), column("driven_radius")]),
        pretension=column("pretension"),
        stiffness=column("stiffness"),
        tau=column("tau"),
        height=column("height"),
        ends=tuple((names.index(belt.driver), names.index(belt.driven)) for belt in arm.belts),
    )
