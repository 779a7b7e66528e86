"""What the numbers of an arm must be like once others were put in their place: a changed arm is still an arm."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from ident.arm.arm import Arm
from ident.arm.drive_check import check_drives, sign_problems
from ident.arm.parts import Joint, check_inertia
from ident.arm.spring_check import check_springs
from ident.errors import InputError, Problem

MOST_JOINTS = 24
"""Joints of an arm that is read or studied; what more of them cost is in docs/own-arm.md."""


def check_size(joints: int, where: str) -> None:
    """Refuse an arm of more joints than are worth waiting for, before anything is compiled for it.

    Raises:
        InputError: it is one, with where it comes from.
    """
    if joints > MOST_JOINTS:
        remedy = "leave out joints that hardly give: time and memory grow with the square of their number"
        raise InputError(Problem(where, f"{joints} joints", f"at most {MOST_JOINTS}", remedy))


def check_arm(arm: Arm) -> None:
    """Refuse numbers that no arm can have, as `Arm.replace` may have put in: signs, inertia, drives, a massless end.

    Raises:
        InputError: every problem, each with the name of its part.
    """
    problems = tuple(_problems(arm))
    if problems:
        raise InputError(problems)


def massless_joints(joints: Sequence[Joint]) -> Iterator[tuple[int, str, str]]:
    """Yield the joints whose equation would be singular, the last one first: its place, why, and what it lacks.

    Turning a bushing moves the joint's own bodies and the bushing after it, for what that one carries may stay as it
    is, by turning back; turning the last one moves its own bodies alone.
    """
    for place in reversed(range(len(joints))):
        last, inertia, mass = place == len(joints) - 1, np.zeros((3, 3)), 0.0
        for body in (*joints[place].shaft, *joints[place].link):
            inertia += np.asarray(body.inertia) + _of_mass(float(body.mass), np.asarray(body.com))
            mass += float(body.mass)
        if not last:
            inertia += _of_mass(mass or 1.0, np.asarray(joints[place + 1].offset))
        moments = np.linalg.eigvalsh(inertia)
        if mass and moments[0] > 1e-12 * moments[2]:
            continue
        if mass:
            yield place, "a rotation that moves no mass", "inertia about every axis"
        elif last:
            yield place, "no mass beyond the bushing", "mass beyond every bushing"
        else:
            yield place, "no mass on the bushing", "inertia on every bushing"


def _of_mass(mass: float, at: np.ndarray) -> np.ndarray:
    """Return the inertia of a point mass about the origin (3, 3) [kg m^2]."""
    return mass * (at @ at * np.eye(3) - np.outer(at, at))


def _problems(arm: Arm) -> Iterator[Problem]:
    bodies = [body for joint in arm.joints for body in (*joint.shaft, *joint.link)]
    bodies += [payload.body for payload in arm.payloads]
    signs = [problem for part in (*arm.joints, *bodies, *arm.points) for problem in sign_problems(part)]
    yield from signs
    if signs:
        return
    for body in bodies:
        yield from _raised(partial(check_inertia, body.name, body.mass, body.inertia))
    yield from _raised(partial(check_drives, arm))
    yield from _raised(partial(check_springs, arm))
    for place, got, expected in massless_joints(arm.joints):
        remedy = "give its shaft or link a positive mass, with inertia"
        yield Problem(arm.joints[place].name, got, expected, remedy)


def _raised(check: Callable[[], None]) -> tuple[Problem, ...]:
    try:
        check()
    except InputError as error:
        return error.problems
    return ()
