"""The report of the spectra of traces: their peaks, and the modes near them; and its table."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ident.report.report import Cell, Part, Report, Section, Table, by_head, cut
from ident.report.words import (
    TRACE_UNITS,
    counted,
    degrees,
)
from ident.studies.working.spectra import PEAKS, MarkedModes, Spectra

if TYPE_CHECKING:
    from ident.studies.working.spectra import Band, MarkedModes

STRONGEST = 2
"""Peaks of each direction on the first screen, for a single trace."""


def spectrum_sections(spectra: Spectra) -> Report:
    """Return the report of spectra."""
    names = " and ".join(cut(name, 40) for name in spectra.traces)
    return Report(
        f"Amplitude spectra of {names}: {spectra.kind}, 0-peak, up to {spectra.upto:g} Hz",
        answer=tuple(_answer(spectra)),
        remark=spectra.remark,
        next="ident resonance {arm}" if spectra.modes else "ident spectrum {trace} --arm ARM",
        details=tuple(_details(spectra)),
    )


def _answer(spectra: Spectra) -> Iterator[Part]:
    most = STRONGEST if len(spectra.traces) == 1 else 1
    for name in spectra.traces:
        caption = "Strongest peaks" + (f" of {cut(name, 40)}" if len(spectra.traces) > 1 else "")
        yield _peaks_table(spectra, name, caption, most)


def _details(spectra: Spectra) -> Iterator[Section]:
    for name, trace in spectra.traces.items():
        span = f"{trace.time[0]:.4g} to {trace.time[-1]:.4g} s"
        samples = f"{counted(len(trace.time), 'sample')} from {span}, {1 / trace.interval:.4g} a second."
        title = f"Strongest peaks of {cut(name, 40)}, up to {spectra.upto:g} Hz"
        peaks = _peaks_table(spectra, name, "", PEAKS)
        yield Section(title, (peaks, f"{spectra.spectra[name].description()}.", samples))
    if spectra.modes is not None:
        yield _modes(spectra.modes)


# -------- Peaks and modes


def where_marked(modes: "MarkedModes") -> str:
    """Name the posture or the motion of the arm's natural frequencies."""
    if modes.held:
        return f"at {degrees(modes.first)}"
    return f"along the motion from {degrees(modes.first)} to {degrees(modes.last)}"


def hertz(band: "Band", digits: int = 2) -> str:
    """Write a frequency [Hz] or its range: `4.80 to 5.23 Hz`."""
    low, high = (f"{frequency:.{digits}f}" for frequency in band)
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


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
    heads = "", "frequency [Hz]|.3f", f"amplitude [{unit}]|#.4g", "mode near it", "its range"
    shown = len(heads) if spectra.modes else 3
    return by_head(heads[:shown], (row[:shown] for row in rows), caption)


def _modes(modes: MarkedModes) -> Section:
    rows = ((label, hertz(band, 4)) for label, band in modes.bands.items())
    meaning = (
        "Names as at the end of the motion. A peak in z is named by a vertical mode if one is near, others by a "
        "lateral one; of several, by the one that is near for longest."
    )
    title = f"Natural frequencies of {cut(modes.arm, 40)}, {modes.load}, {where_marked(modes)}"
    return Section(title, (by_head(("mode", "frequency"), rows, note="" if modes.held else meaning),))


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
