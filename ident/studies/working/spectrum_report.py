"""Spectra of traces: what is said of their peaks, of the modes near these and of pulley orders; the peaks as rows."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ident.report.report import Cell, Part, Report, Section, Table, cut
from ident.report.words import (
    TRACE_UNITS,
    counted,
    degrees,
)
from ident.studies.working.spectra import PEAKS, MarkedModes, Spectra

if TYPE_CHECKING:
    from ident.studies.working.spectra import Band, MarkedModes

STRONGEST = 2
"""Peaks of a direction on the first screen, of a single trace."""


def spectrum_sections(spectra: Spectra) -> Report:
    """Return all that is said of spectra."""
    names = " and ".join(cut(name, 40) for name in spectra.traces)
    return Report(
        f"Amplitude spectra of {names}: {spectra.kind}, 0-peak, up to {spectra.upto:g} Hz",
        answer=tuple(_answer(spectra)),
        remark=spectra.remark,
        next=_next(spectra),
        details=tuple(_details(spectra)),
    )


def _next(spectra: Spectra) -> str:
    """Return what names the modes near the peaks, or else what excites them."""
    if spectra.modes is None:
        return "ident spectrum {trace} --arm ARM"
    tracked = any(pulley.angle is not None for pulley in spectra.pulleys.values()) and not spectra.tracks
    return "ident spectrum {trace} --arm {arm} --orders 1,2" if tracked else "ident resonance {arm}"


def _answer(spectra: Spectra) -> Iterator[Part]:
    most = STRONGEST if len(spectra.traces) == 1 else 1
    for name in spectra.traces:
        caption = "Strongest peaks" + (f" of {cut(name, 40)}" if len(spectra.traces) > 1 else "")
        yield _peaks_table(spectra, name, caption, most)
    rows = [max(each, key=lambda row: row.amplitude) for each in _orders(spectra).values() if each]
    if rows:
        yield _orders_table(spectra, "Strongest pulley order in each direction", rows)


def _details(spectra: Spectra) -> Iterator[Section]:
    for name, trace in spectra.traces.items():
        span = f"{trace.time[0]:.4g} to {trace.time[-1]:.4g} s"
        samples = f"{counted(len(trace.time), 'sample')} from {span}, {1 / trace.interval:.4g} a second."
        title = f"Strongest peaks of {cut(name, 40)}, up to {spectra.upto:g} Hz"
        peaks = _peaks_table(spectra, name, "", PEAKS)
        yield Section(title, (peaks, f"{spectra.spectra[name].description()}.", samples))
    if spectra.modes is not None:
        yield _modes(spectra.modes)
    for name, track in spectra.tracks.items():
        rows = [row for each in _orders(spectra, attributed=True).values() for row in each if row.pulley == name]
        title = f"Orders of {name}, in blocks of {track.revolutions} revolutions: largest amplitude"
        note = (
            "belongs to: another pulley's lower order at the same frequency, which excites it. Free vibration near "
            "such a frequency is included."
        )
        yield Section(title, (_orders_table(spectra, "", rows, note),))


# -------- Peaks


def _peaks_table(spectra: Spectra, name: str, caption: str, most: int) -> Table:
    """Return the strongest peaks of a trace in each direction, and the mode near each."""
    factor, unit = TRACE_UNITS[spectra.kind]
    rows: list[tuple[Cell, ...]] = []
    for direction in spectra.directions:
        for i, peak in enumerate(spectra.strongest(name, direction)[:most]):
            first, label = direction if i == 0 else "", spectra.mode_near(name, direction, peak.frequency)
            mode = (label, hertz(spectra.modes.bands[label])) if label and spectra.modes else ("none", "")
            rows.append((first, peak.frequency, factor * peak.amplitude, *mode))
        if not spectra.strongest(name, direction):
            rows.append((direction, None, None, "", ""))
    head = ("", "frequency [Hz]", f"amplitude [{unit}]", "mode near it", "its range")
    forms = ("", ".3f", "#.4g", "", "")
    shown = len(head) if spectra.modes else 3
    return Table(caption, head[:shown], tuple(row[:shown] for row in rows), forms[:shown])


def _modes(modes: MarkedModes) -> Section:
    rows = tuple((label, hertz(band, 4)) for label, band in modes.bands.items())
    meaning = (
        "Names as at the end of the motion. A peak in z is named by a vertical mode if one is near, others by a "
        "lateral one; of several, by the one that is near for longest."
    )
    title = f"Natural frequencies of {cut(modes.arm, 40)}, {modes.load}, {where_marked(modes)}"
    return Section(title, (Table("", ("mode", "frequency"), rows, note="" if modes.held else meaning),))


# -------- Orders


class _Order(NamedTuple):
    """The largest amplitude of an order of a pulley in a direction, in the trace's unit; NaN if not resolved."""

    direction: str
    order: float
    pulley: str
    amplitude: float
    time: float
    turning: float
    other: str


def _orders(spectra: Spectra, *, attributed: bool = False) -> dict[str, list[_Order]]:
    """Return the orders by direction; those that belong to another pulley or are not resolved only if asked for."""
    factor = TRACE_UNITS[spectra.kind][0]
    found: dict[str, list[_Order]] = {direction: [] for direction in spectra.directions}
    for d, direction in enumerate(spectra.directions):
        for name, track in spectra.tracks.items():
            for o, order in enumerate(track.orders):
                amplitude = track.amplitude[o, :, d]
                numbers, other = (math.nan, math.nan, math.nan), "beyond what the sampling resolves"
                if not np.isnan(amplitude).all():
                    place = int(np.nanargmax(amplitude))
                    other = spectra.lower_order(name, o, place) or ""
                    numbers = factor * amplitude[place], track.time[place], track.frequency[place]
                if attributed or not other:
                    found[direction].append(_Order(direction, order, name, *numbers, other))
    return found


def _orders_table(spectra: Spectra, caption: str, orders: list[_Order], note: str = "") -> Table:
    unit = TRACE_UNITS[spectra.kind][1]
    rows: list[tuple[Cell, ...]] = []
    for row in orders:
        numbers = map(float, (row.amplitude, row.time, row.turning, row.order * row.turning))
        rows.append((row.direction, f"{row.order:g} x {row.pulley}", *numbers, row.other))
    head = ("", "order", f"amplitude [{unit}]", "at [s]", "pulley [Hz]", "vibration [Hz]", "belongs to")
    forms = ("", "", "#.4g", ".3f", ".3f", ".3f", "")
    shown = len(head) if note and any(row.other for row in orders) else len(head) - 1
    return Table(caption, head[:shown], tuple(row[:shown] for row in rows), forms[:shown], note * (shown == len(head)))


# -------- Rows


def spectrum_rows(spectra: Spectra) -> list[dict[str, Any]]:
    """Return the strongest peaks as rows: frequency [Hz], amplitude [m or m/s^2], and the mode near it."""
    return [
        {"trace": name, "direction": direction, "frequency": peak.frequency, "amplitude": peak.amplitude}
        | {"mode": spectra.mode_near(name, direction, peak.frequency)}
        for name in spectra.traces
        for direction in spectra.directions
        for peak in spectra.strongest(name, direction)
    ]


def where_marked(modes: "MarkedModes") -> str:
    """Say at which posture the natural frequencies are those of the arm, or along which motion."""
    if modes.held:
        return f"at {degrees(modes.first)}"
    return f"along the motion from {degrees(modes.first)} to {degrees(modes.last)}"


def hertz(band: "Band", digits: int = 2) -> str:
    """Write a frequency [Hz], or between which ones it changes: `4.80 to 5.23 Hz`."""
    low, high = (f"{frequency:.{digits}f}" for frequency in band)
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"
