"""The file of resonance along a motion: a Campbell diagram in numbers, with where it comes from."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.assess.basis import Basis
from ident.present.files.basis import motion_document, origin, values_document
from ident.present.files.document import plain
from ident.present.text.resonance import passage_words
from ident.present.text.resonance_words import grouped
from ident.vibrate.modal.branches import Branches
from ident.vibrate.modal.excitation import Excitation
from ident.vibrate.modal.resonance import ResonanceCrossing

FORMAT = "ident-resonance/2"
OWN = ("branch", "start", "end", "time", "posture", "natural", "excitation", "damping_ratio", "margin", "rate")
JUDGED = ("crossings", "distance", "relative_distance", "cycles", "sweep_number", "magnification", "built_up")
SHARES = ("probability", "crossing_probability")


def resonance_document(
    basis: Basis,
    branches: Branches,
    excitation: Excitation,
    crossings: Sequence[ResonanceCrossing],
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Describe a Campbell diagram as plain data, all numbers SI and frequencies in Hz."""
    document = {
        **origin(FORMAT, basis, options),
        **motion_document(basis),
        "time": branches.time,
        "posture": branches.posture,
        "draws": branches.batch_size,
        "branches": [_branch(branches, b) for b in range(len(branches.labels))],
        "veerings": [{"time": v.time, "branches": v.branches, "mac": v.mac} for v in branches.veerings],
        "excitation": [
            {"drive": s.drive, "joint": s.joint, "pulley": s.pulley, "order": s.order, "frequency": line}
            for s, line in zip(excitation.sources, excitation.frequency, strict=True)
        ],
        "resonance_crossings": [
            _crossing(crossing, number)
            for number, group in enumerate(grouped(crossings), start=1)
            for crossing in group
        ],
        **values_document(basis),
    }
    return plain(document)


def crossing_rows(crossings: Sequence[ResonanceCrossing]) -> list[dict[str, Any]]:
    """Return resonance crossings as rows, numbered as in the report: times [s], frequencies [Hz], ratios."""
    names = ("start", "end", "time", "natural", "excitation", *JUDGED[1:], *SHARES)
    return [
        _head(crossing, number) | {name: getattr(crossing, name) for name in names}
        for number, group in enumerate(grouped(crossings), start=1)
        for crossing in group
    ]


def _branch(branches: Branches, b: int) -> dict[str, Any]:
    changes = [change for change in branches.changes if change.branch == b]
    return {
        "label": str(branches.labels[b]),
        "frequency": branches.median[b],
        "damping_ratio": branches.median_damping_ratio[b],
        "band_5_95": branches.band()[:, b] if branches.batch_size else None,
        "changes": [{"time": c.time, "before": str(c.before), "after": str(c.after)} for c in changes],
    }


def _crossing(crossing: ResonanceCrossing, number: int) -> dict[str, Any]:
    values = {name: getattr(crossing, name) for name in (*OWN, *JUDGED, *SHARES)}
    return _head(crossing, number) | values | {"words": passage_words(crossing)}


def _head(crossing: ResonanceCrossing, number: int) -> dict[str, Any]:
    source = crossing.source
    return {"number": number, "drive": source.drive, "order": source.order, "label": str(crossing.label)}
