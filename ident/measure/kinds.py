"""Kinds of measurement: their quantity, and what else each of their rows says."""

KINDS = {
    "frequency": "frequency",
    "deflection": "length",
    "deflection_difference": "length",
    "position": "length",
    "rotation": "rotation",
    "rotation_difference": "rotation",
    "twist": "rotation",
    "twist_difference": "rotation",
    "damping_ratio": "damping_ratio",
}
"""Kinds of measurement, each with the quantity it is measured in."""

ROLES = {
    "frequency": ("mode", "of"),
    "deflection": ("point", "direction", "setup"),
    "deflection_difference": ("point", "direction", "reference_load", "setup"),
    "position": ("point", "direction", "setup"),
    "rotation": ("point", "direction", "setup"),
    "rotation_difference": ("point", "direction", "reference_load", "setup"),
    "twist": ("joint",),
    "twist_difference": ("joint", "reference_load"),
    "damping_ratio": ("mode",),
}
"""The fields that a kind has beside posture, load, value and sigma."""

DIFFERENCES = ("deflection_difference", "rotation_difference", "twist_difference")
"""Kinds that are what a load makes of the arm less what the reference load makes of it."""

ROTATIONS = ("rotation", "rotation_difference")
"""Kinds that turn about their direction; no direction is usual, so it must be given."""

POSITIONS = ("position",)
"""Kinds that say where a point is, not how far it was moved; their direction must be given as well."""

TWISTS = ("twist", "twist_difference")
"""Kinds that encoders on both sides of a joint read: angle of the link less that of the motor over the ratio."""
