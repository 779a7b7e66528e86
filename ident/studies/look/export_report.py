"""Identified numbers, as a comment in a robot description."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ident.arm.arm import Arm
from ident.report.words import unit_of
from ident.text import one_line

if TYPE_CHECKING:
    from ident.identify.values import Identified

SHOWN = ("k_bend", "k_tors", "tau_bend", "tau_tors")


def identified_lines(arm: Arm, found: "Identified", date: str, posture: tuple[float, ...] | None = None) -> list[str]:
    """Return the source of an arm's bushings, each of their numbers with its interval, and other fitted numbers.

    Args:
        arm: the identified arm.
        found: the identified numbers.
        date: of today.
        posture: [deg] at which the springs are tangent to the bushings.
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
