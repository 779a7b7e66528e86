"""`ident check`."""

import typer

from ident.cli import running
from ident.cli.command import ArmOption, CampaignArgument, StrictOption, command, leave
from ident.studies.check import CheckOptions


@command(CheckOptions)
def check_command(
    campaign: CampaignArgument, options: CheckOptions, arm: ArmOption = None, strict: StrictOption = False
) -> None:
    """Say what a campaign can tell about each parameter, before any solving.

    A verdict for each one, what the data leave open, which measurements matter, which modes may be mistaken, and
    whether the kinds of measurement agree. Nothing is written.
    """
    from ident.studies.check import check

    measured, described = running.read(campaign, arm)
    result = check(described, measured, options)
    typer.echo(result.report(), nl=False)
    leave(short=False, doubtful=result.contradictory, strict=strict)
