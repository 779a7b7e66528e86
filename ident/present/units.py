"""The units that people read: N mm/deg, mm, Hz, percent."""

from ident.measure import stiffness_to_nmm_per_deg

KINDS = {"frequency": (1.0, "Hz"), "deflection": (1e3, "mm"), "deflection_difference": (1e3, "mm")}
FIELDS = {
    "k_bend": "N m/rad",
    "k_tors": "N m/rad",
    "tau_bend": "s",
    "tau_tors": "s",
    "mass": "kg",
    "com": "m",
    "offset": "m",
    "position": "m",
    "inertia": "kg m^2",
    "rotor_inertia": "kg m^2",
    "eccentric_mass": "kg",
    "eccentricity": "m",
    "height": "m",
    "phase": "rad",
    "error": "rad",
    "error_phase": "rad",
    "driver_radius": "m",
    "driven_radius": "m",
    "pretension": "N",
    "stiffness": "N/m",
    "tau": "s",
    "speed": "%",
}
"""SI unit of each field of the arm that can be fitted or varied, and of the speed."""


def shown(kind: str, value: float) -> tuple[float, str]:
    """Return a measured or predicted SI value in the unit that its kind is read in, and the unit."""
    factor, unit = KINDS.get(kind, (100.0, "%"))
    return value * factor, unit


def field_of(path: str) -> str:
    """Return the field of a parameter's path; the name itself if it is no path."""
    return path.split(".")[1] if "." in path else path


def unit_of(path: str) -> str:
    """Return the SI unit of a parameter; `-` for factors, and for parameters of a model that is no arm."""
    return FIELDS.get(field_of(path), "-")


def is_stiffness(path: str) -> bool:
    """Tell whether a path names a bushing stiffness."""
    return field_of(path) in ("k_bend", "k_tors")


def nmm_per_deg(value: float) -> float:
    """Return a stiffness [N m/rad] in N mm/deg, the paper's unit."""
    return float(stiffness_to_nmm_per_deg(value))
