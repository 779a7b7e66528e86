"""`ident fit`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app


@app.command("fit")
def fit_command(
    campaign: options.CampaignArgument,
    arm: options.ArmOption = None,
    out: options.OutOption = Path("out"),
    fix: options.FixOption = None,
    tie: options.TieOption = None,
    free: options.FreeOption = None,
    prior_sd: options.PriorSdOption = 1.0,
    no_prior: options.NoPriorOption = False,
    prior: options.PriorOption = None,
    discrepancy: options.DiscrepancyOption = None,
    starts: Annotated[int, typer.Option(min=1, help="starts of the search, at least")] = 16,
    seed: options.SeedOption = 0,
    trust_values: options.TrustOption = False,
    no_figure: options.NoFigureOption = False,
) -> None:
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out.
    """
    asked = {
        "fix": fix or [],
        "tie": tie or [],
        "free": free or [],
        "prior_sd": None if no_prior else prior_sd,
        "prior": prior or [],
        "discrepancy": discrepancy or [],
        "starts": starts,
        "seed": seed,
        "trust_values": trust_values,
    }
    unknown = options.unknowns(fix, tie, free, prior_sd, no_prior, prior, discrepancy)
    running.start()
    from ident.identify.campaign_fit import fit_campaign
    from ident.present.report import fit_report
    from ident.present.result import fit_document, write_json

    measured, arm_file = running.read(campaign, arm)
    result = fit_campaign(
        arm_file.arm,
        measured,
        starts=starts,
        seed=seed,
        trust_values=trust_values,
        progress=running.progress("starts"),
        **unknown,
    )
    typer.echo(fit_report(result))
    path = out / f"{measured.name}.fit.json"
    write_json(fit_document(result, arm_file, asked), path)
    typer.echo(f"wrote {path}")
    if not no_figure:
        from ident.present.figures import fit_figure, save

        save(fit_figure(result), path.with_suffix(".png"))
        typer.echo(f"wrote {path.with_suffix('.png')}")
