"""A base that gives: an undriven bushing at the foot of an arm, about which the whole arm rocks and turns."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint
from ident.errors import InputError, Problem

BASE, PEDESTAL = "base", "pedestal"
"""Names of the bushing, and of the body on it, that `on_soft_base` adds."""
STIFFER = 10.0
"""Stiffness of that bushing as a multiple of joint 1's; assumed, as no published ratio of the two was found."""

FAR = 10.0
"""Height as a multiple of the arm's length above which it is taken for a slip, such as millimetres."""


def on_soft_base(arm: Arm, height: float) -> Arm:
    """Return the arm on a base that gives about a point below bushing 1, which stays where it is.

    The base is an undriven joint before the others, of `STIFFER` times joint 1's stiffness and its damping per
    stiffness. On it stands a solid cylinder, half as wide as high, of the mean mass of the arm's joints: with a base of
    no mass one direction would have no inertia. Of a stiff base this mass moves frequencies in second order only.

    Args:
        arm: it may stand on such a base already; then it is returned as it is.
        height: [m] of bushing 1 above the point about which the base gives, along the base frame's z axis.

    Raises:
        InputError: the arm's first joint is undriven already, one of its parts has a name that is needed, or the height
            is out of all proportion to the arm.
    """
    first = arm.joints[0]
    if not first.driven:
        if first.name == BASE and len(arm.joints) > 1 and abs(float(arm.joints[1].offset[2]) - height) < 1e-9:
            return arm
        remedy = "drop `soft_base`, or take that joint out of the arm file"
        got = f"{arm.name}, whose first joint {first.name} is undriven"
        raise InputError(Problem("soft_base", got, "an arm on a rigid base", remedy))
    longest = FAR * _length(arm)
    if height > longest > 0:
        expected = f"a height below bushing 1 of {longest:.2g} m at most, {FAR:g} times the arm's length"
        raise InputError(Problem("soft_base", f"{height:g} m", expected, "give it in metres"))
    up = jnp.array([0.0, 0.0, height])
    bodies = [body for joint in arm.joints for body in (*joint.shaft, *joint.link)]
    mass = float(sum(body.mass for body in bodies)) / len(arm.joints)
    square = (height / 4) ** 2
    inertia = mass * np.diag([square / 4 + height**2 / 12] * 2 + [square / 2])
    base = Joint(
        BASE,
        offset=first.offset - up,
        k_bend=STIFFER * first.k_bend,
        k_tors=STIFFER * first.k_tors,
        tau_bend=first.tau_bend,
        tau_tors=first.tau_tors,
        loss_bend=first.loss_bend,
        loss_tors=first.loss_tors,
        link=(Body(PEDESTAL, mass, up / 2, inertia),),
        driven=False,
    )
    raised = eqx.tree_at(lambda joint: joint.offset, first, up)
    return eqx.tree_at(lambda arm: arm.joints, _checked_names(arm), (base, raised, *arm.joints[1:]))


def _length(arm: Arm) -> float:
    """Return the length of the arm [m], from bushing to bushing and on to its farthest point."""
    ends = [np.linalg.norm(point.position) for point in arm.points]
    return float(sum(np.linalg.norm(joint.offset) for joint in arm.joints[1:]) + max(ends, default=0.0))


def _checked_names(arm: Arm) -> Arm:
    for part in arm.parts():
        if part.name in (BASE, PEDESTAL):
            raise InputError(Problem("soft_base", f"a part {part.name}", "that name for the base", "rename the part"))
    return arm
