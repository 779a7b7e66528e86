"""Belts of an arm: whether they can run along the stroke, and which joints they tie together.

Pulleys at both ends of a belt must pass the same length of it all along the stroke.

Seen from the link along which a belt runs, the driver's pulley turns by theta1 - q1 = (N1 - 1) q1, since its shaft
turns by -q1, and the driven one, whose shaft is fixed to the link, by theta2 = N2 q2. With q = alpha direction the
belt stays as it is where

    r1 (N1 - 1) direction1 = r2 N2 direction2

Otherwise one span grows by the difference of both sides times alpha, and the other is slack as soon as that exceeds
pretension / stiffness.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.arm.parts import Belt


@dataclass(frozen=True)
class BeltMismatch:
    """A belt that cannot run along the stroke.

    Attributes:
        belt: name of the belt.
        stretch: () [m] elongation of one span over the stroke, and shortening of the other.
        allowed: () [m] stretch at which the other span is slack: pretension / stiffness.
        drive: name of the driven joint's drive.
        ratio: () [-] of that drive that would keep the stretch at zero.
        radius: () [m] of the driven pulley that would; not positive where no radius does.
    """

    belt: str
    stretch: float
    allowed: float
    drive: str
    ratio: float
    radius: float

    def __str__(self) -> str:
        radius = f", or {self.belt}.driven_radius = {1e3 * self.radius:.6g} mm" if self.radius > 0 else ""
        return (
            f"{self.belt} would stretch by {1e3 * self.stretch:.4g} mm over the stroke, {1e3 * self.allowed:.4g} mm "
            f"slackens it; it runs with {self.drive}.ratio = {self.ratio:.6g}{radius}"
        )


def belt_mismatches(arm: Arm) -> tuple[BeltMismatch, ...]:
    """Return the belts that become slack somewhere along the stroke; none without a stroke.

    Args:
        arm: one arm, with concrete numbers.
    """
    if arm.stroke is None:
        return ()
    names = [joint.name for joint in arm.driven]
    shares = dict(zip(names, np.asarray(arm.stroke.direction).tolist(), strict=True))
    drives = {drive.joint: drive for drive in arm.drives}
    way = abs(float(arm.stroke.folded) - float(arm.stroke.unfolded))
    pairs = ((belt, drives[belt.driver], drives[belt.driven]) for belt in arm.belts)
    found = []
    for belt, one, other in pairs:
        share = shares[belt.driven]
        passed = float(belt.driver_radius) * (float(one.ratio) - 1) * shares[belt.driver]
        stretch = abs(passed - float(belt.driven_radius) * float(other.ratio) * share) * way
        stiffness = float(belt.stiffness)
        allowed = float(belt.pretension) / stiffness if stiffness else float("inf")
        ratio, radius = (
            passed / (float(x) * share) if float(x) * share else float("nan") for x in (belt.driven_radius, other.ratio)
        )
        if stretch > allowed:
            found.append(BeltMismatch(belt.name, stretch, allowed, other.name, ratio, radius))
    return tuple(found)


def pin_shares(arm: Arm, joint: str) -> dict[str, Any]:
    """Return the turn of each joint's pin per turn of one joint's pin (1), for the joints tied to it by belts, by name.

    By the same condition; differentiable in the arm's numbers.
    """
    drives, shares = {drive.joint: drive for drive in arm.drives}, dict[str, Any]({joint: 1.0})
    order = [each.name for each in arm.joints]
    outwards = sorted(arm.belts, key=lambda belt: order.index(belt.driver))

    def passed_on(belt: Belt) -> Any:
        """Return direction2 / direction1."""
        one, other = drives[belt.driver].ratio, drives[belt.driven].ratio
        return belt.driver_radius * (one - 1) / (belt.driven_radius * other)

    for belt in outwards:
        if belt.driver in shares:
            shares[belt.driven] = shares[belt.driver] * passed_on(belt)
    for belt in reversed(outwards):
        if belt.driven in shares and belt.driver not in shares:
            shares[belt.driver] = shares[belt.driven] / passed_on(belt)
    return shares
