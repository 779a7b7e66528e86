"""The units that people read: N mm/deg, mm, Hz, percent."""

from ident.measure import stiffness_to_nmm_per_deg

KINDS = {"frequency": (1.0, "Hz"), "deflection": (1e3, "mm"), "deflection_difference": (1e3, "mm")}
MM = 1e3
"""mm in a metre."""
NMM = "N mm/deg"
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


def in_paper_unit(path: str, value: float) -> tuple[float, str]:
    """Return a value in the unit that people read, and the unit: N mm/deg for a stiffness."""
    return (nmm_per_deg(value), NMM) if is_stiffness(path) else (value, unit_of(path))


def value_in_words(path: str, value: float) -> str:
    """Write a value with its unit, as `6.28e+06 N mm/deg`."""
    number, name = in_paper_unit(path, value)
    return f"{number:.4g} {name}".removesuffix(" -")
