"""`ident fit`."""

from pathlib import Path

from ident.cli import running
from ident.cli.command import (
    ArmOption,
    CampaignArgument,
    NoFigureOption,
    OutOption,
    StrictOption,
    command,
    finish,
    leave,
)
from ident.studies.fit import FitOptions


@command(FitOptions)
def fit_command(
    campaign: CampaignArgument,
    options: FitOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
    strict: StrictOption = False,
) -> None:
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out. Exit status 3 where no optimum was reached.
    """
    from ident.studies.fit import fit

    measured, described = running.read(campaign, arm)
    result = fit(described, measured, options, progress=running.progress)
    finish(result, out, no_figure)
    leave(short=not result.fit.best.converged, doubtful=bool(result.doubts), strict=strict)
