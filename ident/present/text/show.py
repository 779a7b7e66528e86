"""An arm described in words: what looks odd, masses and reach, first modes, and every number with its origin."""

import math
import textwrap
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.arm.arm import Arm
from ident.arm.fields import fields_in
from ident.assess.show import ArmNames, ArmView
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


# -------- Names
# The names of an arm as a list: what commands, options and campaigns take.


def names_report(
    names: ArmNames,
    kinds: Mapping[str, str],
    choices: Mapping[str, Sequence[str]],
    columns: Mapping[str, Sequence[str]],
) -> str:
    """Return every name of an arm, by what takes it.

    Args:
        names: of the arm.
        kinds: SI unit of each kind of measurement.
        choices: words that options have to choose from, by command and flag.
        columns: words that columns of a campaign have to choose from.
    """
    arm = names.arm_file.arm
    joints = [_joint(joint.name, joint.limits, joint.driven) for joint in arm.joints]
    loads = [f"  {each.body.name:26s} {float(each.body.mass):.4g} kg on {each.joint}" for each in arm.payloads]
    points = [f"  {point.name:26s} on {point.joint}" for point in arm.points]
    end = arm.points[-1].name if arm.points else "POINT"
    return paragraphs(
        [
            [f"Names of {cut(arm.name, 60)}"],
            [
                "Numbers [SI] (--set, --fix, --tie, --free, --change, ...), by a factor or a difference",
                *_number_names(names),
            ],
            ["Joints, in the order of --posture and of the columns q1, q2, ...", *joints],
            ["Points (column point; the last one is the end point)", *points] if points else [],
            [
                "Loads (--load, columns load and reference_load)",
                *loads,
                f"  '5 kg @ {end}', '20 N -z @ {end}', sums by ' + '",
            ],
            _mode_names(names),
            ["Kinds of measurement (column kind; --discrepancy), with the unit that a value is kept in"],
            [f"  {kind:26s} {unit}" for kind, unit in kinds.items()],
            ["Words that columns of a campaign choose from", *_words(columns)],
            ["Words that options choose from", *_words(choices)],
        ]
    )


def _number_names(names: ArmNames) -> Iterator[str]:
    for each in names.numbers:
        by = "factor" if each.factor else "difference"
        yield f"  {each.path:26s} {each.value + 0.0:>14.7g} {each.unit:10s} {each.origin:11s} {by}"


def _words(choices: Mapping[str, Sequence[str]]) -> Iterator[str]:
    yield from (f"  {name:26s} {', '.join(words)}" for name, words in choices.items())


def _rows(texts: Mapping[str, str]) -> Iterator[str]:
    yield from (f"  {name:26s} {text}" for name, text in texts.items())


def _joint(name: str, limits: tuple[float, float], driven: bool) -> str:
    low, high = (math.degrees(limit) for limit in limits)
    within = "turns freely" if math.isinf(low) else f"{low:.4g} to {high:.4g} deg"
    return f"  {name:26s} {within if driven else 'no pin'}"


def _mode_names(names: ArmNames) -> list[str]:
    if not names.modes:
        return []
    head = f"Modes at {degrees(names.posture)} under its own weight (column mode; also as 'vertical 1', 'torsion 2')"
    return [head, *_rows({label: f"{frequency:.4g} Hz" for label, frequency in names.modes})]
