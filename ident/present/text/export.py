"""What was identified, as lines of a comment in a robot description."""

from collections.abc import Iterator

from ident.arm.arm import Arm
from ident.identify.identified import Identified
from ident.present.text.units import unit_of
from ident.text import one_line

SHOWN = ("k_bend", "k_tors", "tau_bend", "tau_tors")


def identified_lines(arm: Arm, found: Identified, date: str) -> list[str]:
    """Return where the bushings of an arm come from, and each of their numbers with its interval."""
    lines = [f"Bushings of {one_line(arm.name)}, identified by ident, {date}"]
    lines += [f"{word}: {one_line(path)}, SHA-256 {sha256}" for word, path, sha256 in found.sources]
    lines += [f"in doubt: {one_line(doubt)}" for doubt in found.doubts]
    return [*lines, "", *_numbers(arm, found)]


def _numbers(arm: Arm, found: Identified) -> Iterator[str]:
    for path in (f"{joint.name}.{field}" for joint in arm.joints for field in SHOWN):
        text = f"{path} = {float(arm.get(path)):.6g} {unit_of(path)}"
        if path not in found.values:
            yield f"{text}, not fitted"
        else:
            low, high = found.intervals[path]
            weak = "" if path in found.supported else ", which the data do not support"
            yield f"{text}, 95 % interval {low:.4g} to {high:.4g}{weak}"
