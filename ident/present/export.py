"""What was identified, as a comment in a robot description; what is said of an explored arm and of a rerun."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ident.arm.arm import Arm, stiffness_paths
from ident.assess.repetition import SAME, Difference
from ident.present.predict import values_used
from ident.present.report import Finding, Report, Section, Table, Verdict, cut, short_power
from ident.present.words import counted, unit_of
from ident.text import one_line

if TYPE_CHECKING:
    from ident.assess.explore import Exploration
    from ident.identify.values import Identified, Values

SHOWN = ("k_bend", "k_tors", "tau_bend", "tau_tors")


def identified_lines(arm: Arm, found: "Identified", date: str, posture: tuple[float, ...] | None = None) -> list[str]:
    """Return where the bushings of an arm come from, each of their numbers with its interval, and what else was fitted.

    Args:
        arm: the arm that was identified.
        found: what was identified.
        date: of today.
        posture: [deg] where springs are tangent to its bushings.
    """
    lines = [f"Bushings of {one_line(arm.name)}, identified by ident, {date}"]
    lines += [f"{word}: {one_line(path)}, SHA-256 {sha256}" for word, path, sha256 in found.sources]
    lines += [f"in doubt: {one_line(doubt)}" for doubt in found.doubts]
    if arm.base is not None:
        height = float(arm.joints[1].offset[2])
        lines.append(f"{arm.base.name}: a base that gives about a point {height:g} m below {arm.joints[1].name}")
    if posture is not None:
        angles = ", ".join(f"{angle:g}" for angle in posture)
        lines.append(f"springs: tangent to the bushings under the arm's own weight at {angles} deg")
    return [*lines, "", *_numbers(arm, found)]


def _numbers(arm: Arm, found: "Identified") -> Iterator[str]:
    own = set(arm.paths())
    bushings = [path for joint in arm.joints for field in SHOWN if (path := f"{joint.name}.{field}") in own]
    for path in (*bushings, *(path for path in found.values if path in own and path not in bushings)):
        text = f"{path} = {float(arm.get(path)):.6g} {unit_of(path)}"
        if path in found.intervals:
            low, high = found.intervals[path]
            weak = "" if path in found.supported else ", which the data do not support"
            yield f"{text}, 95 % interval {low:.4g} to {high:.4g}{weak}"
        else:
            yield f"{text}, {'by measured damping ratios' if path in found.values else 'not fitted'}"


# -------- Explore
# What `ident explore` prints: what the page that it has written contains.


def explore_sections(
    exploration: "Exploration",
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    changed: Mapping[str, float] | None = None,
) -> Report:
    """Say which sliders the page has, and which values it begins with.

    Args:
        exploration: what the page knows of the arm.
        fit: fitted values that the arm has taken over.
        posterior: draws that the marks are from.
        changed: numbers that were set, by path [SI].
    """
    arm, carried = exploration.arm, exploration.carried
    on_stroke = "place on the stroke" + " and speed" * bool(arm.drives)
    place = on_stroke if exploration.stroke else f"{len(arm.driven)} joint angles"
    mass = f"mass of {cut(carried.name, 30)}" if carried.kind == "payload" else f"mass at {cut(carried.name, 30)}"
    origin, cautions = values_used(fit, posterior, changed or {})
    lines = [f"Sliders: {len(stiffness_paths(arm))} stiffnesses, {mass} up to {carried.largest:g} kg, {place}."]
    lines += [f"Always on the arm: {exploration.fixed}."] if exploration.fixed else []
    lines += [f"Marks of 5 to 95 % at {len(exploration.bands)} stiffnesses."] if exploration.bands else []
    subject = f"{cut(arm.name, 60)} as a page to explore: open it in a browser"
    return Report(subject, answer=(*lines, *origin), findings=cautions)


def explore_rows(exploration: "Exploration") -> list[dict[str, Any]]:
    """Return a row for each number that has a slider."""
    arm, carried = exploration.arm, exploration.carried
    rows = [{"name": p, "value": float(arm.get(p)), "unit": unit_of(p)} for p in stiffness_paths(arm)]
    return [*rows, {"name": f"{carried.kind} {carried.name}", "value": carried.present, "unit": "kg"}]


# -------- Rerun
# What the repetition of a result has shown.

SHOWN_OF_RERUN = 10
"""Differences that the first screen lists."""


def rerun_sections(repeated: Report, differences: Sequence[Difference], rows: int, *, sampled: bool) -> Report:
    """Return whether the numbers of a result are those of its file.

    Args:
        repeated: what the repetition itself says.
        differences: numbers that differ.
        rows: of its table.
        sampled: whether they may differ by a Monte Carlo error.
    """
    within = "within their Monte Carlo error" if sampled else f"to {short_power(f'{SAME:g}')}"
    subject = f"Repeated: {repeated.subject}"
    if not differences:
        reason = f"{counted(rows, 'row')} of numbers agree{'s' * (rows == 1)} with the file {within}."
        return Report(subject, Verdict("SAME", reason, "good"))
    count = len(differences)
    reason = f"{counted(count, 'number')} do{'es' * (count == 1)} not agree with the file {within}."
    cells = tuple((str(each.row + 1), each.column, _cell(each.before), _cell(each.now)) for each in differences)
    every, hidden = Table("", ("row", "column", "in the file", "now"), cells), count - SHOWN_OF_RERUN
    table = replace(every, rows=cells[:SHOWN_OF_RERUN])
    return Report(
        subject,
        Verdict("DIFFERENT", reason, "bad"),
        (table, *([f"{hidden} more numbers differ."] if hidden > 0 else [])),
        (Finding("inputs and options are those of the file", "compare the versions under `software` in the file"),),
        details=(Section("All differences", (every,)),) if hidden > 0 else (),
    )


def _cell(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else cut(str(value), 30)
