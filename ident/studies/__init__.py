"""What ident can do: one file a study, with its options, its result and its function."""

STUDIES = (
    *("modal", "predict", "check", "fit", "profile", "sample", "validate", "plan"),
    *("compare", "fleet", "resonance", "simulate", "spectrum", "sweep", "design", "diagnose"),
)
"""The studies in the order of use; the format of a result file names its study, as in `ident-fit/3`."""
