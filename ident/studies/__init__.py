"""What ident can do: a study has a file with its options, its result and its function; small ones share one."""

STUDIES = (
    *("modal", "predict", "check", "fit", "profile", "sample", "validate", "plan", "compare", "fleet"),
    *("resonance", "simulate", "spectrum", "triage", "source", "balance", "joint", "sweep", "motion", "design"),
    "diagnose",
)
"""The studies in the order of use; the format of a result file names its study, as in `ident-fit/3`."""
