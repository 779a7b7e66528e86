"""What was measured: campaigns of single numbers, logs and traces, from CSV into SI units."""

import importlib
from typing import TYPE_CHECKING, Any

from ident.measure.campaign import Campaign, Measurement
from ident.measure.load import DEFINITIONS, DRIVE_STATES, KINDS, OWN_WEIGHT, Load
from ident.measure.reading import parse_campaign, read_campaign, write_campaign
from ident.units import to_si

if TYPE_CHECKING:
    from ident.measure.series import Log, Trace, read_log, read_pulleys, read_trace

__all__ = [
    "DEFINITIONS",
    "DRIVE_STATES",
    "KINDS",
    "OWN_WEIGHT",
    "Campaign",
    "Load",
    "Log",
    "Measurement",
    "Trace",
    "parse_campaign",
    "read_campaign",
    "read_log",
    "read_pulleys",
    "read_trace",
    "to_si",
    "write_campaign",
]

_SERIES = ("Log", "Trace", "read_log", "read_pulleys", "read_trace")
"""Series in time: they need NumPy, for which a campaign that is refused need not wait."""


def __getattr__(name: str) -> Any:
    if name in _SERIES:
        return getattr(importlib.import_module("ident.measure.series"), name)
    raise AttributeError(f"module 'ident.measure' has no attribute '{name}'")
