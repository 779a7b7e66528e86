"""What was identified, as a comment in a robot description; the printed reports of explore and rerun."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ident.arm.arm import Arm, stiffness_paths
from ident.assess.explore import Exploration
from ident.assess.repetition import SAME, Difference
from ident.identify.values import Identified, Values
from ident.present.text.basis import changes_in_words, values_in_words
from ident.present.text.words import cut, paragraphs, unit_of
from ident.text import one_line

SHOWN = ("k_bend", "k_tors", "tau_bend", "tau_tors")


def identified_lines(arm: Arm, found: Identified, date: str, posture: tuple[float, ...] | None = None) -> list[str]:
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


def _numbers(arm: Arm, found: Identified) -> Iterator[str]:
    bushings = [f"{joint.name}.{field}" for joint in arm.joints for field in SHOWN]
    own = set(arm.paths())
    for path in (*bushings, *(path for path in found.values if path in own and path not in bushings)):
        text = f"{path} = {float(arm.get(path)):.6g} {unit_of(path)}"
        if path not in found.values:
            yield f"{text}, not fitted"
        else:
            low, high = found.intervals[path]
            weak = "" if path in found.supported else ", which the data do not support"
            yield f"{text}, 95 % interval {low:.4g} to {high:.4g}{weak}"


# -------- Explore
# What `ident explore` prints: what the page it has written is about.


def explore_report(
    exploration: Exploration,
    *,
    fit: Values | None = None,
    posterior: Values | None = None,
    changed: Mapping[str, float] | None = None,
) -> str:
    """Say which sliders the page has, and what its numbers begin with.

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
    head = [
        f"{cut(arm.name, 60)}, to be explored in a browser",
        f"  sliders: {len(stiffness_paths(arm))} stiffnesses, {mass} up to {carried.largest:g} kg, {place}",
        f"  always on it: {exploration.fixed}" if exploration.fixed else "",
        f"  marks of 5 to 95 % at {len(exploration.bands)} stiffnesses" if exploration.bands else "",
        *values_in_words(fit, posterior),
        *changes_in_words(changed or {}),
    ]
    return paragraphs([filter(None, head)])


def slider_rows(exploration: Exploration) -> list[dict[str, Any]]:
    """Return a row for each number that has a slider."""
    arm, carried = exploration.arm, exploration.carried
    rows = [{"name": p, "value": float(arm.get(p)), "unit": unit_of(p)} for p in stiffness_paths(arm)]
    return [*rows, {"name": f"{carried.kind} {carried.name}", "value": carried.present, "unit": "kg"}]


# -------- Rerun
# What the repetition of a result has shown.

SHOWN_OF_RERUN = 10
"""Differences that are listed."""


def rerun_report(differences: Sequence[Difference], rows: int, *, sampled: bool) -> str:
    """Return whether the numbers of a result are those of its file.

    Args:
        differences: numbers that are not.
        rows: of its table.
        sampled: whether they may differ by a Monte Carlo error.
    """
    return paragraphs([_verdict(differences, rows, sampled)])


def _verdict(differences: Sequence[Difference], rows: int, sampled: bool) -> Iterator[str]:
    within = "within their Monte Carlo error" if sampled else f"to {SAME:g}"
    if not differences:
        yield f"The same as in the file: {rows} row{'s' * (rows != 1)} of numbers agree {within}."
        return
    count = len(differences)
    yield f"NOT the same as in the file: {count} number{'s do' if count > 1 else ' does'} not agree {within}."
    yield from map(_line, differences[:SHOWN_OF_RERUN])
    if count > SHOWN_OF_RERUN:
        yield f"  and {count - SHOWN_OF_RERUN} more"


def _line(difference: Difference) -> str:
    place = f"row {difference.row + 1}, {cut(difference.column, 24)}"
    return f"  {place:34s} {_cell(difference.before)} in the file, now {_cell(difference.now)}"


def _cell(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else cut(str(value), 30)
