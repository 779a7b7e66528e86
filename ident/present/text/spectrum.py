"""The printed report of spectra: the strongest peaks, the modes near them, and the orders of the pulleys."""

from collections.abc import Iterator

import numpy as np

from ident.assess.spectrum import Band, MarkedModes, Spectra
from ident.present.text.words import cut, degrees, paragraphs

UNITS = {"displacement": (1e3, "mm"), "acceleration": (1.0, "m/s^2")}
"""Unit in which each kind of trace is reported, and how many there are in the SI unit."""


def spectrum_report(spectra: Spectra) -> str:
    """Return the report: peaks of each trace and direction, natural frequencies, orders."""
    sections = [_heading(spectra), *(_peaks(spectra, name) for name in spectra.traces), _modes(spectra)]
    sections += [_orders(spectra, name) for name in spectra.tracks]
    return paragraphs(sections)


def _heading(spectra: Spectra) -> Iterator[str]:
    yield f"Amplitude spectra of {', '.join(cut(name, 40) for name in spectra.traces)}, {spectra.kind}, 0-peak"
    for name, trace in spectra.traces.items():
        rate = 1 / trace.interval
        span = f"{trace.time[0]:.4g} to {trace.time[-1]:.4g} s"
        yield f"  {cut(name, 40)}: {len(trace.time)} samples from {span}, {rate:.4g} a second"
    if spectra.remark:
        yield f"  {spectra.remark}"


def _peaks(spectra: Spectra, name: str) -> Iterator[str]:
    factor, unit = UNITS[spectra.kind]
    yield f"Strongest peaks up to {spectra.upto:g} Hz of {cut(name, 40)}"
    last = "   mode near it, see below" if spectra.modes else ""
    yield f"  {'':4s} {'frequency [Hz]':>15s} {f'amplitude [{unit}]':>18s}{last}"
    for direction in spectra.directions:
        strongest = spectra.strongest(name, direction)
        for i, peak in enumerate(strongest):
            mode = _mode(spectra, name, direction, peak.frequency)
            start = direction if i == 0 else ""
            yield f"  {start:4s} {peak.frequency:15.3f} {factor * peak.amplitude:#18.4g}   {mode}".rstrip()
        if not strongest:
            yield f"  {direction:4s} {'no peak':>15s}"
    yield f"  {spectra.spectra[name].description()}"


def _mode(spectra: Spectra, name: str, direction: str, frequency: float) -> str:
    """Name the mode near a peak, if there is one."""
    label = spectra.mode_near(name, direction, frequency)
    if label is None or spectra.modes is None:
        return "none near" if spectra.modes else ""
    return f"{label}, {hertz(spectra.modes.bands[label])}"


def _modes(spectra: Spectra) -> Iterator[str]:
    modes = spectra.modes
    if modes is not None:
        yield f"Natural frequencies of {modes.arm}, {modes.load},"
        yield f"  {where(modes)}"
        if not modes.held:
            yield "  named as at the end; near z vertical ones come first, else lateral ones; then the longest near"
        for label, band in modes.bands.items():
            yield f"  {hertz(band, 4):>22s}  {label}"


def where(modes: MarkedModes) -> str:
    """Say at which posture the natural frequencies are those of the arm, or along which motion."""
    if modes.held:
        return f"at {degrees(modes.first)}"
    return f"along the motion from {degrees(modes.first)} to {degrees(modes.last)}"


def hertz(band: Band, digits: int = 2) -> str:
    """Write a frequency [Hz], or between which ones it changes: `4.80 to 5.23 Hz`."""
    low, high = (f"{frequency:.{digits}f}" for frequency in band)
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


def _orders(spectra: Spectra, name: str) -> Iterator[str]:
    """Yield the orders of a pulley."""
    unit, track = UNITS[spectra.kind][1], spectra.tracks[name]
    yield f"Orders of {name}, blocks of {track.revolutions} revolutions: largest amplitude [{unit}]"
    yield f"  {'':4s} {'order':>6s} {'amplitude':>11s} {'at s':>9s} {'pulley at Hz':>13s} {'vibration at Hz':>16s}"
    yield "  what vibrates freely near such a frequency counts too; is: as fast, so attributed to that"
    for d, direction in enumerate(spectra.directions):
        for o, order in enumerate(track.orders):
            yield _order(spectra, name, o, float(order), d, direction if o == 0 else "")


def _order(spectra: Spectra, name: str, o: int, order: float, d: int, start: str) -> str:
    factor, track = UNITS[spectra.kind][0], spectra.tracks[name]
    amplitude = track.amplitude[o, :, d]
    if np.isnan(amplitude).all():
        return f"  {start:4s} {order:6g} {'-':>11s}   beyond what the sampling resolves"
    place = int(np.nanargmax(amplitude))
    turning, other = track.frequency[place], spectra.lower_order(name, o, place)
    row = (
        f"  {start:4s} {order:6g} {factor * amplitude[place]:#11.4g} {track.time[place]:9.3f} {turning:13.3f}"
        f" {order * turning:16.3f}"
    )
    return f"{row}   is {cut(other, 24)}" if other else row
