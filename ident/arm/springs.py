"""Springs that are no straight line: what a bushing's torque adds to stiffness times angle.

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

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.arm.fields import names_of
from ident.arm.rotations import identity, outer

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
        for field in names_of("Spring"):
            setattr(self, field, jnp.asarray(numbers[field], float))


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

    def energy(self, s: Angle) -> Angle:
        """Return the energy that is added [N m]."""
        _, _, _, energy = self._ramps(s)
        return (self.rise * energy).sum(0) + self.cubic * s * s / 4

    def secant(self, s: Angle) -> Angle:
        """Return the torque that is added, per angle [N m/rad]."""
        x, _, ramp, _ = self._ramps(s)
        return (self.rise * ramp / x).sum(0) + self.cubic * s

    def steepening(self, s: Angle) -> Angle:
        """Return by how much the tangent is above the secant, per square of the angle [N m/rad^3]."""
        x, step, ramp, _ = self._ramps(s)
        return (self.rise * (step - ramp / x) / x**2).sum(0) + 2 * self.cubic

    def _ramps(self, s: Angle) -> tuple[Array, Array, Array, Array]:
        """Return the angle, slope and height of both ramps there, and the area below them.

        Far below a ramp the angle stands still: nothing depends on it there, and it may be zero.
        """
        x = jnp.sqrt(jnp.maximum(s, (self.angle / 2) ** 2))
        half = WIDTH * self.angle
        u = x / half - 1 / WIDTH
        beyond, u = jnp.maximum(u - 1, 0.0), jnp.clip(u, -1.0, 1.0)
        step = (2 + 3 * u - u**3) / 4
        ramp = (3 + 8 * u + 6 * u**2 - u**4) / 16
        area = (4 + 15 * u + 20 * u**2 + 10 * u**3 - u**5) / 80
        return x, step, half * (ramp + beyond), half**2 * (area + beyond + beyond**2 / 2)


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

    def energy(self, phi: Vectors) -> Angle:
        """Return the energy of each bushing beyond that of its stiffness [N m]."""
        across, along = self._parts(phi)
        energy = jnp.zeros_like(along)
        if self.bend is not None:
            energy = energy + self.bend.energy((across * across).sum(0))
        return energy if self.tors is None else energy + self.tors.energy(along * along)

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

    def sizes(self, moment: Vectors) -> tuple[Angle, Angle]:
        """Return the sizes of the bushings' moments in bending and in torsion, in the unit of the moments."""
        across, along = self._parts(moment)
        return jnp.sqrt((across * across).sum(0)), jnp.abs(along)

    def _parts(self, phi: Vectors) -> tuple[Vectors, Angle]:
        along = (self.axis * phi).sum(0)
        return phi - self.axis * along, along


def bends(spring: Spring, k: Any) -> tuple[Any, Any]:
    """Return the angles at which a spring's line bends [rad], K1 [N m/rad] given; T2 below T1 counts as T1."""
    first = spring.torque1 / k
    return first, first + jnp.maximum(spring.torque2 - spring.torque1, 0.0) / (k * spring.ratio2)
