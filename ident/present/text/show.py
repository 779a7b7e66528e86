"""An arm described in words: what looks odd, masses and reach, first modes, and every number with its origin."""

import math
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

from ident.arm.arm import Arm
from ident.arm.fields import fields_in
from ident.assess.arm_view import ArmView
from ident.present.text.words import cut, degrees, paragraphs

MIXED = "mixed"
"""Origin of a vector whose components have several."""


def show_report(view: ArmView) -> str:
    """Return what looks odd about an arm, its sums, first modes, and every number [SI] with its origin."""
    return paragraphs([_heading(view), _odd(view), _modes(view), _joints(view), _numbers(view)])


def sums(view: ArmView) -> str:
    """Return masses and reach in a line."""
    loads = [f"{solid.name} {solid.mass:.4g} kg" for solid in view.solids if solid.kind == "payload"]
    bodies = sum(solid.kind != "payload" for solid in view.solids)
    joints, driven = len(view.hinges), len(view.arm.driven)
    turning = "" if driven == joints else f", {driven} of them driven"
    payload = f"; payload: {', '.join(loads)}" if loads else ""
    mass = f"{bodies} bodies, {view.mass:.4g} kg{payload}"
    return f"{joints} joints{turning}; {mass}; reach when stretched {view.reach:.3g} m"


def _heading(view: ArmView) -> Iterator[str]:
    yield f"{cut(view.arm.name, 60)} at {degrees(view.posture)}"
    yield f"  {sums(view)}"
    origins = Counter(view.arm_file.origins.values())
    if origins:
        counted = ", ".join(f"{count} {origin}" for origin, count in origins.most_common())
        yield f"  {sum(origins.values())} numbers: {counted}"
    for note in view.arm_file.notes:
        yield textwrap.fill(f"  NOTE: {note}", 100, subsequent_indent="    ", break_long_words=False)


def _odd(view: ArmView) -> Iterator[str]:
    if view.failure:
        yield f"WARNING: no modes: {view.failure}"
    yield from (f"WARNING: {odd}" for odd in view.oddities)
    if not view.oddities and not view.failure:
        yield "Nothing looks odd: lengths, masses, inertias, stiffnesses and angles are of the kind that arms have."


def _modes(view: ArmView) -> Iterator[str]:
    analysis = view.analysis
    if not analysis:
        return
    yield "First modes under its own weight, and the joints that give most [% of the strain energy]"
    for i, label in enumerate(analysis.labels):
        shares = {f"{joint.name}.k_bend": float(analysis.modes.bend[j, i]) for j, joint in enumerate(view.arm.joints)}
        shares |= {f"{joint.name}.k_tors": float(analysis.modes.tors[j, i]) for j, joint in enumerate(view.arm.joints)}
        most = sorted(shares, key=lambda path: -shares[path])[:2]
        where = ", ".join(f"{path} {100 * shares[path]:.0f}" for path in most)
        yield f"  {i + 1}  {analysis.modes.frequency[i]:8.2f} Hz  {label!s:22s} {where}"
    name, moved = list(analysis.deflection.items())[-1]
    yield f"  {name} sags by {1e3 * float(np.linalg.norm(moved)):.3g} mm"


def _joints(view: ArmView) -> Iterator[str]:
    yield "Joints: axis of the pin in the zero posture, and its limits"
    for joint in view.arm.joints:
        axis = _vector(np.asarray(joint.axis))
        low, high = (math.degrees(limit) for limit in joint.limits)
        within = "turns freely" if math.isinf(low) else f"{low:.4g} to {high:.4g} deg"
        yield f"  {joint.name:18s} {f'({axis})':24s} {within if joint.driven else 'no pin: gives only'}"


def _numbers(view: ArmView) -> Iterator[str]:
    yield "Numbers, vectors in the axes of their joint; inertia about the mass centre: xx, yy, zz"
    yield f"  {'number':26s} {'value':>28s}  {'unit':10s} origin"
    for path, value, unit, origin in number_rows(view.arm, view.arm_file.origins):
        yield f"  {path:26s} {value:>28s}  {unit:10s} {origin}"


def number_rows(arm: Arm, origins: Mapping[str, str]) -> Iterator[tuple[str, str, str, str]]:
    """Yield path, value [SI], unit and origin of every number or vector."""
    for part in arm.parts():
        for field in fields_in(part):
            value = np.asarray(getattr(part, field.name))
            places = list(field.ends.values())
            path = f"{part.name}.{field.name}"
            given = {origins.get(f"{path}{end}", "") for end in field.ends}
            shown = _vector(np.array([value[place] for place in places]))
            yield path, shown, field.unit, given.pop() if len(given) == 1 else MIXED


def _vector(value: np.ndarray) -> str:
    return ", ".join(f"{x + 0.0:.5g}" for x in value.ravel())
