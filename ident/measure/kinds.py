"""The kinds of measurement, and the words that their rows choose from."""

_KINDS = {
    "frequency": ("frequency", "mode", "of"),
    "deflection": ("length", "point", "direction", "setup", "ramp"),
    "deflection_difference": ("length", "point", "direction", "reference_load", "setup", "ramp"),
    "position": ("length", "point", "direction", "setup", "ramp"),
    "rotation": ("rotation", "point", "direction", "setup", "ramp"),
    "rotation_difference": ("rotation", "point", "direction", "reference_load", "setup", "ramp"),
    "twist": ("rotation", "joint", "ramp"),
    "twist_difference": ("rotation", "joint", "reference_load", "ramp"),
    "damping_ratio": ("damping_ratio", "mode"),
    "shape": ("ratio", "mode", "of", "point", "direction", "reference_point", "reference_direction"),
}
KINDS = {kind: quantity for kind, (quantity, *_) in _KINDS.items()}
"""Kinds of measurement, each with the quantity it is measured in."""
ROLES = {kind: fields for kind, (_, *fields) in _KINDS.items()}
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
DRIVE_STATES = ("brake", "servo")
"""What held the motors while it was measured: brakes or the controller. The model has no motors that turn freely."""
DEFINITIONS = ("undamped", "pole", "damped", "displacement peak", "acceleration peak")
"""What a frequency may be of a damped mode, with the pole s, w = |s| and z = -Re s / w the damping ratio.

undamped: that of the arm without damping; pole: w; damped: Im s = w sqrt(1 - z^2); displacement peak: of the mode's
receptance, w sqrt(1 - 2 z^2); acceleration peak: of its accelerance, w / sqrt(1 - 2 z^2); each divided by 2 pi.
Ewins, "Modal Testing", 2nd ed. 2000, section 2.4.
"""
