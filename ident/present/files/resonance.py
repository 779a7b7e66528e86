"""Resonance along a motion, as rows."""

from collections.abc import Sequence
from typing import Any

from ident.present.text.resonance_words import grouped
from ident.vibrate.modal.resonance import ResonanceCrossing

COLUMNS = (
    *("start", "end", "time", "natural", "excitation", "distance", "relative_distance"),
    *("amplitude", "cycles", "sweep_number", "magnification", "built_up", "probability", "crossing_probability"),
)


def resonance_rows(crossings: Sequence[ResonanceCrossing]) -> list[dict[str, Any]]:
    """Return resonance crossings as rows, numbered as in the report: times [s], frequencies [Hz], amplitude [m]."""
    return [
        _head(crossing, number) | {name: getattr(crossing, name) for name in COLUMNS}
        for number, group in enumerate(grouped(crossings), start=1)
        for crossing in group
    ]


def _head(crossing: ResonanceCrossing, number: int) -> dict[str, Any]:
    source = crossing.source
    return {"number": number, "drive": source.drive, "order": source.order, "label": str(crossing.label)}
