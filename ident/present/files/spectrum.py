"""The file of spectra: amplitudes, peaks, modes and orders of a trace, with where they come from."""

from collections.abc import Iterator, Mapping
from typing import Any

from ident.assess.spectra import Spectra
from ident.description.file import ArmFile
from ident.present.files.basis import source
from ident.present.files.document import plain, provenance
from ident.vibrate.signal.spectrum import Spectrum

FORMAT = "ident-spectrum/2"
MADE = ("resolution", "bandwidth", "window", "segments", "overlap", "length")


def spectrum_document(spectra: Spectra, arm_file: ArmFile | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe spectra as plain data: amplitudes 0-peak in SI, frequencies in Hz up to the highest looked at."""
    head = provenance(FORMAT, arm_file, None, options)
    files = dict(zip(("trace", "against"), map(source, spectra.traces.values()), strict=False))
    head["inputs"] = {"arm": head["inputs"]["arm"], "trace": None, "against": None} | files
    document = head | {
        "kind": spectra.kind,
        "direction": spectra.directions,
        "remark": spectra.remark,
        "spectra": [_spectrum(spectra, name) for name in spectra.traces],
        "peaks": peak_rows(spectra),
        "modes": _modes(spectra),
        "orders": list(_orders(spectra)),
    }
    return plain(document)


def peak_rows(spectra: Spectra) -> list[dict[str, Any]]:
    """Return the strongest peaks as rows: frequency [Hz], amplitude [m or m/s^2], and the mode near it."""
    return [
        {
            "trace": name,
            "direction": direction,
            "frequency": peak.frequency,
            "amplitude": peak.amplitude,
            "mode": spectra.mode_near(name, peak.frequency),
        }
        for name in spectra.traces
        for direction in spectra.directions
        for peak in spectra.strongest(name, direction)
    ]


def _spectrum(spectra: Spectra, name: str) -> dict[str, Any]:
    trace, spectrum = spectra.traces[name], spectra.spectra[name]
    inside = spectrum.frequency <= spectra.upto
    return {
        "trace": name,
        "samples": len(trace.time),
        "start": trace.time[0],
        "end": trace.time[-1],
        **{field: getattr(spectrum, field) for field in MADE},
        "frequency": spectrum.frequency[inside],
        "amplitude": _columns(spectra, spectrum, inside),
    }


def _columns(spectra: Spectra, spectrum: Spectrum, inside: Any) -> dict[str, Any]:
    return {direction: spectrum.amplitude[inside, d] for d, direction in enumerate(spectra.directions)}


def _modes(spectra: Spectra) -> dict[str, Any] | None:
    modes = spectra.modal_analysis
    return None if modes is None else {"posture": modes.posture, "load": str(modes.load), "frequency": spectra.marks}


def _orders(spectra: Spectra) -> Iterator[dict[str, Any]]:
    for name, track in spectra.tracks.items():
        for o, order in enumerate(track.orders.tolist()):
            amplitudes = {direction: track.amplitude[o, :, d] for d, direction in enumerate(spectra.directions)}
            yield {
                "pulley": name,
                "order": order,
                "revolutions": track.revolutions,
                "time": track.time,
                "turning_frequency": track.frequency,
                "amplitude": amplitudes,
            }
