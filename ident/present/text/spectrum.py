"""The printed report of spectra: the strongest peaks, the modes near them, and the orders of the pulleys."""

from collections.abc import Iterator

import numpy as np

from ident.assess.spectra import Spectra
from ident.present.text.words import cut, degrees, paragraphs
from ident.vibrate.signal.orders import OrderTrack

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
    last = f"   nearest mode at {degrees(spectra.modal_analysis.posture)}" if spectra.modal_analysis else ""
    yield f"  {'':4s} {'frequency [Hz]':>15s} {f'amplitude [{unit}]':>18s}{last}"
    for direction in spectra.directions:
        strongest = spectra.strongest(name, direction)
        for i, peak in enumerate(strongest):
            mode = _mode(spectra, name, peak.frequency)
            start = direction if i == 0 else ""
            yield f"  {start:4s} {peak.frequency:15.3f} {factor * peak.amplitude:#18.4g}   {mode}".rstrip()
        if not strongest:
            yield f"  {direction:4s} {'no peak':>15s}"
    yield f"  {spectra.spectra[name].description()}"


def _mode(spectra: Spectra, name: str, frequency: float) -> str:
    """Name the mode nearest to a peak, if it is near."""
    label = spectra.mode_near(name, frequency)
    return f"{label}, {spectra.marks[label]:.3f} Hz" if label else "none near" if spectra.marks else ""


def _modes(spectra: Spectra) -> Iterator[str]:
    modes = spectra.modal_analysis
    if modes is not None:
        yield f"Natural frequencies of {modes.arm.name} at {degrees(modes.posture)}, {modes.load}"
        for label, frequency in spectra.marks.items():
            yield f"  {frequency:10.4f} Hz  {label}"


def _orders(spectra: Spectra, name: str) -> Iterator[str]:
    """Yield the orders of a pulley."""
    (factor, unit), track = UNITS[spectra.kind], spectra.tracks[name]
    yield f"Orders of {name}, blocks of {track.revolutions} revolutions: largest amplitude [{unit}]"
    yield f"  {'':4s} {'order':>6s} {'amplitude':>11s} {'at s':>9s} {'pulley at Hz':>13s} {'vibration at Hz':>16s}"
    yield "  what vibrates freely near such a frequency, or by another pulley that turns so fast, counts too"
    for d, direction in enumerate(spectra.directions):
        for o, order in enumerate(track.orders):
            yield _order(track, o, float(order), d, direction if o == 0 else "", factor)


def _order(track: OrderTrack, o: int, order: float, d: int, start: str, factor: float) -> str:
    amplitude = track.amplitude[o, :, d]
    if np.isnan(amplitude).all():
        return f"  {start:4s} {order:6g} {'-':>11s}   beyond what the sampling resolves"
    place = int(np.nanargmax(amplitude))
    turning = track.frequency[place]
    return (
        f"  {start:4s} {order:6g} {factor * amplitude[place]:#11.4g} {track.time[place]:9.3f} {turning:13.3f}"
        f" {order * turning:16.3f}"
    )
