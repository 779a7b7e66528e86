"""`ident fit`."""

from pathlib import Path

from ident.cli import running
from ident.cli.command import ArmOption, CampaignArgument, NoFigureOption, OutOption, command, finish
from ident.studies.fit import FitOptions


@command(FitOptions)
def fit_command(
    campaign: CampaignArgument,
    options: FitOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out.
    """
    from ident.studies.fit import fit

    measured, described = running.read(campaign, arm)
    finish(fit(described, measured, options, progress=running.progress), out, no_figure)
