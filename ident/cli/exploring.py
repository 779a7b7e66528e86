"""The command `ident explore`: an arm as a page with sliders."""

from ident.cli.command import flag, offer
from ident.studies.explore import explore

offer(
    explore,
    """Explore an arm by hand: a page with sliders for stiffnesses, payload, speed and posture.

    The page shows the arm and its modes, natural frequencies along the motion against the pulleys', static deflection
    and steady response, and computes them itself: one HTML file, no network, no server. Writes ARM.explore.html into
    the folder given by --out.
    """,
    measured=flag("measurements to show beside, a CSV file (data/README.md)", "--campaign"),
)
