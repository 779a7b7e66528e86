"""`ident sample`."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app

FORMAT = "ident-sample/1"


@app.command("sample")
def sample_command(
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
    noise: Annotated[
        list[str] | None,
        typer.Option(
            help="kind of measurement whose sigma is known up to a factor only, as frequency; may be repeated"
        ),
    ] = None,
    weights: Annotated[
        bool, typer.Option("--weights", help="weigh several optima against each other, by nested sampling")
    ] = False,
    ess: Annotated[float, typer.Option(min=100, help="effective samples of each unknown at which to stop")] = 2000.0,
    steps: Annotated[int, typer.Option(min=500, help="steps at which to stop in any case")] = 20000,
    ensembles: Annotated[int, typer.Option(min=4, help="independent ensembles about each optimum")] = 4,
    walkers: Annotated[
        int | None, typer.Option(help="walkers in each ensemble; default: four to twelve times the unknowns")
    ] = None,
    starts: options.StartsOption = 16,
    seed: options.SeedOption = 0,
    trust_values: options.TrustOption = False,
    restart: Annotated[bool, typer.Option("--restart", help="throw away the checkpoints of an unfinished run")] = False,
    no_figure: options.NoFigureOption = False,
) -> None:
    """Sample the posterior of a campaign: how sure each stiffness is, and which combinations are known.

    Goes on where an earlier run of the same inputs was stopped. Writes CAMPAIGN.sample.nc (ArviZ InferenceData) and
    figures into the folder given by --out.
    """
    asked = options.asked(locals())
    unknown = options.unknowns(asked)
    running.start()
    from ident.identify.sample import sample_campaign
    from ident.inference.sample import BLOCK, Settings
    from ident.present.files.document import plain, provenance
    from ident.present.files.fit import rows
    from ident.present.files.sample import inference_data, write_netcdf
    from ident.present.text.sample import sample_report
    from ident.store import Store

    measured, arm_file = running.read(campaign, arm)
    fitted = running.fit(arm_file.arm, measured, asked, unknown)
    folder = out / f"{measured.name}.sample.part"
    if restart:
        Store.discard(folder)
    try:
        result = sample_campaign(
            fitted,
            settings=Settings(ensembles=ensembles, walkers=walkers, target_ess=ess, max_steps=steps, seed=seed),
            noise=noise or (),
            weights=weights,
            folder=folder,
            provenance={
                "campaign": measured.sha256,
                "arm file": arm_file.sha256,
                "number of starts": str(starts),
            },
            progress=running.progress("blocks of steps", steps // BLOCK),
        )
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    typer.echo(sample_report(result))
    path = out / f"{measured.name}.sample.nc"
    origin = provenance(FORMAT, arm_file, measured, asked) | {"trust": plain(result.trust)}
    written = inference_data(result.sample, result.posterior_predictive, rows(measured), origin)
    write_netcdf(written, path)
    typer.echo(f"wrote {path}")
    if all(found.enough(ess) for found in result.sample.diagnosis):
        Store.discard(folder)
    else:
        typer.echo(f"kept {folder}: the same command with more --steps goes on from there")
    if not no_figure:
        from ident.present.figures.sample import sample_figures

        figures = sample_figures(result)
        running.draw({path.with_suffix(f".{name}.png"): figure for name, figure in figures.items()})
