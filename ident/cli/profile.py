"""`ident profile`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app


@app.command("profile")
def profile_command(
    campaign: options.CampaignArgument,
    arm: options.ArmOption = None,
    out: options.OutOption = Path("out"),
    parameter: Annotated[
        list[str] | None, typer.Option("--parameter", help="parameter to profile, default: all; may be repeated")
    ] = None,
    reach: Annotated[
        float, typer.Option(help="factor on the fitted value beyond which a profile is called open")
    ] = 1000.0,
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
    """Check the intervals of a fit: move each parameter, fit all others again, and see how the cost rises.

    With --no-prior the profiles show what the data alone support. Writes CAMPAIGN.profile.json and
    CAMPAIGN.profile.png into the folder given by --out, when all is done.
    """
    asked = options.asked(locals())
    unknown = options.unknowns(asked)
    running.start()
    from ident.identify.build_problem import build_problem
    from ident.inference.profile import check, profile
    from ident.present.files.document import write_json
    from ident.present.files.profile import profile_document
    from ident.present.text.profile import profile_report

    measured, arm_file = running.read(campaign, arm)
    check(build_problem(arm_file.arm, measured, **unknown).parameters, parameter, reach=reach)
    result = running.fit(arm_file.arm, measured, asked, unknown)
    profiles = profile(result.fit, parameter, reach=reach, progress=running.progress("profiles"))
    typer.echo(profile_report(result, profiles))
    path = out / f"{measured.name}.profile.json"
    write_json(profile_document(result, profiles, arm_file, asked), path)
    typer.echo(f"wrote {path}")
    if not no_figure:
        from ident.present.figures.profile import profile_figure

        running.draw({path.with_suffix(".png"): profile_figure(result, profiles)})
