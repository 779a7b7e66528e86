"""What was measured: campaigns of single numbers, logs and traces, from CSV into SI units."""

from ident.measure.campaign import KINDS, Campaign, Measurement
from ident.measure.columns import COLUMNS
from ident.measure.load import OWN_WEIGHT, Load, parse_direction
from ident.measure.log import Log, parse_log, read_log
from ident.measure.pulleys import Pulley, read_pulleys
from ident.measure.reading import parse_campaign, read_campaign
from ident.measure.trace import Trace, parse_trace, read_trace
from ident.measure.writing import format_campaign, write_campaign
from ident.units import NMM_PER_DEG, to_si

__all__ = [
    "COLUMNS",
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
