"""Sizes of an arm in its zero posture, where all frames are parallel: links, reach, and the load of each bushing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.parts import Body


@dataclass(frozen=True)
class Link:
    """The bodies of a joint's link or shaft, and its end.

    Attributes:
        bodies: on the link, or on the shaft; payloads among those of the link.
        end: (3,) [m] the next bushing, or the farthest point, from the joint's own; zero for a shaft.
    """

    bodies: tuple[Body, ...]
    end: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class Carried:
    """The bodies beyond a bushing, in the zero posture and without payloads.

    Attributes:
        mass: [kg]
        distance: [m] of its mass centre from the bushing.
        inertia: [kg m^2] its largest principal moment about the bushing.
    """

    mass: float
    distance: float
    inertia: float


def link_end(arm: Arm, place: int) -> Float[np.ndarray, "3"]:
    """Return the end of a joint's link (3,) [m]: the next bushing, or its farthest point or mass centre."""
    if place + 1 < len(arm.joints):
        return np.asarray(arm.joints[place + 1].offset, float)
    joint = arm.joints[place]
    places = [np.asarray(point.position, float) for point in arm.points if point.joint == joint.name]
    places = places or [np.asarray(body.com, float) for body in joint.link] or [np.zeros(3)]
    return max(places, key=lambda each: float(np.linalg.norm(each)))


def links(arm: Arm) -> tuple[Link, ...]:
    """Return shaft and link of every joint, from the base outwards."""
    found = []
    for place, joint in enumerate(arm.joints):
        bodies = (*joint.link, *(payload.body for payload in arm.payloads if payload.joint == joint.name))
        found += [Link(joint.shaft, np.zeros(3)), Link(bodies, link_end(arm, place))]
    return tuple(found)


def reach_of(arm: Arm) -> float:
    """Return the length of the stretched arm [m]: from bushing to bushing, and to the end of the last link."""
    return float(sum(np.linalg.norm(link_end(arm, place)) for place in range(len(arm.joints))))


def carried(arm: Arm) -> tuple[Carried, ...]:
    """Return the mass and inertia beyond each bushing."""
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    found = []
    for joint in reversed(arm.joints):
        for body in (*joint.shaft, *joint.link):
            m, r, inertia = float(body.mass), np.asarray(body.com, float), np.asarray(body.inertia, float)
            mass, first = mass + m, first + m * r
            second = second + m * np.outer(r, r) + np.trace(inertia) / 2 * np.eye(3) - inertia
        moments = np.linalg.eigvalsh(np.trace(second) * np.eye(3) - second)
        found.append(Carried(mass, float(np.linalg.norm(first)) / mass if mass else 0.0, float(moments[-1])))
        d = np.asarray(joint.offset, float)
        second = second + np.outer(first, d) + np.outer(d, first) + mass * np.outer(d, d)
        first = first + mass * d
    return tuple(reversed(found))


def to_segment(place: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]) -> float:
    """Return the distance [m] of a place from the segment between the origin and an end."""
    square = float(end @ end)
    share = np.clip(float(place @ end) / square, 0.0, 1.0) if square else 0.0
    return float(np.linalg.norm(place - share * end))


def to_box(end: Float[np.ndarray, "3"], box: Float[np.ndarray, "2 3"]) -> float:
    """Return the distance [m] of a box from the segment between the origin and an end, to a hundredth of its length."""
    places = np.linspace(0.0, 1.0, 101)[:, None] * end
    return float(np.linalg.norm(places - np.clip(places, box[0], box[1]), axis=1).min())
