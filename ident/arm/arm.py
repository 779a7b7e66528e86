"""The arm as a value: rigid bodies, pins and elastic bushings in a serial chain, and what drives it.

All numbers are SI (m, kg, s, rad, N). In the zero posture (every pin at zero, no elastic rotation) all frames
are parallel to the base frame: z up, x along the unfolded arm, y to the left.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.drive import Belt, Drive, Servo, Stroke
from ident.arm.drive_check import check_drives
from ident.arm.fields import STIFFNESS, fields_in
from ident.arm.parts import Body, Joint, Payload, Point
from ident.arm.spring_check import check_springs
from ident.arm.springs import CubicSpring, Spring
from ident.arm.workspace import ANYWHERE, Workspace
from ident.errors import InputError, Problem
from ident.jit import library
from ident.text import did_you_mean, one_line, table_lines
from ident.units import stiffness_unit

GRAVITY = (0.0, 0.0, -9.80665)
"""Standard gravity [m/s^2] in the base frame (CGPM 1901)."""


def _floats(value: Any) -> Array:
    return jnp.asarray(value, float)


class Arm(eqx.Module):
    """A serial chain of joints with their bodies, points and payloads.

    Attributes:
        name: what the arm is called.
        joints: from the base outwards, the undriven ones included.
        points: named points; the last one is the end point, by which mode shapes are drawn and labelled.
        payloads: bodies that a load case may add.
        gravity: (3,) [m/s^2] in the base frame.
        drives: harmonic drives, which static deflection and modes do not ask for.
        belts: belts between their pulleys.
        stroke: the straight motion of the hand, if it has one.
        workspace: where it may be held, besides the joint limits.
        servos: what holds the motors where no brake does; only measurements with a servo on ask for them.
        springs: of bushings whose torque is no straight line over the angle.
    """

    name: str = eqx.field(static=True)
    joints: tuple[Joint, ...] = eqx.field(converter=tuple)
    points: tuple[Point, ...] = eqx.field(converter=tuple, default=())
    payloads: tuple[Payload, ...] = eqx.field(converter=tuple, default=())
    gravity: Float[Array, "3"] = eqx.field(converter=_floats, default=GRAVITY)
    drives: tuple[Drive, ...] = eqx.field(converter=tuple, default=())
    belts: tuple[Belt, ...] = eqx.field(converter=tuple, default=())
    stroke: Stroke | None = None
    workspace: Workspace = eqx.field(static=True, default=ANYWHERE)
    servos: tuple[Servo, ...] = eqx.field(converter=tuple, default=())
    springs: tuple[Spring | CubicSpring, ...] = eqx.field(converter=tuple, default=())

    def __check_init__(self) -> None:
        names = [part.name for part in self.parts()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(Problem(self.name, f"{twice[0]} twice", "unique names", "rename one of them"))
        check_drives(self)
        check_springs(self)
        self._check_workspace()

    def __str__(self) -> str:
        """Return a short table: of each joint the axis, the offset, the stiffnesses and the mass that it carries."""
        if self.batch or any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(self)):
            return repr(self)
        size, unit = stiffness_unit()
        rows = [("joint", "axis", "offset [m]", f"k_bend, k_tors [{unit}]", "mass [kg]")]
        for joint in self.joints:
            vectors = (np.asarray(vector).round(9) + 0.0 for vector in (joint.axis, joint.offset))
            axis, offset = (" ".join(f"{x:.4g}" for x in vector) for vector in vectors)
            stiffness = ", ".join(f"{float(k) / size:.4g}" for k in (joint.k_bend, joint.k_tors))
            mass = sum(float(body.mass) for body in joint.shaft + joint.link)
            name = one_line(joint.name) + ("" if joint.driven else " (no pin)")
            rows.append((name, axis, offset, stiffness, f"{mass:.4g}"))
        lines = [f"{one_line(self.name)}: {len(self.driven)} driven joints", *table_lines(rows)]
        others: dict[str, Any] = {"points": self.points, "payloads": [payload.body for payload in self.payloads]}
        others |= {"drives": self.drives, "belts": self.belts, "servos": self.servos, "springs": self.springs}
        lines += [f"{word}: {', '.join(one_line(p.name) for p in parts)}" for word, parts in others.items() if parts]
        return "\n".join(lines)

    @property
    def driven(self) -> tuple[Joint, ...]:
        """The joints that have a pin, in the order of the posture's angles."""
        return tuple(joint for joint in self.joints if joint.driven)

    @property
    def base(self) -> Joint | None:
        """The base, where it gives: the first joint, if it has no pin."""
        return None if self.joints[0].driven else self.joints[0]

    @property
    def batch(self) -> tuple[int, ...]:
        """Batch axes `(*batch)` that the arm's numbers carry, as posterior draws given by `replace`; none as a rule."""
        return jnp.broadcast_shapes(
            *(jnp.shape(getattr(part, field.name))[field.rank :] for part in self.parts() for field in fields_in(part))
        )

    def parts(self) -> Iterator[Joint | Body | Point | Drive | Belt | Servo | Spring | CubicSpring | Stroke]:
        """Everything that has a name."""
        for joint in self.joints:
            yield joint
            yield from joint.shaft + joint.link
        yield from self.points
        yield from (payload.body for payload in self.payloads)
        yield from self.drives + self.belts + self.servos + self.springs
        if self.stroke:
            yield self.stroke

    def get(self, path: str) -> Array:
        """Return the number [SI] at a path such as `joint1.k_bend`, `link2.mass` or `fingers.com.x`.

        Raises:
            InputError: the path names no number of this arm; the nearest names are suggested.
        """
        name, field, component = self._split(path)
        value = getattr(next(part for part in self.parts() if part.name == name), field)
        return _component(value, component)

    def replace(self, values: Mapping[str, Any]) -> "Arm":
        """Return an arm that has these numbers at these paths; differentiable in the numbers.

        A number may be an array `(*batch)`; `at_posture` then gives a chain for each of its entries.

        Raises:
            InputError: a path names no number of this arm.
        """
        by_part: dict[str, list[tuple[str, tuple[int, ...], Any]]] = {}
        for path, value in values.items():
            name, field, component = self._split(path)
            by_part.setdefault(name, []).append((field, component, value))

        def changed(node: Any) -> Any:
            name = getattr(node, "name", None)
            new: dict[str, Array] = {}
            for field, component, value in by_part.get(name, ()) if name else ():
                old, number = new.get(field, getattr(node, field)), jnp.asarray(value, float)
                new[field] = _with_component(old, component, number) if component else number
            if new:
                node = eqx.tree_at(lambda node: [getattr(node, field) for field in new], node, list(new.values()))
            return node

        def joint(old: Joint) -> Joint:
            bodies = tuple(changed(b) for b in old.shaft), tuple(changed(b) for b in old.link)
            return eqx.tree_at(lambda n: (n.shaft, n.link), changed(old), bodies)

        return eqx.tree_at(
            lambda arm: (
                arm.joints,
                arm.points,
                arm.payloads,
                arm.drives,
                arm.belts,
                arm.servos,
                arm.springs,
                arm.stroke,
            ),
            self,
            (
                tuple(joint(j) for j in self.joints),
                tuple(changed(p) for p in self.points),
                tuple(eqx.tree_at(lambda n: n.body, p, changed(p.body)) for p in self.payloads),
                tuple(changed(d) for d in self.drives),
                tuple(changed(b) for b in self.belts),
                tuple(changed(s) for s in self.servos),
                tuple(changed(s) for s in self.springs),
                changed(self.stroke),
            ),
            is_leaf=lambda node: node is None,
        )

    def paths(self) -> tuple[str, ...]:
        """All paths that `get` and `replace` know."""
        return tuple(path for path, _, _, _ in self._places())

    def numbers(self) -> dict[str, Array]:
        """All numbers [SI] by path: quicker than `get` for each."""
        numbers = {}
        for path, part, field, component in self._places():
            value = getattr(part, field)
            numbers[path] = _component(value, component)
        return numbers

    def _check_workspace(self) -> None:
        count, where = len(self.driven), self.workspace
        if where.line is not None and where.postures:
            raise InputError(Problem("workspace", "line and postures", "one of them", "drop one", "postures"))
        given = [("line", where.line)] if where.line is not None else [("postures", each) for each in where.postures]
        for column, angles in given:
            if len(angles) != count:
                got, expected = f"{len(angles)} numbers", f"{count}, one for each driven joint"
                raise InputError(Problem("workspace", got, expected, "give one for each joint", column))
        for posture in where.postures:
            for joint, angle in zip(self.driven, posture, strict=True):
                low, high = map(math.degrees, joint.limits)
                if not low <= math.degrees(angle) <= high:
                    got = f"{joint.name} at {math.degrees(angle):.4g} deg"
                    expected, remedy = f"{low:.4g} to {high:.4g} deg, its limits", "correct the posture or the limits"
                    raise InputError(Problem("workspace", got, expected, remedy, "postures"))

    def _places(self) -> Iterator[tuple[str, Any, str, tuple[int, ...]]]:
        for part in self.parts():
            for field in fields_in(part):
                for end, component in field.ends.items():
                    yield f"{part.name}.{field.name}{end}", part, field.name, component

    def _split(self, path: str) -> tuple[str, str, tuple[int, ...]]:
        name, _, rest = path.partition(".")
        part = next((part for part in self.parts() if part.name == name), None)
        for field in fields_in(part) if part else ():
            for end, component in field.ends.items():
                if rest == field.name + end:
                    return name, field.name, component
        remedy = did_you_mean(path, self.paths(), "see `Arm.paths()`")
        raise InputError(Problem("", path or "no name", f"a number of the arm {self.name}", remedy))


def stiffness_paths(arm: Arm) -> tuple[str, ...]:
    """Paths of all bushing stiffnesses: bending of every joint, then torsion of every joint."""
    return tuple(f"{joint.name}.{field}" for field in STIFFNESS for joint in arm.joints)


def _component(value: Array, component: tuple[int, ...]) -> Array:
    if not component or library(value) is jnp:
        return value[component] if component else value
    return jnp.asarray(np.asarray(value)[component])


def _with_component(old: Array, component: tuple[int, ...], value: Array) -> Array:
    batch = jnp.broadcast_shapes(old.shape[len(component) :], value.shape)
    xp = library(old, value)
    spread = xp.reshape(xp.asarray(old), old.shape + (1,) * (len(component) + len(batch) - old.ndim))
    whole = xp.broadcast_to(spread, old.shape[: len(component)] + batch)
    if xp is jnp:
        return whole.at[component].set(value)
    whole = whole.copy()
    whole[component] = value
    return jnp.asarray(whole)
