"""What drives, belts and stroke of an arm must be like to go together."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ident.arm.drive import PROFILES, Belt, Drive, Servo, Stroke
from ident.arm.fields import EXPECTED, fields_of
from ident.errors import InputError, Problem
from ident.text import did_you_mean, quoted

if TYPE_CHECKING:
    from ident.arm.arm import Arm


AT_LIMIT = 1e-9
"""Angle [rad] by which a stroke may end beyond a joint limit: rounding."""
PARALLEL = 1e-6
"""Angle between axes [rad] up to which they count as parallel."""


def check_drives(arm: "Arm") -> None:
    """Refuse drives, belts and a stroke that no arm can have; abstract values (under `jit` or `grad`) are not checked.

    Raises:
        InputError: every problem, each with the name of its part.
    """
    strokes = (arm.stroke,) if arm.stroke else ()
    problems = [
        *(problem for drive in arm.drives for problem in _of_drive(arm, drive)),
        *(problem for belt in arm.belts for problem in _of_belt(arm, belt)),
        *(problem for servo in arm.servos for problem in _of_servo(arm, servo)),
        *(problem for stroke in strokes for problem in _of_stroke(arm, stroke)),
        *(problem for part in (*arm.drives, *arm.belts, *arm.servos, *strokes) for problem in sign_problems(part)),
    ]
    if problems:
        raise InputError(problems)


def _of_drive(arm: "Arm", drive: Drive) -> Iterator[Problem]:
    names = [joint.name for joint in arm.driven]
    if drive.joint not in names:
        remedy = did_you_mean(drive.joint, names, "name a joint that has a pin")
        yield Problem(drive.name, f"'{drive.joint}'", f"one of {', '.join(names)}", remedy, "joint")
        return
    if [d.joint for d in arm.drives].count(drive.joint) > 1:
        yield Problem(drive.name, f"a second drive of {drive.joint}", "one drive a joint", "remove one", "joint")
    mass = number_of(drive.eccentric_mass)
    shaft = [number_of(body.mass) for joint in arm.joints if joint.name == drive.joint for body in joint.shaft]
    if mass is not None and None not in shaft:
        heaviest = np.sum([m for m in shaft if m is not None], axis=0)
        if np.any(mass > heaviest):
            remedy = "the turning mass is part of the shaft's: correct one of them"
            expected = f"0 to {_first(heaviest):.4g} kg, the mass of the shaft"
            yield Problem(drive.name, f"{_first(mass):.4g} kg", expected, remedy, "eccentric_mass")


def _of_belt(arm: "Arm", belt: Belt) -> Iterator[Problem]:
    drives = [drive.joint for drive in arm.drives]
    for end, joint in (("driver", belt.driver), ("driven", belt.driven)):
        if joint not in drives:
            remedy = did_you_mean(joint, drives, "describe its drive, or leave the belt out")
            yield Problem(belt.name, f"'{joint}'", "a joint that has a drive", remedy, end)
            return
    every = [joint.name for joint in arm.joints]
    if every.index(belt.driven) != every.index(belt.driver) + 1:
        got = f"a belt from {belt.driver} to {belt.driven}"
        remedy = "a belt runs along one link, without a bushing between"
        yield Problem(belt.name, got, "neighbours, the driver first", remedy, "driven")
    else:
        yield from _of_geometry(arm, belt)
    if [b.driven for b in arm.belts].count(belt.driven) > 1:
        yield Problem(belt.name, f"a second belt that drives {belt.driven}", "one", "remove one of them", "driven")


def _of_geometry(arm: "Arm", belt: Belt) -> Iterator[Problem]:
    """Yield what keeps the pulleys from lying side by side in one plane."""
    one, other = (joint for joint in arm.joints if joint.name in (belt.driver, belt.driven))
    numbers = one.axis, other.axis, other.offset, belt.driver_radius, belt.driven_radius
    known = [value for number in numbers if (value := number_of(number)) is not None]
    if len(known) < len(numbers) or any(value.ndim > 1 for value in known[:3]):
        return
    axis, parallel, offset, *radii = known
    if np.abs(np.cross(axis, parallel)).max() > PARALLEL:
        yield Problem(belt.name, "axes that are not parallel", "pulleys in one plane", "leave the belt out", "driven")
        return
    distance, room = np.linalg.norm(np.cross(axis, offset)), sum(np.max(radius) for radius in radii)
    if distance <= room:
        got, expected = f"axes {distance:.4g} m apart", f"more than {room:.4g} m, the sum of the radii"
        yield Problem(belt.name, got, expected, "correct radii or offset", "driven_radius")


def _of_servo(arm: "Arm", servo: Servo) -> Iterator[Problem]:
    drives = [drive.joint for drive in arm.drives]
    if servo.joint not in drives:
        remedy = did_you_mean(servo.joint, drives, "describe the drive that its motor turns")
        yield Problem(servo.name, f"'{servo.joint}'", "a joint that has a drive", remedy, "joint")
        return
    tied = tied_by_belts(arm, servo.joint)
    before = [other.name for other in arm.servos[: arm.servos.index(servo)] if other.joint in tied]
    if before:
        got = f"a second servo of what {before[0]} holds"
        yield Problem(servo.name, got, "one servo for joints that belts tie", "remove one of them", "joint")


def tied_by_belts(arm: "Arm", joint: str) -> list[str]:
    """Return the joints whose pulleys turn together with that of a joint, itself included, from the base outwards."""
    tied = {joint}
    for _ in arm.belts:
        ends = [{belt.driver, belt.driven} for belt in arm.belts]
        tied = tied.union(*(each for each in ends if each & tied))
    return [each.name for each in arm.joints if each.name in tied]


def _of_stroke(arm: "Arm", stroke: Stroke) -> Iterator[Problem]:
    if stroke.direction.shape[0] != len(arm.driven):
        got = f"{stroke.direction.shape[0]} shares"
        yield Problem("stroke", got, f"{len(arm.driven)}, one a joint", "correct it", "direction")
    if stroke.profile not in PROFILES:
        remedy = did_you_mean(stroke.profile, PROFILES, "choose one of them")
        yield Problem("stroke", quoted(stroke.profile), f"one of {', '.join(PROFILES)}", remedy, "profile")
    folded, unfolded = number_of(stroke.folded), number_of(stroke.unfolded)
    if folded is not None and unfolded is not None and np.any(folded == unfolded):
        remedy = "give two different angles"
        yield Problem("stroke", f"folded and unfolded at {_first(folded):g} rad", "a motion", remedy, "folded")
    for end in ("folded", "unfolded"):
        yield from _beyond_limits(arm, stroke, end)


def _beyond_limits(arm: "Arm", stroke: Stroke, end: str) -> Iterator[Problem]:
    """Yield the joints that an end of the stroke takes beyond their limits."""
    shares, alpha = number_of(stroke.direction), number_of(getattr(stroke, end))
    if shares is None or alpha is None or len(shares) != len(arm.driven):
        return
    for joint, share in zip(arm.driven, shares, strict=True):
        angles, (low, high) = share * alpha, joint.limits
        worst = np.ravel(angles)[np.argmax(np.maximum(low - angles, angles - high))]
        if not low - AT_LIMIT <= worst <= high + AT_LIMIT:
            got = f"{joint.name} at {math.degrees(worst):.6g} deg"
            expected = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits"
            yield Problem("stroke", got, expected, "shorten the stroke, or correct the limits", end)


def sign_problems(part: Any) -> Iterator[Problem]:
    """Yield the numbers of a part of an arm that are not finite, or of a sign that they can't have."""
    for field in fields_of(type(part).__name__):
        value = number_of(getattr(part, field.name))
        if value is not None and field.rank == 2:
            value = np.diagonal(value)
        if value is not None and not (allowed := field.allows(value)).all():
            got = f"{_first(value[~allowed]):g} {field.unit}".removesuffix(" -")
            yield Problem(part.name, got, EXPECTED[field.sign], "correct it", field.name)


def number_of(value: Any) -> np.ndarray | None:
    """Return a number of an arm; None for an abstract one (under `jit` or `grad`)."""
    return None if isinstance(value, jax.core.Tracer) or not hasattr(value, "shape") else np.asarray(value)


def _first(value: Any) -> float:
    return float(np.ravel(value)[0])
