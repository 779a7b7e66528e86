"""An arm with additional hinges where it might be elastic: under its foot and in the middle of its links."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint, Payload, Point

UP = np.array([0.0, 0.0, 1.0])


class Hinge(NamedTuple):
    """An additional hinge of the arm.

    Attributes:
        place: index among the joints of the cut arm.
        beside: index of the joint whose link it cuts; of joint 1 for the base.
        link: whether it cuts a link.
    """

    place: int
    beside: int
    link: bool


class CutArm(eqx.Module):
    """An arm with undriven bushings of stiffness 1 N m/rad at its hinges; with these at rest it is the original arm.

    Attributes:
        arm: the same bodies, points and payloads; without drives, belts and stroke.
        own: indices of the original joints.
        hinges: the additional ones.
        height: [m] of bushing 1 above the hinge of the base.
    """

    arm: Arm
    own: tuple[int, ...] = eqx.field(static=True)
    hinges: tuple[Hinge, ...] = eqx.field(static=True)
    height: float = eqx.field(static=True)

    def pieces(self, place: int) -> tuple[int, ...]:
        """Return the indices of the joints that carry a link: its own joint, and the hinge in its middle."""
        return (place, *(hinge.place for hinge in self.hinges if hinge.link and hinge.beside == place))

    def link_end(self, place: int) -> Float[Array, "3"]:
        """Return the end of a link relative to its joint's bushing [m]."""
        _, *hinges = self.pieces(place)
        return 2 * self.arm.joints[hinges[0]].offset if hinges else end_of(self.arm, place)


def cut(arm: Arm) -> CutArm:
    """Cut an arm under its foot and in the middle of each link, unless it already has a bushing without a pin there.

    A link's middle is half way to the next bushing, or to the arm's last point. Bodies whose centre is farther out lie
    beyond the hinge, whose axis is along the link. The base's hinge is below bushing 1 by half the longest distance
    between neighbouring bushings, with its axis along the base frame's z.
    """
    ends = [np.asarray(end_of(arm, n)) for n in range(len(arm.joints))]
    height = float(max(np.linalg.norm(end) for end in ends[:-1] or ends)) / 2
    joints, hinges, own = list[Joint](), list[Hinge](), list[int]()
    at, cuts = np.zeros(3), dict[str, np.ndarray]()
    if arm.base is None:
        at = np.asarray(arm.joints[0].offset) - height * UP
        joints.append(_hinge("/foot", at, UP))
        hinges.append(Hinge(0, 1, link=False))
    after = [*(joint.driven for joint in arm.joints[1:]), True]
    for joint, further, end in zip(arm.joints, after, ends, strict=True):
        # cut links of nonzero length, between bushings with pins, or at the arm's end
        rigid = joint.driven and further and bool(np.linalg.norm(end) > 1e-6)
        own.append(len(joints))
        beyond = [rigid and bool(_beyond(body.com, end)) for body in joint.link]
        inner = tuple(body for body, far in zip(joint.link, beyond, strict=True) if not far)
        joints.append(eqx.tree_at(lambda j: (j.offset, j.link), joint, (jnp.asarray(joint.offset - at), inner)))
        at = np.zeros(3)
        if rigid:
            at, cuts[joint.name] = end / 2, end
            outer = tuple(_shifted(body, at) for body, far in zip(joint.link, beyond, strict=True) if far)
            hinges.append(Hinge(len(joints), own[-1], link=True))
            joints.append(_hinge(_middle(joint.name), at, end / np.linalg.norm(end), outer))

    def half_way(joint: str, place: Any) -> np.ndarray | None:
        """Return the hinge in the middle of a joint's link if a place on the link lies beyond it."""
        end = cuts.get(joint)
        return None if end is None or not _beyond(place, end) else end / 2

    points, payloads = list(arm.points), list(arm.payloads)
    for k, point in enumerate(points):
        if (half := half_way(point.joint, point.position)) is not None:
            points[k] = Point(point.name, _middle(point.joint), np.asarray(point.position) - half)
    for k, payload in enumerate(payloads):
        if (half := half_way(payload.joint, payload.body.com)) is not None:
            payloads[k] = Payload(_middle(payload.joint), _shifted(payload.body, half))
    whole = Arm(arm.name, tuple(joints), tuple(points), tuple(payloads), arm.gravity, springs=arm.springs)
    return CutArm(whole, tuple(own), tuple(hinges), height)


def _middle(name: str) -> str:
    return f"{name}/middle"


def end_of(arm: Arm, place: int) -> Float[Array, "3"]:
    """Return the end of a link relative to its bushing [m]: the last point, or a body's centre, or zero."""
    if place + 1 < len(arm.joints):
        return arm.joints[place + 1].offset
    ends = [point.position for point in arm.points if point.joint == arm.joints[place].name]
    bodies = (*arm.joints[place].link, *arm.joints[place].shaft)
    return jnp.asarray([*ends[::-1], *(body.com for body in bodies), np.zeros(3)][0])


def _beyond(place: Any, end: Float[np.ndarray, "3"]) -> Any:
    return np.asarray(place) @ end > end @ end / 2


def _hinge(name: str, offset: Any, axis: Any, link: tuple[Body, ...] = ()) -> Joint:
    return Joint(name, axis=axis, offset=offset, k_bend=1.0, k_tors=1.0, link=link, driven=False)


def _shifted(body: Body, by: Float[np.ndarray, "3"]) -> Body:
    return eqx.tree_at(lambda b: b.com, body, jnp.asarray(body.com - by))
