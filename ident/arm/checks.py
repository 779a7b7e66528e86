"""What the numbers of an arm must be like once others were put in their place: a changed arm is still an arm."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ident.arm.arm import Arm
from ident.arm.drive_check import check_drives, sign_problems
from ident.arm.parts import Joint, check_inertia
from ident.errors import InputError, Problem


def check_arm(arm: Arm) -> None:
    """Refuse numbers that no arm can have, as `Arm.replace` may have put in: signs, inertia, drives, a massless end.

    Raises:
        InputError: every problem, each with the name of its part.
    """
    problems = tuple(_problems(arm))
    if problems:
        raise InputError(problems)


def massless_joint(joint: Joint) -> str:
    """Say why a last joint's equation would be singular: turning it moves no mass. Empty if all is well."""
    inertia, mass = np.zeros((3, 3)), 0.0
    for body in (*joint.shaft, *joint.link):
        c, m = np.asarray(body.com), float(body.mass)
        inertia += np.asarray(body.inertia) + m * (c @ c * np.eye(3) - np.outer(c, c))
        mass += m
    moments = np.linalg.eigvalsh(inertia)
    if mass and moments[0] > 1e-12 * moments[2]:
        return ""
    return "a rotation that moves no mass" if mass else "no mass beyond the bushing"


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
    if got := massless_joint(arm.joints[-1]):
        remedy = "give its shaft or link a positive mass, with inertia"
        yield Problem(arm.joints[-1].name, got, "mass beyond every bushing", remedy)


def _raised(check: Callable[[], None]) -> tuple[Problem, ...]:
    try:
        check()
    except InputError as error:
        return error.problems
    return ()
