"""Words that options choose from and that belong to rooms which are too heavy to be imported for `ident --help`."""

STROKE_PROFILES = ("s-curve", "trapezoid", "cycloid")
"""Those of `ident.arm.drive`."""
WINDOWS = ("hann", "boxcar", "hamming", "blackmanharris", "flattop")
"""Those of `ident.vibrate.signal.windows`."""
MEASURES = ("peak", "rms", "residual")
"""Those of `ident.vibrate.response.amplitude`."""
