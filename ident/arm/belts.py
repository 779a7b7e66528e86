"""Elastic belts between pulleys: stretch, tension, and what they do to bushings and pins.

    upper span  T_u = max(0, T0 + k (e_u + tau de_u/dt)),   lower span likewise
    e_u = L(D) - L(D0) + s,   e_l = L(D) - L(D0) - s,   s = r1 (theta1 - gamma) - r2 (theta2 - gamma)

D is the distance of the pulleys' centres across the axis and gamma the turn of the line between them; both change as
the driven shaft tilts under the belt. L(D) = sqrt(D^2 - d^2) + d asin(d/D), d = r1 - r2, is the length of a span with
its share of the arcs, so that dL/dD = cos(beta), sin(beta) = d/D. By virtual work, torque T_u - T_l times radius on
each pulley, (T_u + T_l) cos(beta) along the line of centres and (T_u - T_l) sin(beta) across it follow. Angles are
counted from the command, on which the belts run without stretch, and forces from the assembled arm: the bushings were
aligned under pretension.

Rigid belts (xi = 0) are not the limit of stiff ones. Those force s to zero, with gamma = 0 and without kinematic error

    r2 (N2 xi2 + phi2) = r1 (N1 - 1) xi1

phi along the axis: the pulley is held in space, not on its shaft. Behind a driver at rest xi = -phi / N, the link turns
by phi (1 - 1/N), and a frequency of torsion is higher by about 1/N. Stiff belts also hold their driven shafts from
tilting, by 2 k height^2. With a stretch a torque at the link sees the compliance

    (1 - 1/N)^2 / k_tors + 1 / (2 k (N r2)^2)

References:
    Ours, after the paper's Figure 3; its printed equations are lost.
"""

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.rotations import matvec, rotation

if TYPE_CHECKING:
    from ident.arm.multibody import Multibody

Spans = Float[Array, "2 B *#batch"]


def stretch(model: "Multibody", phi: Array, xi: Array, error: Array) -> Spans:
    """Return by how much upper and lower span of each belt are longer than unloaded [m].

    Args:
        model: the multibody model.
        phi: (3, N, *batch) [rad] rotation vectors of the bushings.
        xi: (N, *batch) [rad] deviation of each pin from its command.
        error: (N, *batch) [rad] kinematic error of each drive.
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
    """Return the moments [N m] on bushings, wave generators and kinematic errors that the belts ask for.

    Args:
        model: the multibody model.
        position: phi (3, N, *batch), xi and error (N, *batch) [rad], as in `stretch`.
        rate: their rates [rad/s].
    """

    def length(phi: Array, xi: Array, error: Array) -> Array:
        return stretch(model, phi, xi, error)

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
