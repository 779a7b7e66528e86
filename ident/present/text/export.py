"""What was identified, as lines of a comment in a robot description."""

from collections.abc import Iterator

from ident.arm.arm import Arm
from ident.identify.identified import Identified
from ident.present.text.units import unit_of
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
