"""The report of an arm: implausible numbers, masses and reach, first modes, every number; and of its names."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.fields import STIFFNESS, fields_in
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut, kept
from ident.report.words import counted, degrees, sentence
from ident.text import by_key

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.arm.parts import Joint
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.studies.look.arm_names import ArmNames
    from ident.studies.look.arm_view import ArmView


def show_sections(view: "ArmView") -> Report:
    """Return the report of an arm: implausible numbers, first modes, every number [SI] with its origin."""
    odd, failed, sag = view.oddities, [Finding(view.failure)] if view.failure else [], ""
    if view.analysis:
        name, moved = list(view.analysis.deflection.items())[-1]
        sag = f"Sag of {name}: {1e3 * float(np.linalg.norm(moved)):.3g} mm."
    lines, arm = view.arm_file.lines, view.arm
    found = [f"line {lines[each.path]}, {each}" if lines.get(each.path) else str(each) for each in odd]
    note = "Vectors in the axes of their joint; inertia about the mass centre: xx, yy, zz."
    numbers = by_head(("number", "value", "unit", "origin"), number_rows(arm, view.arm_file.origins), note=note)
    joints = ((joint.name, f"({_vector(np.asarray(joint.axis))})", _limits(joint)) for joint in arm.joints)
    axes = by_head(("joint", "axis of the pin in the zero posture", "limits"), joints)
    return Report(
        f"{cut(arm.name, 60)} at {degrees(view.posture)}: {sums(view)}",
        _verdict(view),
        (_modes(view.analysis),) if view.analysis else (),
        (*failed, *map(Finding, found)),
        sag,
        "" if odd or failed else "ident plan --arm {arm}",
        (Section("Joints", (axes,)), Section("Numbers", (numbers,))),
    )


def sums(view: "ArmView") -> str:
    """Return masses and reach in a line."""
    loads = [f"{solid.name} {solid.mass:.4g} kg" for solid in view.solids if solid.kind == "payload"]
    joints, driven = len(view.hinges), len(view.arm.driven)
    turning = "" if driven == joints else f", {driven} of them driven"
    payload = f"; payload: {', '.join(loads)}" if loads else ""
    mass = f"{len(view.solids) - len(loads)} bodies, {view.mass:.4g} kg{payload}"
    return f"{joints} joints{turning}; {mass}; reach {view.reach:.3g} m"


def _verdict(view: "ArmView") -> Verdict:
    """Judge an arm by the plausibility checks of its numbers, and by whether it has modes."""
    origins = Counter(view.arm_file.origins.values())
    counts = ", ".join(f"{count} {origin}" for origin, count in origins.most_common())
    numbers = f"{sum(origins.values())} numbers: {counts}" if origins else ""
    if odd := len(view.oddities):
        word = "1 NUMBER LOOKS WRONG" if odd == 1 else f"{odd} NUMBERS LOOK WRONG"
        file = cut(view.arm_file.path, 50) or "the arm"
        return Verdict(word, sentence(f"correct {file} before you measure or fit. {numbers}"), "bad")
    if view.failure:
        return Verdict("NO MODES", sentence(f"every number is plausible alone, but {view.failure}. {numbers}"), "bad")
    passed = "Lengths, masses, inertias, stiffnesses and angles are in the range usual for robot arms."
    return Verdict("PLAUSIBLE", f"{passed} {sentence(numbers) if numbers else ''}".rstrip(), "good")


def _modes(analysis: "ModalAnalysis") -> Table:
    """Return the first modes."""
    modes = enumerate(zip(analysis.labels, analysis.modes.frequency.tolist(), strict=False))
    rows = ((i + 1, str(label), hz, largest_shares(analysis, i)) for i, (label, hz) in modes)
    heads = "no.|d", "first modes under own weight", "frequency [Hz]|.2f", "largest shares of strain energy"
    return by_head(heads, rows)


def largest_shares(analysis: "ModalAnalysis", i: int) -> str:
    """Name the two bushing stiffnesses with the largest shares of the strain energy of the i-th mode."""
    shares = {
        f"{joint.name}.{stiffness}": float(share[j, i])
        for stiffness, share in (("k_bend", analysis.modes.bend), ("k_tors", analysis.modes.tors))
        for j, joint in enumerate(analysis.arm.joints)
        if getattr(joint, stiffness) is not None
    }
    most = sorted(shares, key=lambda path: -shares[path])[:2]
    return ", ".join(f"{path} {100 * shares[path]:.0f} %" for path in most)


def _limits(joint: "Joint") -> str:
    low, high = (math.degrees(limit) for limit in joint.limits)
    within = "turns freely" if math.isinf(low) else f"{low:.4g} to {high:.4g} deg"
    return within if joint.driven else "no pin: elastic only"


def number_rows(arm: "Arm", origins: Mapping[str, str]) -> Iterator[tuple[str, str, str, str]]:
    """Yield path, value [SI], unit and origin of every number or vector."""
    for part in arm.parts():
        for field in fields_in(part):
            value = np.asarray(getattr(part, field.name))
            places = list(field.ends.values())
            path = f"{part.name}.{field.name}"
            given = {origins.get(f"{path}{end}", "") for end in field.ends}
            shown = _vector(np.array([value[place] for place in places]))
            yield path, shown, field.unit, given.pop() if len(given) == 1 else "mixed"
        yield from ((f"{part.name}.{k}", "rigid", "", "") for k in STIFFNESS if getattr(part, k, "") is None)


def _vector(value: np.ndarray) -> str:
    return ", ".join(f"{x + 0.0:.5g}" for x in value.ravel())


# -------- Names
# The names of an arm, for commands, options and campaigns.

Choices = Mapping[str, Sequence[str]]


def names_sections(names: "ArmNames", kinds: Mapping[str, str], choices: Choices, columns: Choices) -> Report:
    """Return every name of an arm by use: in short, and with values, units and limits in the details.

    Args:
        names: of the arm.
        kinds: SI unit of each kind of measurement.
        choices: allowed words of options, by command and flag.
        columns: allowed words of campaign columns.
    """
    arm = names.arm_file.arm
    end = arm.points[-1].name if arm.points else "POINT"
    loads = [payload.body.name for payload in arm.payloads]
    examples = ", ".join(map(kept, (f"'5 kg @ {end}'", f"'20 N -z @ {end}'", "sums by ' + '")))
    lines = [
        "Numbers (--set, --fix, --tie, --free, --change, ...):",
        *(f"  {line}" for line in _grouped([each.path for each in names.numbers])),
        f"Joints, in the order of --posture and of the columns q1, q2, ...: {_listed(j.name for j in arm.joints)}",
        f"Points (column point; the last one is the end point): {_listed(point.name for point in arm.points)}",
        f"Loads (--load, columns load and reference_load): {_listed(loads)}; {examples}",
        f"Modes (column mode; also as 'vertical 1', 'torsion 2'): {_listed(label for label, _ in names.modes)}",
        f"Kinds of measurement (column kind; --discrepancy): {_listed(kinds)}",
    ]
    counts = {"number": names.numbers, "joint": arm.joints, "point": arm.points, "load": loads}
    subject = ", ".join(counted(len(each), noun) for noun, each in counts.items())
    details = tuple(_names_details(names, kinds, choices, columns))
    return Report(f"Names of {cut(arm.name, 60)}: {subject}", answer=tuple(lines), details=details)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _grouped(paths: Sequence[str]) -> Iterator[str]:
    """Yield the paths of numbers, parts of the same kind together: `joint1, joint2: offset.x/y/z, k_bend`."""
    fields: dict[str, dict[str, list[str]]] = {}
    for path in paths:
        part, field, *end = path.split(".")
        fields.setdefault(part, {}).setdefault(field, []).extend(end)
    parts = by_key(
        (", ".join(f"{field}{'.' * bool(ends)}{'/'.join(ends)}" for field, ends in own.items()), part)
        for part, own in fields.items()
    )
    yield from (f"{', '.join(names)}: {words}" for words, names in parts.items())


def _names_details(
    names: "ArmNames", kinds: Mapping[str, str], choices: Choices, columns: Choices
) -> Iterator[Section]:
    arm = names.arm_file.arm
    ways = {True: "factor", False: "difference"}
    numbers = [(each.path, each.value + 0.0, each.unit, each.origin, ways[each.factor]) for each in names.numbers]
    loads = [(each.body.name, float(each.body.mass), each.joint) for each in arm.payloads]
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[Any]]]] = {
        "Numbers [SI]": (("number", "value|.7g", "unit", "origin", "changed by"), numbers),
        "Joints": (("joint", "limits"), [(joint.name, _limits(joint)) for joint in arm.joints]),
        "Points": (("point", "on joint"), [(point.name, point.joint) for point in arm.points]),
        "Loads": (("load", "mass [kg]|.4g", "on joint"), loads),
        f"Modes at {degrees(names.posture)} under own weight": (("mode", "frequency [Hz]|.4g"), names.modes),
        "Kinds of measurement": (("kind", "unit in which a value is stored"), [*kinds.items()]),
    }
    yield from (Section(title, (by_head(*table),)) for title, table in tables.items() if table[1])
    for title, every in {"columns of a campaign": columns, "options": choices}.items():
        words = tuple(f"{name}: {', '.join(each)}" for name, each in every.items())
        yield Section(f"Words that {title} choose from", words)
