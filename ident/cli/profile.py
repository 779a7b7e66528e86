"""`ident profile`."""

from pathlib import Path

from ident.cli import running
from ident.cli.command import ArmOption, CampaignArgument, NoFigureOption, OutOption, command, finish
from ident.studies.profile import ProfileOptions


@command(ProfileOptions)
def profile_command(
    campaign: CampaignArgument,
    options: ProfileOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Check the intervals of a fit: move each parameter, fit all others again, and see how the cost rises.

    With --no-prior the profiles show what the data alone support. Writes CAMPAIGN.profile.json and
    CAMPAIGN.profile.png into the folder given by --out, when all is done.
    """
    from ident.studies.profile import profile

    measured, described = running.read(campaign, arm)
    finish(profile(described, measured, options, progress=running.progress), out, no_figure)
