"""An arm as TOML text, with an origin for every number; what `read_arm` reads back as the same arm."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint
from ident.description.quantities import Origin
from ident.text import one_line

NOTHING = 1e-12
"""Magnitude below which a length or inertia [SI] is rounding, and written as zero."""


def arm_text(arm: Arm, *, origin: Origin, guessed: tuple[str, ...] = (), note: str = "", head: str = "") -> str:
    """Return an arm without drives, belts and stroke as TOML, vectors along its own axes, in SI and degrees.

    Args:
        arm: the arm.
        origin: of its numbers.
        guessed: keys whose origin is `assumed` instead.
        note: a line that every joint and body gets.
        head: comment above it, without the `#`.
    """
    writer = _Writer(origin, guessed, note)
    lines = [f"# {one_line(line)}".rstrip() for line in head.splitlines()]
    lines += ['format = "ident-arm/1"', f"name = {_quoted(arm.name)}"]
    for joint in arm.joints:
        lines += ["", *writer.joint(joint)]
    for point in arm.points:
        lines += ["", "[[point]]", f'name = "{point.name}"', f'joint = "{point.joint}"']
        lines.append(writer.line("position", point.position, "m"))
    return "\n".join(lines) + "\n"


class _Writer:
    """Writes numbers with their origin."""

    def __init__(self, origin: Origin, guessed: tuple[str, ...], note: str):
        self.origin, self.guessed, self.note = origin, guessed, note

    def line(self, key: str, value: Any, unit: str = "") -> str:
        """Return a quantity."""
        units = f', unit = "{unit}"' if unit else ""
        origin = "assumed" if key in self.guessed else self.origin
        return f'{key} = {{ value = {_written(value)}{units}, origin = "{origin}" }}'

    def joint(self, joint: Joint) -> Iterator[str]:
        """Yield a joint with its bodies."""
        yield from ["[[joint]]", f'name = "{joint.name}"', self.line("axis", joint.axis)]
        yield self.line("offset", joint.offset, "m")
        for key, unit in (("k_bend", "N*m/rad"), ("k_tors", "N*m/rad"), ("tau_bend", "s"), ("tau_tors", "s")):
            yield self.line(key, getattr(joint, key), unit)
        if all(map(math.isfinite, joint.limits)):
            yield self.line("limits", np.degrees(joint.limits), "deg")
        if not joint.driven:
            yield "driven = false"
        for kind, bodies in (("shaft", joint.shaft), ("link", joint.link)):
            for body in bodies:
                yield from ["", f"[[joint.{kind}]]", *self.body(body)]

    def body(self, body: Body) -> Iterator[str]:
        """Yield the keys of a body."""
        note = f", note = {_quoted(self.note)} }}" if self.note else " }"
        yield f'name = "{body.name}"'
        yield self.line("mass", body.mass, "kg").removesuffix(" }") + note
        yield self.line("com", body.com, "m")
        inertia = np.asarray(body.inertia)
        diagonal = np.abs(inertia - np.diag(np.diag(inertia))).max() < NOTHING
        yield self.line("inertia", np.diag(inertia) if diagonal else inertia, "kg*m^2")


def _written(value: Any) -> str:
    """Return a number, vector or matrix as TOML, with twelve digits."""
    if np.ndim(value):
        return f"[{', '.join(map(_written, np.asarray(value)))}]"
    number = float(value)
    return f"{number:.12g}" if abs(number) > NOTHING else "0"


def _quoted(text: str) -> str:
    escaped = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
