"""The report of the spectra of traces: their peaks, and the modes near them; and its table."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.report.report import Finding, Part, Report, Section, Table, by_head, cut
from ident.report.words import TRACE_UNITS, counted, degrees, some, trace_unit
from ident.studies.working.spectra import PEAKS, Spectra
from ident.text import as_word
from ident.units import sensor_factor

if TYPE_CHECKING:
    from ident.studies.working.spectra import Band, MarkedModes

STRONGEST = 2
"""Peaks of each direction on the first screen, for a single trace of at most `FEW` directions."""
FEW, CHANNELS = 3, 6
"""Directions with room for two peaks on the first screen, and channels that it shows at most."""
LOWEST_MODE = 2.0
"""Frequency [Hz] that a recording must reach; assumed."""
FAINT = 5.0
"""Height of a line, in standard errors, that the largest of thousands of bins of noise reaches."""


def spectrum_sections(spectra: Spectra) -> Report:
    """Return the report of spectra."""
    names = " and ".join(cut(name, 40) for name in spectra.traces)
    what = spectra.kind if spectra.kind in TRACE_UNITS else f"in {spectra.kind}"
    return Report(
        f"Amplitude spectra of {names}: {what}, 0-peak, up to {spectra.upto:g} Hz",
        answer=tuple(_answer(spectra)),
        findings=tuple(_findings(spectra)),
        remark=spectra.remark,
        next=_next(spectra),
        details=tuple(_details(spectra)),
    )


def _next(spectra: Spectra) -> str:
    """Return the step that names the modes near the peaks, or else their cause; or that reads a test or a log."""
    units, arm = [grade.kind for grade in spectra.grades], "ARM" if spectra.modes is None else "{arm}"
    if any(sensor_factor(unit, "force") for unit in units):
        return f"ident modal {as_word(str(Path(spectra.traces[spectra.name].path).parent))} --init"
    if units and all(sensor_factor(unit, "angle") for unit in units):
        return f"ident triage TRACE --path {{trace}} --arm {arm}"
    if spectra.modes is None:
        return "ident spectrum {trace} --arm ARM"
    return "ident triage {trace} --path LOG --arm {arm}" if units else "ident sweep {arm} --vary speed"


def _answer(spectra: Spectra) -> Iterator[Part]:
    alone = len(spectra.traces) == 1
    most = STRONGEST if alone and len(spectra.directions) <= FEW else 1
    if alone and spectra.grades:
        yield _grades(spectra, CHANNELS)
    for name in spectra.traces:
        caption = "Strongest peaks" + (f" of {cut(name, 40)}" if not alone else "")
        yield _peaks_table(spectra, name, caption, most, CHANNELS)


def _findings(spectra: Spectra) -> Iterator[Finding]:
    """Yield what spoils the numbers, then what a reader has made of the file."""
    if clipped := [cut(grade.name, 24) for grade in spectra.grades if grade.clipped > 0]:
        yield Finding(f"clipped, which adds lines: {some(clipped)}", "measure again with a larger range")
    if slow := [grade for grade in spectra.grades if grade.band[1] < LOWEST_MODE]:
        words = f"{cut(slow[0].name, 24)}: {slow[0].rate:.3g} samples a second are too few for any mode of an arm"
        yield Finding(words, "check the unit of the times: --columns time=time:ms")
    for grade in [grade for grade in spectra.grades if grade.strongest > spectra.upto][:1]:
        words = f"{cut(grade.name, 24)}: the largest line is at {grade.strongest:.4g} Hz"
        yield Finding(words, f"--upto {1.5 * grade.strongest:.2g}")
    yield from (Finding(note) for trace in spectra.traces.values() for note in trace.notes)


def _details(spectra: Spectra) -> Iterator[Section]:
    for name, trace in spectra.traces.items():
        span = f"{trace.time[0]:.4g} to {trace.time[-1]:.4g} s"
        samples = f"{counted(len(trace.time), 'sample')} from {span}, {1 / trace.interval:.4g} a second."
        title = f"Strongest peaks of {cut(name, 40)}, up to {spectra.upto:g} Hz"
        peaks = _peaks_table(spectra, name, "", PEAKS)
        yield Section(title, (peaks, f"{spectra.spectra[name].description()}.", samples))
    if spectra.modes is not None:
        yield _modes(spectra.modes)
    if spectra.grades and (len(spectra.traces) > 1 or len(spectra.grades) > CHANNELS):
        yield Section(f"Channels of {cut(spectra.name, 40)}", (_grades(spectra, None),))


# -------- Channels


def _grades(spectra: Spectra, most: int | None) -> Table:
    """Return what each channel of the first file is worth."""
    rows = []
    for grade in spectra.grades[:most]:
        (factor, unit), (low, high) = trace_unit(grade.kind), grade.band
        sizes = (grade.rate, grade.duration, factor * grade.resolution, grade.clipped, factor * grade.noise)
        rows.append((cut(grade.name, 24), unit, *sizes, f"{low:.2g} to {high:.4g}" if low < high else "none"))
    sizes_of = "resolution [unit]|.2g", "clipped [samples]|.0f", "noise floor [unit/sqrt(Hz)]|.2g"
    heads = "Channel", "unit", "rate [Hz]|.4g", "length [s]|.4g", *sizes_of, "trusted band [Hz]"
    drawn = spectra.traces[spectra.name].values
    note = "Without an anti-alias filter in the sensor, vibration above half the rate folds into the band."
    if any(grade.kind == "acceleration" for grade in spectra.grades):
        note += " A sensor is a load, which lowers frequencies: --load '0.2 kg @ tip' for a phone."
    other = [cut(grade.name, 24) for grade in spectra.grades if grade.name not in drawn]
    note += f" Not drawn, of another quantity or clock: {some(other)}." if other else ""
    note += f" {hidden} more with --details." if (hidden := len(spectra.grades) - len(rows)) else ""
    return by_head(heads, rows, note=note)


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


def _peaks_table(spectra: Spectra, name: str, caption: str, most: int, channels: int | None = None) -> Table:
    """Return the strongest peaks of a trace in each direction, and the mode near each."""
    factor, unit = trace_unit(spectra.kind)
    rows: list[tuple[Any, ...]] = []
    for direction in spectra.directions[:channels]:
        first = cut(direction, 24)
        for peak in spectra.peaks[name, direction][:most]:
            label = spectra.mode_near(name, direction, peak.frequency)
            mode = (label, hertz(spectra.modes.bands[label])) if label and spectra.modes else ("none", "")
            numbers = (peak.frequency, peak.frequency_sd, factor * peak.amplitude, factor * peak.amplitude_sd)
            rows.append((first, *numbers, *mode))
            first = ""
        if first:
            rows.append((first, None, None, None, None, "", ""))
    amplitudes = f"amplitude [{unit}]|#.4g", f"± [{unit}]|.2g"
    heads = "", "frequency [Hz]|.3f", "± [Hz]|.2g", *amplitudes, "mode near it", "its range"
    shown = len(heads) if spectra.modes else 5
    faint = any(row[3] and row[3] < FAINT * row[4] for row in rows)
    note = "±: std. error." + f" Below {FAINT:g} of them a line may be noise, or sweep." * faint
    return by_head(heads[:shown], (row[:shown] for row in rows), caption, note)


def _modes(modes: "MarkedModes") -> Section:
    rows = ((label, hertz(band, 4)) for label, band in modes.bands.items())
    meaning = (
        "Names as at the end of the motion. A peak in z is named by a vertical mode if one is near, others by a "
        "lateral one; of several, by the one that is near for longest."
    )
    title = f"Natural frequencies of {cut(modes.arm, 40)}, {modes.load}, {where_marked(modes)}"
    return Section(title, (by_head(("mode", "frequency"), rows, note="" if modes.held else meaning),))


# -------- Rows


def spectrum_rows(spectra: Spectra) -> list[dict[str, Any]]:
    """Return the strongest peaks as rows: frequency [Hz], amplitude [SI], standard errors, and the mode near it."""
    return [
        {"trace": name, "direction": direction, "frequency": peak.frequency, "amplitude": peak.amplitude}
        | {"mode": spectra.mode_near(name, direction, peak.frequency)}
        | {"frequency_sd": peak.frequency_sd, "amplitude_sd": peak.amplitude_sd}
        for name in spectra.traces
        for direction in spectra.directions
        for peak in spectra.peaks[name, direction]
    ]
