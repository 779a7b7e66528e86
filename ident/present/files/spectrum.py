"""The peaks of spectra as rows."""

from typing import Any

from ident.assess.spectra import Spectra


def spectrum_rows(spectra: Spectra) -> list[dict[str, Any]]:
    """Return the strongest peaks as rows: frequency [Hz], amplitude [m or m/s^2], and the mode near it."""
    return [
        {
            "trace": name,
            "direction": direction,
            "frequency": peak.frequency,
            "amplitude": peak.amplitude,
            "mode": spectra.mode_near(name, direction, peak.frequency),
        }
        for name in spectra.traces
        for direction in spectra.directions
        for peak in spectra.strongest(name, direction)
    ]
