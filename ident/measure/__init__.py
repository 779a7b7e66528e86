"""What was measured: campaigns of frequencies, deflections and damping ratios, from CSV into SI units."""

from ident.measure.campaign import KINDS, Campaign, Measurement
from ident.measure.columns import COLUMNS
from ident.measure.load import OWN_WEIGHT, Load, parse_direction
from ident.measure.reading import parse_campaign, read_campaign
from ident.measure.units import NMM_PER_DEG, stiffness_from_nmm_per_deg, stiffness_to_nmm_per_deg, to_si
from ident.measure.writing import format_campaign, write_campaign

__all__ = [
    "COLUMNS",
    "KINDS",
    "NMM_PER_DEG",
    "OWN_WEIGHT",
    "Campaign",
    "Load",
    "Measurement",
    "format_campaign",
    "parse_campaign",
    "parse_direction",
    "read_campaign",
    "stiffness_from_nmm_per_deg",
    "stiffness_to_nmm_per_deg",
    "to_si",
    "write_campaign",
]
