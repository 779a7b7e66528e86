"""What figure and report of resonance say alike: numbers of resonance crossings, names of what excites."""

from collections.abc import Sequence

import numpy as np

from ident.present.text.units import MM
from ident.vibrate.modal.branches import BAND, Branches
from ident.vibrate.modal.excitation import Excitation, Source
from ident.vibrate.modal.resonance import ResonanceCrossing

SAME = 1e-6
"""Distance in time [s] or relative in frequency within which two are one."""
SMALL = 1e-4
"""Vibration [m] from which on it is told in mm."""


def grouped(crossings: Sequence[ResonanceCrossing]) -> list[list[ResonanceCrossing]]:
    """Put crossings of one branch in the same interval together, as of pulleys that turn alike; the order stays."""
    groups: list[list[ResonanceCrossing]] = []
    for crossing in crossings:
        same = next((group for group in groups if _together(group[0], crossing)), None)
        if same is None:
            groups.append([crossing])
        else:
            same.append(crossing)
    return groups


def caused_words(group: Sequence[ResonanceCrossing]) -> str:
    """Say the vibration that crossings of one mode at one time cause together: 0.7 mm, or 12 um."""
    size = sum(crossing.amplitude for crossing in group)
    return f"{MM * size:.3g} mm" if size >= SMALL else f"{1e6 * size:.3g} um"


def same_lines(excitation: Excitation) -> list[list[int]]:
    """Put sources together whose frequencies are the same all the time."""
    groups: list[list[int]] = []
    for i, line in enumerate(excitation.frequency):
        scale = SAME * max(float(line.max()), SAME)
        same = next((g for g in groups if np.abs(excitation.frequency[g[0]] - line).max() <= scale), None)
        if same is None:
            groups.append([i])
        else:
            same.append(i)
    return groups


def sources_words(sources: Sequence[Source]) -> str:
    """Name what excites: `pulleys 1 and 3`, `pulley 2, pulley 1 x 2`."""
    orders = sorted({source.order for source in sources})
    return ", ".join(_of_order([source for source in sources if source.order == order]) for order in orders)


def band_words(branches: Branches) -> str:
    """Say what the bands are."""
    low, high = BAND
    return f"{low:g} to {high:g} % of {branches.batch_size} draws"


def _of_order(sources: Sequence[Source]) -> str:
    if len(sources) == 1:
        return str(sources[0])
    *most, last = (str(source.pulley) for source in sources)
    order = f" x {sources[0].order}" if sources[0].order > 1 else ""
    return f"pulleys {', '.join(most)} and {last}{order}"


def _together(one: ResonanceCrossing, other: ResonanceCrossing) -> bool:
    apart = max(abs(one.start - other.start), abs(one.end - other.end), abs(one.time - other.time))
    return one.branch == other.branch and apart < SAME
