"""Where on the arm the channels of a modal test are: points, and directions in the base frame."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.parts import Point
from ident.errors import InputError, Problem
from ident.measure.channels import FRAMES, ChannelRow, ChannelTable
from ident.measure.load import named_points, unit_vector
from ident.text import did_you_mean, quoted

BODY = FRAMES[1]


def with_places(arm: Arm, table: ChannelTable) -> Arm:
    """Return the arm with the points that the table alone defines, before its own: the end point stays the last one.

    Raises:
        InputError: a point that neither arm nor table define, or a load at one that the arm's file has not.
    """
    own = {point.name for point in arm.points}
    new: dict[str, Point] = {}
    problems: list[Problem] = []
    for row in table.rows:
        if not row.counts:
            continue
        problems += _problems(arm, row, own)
        if row.point not in own and row.position is not None:
            point = new.setdefault(row.point, Point(row.point, row.joint, row.position))
            if point.joint != row.joint or not np.allclose(point.position, row.position):
                got, remedy = f"another place of {quoted(row.point)}", "give each place a name of its own"
                problems.append(Problem(row.where, got, "the same as above", remedy, "position"))
    if problems:
        raise InputError(problems)
    return eqx.tree_at(lambda a: a.points, arm, (*new.values(), *arm.points)) if new else arm


def in_base_frame(arm: Arm, table: ChannelTable) -> ChannelTable:
    """Return the table with every direction in the base frame, at the posture that its row says.

    Axes of a body are taken without the arm's elastic rotations, some tenths of a degree.

    Args:
        arm: with all points of the table, see `with_places`.
        table: the channel table.

    Raises:
        InputError: a posture that has not one angle for each joint.
    """
    for row in table.rows:
        if row.counts and len(row.posture) != len(arm.driven):
            got, expected = f"{len(row.posture)} joint angles", f"{len(arm.driven)}, as {arm.name} has"
            raise InputError(Problem(row.where, got, expected, "add or remove columns q1, q2, ...", "q1"))
    turned = [i for i, row in enumerate(table.rows) if row.counts and row.frame == BODY]
    rows = list(table.rows)
    for posture in dict.fromkeys(rows[i].posture for i in turned):
        here = [i for i in turned if rows[i].posture == posture]
        for i, direction in zip(here, _turned(arm, posture, [rows[i] for i in here]), strict=True):
            rows[i] = replace(rows[i], direction=unit_vector(direction), frame=FRAMES[0])
    return replace(table, rows=tuple(rows))


def _turned(arm: Arm, posture: tuple[float, ...], rows: Sequence[ChannelRow]) -> Iterator[list[float]]:
    """Yield directions of bodies in the base frame: where a point that far from the body's origin comes to lie."""
    joints = {point.name: point.joint for point in arm.points}
    ends = tuple(Point(f"end{i}", joints[row.point], row.direction) for i, row in enumerate(rows))
    chain = at_posture(eqx.tree_at(lambda a: a.points, arm, ends), jnp.asarray(posture))
    for column in np.asarray(chain.position).T:
        yield [float(f"{each:.12g}") + 0.0 for each in column]


def _problems(arm: Arm, row: ChannelRow, own: set[str]) -> Iterator[Problem]:
    joints = [joint.name for joint in arm.joints]
    if row.point not in own and row.position is None:
        expected = f"a point of {arm.name}, or joint and position of a new one"
        yield Problem(row.where, quoted(row.point), expected, did_you_mean(row.point, own, "correct it"), "point")
    if row.joint and row.joint not in joints:
        remedy = did_you_mean(row.joint, joints, "correct it")
        yield Problem(row.where, quoted(row.joint), f"a joint of {arm.name}", remedy, "joint")
    if row.point in own and row.position is not None:
        remedy = "empty joint and position, or give the place another name"
        yield Problem(
            row.where, f"a position of {quoted(row.point)}", "none: the arm has this point", remedy, "position"
        )
    payloads = {payload.body.name for payload in arm.payloads}
    for name in named_points(row.load):
        if name not in own:
            remedy = "add it to the arm's file as a [[point]]: a fit needs it, too"
            yield Problem(row.where, f"a load at {quoted(name)}", f"a point of {arm.name}", remedy, "load")
    for name in row.load.payloads:
        if name not in payloads:
            remedy = did_you_mean(name, payloads, "correct the load")
            yield Problem(row.where, quoted(name), f"a payload of {arm.name}", remedy, "load")
