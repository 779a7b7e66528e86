"""`ident fit`."""

from pathlib import Path

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
    starts: options.StartsOption = 16,
    seed: options.SeedOption = 0,
    trust_values: options.TrustOption = False,
    no_figure: options.NoFigureOption = False,
) -> None:
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out.
    """
    asked = options.asked(locals())
    unknown = options.unknowns(asked)
    running.start()
    from ident.present.files.fit import fit_document, write_json
    from ident.present.text.fit import fit_report

    measured, arm_file = running.read(campaign, arm)
    result = running.fit(arm_file.arm, measured, asked, unknown)
    typer.echo(fit_report(result))
    path = out / f"{measured.name}.fit.json"
    write_json(fit_document(result, arm_file, asked), path)
    typer.echo(f"wrote {path}")
    if not no_figure:
        from ident.present.figures.fit import fit_figure

        running.draw({path.with_suffix(".png"): fit_figure(result)})
