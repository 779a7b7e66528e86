"""Kinds of measurement: their quantity, and what else each of their rows says."""

KINDS = {
    "frequency": "frequency",
    "deflection": "length",
    "deflection_difference": "length",
    "rotation": "rotation",
    "rotation_difference": "rotation",
    "twist": "rotation",
    "twist_difference": "rotation",
    "damping_ratio": "damping_ratio",
    "shape": "ratio",
}
"""Kinds of measurement, each with the quantity it is measured in."""

ROLES = {
    "frequency": ("mode", "of"),
    "deflection": ("point", "direction"),
    "deflection_difference": ("point", "direction", "reference_load"),
    "rotation": ("point", "direction"),
    "rotation_difference": ("point", "direction", "reference_load"),
    "twist": ("joint",),
    "twist_difference": ("joint", "reference_load"),
    "damping_ratio": ("mode",),
    "shape": ("mode", "of", "point", "direction", "reference_point", "reference_direction"),
}
"""The fields that a kind has beside posture, load, value and sigma."""

DIFFERENCES = ("deflection_difference", "rotation_difference", "twist_difference")
"""Kinds that are what a load makes of the arm less what the reference load makes of it."""

ROTATIONS = ("rotation", "rotation_difference")
"""Kinds that turn about their direction; no direction is usual, so it must be given."""

TWISTS = ("twist", "twist_difference")
"""Kinds that encoders on both sides of a joint read: angle of the link less that of the motor over the ratio."""

SHAPES = ("shape",)
"""Kinds that say how a mode moves a point along a direction, over how it moves the reference along its own."""
