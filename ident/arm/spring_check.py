"""What springs of an arm that are no straight lines must be like to go together."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ident.arm.drive_check import number_of, sign_problems
from ident.arm.springs import DIRECTIONS, CubicSpring, Spring
from ident.errors import InputError, Problem
from ident.text import did_you_mean, quoted

if TYPE_CHECKING:
    from ident.arm.arm import Arm

LOSS_OF = {"bending": "loss_bend", "torsion": "loss_tors"}


def check_springs(arm: "Arm") -> None:
    """Refuse springs that no arm can have; abstract values (under `jit` or `grad`) are not checked.

    Raises:
        InputError: every problem, each with the name of its spring.
    """
    problems = [problem for spring in arm.springs for problem in (*_of(arm, spring), *sign_problems(spring))]
    if problems:
        raise InputError(problems)


def _of(arm: "Arm", spring: Spring | CubicSpring) -> Iterator[Problem]:
    names, direction = [joint.name for joint in arm.joints], spring.direction
    if spring.joint not in names:
        remedy = did_you_mean(spring.joint, names, "name a joint of this arm")
        yield Problem(spring.name, quoted(spring.joint), f"one of {', '.join(names)}", remedy, "joint")
        return
    if direction not in DIRECTIONS:
        yield Problem(spring.name, quoted(direction), " or ".join(DIRECTIONS), "choose one", "direction")
        return
    same = [each.name for each in arm.springs if (each.joint, each.direction) == (spring.joint, direction)]
    if same[0] != spring.name:
        got = f"a second spring of {spring.joint} in {direction}"
        yield Problem(spring.name, got, "one for each joint and direction", f"remove it or {same[0]}", "joint")
    if getattr(arm.joints[names.index(spring.joint)], LOSS_OF[direction]) is not None:
        got = f"{spring.joint} with a loss factor in {direction}, too"
        remedy = f"take {LOSS_OF[direction]} out: loss factors hold for straight springs"
        yield Problem(spring.name, got, "a curved spring or a loss factor", remedy)
    if isinstance(spring, Spring):
        yield from _in_order(spring)


def _in_order(spring: Spring) -> Iterator[Problem]:
    first, second = number_of(spring.torque1), number_of(spring.torque2)
    if first is not None and second is not None and (out := second <= first).any():
        got = f"T2 = {np.broadcast_to(second, out.shape)[out].flat[0]:g} N m"
        expected = f"more than T1 = {np.broadcast_to(first, out.shape)[out].flat[0]:g} N m"
        yield Problem(spring.name, got, expected, "swap or correct them", "torque2")
