"""What was measured: campaigns of single numbers, logs and traces, from CSV into SI units."""

import importlib
from typing import TYPE_CHECKING, Any

from ident.measure.campaign import Campaign, Measurement
from ident.measure.columns import COLUMNS
from ident.measure.kinds import DEFINITIONS, DRIVE_STATES, KINDS
from ident.measure.load import OWN_WEIGHT, Load, parse_direction
from ident.measure.reading import parse_campaign, read_campaign
from ident.measure.writing import format_campaign, write_campaign
from ident.units import NMM_PER_DEG, to_si

if TYPE_CHECKING:
    from ident.measure.log import Log, parse_log, read_log
    from ident.measure.pulleys import Pulley, read_pulleys
    from ident.measure.trace import Trace, parse_trace, read_trace

__all__ = [
    "COLUMNS",
    "DEFINITIONS",
    "DRIVE_STATES",
    "KINDS",
    "NMM_PER_DEG",
    "OWN_WEIGHT",
    "Campaign",
    "Load",
    "Log",
    "Measurement",
    "Pulley",
    "Trace",
    "format_campaign",
    "parse_campaign",
    "parse_direction",
    "parse_log",
    "parse_trace",
    "read_campaign",
    "read_log",
    "read_pulleys",
    "read_trace",
    "to_si",
    "write_campaign",
]

_SERIES = {
    "log": ("Log", "parse_log", "read_log"),
    "pulleys": ("Pulley", "read_pulleys"),
    "trace": ("Trace", "parse_trace", "read_trace"),
}
"""Series in time: they need NumPy, for which a campaign that is refused need not wait."""


def __getattr__(name: str) -> Any:
    for module, names in _SERIES.items():
        if name in names:
            return getattr(importlib.import_module(f"ident.measure.{module}"), name)
    raise AttributeError(f"module 'ident.measure' has no attribute '{name}'")
