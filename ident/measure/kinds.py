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
    "shape": "ratio",
}
"""Kinds of measurement, each with the quantity it is measured in."""

ROLES = {
    "frequency": ("mode", "of"),
    "deflection": ("point", "direction", "setup", "ramp"),
    "deflection_difference": ("point", "direction", "reference_load", "setup", "ramp"),
    "position": ("point", "direction", "setup", "ramp"),
    "rotation": ("point", "direction", "setup", "ramp"),
    "rotation_difference": ("point", "direction", "reference_load", "setup", "ramp"),
    "twist": ("joint", "ramp"),
    "twist_difference": ("joint", "reference_load", "ramp"),
    "damping_ratio": ("mode",),
    "shape": ("mode", "of", "point", "direction", "reference_point", "reference_direction"),
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

SHAPES = ("shape",)
"""Kinds that say how a mode moves a point along a direction, over how it moves the reference along its own."""

RAMPS = ("loading", "unloading")
"""On which way of a ramp it was read, up to the largest load or back."""

DRIVE_STATES = ("brake", "servo", "off")
"""What held the motors while it was measured: brakes, the controller, or nothing."""

DEFINITIONS = ("undamped", "pole", "damped", "displacement peak", "acceleration peak")
"""What a frequency may be of a damped mode, with the pole s, w = |s| and z = -Re s / w the damping ratio.

undamped: that of the arm without damping; pole: w; damped: Im s = w sqrt(1 - z^2); displacement peak: of the mode's
receptance, w sqrt(1 - 2 z^2); acceleration peak: of its accelerance, w / sqrt(1 - 2 z^2); each divided by 2 pi.
Ewins, "Modal Testing", 2nd ed. 2000, section 2.4.
"""
