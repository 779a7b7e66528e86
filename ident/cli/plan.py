"""`ident plan`."""

from math import log1p, radians
from pathlib import Path
from typing import Annotated

import typer

from ident.cli import options, running
from ident.cli.app import app
from ident.errors import InputError, Problem


@app.command("plan")
def plan_command(
    campaign: Annotated[
        Path | None, typer.Argument(help="what is measured already, a CSV file; leave it out for nothing")
    ] = None,
    arm: options.ArmOption = None,
    out: options.OutOption = Path("out"),
    count: Annotated[int, typer.Option("--count", "-k", min=1, help="visits in the batch, at most")] = 4,
    criterion: Annotated[
        str,
        typer.Option(help="what visits are chosen for: d (information), a (mean variance) or a parameter's name"),
    ] = "d",
    target: Annotated[
        float, typer.Option(help="end the batch when all standard deviations are below this, in percent; 0 for none")
    ] = 0.0,
    step: Annotated[float, typer.Option(help="step of the grid of joint angles [deg]")] = 30.0,
    modes: Annotated[int, typer.Option(min=1, help="frequencies that a hammer test gives, from the lowest")] = 4,
    load: Annotated[
        list[str] | None, typer.Option(help="load that can be mounted, as 'glass' or '5 kg @ tip'; may be repeated")
    ] = None,
    sigma: Annotated[
        list[str] | None,
        typer.Option(help="standard deviation as a share of the value, as frequency=0.005; default: the campaign's"),
    ] = None,
    cost: Annotated[
        list[str] | None,
        typer.Option(help="minutes for a part of a visit, as posture=10; also hammer, labels, dial and load"),
    ] = None,
    draws: Annotated[
        int, typer.Option(min=0, help="points besides the best estimate over which gains are averaged")
    ] = 8,
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
    """Rank what to measure next by what it would tell for its cost, and say what the intervals will become.

    Writes CAMPAIGN.plan.json, CAMPAIGN.plan.csv (a campaign to fill in) and CAMPAIGN.plan.png into the folder given by
    --out. Without CAMPAIGN, name the arm (--arm); the files are then called after its file.
    """
    asked = options.asked(locals())
    if campaign is None and arm is None:
        raise InputError(Problem("", "neither campaign nor arm", "one of them", "as ident plan --arm arm.toml"))
    if not 0 <= target < 1e4:
        raise InputError(Problem("--target", f"{target:g}", "percent, 0 or more", "correct it"))
    unknown = options.unknowns(asked)
    shares = options.numbers(sigma, "--sigma")
    costs = options.numbers(cost, "--cost")
    running.start()
    from ident.description.file import read_arm
    from ident.identify.plan import plan_campaign
    from ident.measure import OWN_WEIGHT, Load
    from ident.present.files.document import write_json
    from ident.present.files.plan import plan_document, write_form
    from ident.present.text.plan import plan_report

    if campaign is None:
        assert arm is not None
        measured, arm_file = None, read_arm(arm)
    else:
        measured, arm_file = running.read(campaign, arm)
    plan = plan_campaign(
        arm_file.arm,
        measured,
        count=count,
        aim=criterion,
        target=log1p(target / 100),
        step=radians(step),
        modes=modes,
        loads=(OWN_WEIGHT, *(Load.parse(text) for text in load or ())),
        sigma=shares,
        costs=costs,
        draws=draws,
        starts=starts,
        seed=seed,
        trust_values=trust_values,
        **unknown,
    )
    typer.echo(plan_report(plan))
    name = campaign.stem if campaign else Path(str(arm)).stem
    path = out / f"{name}.plan.json"
    write_json(plan_document(plan, arm_file, asked), path)
    typer.echo(f"wrote {path}")
    if plan.steps:
        write_form(plan, path.with_suffix(".csv"))
        typer.echo(f"wrote {path.with_suffix('.csv')}")
    if not no_figure:
        from ident.present.figures.plan import plan_figure

        running.draw({path.with_suffix(".png"): plan_figure(plan)})
