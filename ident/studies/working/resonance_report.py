"""The report of pulley frequencies crossing natural frequencies along a motion, and its table."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.report.report import Finding, Part, Report, Section, Table, Verdict, by_head
from ident.report.words import MM, counted, degrees, percent
from ident.studies.basis import (
    alike,
    assumed_section,
    assumption_findings,
    basis_findings,
    subject,
    without_transmission_error,
)
from ident.vibrate.branches import BAND, Branches
from ident.vibrate.resonance import MARGIN, QUASI_STEADY, Excitation, ResonanceCrossing, Source

if TYPE_CHECKING:
    from ident.studies.scenario import Basis

# -------- Words
# Shared by figure and report: numbers of resonance crossings, names of the excitation.

SAME = 1e-6
"""Distance in time [s] or relative in frequency below which two are the same."""
SMALL = 1e-4
"""Vibration [m] from which it is given in mm."""


def grouped(crossings: Sequence[ResonanceCrossing]) -> list[list[ResonanceCrossing]]:
    """Group crossings of one branch in the same interval, as from pulleys with equal speed; the order stays."""

    def together(one: ResonanceCrossing, other: ResonanceCrossing) -> bool:
        apart = max(abs(one.start - other.start), abs(one.end - other.end), abs(one.time - other.time))
        return one.branch == other.branch and apart < SAME

    return alike(crossings, together)


def caused_words(group: Sequence[ResonanceCrossing]) -> str:
    """Write the vibration that crossings of one mode at one time cause together: 0.7 mm, or 12 um."""
    size = sum(crossing.amplitude for crossing in group)
    return f"{MM * size:.3g} mm" if size >= SMALL else f"{1e6 * size:.3g} um"


def same_lines(excitation: Excitation) -> list[list[int]]:
    """Group sources whose frequencies are always equal."""
    lines = excitation.frequency

    def same(first: int, other: int) -> bool:
        return bool(np.abs(lines[first] - lines[other]).max() <= SAME * max(float(lines[other].max()), SAME))

    return alike(range(len(lines)), same)


def sources_words(sources: Sequence[Source]) -> str:
    """Name the excitation: `pulleys 1 and 3`, `pulley 2, pulley 1 x 2`."""
    orders = sorted({source.order for source in sources})
    return ", ".join(_of_order([source for source in sources if source.order == order]) for order in orders)


def band_words(branches: Branches) -> str:
    """Explain the bands."""
    low, high = BAND
    return f"{low:g} to {high:g} % of {branches.batch_size} draws"


def _of_order(sources: Sequence[Source]) -> str:
    *most, last = (str(source.pulley) for source in sources)
    order = f" x {sources[0].order:g}" if sources[0].order != 1 else ""
    return f"pulleys {', '.join(most)} and {last}{order}" if most else str(sources[0])


# -------- Report

STEADY, FAST = 0.9, 0.5
"""Share of the steady amplitude from which a mode counts as built up, and below which as passed too fast."""
UNSURE = 0.99
"""Share of the draws and postures with reliable mode tracking."""
LISTED = 8
"""Crossings on the first screen."""

Group = Sequence[ResonanceCrossing]
"""Crossings of pulleys with equal speed with one mode."""


def resonance_sections(
    basis: "Basis",
    branches: Branches,
    excitation: Excitation,
    crossings: Sequence[ResonanceCrossing],
    margin: float = 100 * MARGIN,
) -> Report:
    """Return the report of resonance along a motion.

    Args:
        basis: arm and motion.
        branches: natural frequencies along it.
        excitation: frequencies of the pulleys.
        crossings: where both meet or come near, sorted by the vibration they cause.
        margin: distance that counts as near [% of the natural frequency].
    """
    margin /= 100
    groups = grouped(crossings)
    hidden = len(groups) - LISTED
    note = f"{counted(hidden, 'more crossing')}, weaker: --details" if hidden > 0 else ""
    return Report(
        f"Resonances of {subject(basis)}: {branches.time[0]:.4g} to {branches.time[-1]:.4g} s",
        _verdict(branches, groups, margin),
        (crossings_table(branches, groups[:LISTED], note),) if groups else (),
        tuple(_findings(basis, branches, excitation)),
        next="ident simulate {arm}",
        details=tuple(_details(basis, branches, excitation, groups, margin)),
    )


def _verdict(branches: Branches, groups: Sequence[Group], margin: float) -> Verdict:
    """Judge a motion: RESONANCE if a pulley crosses a natural frequency, NEAR within the margin, else CLEAR."""
    if not groups:
        modes = counted(len(branches.labels), "natural frequency").replace("ys", "ies")
        return Verdict("CLEAR", f"No pulley comes within {100 * margin:.3g} % of the {modes} followed.", "good")
    met = sum(bool(group[0].crossings) for group in groups)
    near = f"{len(groups) - met} within {100 * margin:.3g} %" if len(groups) > met else ""
    counts = " and ".join(filter(None, [counted(met, "crossing") if met else "", near]))
    reason = f"{_meeting(branches, groups[0])}. Total: {counts}."
    return Verdict("RESONANCE", reason, "bad") if met else Verdict("NEAR", reason, "caution")


def _meeting(branches: Branches, group: Group) -> str:
    """Describe a crossing in one sentence: `Pulley 2 (drive2) crosses lateral torsion 1 at 13.61 s, 7.63 Hz: ...`."""
    e = group[0]
    who = sources_words([crossing.source for crossing in group])
    many = "" if len(group) > 1 else "s"
    near = f"come{many} within {100 * e.relative_distance:.1f} % ({e.distance:.2g} Hz) of"
    does = f"cross{'es' * bool(many)}" if e.crossings else near
    chance = f"; near in {percent(e.probability)} of {branches.batch_size} draws" if branches.batch_size else ""
    drives = ", ".join(dict.fromkeys(crossing.source.drive for crossing in group))
    return (
        f"{who[:1].upper()}{who[1:]} ({drives}) {does} {e.label} at {e.time:.2f} s, {e.natural:.2f} Hz: "
        f"the vibration reaches {caused_words(group)}, {percent(e.built_up)} of that at steady resonance{chance}"
    )


def passage(crossing: ResonanceCrossing) -> str:
    """Say how far the mode builds up."""
    if not crossing.crossings:
        return "does not cross"
    if crossing.built_up >= STEADY:
        return "builds up fully"
    return "builds up in part" if crossing.built_up >= FAST else "passes too fast"


def crossings_table(branches: Branches, groups: Sequence[Group], note: str = "") -> Table:
    """Return the crossings: excitation, mode, time, and vibration."""
    drawn, rows = branches.batch_size > 0, []
    for number, group in enumerate(groups, 1):
        e = group[0]
        who = sources_words([crossing.source for crossing in group])
        distance = "crosses" if e.crossings else f"{100 * e.relative_distance:.1f} %"
        share = (percent(e.probability),) if drawn else ()
        size, built_up = caused_words(group), percent(e.built_up)
        rows.append((str(number), who, str(e.label), e.time, e.natural, distance, size, built_up, *share))
    heads = "", "excitation", "mode", "at [s]|.2f", "f [Hz]|.2f", "distance", "vibration", "built up"
    return by_head((*heads, *["near"] * drawn), rows, note=note)


def _findings(basis: "Basis", branches: Branches, excitation: Excitation) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    for veering in branches.veerings:
        names = " and ".join(str(branches.labels[b]) for b in veering.branches)
        text = f"veering at {veering.time:.3f} s: {names} exchange shapes (MAC {veering.mac:.2f}) faster than resolved"
        yield Finding(text, "beyond it their names may be swapped: trust the frequencies")
    if branches.batch_size and min(branches.likeness) < UNSURE:
        share = percent(1 - min(branches.likeness))
        yield Finding(f"in {share} of draws and postures a mode hardly matches (MAC below 0.5): a band mixes two modes")
    yield from basis_findings(basis)
    yield from assumption_findings(basis)
    if without_transmission_error(basis):
        text, remedy = "order 2 causes no vibration, as transmission error is set to 0", "--set drive1.error=..."
        if all(source.order != 2 for source in excitation.sources):
            text = "transmission error is set to 0, so twice the pulley frequencies were not checked"
            remedy = "check it with --orders 1,2"
        yield Finding(text, remedy)


# -------- Details


def _details(
    basis: "Basis", branches: Branches, excitation: Excitation, groups: Sequence[Group], margin: float
) -> Iterator[Section]:
    lines = zip(excitation.sources, excitation.frequency, strict=True)
    peaks = ", ".join(f"{source} ({source.drive}) up to {line.max():.2f} Hz" for source, line in lines)
    yield Section("Pulley frequencies", (f"{peaks}.",))
    if groups:
        drawn = ", times the share of draws that meet it" * (branches.batch_size > 0)
        title = f"Resonance crossings, by the vibration they cause{drawn}"
        yield Section(title, tuple(_crossings(branches, groups, margin)))
    yield _branches(branches)
    further = " (and those of its `errors`)" if any(drive.errors for drive in basis.arm.drives) else ""
    meaning = (
        "Natural frequencies are those of the arm held at each posture. A pulley turns at |ratio qd| / 2 pi as seen "
        f"from its shaft; order 1 is its imbalance, order 2{further} the transmission error of its drive."
    )
    yield Section("What the frequencies are", (meaning,))
    yield from assumed_section(basis)


def passages_table(branches: Branches, groups: Sequence[Group]) -> Table:
    """Return how each crossing passes: when, at which posture, how far apart, and how far the mode builds up."""
    drawn, rows = branches.batch_size > 0, []
    for number, (e, *_) in enumerate(groups, 1):
        span, posture = f"{e.start:.2f} to {e.end:.2f}", degrees(e.posture).removesuffix(" deg")
        last = percent(e.crossing_probability) if drawn else e.sweep_number
        rows.append((str(number), span, posture, e.distance, e.magnification, passage(e), last))
    heads = "", "near [s]", "posture [deg]", "distance [Hz]|.2g", "magnification|.3g", "passage"
    return by_head((*heads, "cross" if drawn else "sweep number|.3g"), rows)


def _crossings(branches: Branches, groups: Sequence[Group], margin: float) -> Iterator[Part]:
    drawn = branches.batch_size > 0
    if len(groups) > LISTED:
        yield crossings_table(branches, groups)
    yield passages_table(branches, groups)
    yield (
        f"near: within {100 * margin:.3g} % of the natural frequency, or its half-power bandwidth if wider. vibration: "
        "largest vibration of the end point along the mode's motion, by these pulleys alone with the worst phases, "
        "while they are near and the mode swells; by the fast method. A mode of a similar frequency that moves the end "
        "point the same way is included."
    )
    yield (
        "magnification: largest amplitude over the static response to the same force, of one mode at constant force, "
        "passed at the true rate from rest. built up: the same over steady resonance, 1/(2 zeta)."
    )
    of_draws = (
        f"near, cross: share of the {branches.batch_size} draws for which the pulley comes near the natural frequency "
        "in this interval, or crosses it; all else holds for the medians."
    )
    of_one = (
        f"sweep number: rate of the pulley relative to the mode [Hz/s] / (zeta f)^2. Up to {QUASI_STEADY:g} the "
        "response is nearly steady (ISO 7626-2); far above, the pulley passes too fast for the mode to build up "
        "(Lewis, 1932)."
    )
    yield of_draws if drawn else of_one


def _branches(branches: Branches) -> Section:
    drawn = branches.batch_size > 0
    ends = branches.median[:, [0, -1]].tolist()
    rows = ((str(label), first, last) for label, (first, last) in zip(branches.labels, ends, strict=True))
    medians = f", medians of {branches.batch_size} draws" * drawn
    changes = tuple(
        (str(branches.labels[c.branch]), str(c.before), c.time, str(c.after))
        for c in sorted(branches.changes, key=lambda change: (change.branch, change.time))
    )
    parts: list[Part] = [by_head(("mode", "first [Hz]|.3f", "last [Hz]|.3f"), rows)]
    if changes:
        heads = "mode", "called", "until [s]|.2f", "then"
        parts.append(by_head(heads, changes, "Names follow the shape, which changes on the way"))
    if drawn:
        parts.append(f"Bands: {band_words(branches)}.")
    return Section(f"Natural frequencies at the first and the last posture{medians}", tuple(parts))


# -------- Rows

COLUMNS = (
    *("start", "end", "time", "natural", "excitation", "distance", "relative_distance"),
    *("amplitude", "cycles", "sweep_number", "magnification", "built_up", "probability", "crossing_probability"),
)


def resonance_rows(crossings: Sequence[ResonanceCrossing]) -> list[dict[str, Any]]:
    """Return resonance crossings as rows, numbered as in the report: times [s], frequencies [Hz], amplitude [m]."""
    return [
        {"number": number, "drive": each.source.drive, "order": each.source.order, "label": str(each.label)}
        | {name: getattr(each, name) for name in COLUMNS}
        for number, group in enumerate(grouped(crossings), start=1)
        for each in group
    ]
