"""The parts of an arm: rigid bodies, joints of pin and elastic bushing, named points, payloads.

All numbers are SI (m, kg, s, rad, N).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem


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
        self.mass, self.com, self.inertia = (
            jnp.asarray(mass, float),
            jnp.asarray(com, float),
            jnp.asarray(inertia, float),
        )

    def __check_init__(self) -> None:
        check_inertia(self.name, self.mass, self.inertia)


class Joint(eqx.Module):
    """A bushing (spherical, elastic), the shaft on it, and the pin about which the link turns.

    The bushing's moment is K phi with K = k_bend (1 - a a') + k_tors a a', a the axis, phi the rotation vector;
    its damping moment is C dphi/dt with the coefficients c = tau k. With loss factors eta it also loses, in harmonic
    motion at any frequency, 2 pi eta times its largest strain energy in a cycle: a moment i eta k phi (structural, or
    hysteretic, damping). That has no equation in time, see `ident.arm.losses`.

    Attributes:
        name: unique in its arm.
        axis: (3,) unit vector of the pin.
        offset: (3,) [m] bushing centre in the frame of the link before (the base frame for the first joint).
        k_bend: () [N m/rad] bushing stiffness across the axis.
        k_tors: () [N m/rad] bushing stiffness about the axis.
        tau_bend: () [s] damping per stiffness across the axis.
        tau_tors: () [s] damping per stiffness about the axis.
        loss_bend: () [-] loss factor across the axis; None, as most arms have it, for none.
        loss_tors: () [-] loss factor about the axis; None for none.
        shaft: bodies before the pin.
        link: bodies after the pin.
        driven: False for an extra bushing that has no pin (flexibility of a link, the base or the fingers).
        limits: (lower, upper) [rad] of the pin angle.
    """

    name: str = eqx.field(static=True)
    axis: Float[Array, "3"]
    offset: Float[Array, "3"]
    k_bend: Float[Array, ""]
    k_tors: Float[Array, ""]
    tau_bend: Float[Array, ""]
    tau_tors: Float[Array, ""]
    loss_bend: Float[Array, ""] | None
    loss_tors: Float[Array, ""] | None
    shaft: tuple[Body, ...]
    link: tuple[Body, ...]
    driven: bool = eqx.field(static=True)
    limits: tuple[float, float] = eqx.field(static=True)

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
    ):
        self.name, self.driven, self.limits = name, driven, limits
        self.axis, self.offset = jnp.asarray(axis, float), jnp.asarray(offset, float)
        self.k_bend, self.k_tors = jnp.asarray(k_bend, float), jnp.asarray(k_tors, float)
        self.tau_bend, self.tau_tors = jnp.asarray(tau_bend, float), jnp.asarray(tau_tors, float)
        self.loss_bend, self.loss_tors = (None if x is None else jnp.asarray(x, float) for x in (loss_bend, loss_tors))
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


def check_inertia(name: str, mass: Any, inertia: Any) -> None:
    """Refuse a mass or an inertia tensor that no body can have.

    A body's second moment tr(I)/2 - I of mass is positive semi-definite; this is the triangle inequality of its
    principal moments. Abstract values (under `jit` or `grad`) are not checked.

    Raises:
        InputError: the mass is negative or not finite, or the inertia is not symmetric or violates the inequality.

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
        raise InputError(Problem(name, f"mass {m}", "a mass >= 0 kg", "correct it", "mass"))
    size = max(np.abs(tensor).max(), 1e-300)
    if not np.isfinite(tensor).all() or np.abs(tensor - tensor.T).max() > 1e-9 * size:
        raise InputError(Problem(name, "an asymmetric inertia", "a symmetric tensor", "correct it", "inertia"))
    principal = np.linalg.eigvalsh(tensor)
    if principal[0] < -1e-9 * size or principal[2] > (principal[0] + principal[1]) * (1 + 1e-9) + 1e-12 * size:
        shown = ", ".join(f"{p:.4g}" for p in principal)
        raise InputError(
            Problem(
                name,
                f"principal moments {shown} kg m^2",
                "positive moments, none above the sum of the other two",
                "check units, signs and the reference point (the mass centre)",
                "inertia",
            )
        )
