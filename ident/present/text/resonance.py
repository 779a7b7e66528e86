"""The printed report of resonance along a motion."""

from collections.abc import Iterator, Sequence

import numpy as np

from ident.present.text.words import MM, cut, degrees, paragraphs
from ident.vibrate.branches import BAND, Branches
from ident.vibrate.resonance import MARGIN, QUASI_STEADY, Excitation, ResonanceCrossing, Source

# -------- Resonance words
# What figure and report of resonance say alike: numbers of resonance crossings, names of what excites.

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


# -------- Resonance

STEADY, FAST = 0.9, 0.5
"""Share of the steady amplitude from which a mode builds up, and below which it is passed too fast."""
UNSURE = 0.99
"""Share of the draws and postures that must be followed surely."""


def resonance_report(
    branches: Branches,
    excitation: Excitation,
    crossings: Sequence[ResonanceCrossing],
    *,
    title: str = "a motion",
    margin: float = MARGIN,
) -> str:
    """Return the report: a verdict, crossings by the vibration they cause, the mode branches, what was assumed."""
    groups = grouped(crossings)
    sections = [
        _heading(branches, excitation, groups, title),
        _table(branches, groups),
        _sentences(branches, groups),
        _branches(branches),
        _assumed(branches, groups, margin),
    ]
    return paragraphs(sections)


def verdict(branches: Branches, group: Sequence[ResonanceCrossing]) -> str:
    """Say in one sentence what happens: `pulley 2 (drive2) meets lateral torsion 1 at 1.63 s ...`."""
    e = group[0]
    who = sources_words([crossing.source for crossing in group])
    drives = ", ".join(dict.fromkeys(crossing.source.drive for crossing in group))
    place = f"at {e.time:.2f} s, {e.natural:.2f} Hz, {degrees(e.posture)}"
    many = "" if len(group) > 1 else "s"
    if e.crossings:
        does = f"meet{many} {e.label} {place}"
    else:
        does = f"come{many} within {e.relative_distance:.1%} ({e.distance:.2g} Hz) of {e.label} {place}"
    chance = f"; near in {e.probability:.0%} of {branches.batch_size} draws" if branches.batch_size else ""
    return f"{who} ({drives}) {does}: {caused_words(group)}; {passage_words(e)}{chance}"


def passage_words(crossing: ResonanceCrossing) -> str:
    """Say how far the mode builds up."""
    share = f"about {crossing.built_up:.0%} of steady resonance"
    if not crossing.crossings:
        return f"near without crossing, {share}"
    if crossing.built_up >= STEADY:
        return f"dwells and builds up, {share}"
    if crossing.built_up >= FAST:
        return f"passes slowly enough to build up in part, {share}"
    return f"passes too fast to build up, {share}"


def _heading(
    branches: Branches, excitation: Excitation, groups: Sequence[Sequence[ResonanceCrossing]], title: str
) -> Iterator[str]:
    yield f"Resonance along {cut(title, 60)}, {branches.time[0]:.4g} to {branches.time[-1]:.4g} s"
    peaks = (f"{s} up to {line.max():.2f} Hz" for s, line in zip(excitation.sources, excitation.frequency, strict=True))
    yield f"  {', '.join(peaks)}"
    if not groups:
        yield "  No pulley comes near a natural frequency."
        return
    met = sum(bool(group[0].crossings) for group in groups)
    near = len(groups) - met
    counts = f"{met} meet{'s' * (met == 1)}, {near} come{'s' * (near == 1)} near"
    many = f"{len(groups)} resonance crossing{'s' * (len(groups) > 1)}"
    yield f"  {many}: {counts}. What causes most vibration:"
    yield f"  {verdict(branches, groups[0])}."


def _table(branches: Branches, groups: Sequence[Sequence[ResonanceCrossing]]) -> Iterator[str]:
    if not groups:
        return
    end = "  near cross" if branches.batch_size else f"{'number':>9s}"
    yield (
        f"{'':3s}{'excitation':15s} {'mode':18s}{'from':>6s}{'to':>6s}{'at':>6s}{'f':>6s}{'apart':>8s}"
        f"{'caused':>9s}{'times':>6s}{'built':>6s}{end}"
    )
    yield f"{'':37s}{'[s]':>6s}{'[s]':>6s}{'[s]':>6s}{'[Hz]':>6s}"
    for number, group in enumerate(groups, start=1):
        yield _row(branches, number, group)


def _row(branches: Branches, number: int, group: Sequence[ResonanceCrossing]) -> str:
    e = group[0]
    who = cut(sources_words([crossing.source for crossing in group]), 15)
    apart = "crosses" if e.crossings else f"{e.relative_distance:.1%}"
    share = f"{e.probability:6.0%}{e.crossing_probability:6.0%}" if branches.batch_size else f"{e.sweep_number:9.3g}"
    return (
        f"{number:2d} {who:15s} {e.label!s:18s}{e.start:6.2f}{e.end:6.2f}{e.time:6.2f}{e.natural:6.2f}{apart:>8s}"
        f"{caused_words(group):>9s}{e.magnification:6.3g}{e.built_up:6.0%}{share}"
    )


def _sentences(branches: Branches, groups: Sequence[Sequence[ResonanceCrossing]]) -> Iterator[str]:
    for number, group in enumerate(groups, start=1):
        yield f"{number:3d} {verdict(branches, group)}"


def _branches(branches: Branches) -> Iterator[str]:
    yield "Natural frequencies at the first and the last posture" + (", medians" if branches.batch_size else "")
    for b, label in enumerate(branches.labels):
        first, last = branches.median[b, [0, -1]]
        yield f"  {label!s:22s} {first:7.3f} Hz {last:7.3f} Hz"
        for change in (c for c in branches.changes if c.branch == b):
            yield f"    is called {change.before} until {change.time:.2f} s, then {change.after}"
    for veering in branches.veerings:
        names = " and ".join(str(branches.labels[b]) for b in veering.branches)
        yield f"  WARNING: veering at {veering.time:.3f} s: {names} exchange shapes (MAC {veering.mac:.2f}) faster than"
        yield "    the postures tell; beyond it the names may be exchanged."
    if branches.batch_size and min(branches.likeness) < UNSURE:
        yield f"  WARNING: in {1 - min(branches.likeness):.0%} of the draws and postures a mode is hardly the branch's"
        yield "    (MAC below 0.5): near a veering its band mixes two modes."


def _assumed(branches: Branches, groups: Sequence[Sequence[ResonanceCrossing]], margin: float) -> Iterator[str]:
    yield "What the numbers mean and assume"
    yield "  Natural frequencies are those of the arm held at each posture. A pulley turns at |ratio qd| / 2 pi"
    yield "  as seen from its shaft; order 1 is its eccentric mass, order 2 its drive's transmission error."
    yield "  Ratios and speeds are the arm file's, which says which are assumed or calibrated."
    if groups:
        yield f"  Near: within {100 * margin:.3g} % of the natural frequency, or its half-power bandwidth if wider."
        yield "  caused: largest vibration of the end point along the mode's motion, by these pulleys alone"
        yield "  and with the worst phases, while they are near and the mode swells; by the fast method. A mode"
        yield "  near by in frequency that moves the end point the same way is in it as well."
        yield "  times: largest amplitude over the static response to the same force, of one mode at constant"
        yield "  force, passed at the true rate from rest; built: the same over steady resonance, 1/(2 zeta)."
    if groups and not branches.batch_size:
        yield "  number: rate of the pulley relative to the mode [Hz/s] / (zeta f)^2; up to"
        yield f"  {QUASI_STEADY:g} the response is nearly steady (ISO 7626-2), far above the pulley passes too fast for"
        yield "  the mode to build up (Lewis, 1932)."
    if branches.batch_size:
        yield f"  Bands: {band_words(branches)}. near, cross: share of the draws for which the pulley comes"
        yield "  near the natural frequency within the interval, or crosses it; all else is of the medians."
