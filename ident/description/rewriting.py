"""Numbers of an arm put into a TOML document that stays as it is written otherwise."""

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tomlkit

from ident.arm.arm import GRAVITY, Arm
from ident.arm.fields import ALPHA, COMPONENTS, DAMPING, LOSS, STIFFNESS
from ident.arm.parts import Body, Joint, Point
from ident.description.schema import BUSHING, RIGID, DampingTable, Origin, si
from ident.errors import refusal
from ident.text import one_line

NEAR = 1e-9
"""Share of an inertia within which two are the same: that of twelve digits."""


def set_numbers(tables: Mapping[str, Any], values: Mapping[str, float], origin: Origin, where: str) -> None:
    """Put numbers [SI] into tables, by paths as in `Arm.paths()`, and their origin.

    Raises:
        InputError: the tables have no such number.
    """
    for path, value in values.items():
        entry, holder, key = _slot(tables, path, where)
        holder[key] = _in_unit(entry, value)
        entry["origin"] = origin


def place_damping(document: Any, joints: Mapping[str, Any], arm: Arm, paths: Collection[str]) -> None:
    """Write all damping of joints whose tables lack the place of some, as times and loss factors, in their own tables.

    Words for all bushings go into all joints' tables then.

    Args:
        document: of these tables; it gets a place for damping in proportion to mass.
        joints: tables by name; other tables may be among them.
        arm: whose numbers they get.
        paths: numbers that need a place.
    """
    if ALPHA in paths and "alpha" not in document.setdefault("damping", tomlkit.table()):
        document["damping"].update(tomlkit.parse('alpha = { value = 0.0, unit = "1/s", origin = "derived" }'))
    own = [joint for joint in arm.joints if joint.name in joints]
    missing = ((joint, key) for joint in own for key in (*DAMPING, *LOSS) if key not in joints[joint.name])
    lacking = {joint.name for joint, key in missing if f"{joint.name}.{key}" in paths}
    common = {word: quantity for word, quantity in document.get("damping", {}).items() if word != "alpha"}
    for joint in own if common and lacking else [joint for joint in own if joint.name in lacking]:
        table = joints[joint.name]
        words = common | {word: table.pop(word) for word in DampingTable.model_fields if word in table}
        origin: Any = next((quantity["origin"] for quantity in reversed(words.values())), "derived")
        written = tomlkit.parse("\n".join([*_Writer(origin).bushing(joint), ""]))
        table.update({key: quantity for key, quantity in written.items() if key not in table})
    for word in common if lacking else ():
        document["damping"].pop(word)


def changed_numbers(before: Arm, after: Arm) -> dict[str, float]:
    """Return the numbers [SI] of an arm that another one has otherwise, inertias left out: see `set_inertias`."""
    own = before.numbers()
    numbers = ((path, float(value)) for path, value in after.numbers().items() if ".inertia." not in path)
    return {path: value for path, value in numbers if path not in own or value != float(own[path])}


def changed_bodies(before: Arm, after: Arm) -> list[Body]:
    """Return the bodies of an arm that have another mass, mass centre or inertia than in another one."""
    own, keys = {body.name: body for body in bodies_of(before)}, ("mass", "com", "inertia")

    def differs(body: Body) -> bool:
        old = own.get(body.name)
        return old is not None and not all(np.array_equal(getattr(old, key), getattr(body, key)) for key in keys)

    return [body for body in bodies_of(after) if differs(body)]


def set_inertias(tables: Mapping[str, Any], before: Arm, after: Arm, origin: Origin) -> None:
    """Put the inertias of bodies into tables where they differ, in place of a shape if that would give another one.

    Args:
        tables: by name; what has no table stays out.
        before: the arm that the tables describe.
        after: the arm that they are to describe.
        origin: of these inertias.
    """
    own = {body.name: np.asarray(body.inertia) for body in bodies_of(before)}
    for body in bodies_of(after):
        tensor, old = np.asarray(body.inertia), own.get(body.name)
        if body.name in tables and old is not None and np.abs(tensor - old).max() > NEAR * np.abs(tensor).max():
            table = tables[body.name]
            if "inertia" not in table:
                del table["shape"]
                table["inertia"] = tomlkit.inline_table()
                table["inertia"]["unit"] = "kg*m^2"
            entry = table["inertia"]
            diagonal = not (tensor - np.diag(np.diag(tensor))).any()
            rows = [[_in_unit(entry, x) for x in row] for row in tensor]
            entry["value"] = [rows[n][n] for n in range(3)] if diagonal else rows
            entry["origin"] = origin


def bodies_of(arm: Arm) -> list[Body]:
    """Return all bodies of an arm, those of its payloads last."""
    return [part for part in arm.parts() if isinstance(part, Body)]


def _in_unit(entry: Any, value: float) -> float:
    return float(f"{value / (si(1.0, entry['unit']) if 'unit' in entry else 1.0):.12g}")


def _slot(tables: Mapping[str, Any], path: str, where: str) -> tuple[Any, Any, Any]:
    """Return the quantity's table, and the container and key of the number in it."""
    try:
        name, field, *rest = path.split(".")
        entry = holder = tables[name][field]
        key: Any = rest.pop(0) if field == "shape" else "value"
        index = COMPONENTS[rest[0]] if rest else ()
        if len(index) == 2 and not isinstance(entry[key][0], list):
            index = index[:1]
        for step in index:
            holder, key = holder[key], step
        float(holder[key])
    except (KeyError, IndexError, TypeError, ValueError):
        raise refusal(where, path, "a number of this file", "see `Arm.paths()`") from None
    return entry, holder, key


# -------- Writing
# An arm as TOML text, with an origin for every number; what `read_arm` reads back as the same arm.

UNITS = dict.fromkeys(STIFFNESS, "N*m/rad") | dict.fromkeys(DAMPING, "s")
NOTHING = 1e-12
"""Magnitude below which a length or inertia [SI] is rounding, and written as zero."""


def arm_text(
    arm: Arm,
    *,
    origin: Origin,
    guessed: tuple[str, ...] = (),
    note: str = "",
    head: str = "",
    origins: Mapping[str, str] | None = None,
    ratio: float | None = None,
) -> str:
    """Return an arm without drives, belts, springs and stroke as TOML, vectors along its own axes, in SI and degrees.

    Args:
        arm: the arm.
        origin: of its numbers.
        guessed: keys whose origin is `assumed` instead.
        note: a line that every joint and body gets.
        head: comment above it, without the `#`.
        origins: of quantities, as `link2.com`, where it is another.
        ratio: damping ratio of all modes, which is written as assumed in place of the bushings' own damping.
    """
    writer = _Writer(origin, guessed, note, origins or {}, STIFFNESS if ratio is not None else BUSHING)
    lines = [f"# {one_line(line)}".rstrip() for line in head.splitlines()]
    lines += ['format = "ident-arm/1"', f"name = {_quoted(arm.name)}"]
    if not np.array_equal(arm.gravity, GRAVITY):
        lines.append(writer.line("gravity", arm.gravity, "m/s^2"))
    if ratio is not None:
        lines += ["", "[damping]", f'ratio = {{ value = {ratio:g}, origin = "assumed" }}']
    elif arm.damping.alpha is not None:
        lines += ["", "[damping]", writer.line("alpha", arm.damping.alpha, "1/s", "damping")]
    for joint in arm.joints:
        lines += ["", *writer.joint(joint)]
    for point in arm.points:
        lines += ["", *writer.point(point)]
    for payload in arm.payloads:
        lines += ["", "[[payload]]", f'joint = "{payload.joint}"', *writer.body(payload.body)]
    return "\n".join(lines) + "\n"


def joint_text(joint: Joint, origin: Origin) -> str:
    """Return a joint with its bodies as a table of an arm file."""
    return "\n".join([*_Writer(origin).joint(joint), "", ""])


def bushing_text(joint: Joint, origin: Origin) -> str:
    """Return a joint as a table of a file of bushings."""
    return "\n".join(["[[joint]]", f'name = "{joint.name}"', *_Writer(origin).bushing(joint), "", ""])


def point_text(point: Point, origin: Origin) -> str:
    """Return a point as a table of an arm file."""
    return "\n".join([*_Writer(origin).point(point), "", ""])


def with_first(kind: str, text: str, table: str, where: str) -> str:
    """Return a TOML text with a table before the first one of a kind, `joint` or `point`.

    Raises:
        InputError: its joints or points are no tables.
    """
    first = re.search(rf"^[ \t]*\[\[[ \t]*{kind}[ \t]*\]\]", text, re.MULTILINE)
    if first is None:
        got, remedy = f"{kind}s that are no tables", f"write each as [[{kind}]]"
        raise refusal(where, got, f"a table [[{kind}]], before which another one stands", remedy)
    return text[: first.start()] + table + text[first.start() :]


@dataclass(frozen=True)
class _Writer:
    """Writes numbers with their origin."""

    origin: Origin
    guessed: tuple[str, ...] = ()
    note: str = ""
    origins: Mapping[str, str] = field(default_factory=dict)
    keys: tuple[str, ...] = BUSHING

    def line(self, key: str, value: Any, unit: str = "", part: str = "") -> str:
        """Return a quantity of a part."""
        units = f', unit = "{unit}"' if unit else ""
        origin = "assumed" if key in self.guessed else self.origins.get(f"{part}.{key}", self.origin)
        return f'{key} = {{ value = {_written(value)}{units}, origin = "{origin}" }}'

    def joint(self, joint: Joint) -> Iterator[str]:
        """Yield a joint with its bodies."""
        yield from ["[[joint]]", f'name = "{joint.name}"', self.line("axis", joint.axis, part=joint.name)]
        yield self.line("offset", joint.offset, "m", joint.name)
        yield from self.bushing(joint)
        if all(map(math.isfinite, joint.limits)):
            yield self.line("limits", np.degrees(joint.limits), "deg", joint.name)
        for n, (key, rate) in enumerate(zip(("speed", "acceleration", "jerk"), joint.rates, strict=True)):
            if math.isfinite(rate):
                yield self.line(key, np.degrees(rate), ("deg/s", "deg/s^2", "deg/s^3")[n], joint.name)
        if not joint.driven:
            yield "driven = false"
        for kind, bodies in (("shaft", joint.shaft), ("link", joint.link)):
            for body in bodies:
                yield from ["", f"[[joint.{kind}]]", *self.body(body)]

    def point(self, point: Point) -> Iterator[str]:
        """Yield a point."""
        yield from ["[[point]]", f'name = "{point.name}"', f'joint = "{point.joint}"']
        yield self.line("position", point.position, "m", point.name)

    def bushing(self, joint: Joint) -> Iterator[str]:
        """Yield the stiffness of a joint, and its damping if that is written: loss factors where it has any."""
        for key in self.keys:
            if (value := getattr(joint, key)) is not None:
                yield self.line(key, value, UNITS.get(key, ""), joint.name)
            elif key in STIFFNESS:
                yield f'{key} = "{RIGID}"'

    def body(self, body: Body) -> Iterator[str]:
        """Yield the keys of a body."""
        note = f", note = {_quoted(self.note)} }}" if self.note else " }"
        yield f'name = "{body.name}"'
        yield self.line("mass", body.mass, "kg", body.name).removesuffix(" }") + note
        yield self.line("com", body.com, "m", body.name)
        inertia = np.asarray(body.inertia)
        diagonal = np.abs(inertia - np.diag(np.diag(inertia))).max() < NOTHING
        yield self.line("inertia", np.diag(inertia) if diagonal else inertia, "kg*m^2", body.name)


def _written(value: Any) -> str:
    """Return a number, vector or matrix as TOML, with twelve digits."""
    if np.ndim(value):
        return f"[{', '.join(map(_written, np.asarray(value)))}]"
    number = float(value)
    return f"{number:.12g}" if abs(number) > NOTHING else "0"


def _quoted(text: str) -> str:
    escaped = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
