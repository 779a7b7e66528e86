"""`ident check`."""

import typer

from ident.cli import options, running
from ident.cli.app import app


@app.command("check")
def check_command(
    campaign: options.CampaignArgument,
    arm: options.ArmOption = None,
    fix: options.FixOption = None,
    tie: options.TieOption = None,
    free: options.FreeOption = None,
    prior_sd: options.PriorSdOption = 1.0,
    no_prior: options.NoPriorOption = False,
    prior: options.PriorOption = None,
    discrepancy: options.DiscrepancyOption = None,
    seed: options.SeedOption = 0,
    trust_values: options.TrustOption = False,
) -> None:
    """Say what a campaign can tell about each parameter, before any solving.

    A verdict for each one, what the data leave open, which measurements matter, which modes may be mistaken, and
    whether the kinds of measurement agree. Nothing is written.
    """
    unknown = options.unknowns(options.asked(locals()))
    running.start()
    from ident.identify.check import check_campaign
    from ident.present.text.check import check_report

    measured, arm_file = running.read(campaign, arm)
    result = check_campaign(arm_file.arm, measured, seed=seed, trust_values=trust_values, **unknown)
    typer.echo(check_report(result), nl=False)
