"""The kinds of measurement, and the words that their rows may use."""

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
"""Kinds of measurement, each with its quantity."""
ROLES = {kind: fields for kind, (_, *fields) in _KINDS.items()}
"""Fields of each kind in addition to posture, load, value and sigma."""
DIFFERENCES = ("deflection_difference", "rotation_difference", "twist_difference")
"""Kinds that are a difference: response to the load minus response to the reference load."""
ROTATIONS = ("rotation", "rotation_difference")
"""Rotations about their direction, which has no default and must be given."""
POSITIONS = ("position",)
"""Absolute positions of a point, not displacements; their direction must be given as well."""
TWISTS = ("twist", "twist_difference")
"""Kinds read by encoders on both sides of a joint: link angle minus motor angle over the ratio."""
SHAPES = ("shape",)
"""Mode shape components: motion of a point along a direction over that of the reference along its own."""
RAMPS = ("loading", "unloading")
"""Branch of a load ramp: up to the largest load, or back."""
DRIVE_STATES = ("brake", "servo")
"""Motors held by brakes or by the controller during the measurement. The model has no freely turning motors."""
DEFINITIONS = ("undamped", "pole", "damped", "displacement peak", "acceleration peak")
"""Definitions of the frequency of a damped mode with the pole s, w = |s| and the damping ratio z = -Re s / w.

undamped: that of the arm without damping; pole: w; damped: Im s = w sqrt(1 - z^2); displacement peak: of the mode's
receptance, w sqrt(1 - 2 z^2); acceleration peak: of its accelerance, w / sqrt(1 - 2 z^2); each divided by 2 pi.
Ewins, "Modal Testing", 2nd ed. 2000, section 2.4.
"""
