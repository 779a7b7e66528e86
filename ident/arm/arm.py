"""The arm as a value: rigid bodies, pins and elastic bushings in a serial chain, and what drives it.

All numbers are SI (m, kg, s, rad, N). In the zero posture (every pin at zero, no elastic rotation) all frames
are parallel to the base frame: z up, x along the unfolded arm, y to the left.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.fields import DAMPING, EXPECTED, FIELDS, LOSS, STIFFNESS, fields_in, fields_of
from ident.arm.parts import (
    DIRECTIONS,
    PROFILES,
    STIFFNESS_OF,
    Belt,
    Body,
    CubicSpring,
    Drive,
    Joint,
    MassDamping,
    NamedPart,
    Payload,
    Point,
    Servo,
    Spring,
    Stroke,
    inertia_problems,
)
from ident.errors import Problem, refusal, refuse, require
from ident.programs import AnyArray, library
from ident.text import did_you_mean, one_line, quoted, table_lines
from ident.units import stiffness_unit

# -------- Drive check
# What drives, belts and stroke of an arm must be like to go together.

AT_LIMIT = 1e-9
"""Largest angle [rad] of a stroke's end beyond a joint limit, for rounding."""
PARALLEL = 1e-6
"""Angle between axes [rad] up to which they count as parallel; assumed."""


def check_drives(arm: "Arm") -> None:
    """Refuse drives, belts and a stroke that no arm can have; abstract values (under `jit` or `grad`) are not checked.

    Raises:
        InputError: every problem, each with the name of its part.
    """
    refuse(_drive_problems(arm))


def _drive_problems(arm: "Arm") -> Iterator[Problem]:
    parts = (*arm.drives, *arm.belts, *arm.servos, *([arm.stroke] if arm.stroke else []))
    checks: dict[type, Any] = {Drive: _of_drive, Belt: _of_belt, Servo: _of_servo, Stroke: _of_stroke}
    for part in parts:
        yield from checks[type(part)](arm, part)
    for part in (*parts, *(error for drive in arm.drives for error in drive.errors)):
        yield from sign_problems(part)


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
            remedy = "the eccentric mass is part of the shaft's: correct one of them"
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


# -------- Spring check
# What springs of an arm that are no straight lines must be like to go together.

LOSS_OF = {"bending": "loss_bend", "torsion": "loss_tors"}


def _spring_problems(arm: "Arm") -> Iterator[Problem]:
    """Yield springs that no arm can have; abstract values (under `jit` or `grad`) are not checked."""
    for spring in arm.springs:
        yield from (*_of_spring(arm, spring), *sign_problems(spring))


def _of_spring(arm: "Arm", spring: Spring | CubicSpring) -> Iterator[Problem]:
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
    if getattr(arm.joints[names.index(spring.joint)], STIFFNESS_OF[direction]) is None:
        remedy = f"take it out, or give {STIFFNESS_OF[direction]} a value"
        yield Problem(spring.name, f"{spring.joint} rigid in {direction}", "a stiffness there", remedy, "joint")
    if getattr(arm.joints[names.index(spring.joint)], LOSS_OF[direction]) is not None:
        got = f"{spring.joint} with a loss factor in {direction}, too"
        remedy = f"take {LOSS_OF[direction]} out: loss factors hold for straight springs"
        yield Problem(spring.name, got, "a curved spring or a loss factor", remedy)
    first, second = (number_of(getattr(spring, torque, None)) for torque in ("torque1", "torque2"))
    if first is not None and second is not None and (out := second <= first).any():
        got = f"T2 = {np.broadcast_to(second, out.shape)[out].flat[0]:g} N m"
        expected = f"more than T1 = {np.broadcast_to(first, out.shape)[out].flat[0]:g} N m"
        yield Problem(spring.name, got, expected, "swap or correct them", "torque2")


# -------- Workspace
# Where an arm may be held, besides its joint limits.


@dataclass(frozen=True)
class Workspace:
    """The postures in which an arm can be measured: on a line, in a list, above a height.

    Attributes:
        line: (driven,) shares of the pins in the one motion that belts or couplings allow; None where all turn freely.
        postures: (driven,) [rad] each, where no others can be held; empty for all.
        lowest: [m] height in the base frame below which no bushing and no named point may come.
    """

    line: tuple[float, ...] | None = None
    postures: tuple[tuple[float, ...], ...] = ()
    lowest: float = -math.inf


ANYWHERE = Workspace()
"""Within the joint limits only."""


# -------- Arm

GRAVITY = (0.0, 0.0, -9.80665)
"""Standard gravity [m/s^2] in the base frame (CGPM 1901)."""


class Arm(eqx.Module):
    """A serial chain of joints with their bodies, points and payloads.

    Attributes:
        name: what the arm is called.
        joints: from the base outwards, the undriven ones included.
        points: named points; the last one is the end point, used to draw and label mode shapes.
        payloads: bodies that a load case may add.
        gravity: (3,) [m/s^2] in the base frame.
        drives: harmonic drives, which static deflection and modes do not ask for.
        belts: belts between their pulleys.
        stroke: the straight motion of the hand, if it has one.
        workspace: where it may be held, besides the joint limits.
        servos: what holds the motors where no brake does; only measurements with a servo on ask for them.
        springs: of bushings whose torque is no straight line over the angle.
        damping: mass-proportional damping in addition to that of the bushings.
    """

    name: str = eqx.field(static=True)
    joints: tuple[Joint, ...] = eqx.field(converter=tuple)
    points: tuple[Point, ...] = eqx.field(converter=tuple, default=())
    payloads: tuple[Payload, ...] = eqx.field(converter=tuple, default=())
    gravity: Float[Array, "3"] = eqx.field(converter=lambda g: jnp.asarray(g, float), default=GRAVITY)
    drives: tuple[Drive, ...] = eqx.field(converter=tuple, default=())
    belts: tuple[Belt, ...] = eqx.field(converter=tuple, default=())
    stroke: Stroke | None = None
    workspace: Workspace = eqx.field(static=True, default=ANYWHERE)
    servos: tuple[Servo, ...] = eqx.field(converter=tuple, default=())
    springs: tuple[Spring | CubicSpring, ...] = eqx.field(converter=tuple, default=())
    damping: MassDamping = MassDamping()

    def __check_init__(self) -> None:
        names = [part.name for part in self.parts()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            alone = [part.name for part in (self.stroke, self.damping) if part]
            remedy = "name the part otherwise: that is the arm's own" if twice[0] in alone else "rename one of them"
            raise refusal(self.name, f"{twice[0]} twice", "unique names", remedy)
        if not self.degrees_of_freedom:
            remedy = "give one of them a stiffness"
            raise refusal(self.name, "every stiffness rigid", "an arm that gives somewhere", remedy, "joint")
        check_drives(self)
        refuse(_spring_problems(self))
        self._check_workspace()

    def __str__(self) -> str:
        """Return a short table: of each joint the axis, the offset, the stiffnesses and the mass that it carries."""
        if self.batch or library(self) is jnp:
            return repr(self)
        size, unit = stiffness_unit()
        rows = [("joint", "axis", "offset [m]", f"k_bend, k_tors [{unit}]", "mass [kg]")]
        for joint in self.joints:
            vectors = (np.asarray(vector).round(9) + 0.0 for vector in (joint.axis, joint.offset))
            axis, offset = (" ".join(f"{x:.4g}" for x in vector) for vector in vectors)
            both = (joint.k_bend, joint.k_tors)
            stiffness = ", ".join("rigid" if k is None else f"{float(k) / size:.4g}" for k in both)
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
        pairs = ((part, field) for part in self.parts() for field in fields_in(part))
        return np.broadcast_shapes(*{np.shape(getattr(part, field.name))[field.rank :] for part, field in pairs})

    @property
    def degrees_of_freedom(self) -> int:
        """Number of elastic coordinates, and of modes: two of a bushing that bends, one of one that twists."""
        return sum(2 * (joint.k_bend is not None) + (joint.k_tors is not None) for joint in self.joints)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """All bodies but the payloads, from the base outwards."""
        return tuple(body for joint in self.joints for body in (*joint.shaft, *joint.link))

    def parts(self) -> Iterator[NamedPart]:
        """Everything that has a name."""
        for joint in self.joints:
            yield joint
            yield from joint.shaft + joint.link
        yield from self.points
        yield from (payload.body for payload in self.payloads)
        for drive in self.drives:
            yield drive
            yield from drive.errors
        yield from self.belts + self.servos + self.springs
        if self.stroke:
            yield self.stroke
        yield self.damping

    def get(self, path: str) -> AnyArray:
        """Return the number [SI] at a path such as `joint1.k_bend`, `link2.mass` or `fingers.com.x`.

        A loss factor that a joint does not have is zero, as is `damping.alpha`.

        Raises:
            InputError: the path names no number of this arm; the nearest names are suggested.
        """
        part, field, component = self._found(path)
        value = getattr(part, field)
        return np.zeros(()) if value is None else _component(value, component)

    def replace(self, values: Mapping[str, Any]) -> "Arm":
        """Return an arm that has these numbers at these paths; differentiable in the numbers.

        A number may be an array `(*batch)`; `at_posture` then gives a chain for each of its entries.

        Raises:
            InputError: a path names no number of this arm.
        """
        by_part: dict[str, list[tuple[str, tuple[int, ...], Any]]] = {}
        for path, value in values.items():
            part, field, component = self._found(path)
            by_part.setdefault(part.name, []).append((field, component, value))

        def changed(node: Any) -> Any:
            name = getattr(node, "name", None)
            new: dict[str, Array] = {}
            for field, component, value in by_part.get(name, ()) if name else ():
                old, number = new.get(field, getattr(node, field)), jnp.asarray(value, float)
                new[field] = _with_component(old, component, number) if component else number
            if new:
                own = [*new.values()]
                node = eqx.tree_at(
                    lambda x: [getattr(x, field) for field in new], node, own, is_leaf=lambda x: x is None
                )
            return node

        def joint(old: Joint) -> Joint:
            bodies = tuple(changed(b) for b in old.shaft), tuple(changed(b) for b in old.link)
            return eqx.tree_at(lambda n: (n.shaft, n.link), changed(old), bodies)

        def drive(old: Drive) -> Drive:
            return eqx.tree_at(lambda n: n.errors, changed(old), tuple(map(changed, old.errors)))

        plain = ("points", "belts", "servos", "springs")
        return eqx.tree_at(
            lambda arm: (
                *(arm.joints, arm.payloads, arm.stroke, arm.damping, arm.drives),
                *(getattr(arm, name) for name in plain),
            ),
            self,
            (
                tuple(joint(j) for j in self.joints),
                tuple(eqx.tree_at(lambda n: n.body, p, changed(p.body)) for p in self.payloads),
                changed(self.stroke),
                changed(self.damping),
                tuple(map(drive, self.drives)),
                *(tuple(map(changed, getattr(self, name))) for name in plain),
            ),
            is_leaf=lambda node: node is None,
        )

    def paths(self) -> tuple[str, ...]:
        """All paths that `get` and `replace` know."""
        return tuple(path for path, _, _, _ in self._places())

    def numbers(self) -> dict[str, AnyArray]:
        """All numbers [SI] by path: quicker than `get` for each."""
        return {path: _component(getattr(part, field), end) for path, part, field, end in self._places()}

    def _check_workspace(self) -> None:
        count, where = len(self.driven), self.workspace
        if where.line is not None and where.postures:
            raise refusal("workspace", "line and postures", "one of them", "drop one", "postures")
        given = [("line", where.line)] if where.line is not None else [("postures", each) for each in where.postures]
        for column, angles in given:
            got, expected = f"{len(angles)} numbers", f"{count}, one for each driven joint"
            require(len(angles) == count, "workspace", got, expected, "give one for each joint", column)
        for posture in where.postures:
            for joint, angle in zip(self.driven, posture, strict=True):
                low, high = map(math.degrees, joint.limits)
                if not low <= math.degrees(angle) <= high:
                    got = f"{joint.name} at {math.degrees(angle):.4g} deg"
                    expected, remedy = f"{low:.4g} to {high:.4g} deg, its limits", "correct the posture or the limits"
                    raise refusal("workspace", got, expected, remedy, "postures")

    def _places(self) -> Iterator[tuple[str, Any, str, tuple[int, ...]]]:
        for part in self.parts():
            for field in fields_in(part):
                for end, component in field.ends.items():
                    yield f"{part.name}.{field.name}{end}", part, field.name, component

    def _found(self, path: str) -> tuple[NamedPart, str, tuple[int, ...]]:
        name, _, rest = path.partition(".")
        for part in (part for part in self.parts() if part.name == name):
            way = rest.replace("tau", "k").replace("loss", "k") if rest in (*STIFFNESS, *DAMPING, *LOSS) else ""
            if way and getattr(part, way, 0.0) is None:
                remedy = "give it a value in the arm file, or leave it out here"
                raise refusal("", f"{path}, which is rigid", "a number of the arm", remedy)
            for field in fields_of(type(part).__name__):
                for end, component in field.ends.items():
                    if rest == field.name + end:
                        return part, field.name, component
        remedy = did_you_mean(path, self.paths(), "see `Arm.paths()`")
        raise refusal("", path or "no name", f"a number of the arm {self.name}", remedy)


def stiffness_paths(arm: Arm) -> tuple[str, ...]:
    """Paths of all bushing stiffnesses, without rigid ones: bending of every joint, then torsion of every joint."""
    pairs = ((joint, field) for field in STIFFNESS for joint in arm.joints)
    return tuple(f"{joint.name}.{field}" for joint, field in pairs if getattr(joint, field) is not None)


def loss_paths(arm: Arm) -> tuple[str, ...]:
    """Paths of the loss factors of all bushings that give, whether they have any or not."""
    return tuple(path.replace(".k_", ".loss_") for path in stiffness_paths(arm))


def stiffness_or_stiffest(arm: Arm, joint: Joint, field: str) -> AnyArray:
    """Return a stiffness of a joint [N m/rad]; where it is rigid, the largest one of the arm, to compare with."""
    k: AnyArray | None = getattr(joint, field)
    return max(map(arm.get, stiffness_paths(arm)), key=float) if k is None else k


def _component(value: AnyArray, component: tuple[int, ...]) -> AnyArray:
    if not component:
        return value
    return value[component] if isinstance(value, jax.core.Tracer) else np.asarray(np.asarray(value)[component])


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


def nominal(arm: Arm) -> Arm:
    """Return the arm of the medians of its numbers over their batch."""
    ranks = {field.name: field.rank for field in FIELDS} | {"axis": 1, "gravity": 1, "direction": 1}

    def middle(path: Any, leaf: Any) -> Any:
        batch = tuple(range(ranks.get(getattr(path[-1], "name", ""), 0), np.ndim(leaf)))
        return library(leaf).median(leaf, axis=batch) if batch else leaf

    return jax.tree_util.tree_map_with_path(middle, arm)


# -------- Base
# A base that gives: an undriven bushing at the foot of an arm, about which the whole arm rocks and turns.

BASE, PEDESTAL = "base", "pedestal"
"""Names of the bushing, and of the body on it, that `on_soft_base` adds."""
STIFFER = 10.0
"""Stiffness of that bushing as a multiple of joint 1's; assumed, as no published ratio of the two was found."""

FAR = 10.0
"""Height as a multiple of the arm's length above which it is taken for an entry error, such as millimetres."""


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
        raise refusal("soft_base", got, "an arm on a rigid base", remedy)
    ends = [np.linalg.norm(point.position) for point in arm.points]
    length = float(sum(np.linalg.norm(joint.offset) for joint in arm.joints[1:]) + max(ends, default=0.0))
    longest = FAR * length
    if height > longest > 0:
        expected = f"a height below bushing 1 of {longest:.2g} m at most, {FAR:g} times the arm's length"
        raise refusal("soft_base", f"{height:g} m", expected, "give it in metres")
    up = jnp.array([0.0, 0.0, height])
    mass = float(sum(body.mass for body in arm.bodies)) / len(arm.joints)
    square = (height / 4) ** 2
    inertia = mass * np.diag([square / 4 + height**2 / 12] * 2 + [square / 2])
    numbers: dict[str, Any] = {field: STIFFER * stiffness_or_stiffest(arm, first, field) for field in STIFFNESS}
    numbers |= {field: getattr(first, field) for field in LOSS}
    numbers |= {field: 0.0 if (tau := getattr(first, field)) is None else tau for field in DAMPING}
    pedestal = Body(PEDESTAL, mass, up / 2, inertia)
    base = Joint(BASE, offset=first.offset - up, link=(pedestal,), driven=False, **numbers)
    raised = eqx.tree_at(lambda joint: joint.offset, first, up)
    for part in arm.parts():
        if part.name in (BASE, PEDESTAL):
            raise refusal("soft_base", f"a part {part.name}", "that name for the base", "rename the part")
    return eqx.tree_at(lambda arm: arm.joints, arm, (base, raised, *arm.joints[1:]))


# -------- Checks
# What the numbers of an arm must be like once others were put in their place: a changed arm is still an arm.

MOST_JOINTS = 24
"""Joints of an arm that is read or studied; what more of them cost is in docs/own-arm.md."""


def check_size(joints: int, where: str) -> None:
    """Refuse an arm of more joints than are worth waiting for, before anything is compiled for it.

    Raises:
        InputError: it is one, with where it comes from.
    """
    remedy = "leave out joints that hardly give: time and memory grow with the square of their number"
    require(joints <= MOST_JOINTS, where, f"{joints} joints", f"at most {MOST_JOINTS}", remedy)


def massless_joints(joints: Sequence[Joint]) -> Iterator[tuple[int, str, str]]:
    """Yield the joints whose equation would be singular, the last one first: its place, why, and what it lacks.

    Turning a bushing moves the joint's own bodies and the bushing after it, for what that one carries may stay as it
    is, by turning back, but about its rigid directions; turning the last one moves its own bodies alone.
    """
    held, beyond, carried = np.zeros((3, 3)), np.zeros((3, 3)), 0.0  # rigid directions of the next one, what it carries
    for place in reversed(range(len(joints))):
        joint, last = joints[place], place == len(joints) - 1
        inertia, mass = held @ beyond @ held, carried if held.any() else 0.0
        for body in (*joint.shaft, *joint.link):
            inertia += np.asarray(body.inertia) + inertia_of_mass(float(body.mass), np.asarray(body.com))
            mass += float(body.mass)
        if not last:
            inertia += inertia_of_mass(mass or 1.0, np.asarray(joints[place + 1].offset))
        along = np.outer(joint.axis, joint.axis)
        held = (joint.k_bend is None) * (np.eye(3) - along) + (joint.k_tors is None) * along
        beyond, carried = inertia, mass
        turns = np.linalg.eigh(held)[1][:, : 3 - round(np.trace(held))]
        moments = np.linalg.eigvalsh(turns.T @ inertia @ turns)
        if not moments.size or (mass and moments[0] > 1e-12 * np.linalg.eigvalsh(inertia)[2]):
            continue
        if mass:
            yield place, "a rotation that moves no mass", "inertia about every axis"
        elif last:
            yield place, "no mass beyond the bushing", "mass beyond every bushing"
        else:
            yield place, "no mass on the bushing", "inertia on every bushing"


def inertia_of_mass(mass: float, at: np.ndarray) -> np.ndarray:
    """Return the inertia of a point mass about the origin (3, 3) [kg m^2]."""
    return mass * (at @ at * np.eye(3) - np.outer(at, at))


def check_arm(arm: Arm) -> None:
    """Refuse numbers that no arm can have, as `Arm.replace` may have put in: signs, inertia, drives, a massless end.

    Raises:
        InputError: every problem, each with the name of its part.
    """
    bodies = (*arm.bodies, *(payload.body for payload in arm.payloads))
    refuse(problem for part in (*arm.joints, *bodies, *arm.points, arm.damping) for problem in sign_problems(part))
    problems = [problem for body in bodies for problem in inertia_problems(body.name, body.mass, body.inertia)]
    problems += [*_drive_problems(arm), *_spring_problems(arm)]
    for place, got, expected in massless_joints(arm.joints):
        remedy = "give its shaft or link a positive mass, with inertia"
        problems.append(Problem(arm.joints[place].name, got, expected, remedy))
    refuse(problems)
