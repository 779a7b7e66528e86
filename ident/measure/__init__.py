"""Measurements: campaigns of single numbers, logs and traces, from CSV into SI units."""

import importlib
from typing import TYPE_CHECKING, Any

from ident.measure.campaign import Campaign, Measurement
from ident.measure.kinds import DEFINITIONS, DRIVE_STATES, KINDS
from ident.measure.load import OWN_WEIGHT, Load
from ident.measure.reading import parse_campaign, read_campaign, write_campaign
from ident.units import to_si

if TYPE_CHECKING:
    from ident.measure.log import Log, read_log
    from ident.measure.trace import Trace, read_pulleys, read_trace

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

_SERIES = {"Log": "log", "read_log": "log", "Trace": "trace", "read_pulleys": "trace", "read_trace": "trace"}
"""Series in time, with their modules: they need NumPy, for which a campaign that is refused need not wait."""


def __getattr__(name: str) -> Any:
    if name in _SERIES:
        return getattr(importlib.import_module(f"ident.measure.{_SERIES[name]}"), name)
    raise AttributeError(f"module 'ident.measure' has no attribute '{name}'")
