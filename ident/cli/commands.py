"""The commands: each calls the study of its name, prints the report and writes the files."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import (
    SHORT,
    ArmOption,
    CampaignArgument,
    ForceOption,
    NoFigureOption,
    OutOption,
    StrictOption,
    command,
    finish,
    flag,
    leave,
    offer,
    plain,
    write,
)
from ident.cli.output import output
from ident.errors import InputError, Problem
from ident.studies.check import check
from ident.studies.compare import compare
from ident.studies.design import design
from ident.studies.diagnose import discard
from ident.studies.fit import fit
from ident.studies.options import Options, renamed
from ident.studies.plan import PlanOptions, plan
from ident.studies.predict import predict
from ident.studies.profile import profile
from ident.studies.resonance import resonance
from ident.studies.result import written_to
from ident.studies.sample import SampleOptions, sample
from ident.studies.simulate import SimulateResult, simulate
from ident.studies.spectrum import spectrum
from ident.studies.sweep import sweep
from ident.studies.validate import validate

offer(predict, "Predict natural frequencies, modes and static deflection of an arm.", files=False)
offer(
    check,
    """Say what a campaign can tell about each parameter, before any solving.

    A verdict for each one, what the data leave open, which measurements matter, which modes may be mistaken, and
    whether the kinds of measurement agree. Nothing is written.
    """,
    files=False,
    judged=True,
)
offer(
    fit,
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out. Exit status 3 where no optimum was reached.
    """,
    judged=True,
)
offer(
    profile,
    """Check the intervals of a fit: move each parameter, fit all others again, and see how the cost rises.

    With --no-prior the profiles show what the data alone support. Writes CAMPAIGN.profile.json and
    CAMPAIGN.profile.png into the folder given by --out, when all is done.
    """,
)


@command(SampleOptions)
def sample_command(
    campaign: CampaignArgument,
    options: SampleOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    restart: Annotated[bool, typer.Option("--restart", help="throw away the checkpoints of an unfinished run")] = False,
    no_figure: NoFigureOption = False,
    strict: StrictOption = False,
) -> None:
    """Sample the posterior of a campaign: how sure each stiffness is, and which combinations are known.

    Goes on where an earlier run of the same inputs was stopped. Writes CAMPAIGN.sample.nc (ArviZ InferenceData) and
    figures into the folder given by --out. Exit status 3 where the chains are too short.
    """
    from ident.studies.sample import discard

    measured, described = running.read(campaign, arm)
    folder = out / f"{measured.name}.sample.part"
    try:
        result = sample(described, measured, options, folder=folder, restart=restart, progress=running.progress)
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    finish(result, out, no_figure)
    if result.enough:
        running.discard_unless_taken(folder, discard)
    else:
        output().say(f"kept {folder}: the same command with more --steps goes on from there")
    leave(result, strict=strict)


@command(PlanOptions)
def plan_command(
    options: PlanOptions,
    campaign: Annotated[
        Path | None, typer.Argument(help="what is measured already, a CSV file; leave it out for nothing")
    ] = None,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Rank what to measure next by what it would tell for its cost, and say what the intervals will become.

    Writes CAMPAIGN.plan.json, CAMPAIGN.plan.csv (a campaign to fill in) and CAMPAIGN.plan.png into the folder given by
    --out. Without CAMPAIGN, name the arm (--arm); the files are then called after its file.
    """
    from ident.description.file import read_arm

    if campaign is not None:
        measured, described = running.read(campaign, arm)
        result = plan(described, measured, options, progress=running.progress)
        finish(result, out, no_figure)
        leave(result, strict=False)
    elif arm is not None:
        finish(plan(read_arm(arm), None, options), out, no_figure)
    else:
        raise InputError(Problem("", "neither campaign nor arm", "one of them", "as ident plan --arm arm.toml"))


def stop_if_interrupted(result: SimulateResult) -> None:
    """Say so where the user has interrupted the exact method, and end with the code of an interruption."""
    if result.interrupted is not None:
        typer.echo(f"interrupted at {result.interrupted:.4g} s; what there is was written", err=True)
        raise typer.Exit(130)


offer(
    resonance,
    """Draw the Campbell diagram of a motion: pulley frequencies against natural frequencies (the paper's Figure 4).

    Writes ARM.MOTION.resonance.json and .png into the folder given by --out.
    """,
)
offer(
    validate,
    """Say how far a fitted arm may be trusted where it was not measured.

    Each posture is left out in turn (--leave), the arm is fitted to the rest, and what was left out is predicted.
    Writes CAMPAIGN.validate.json and CAMPAIGN.validate.png into the folder given by --out.
    """,
    judged=True,
)
offer(
    compare,
    """Say which joint stiffness has changed between two campaigns, by how much, and how sure that is.

    Both campaigns are fitted again together: what they have in common counts once. Writes FIRST-SECOND.compare.json and
    .png into the folder given by --out.
    """,
    first=Annotated[
        Path, typer.Argument(metavar="before", help="earlier result of fit or sample, or a folder of them")
    ],
    second=Annotated[Path, typer.Argument(metavar="after", help="later one, or a folder")],
)
offer(
    simulate,
    """Simulate how the arm's end vibrates while the arm carries out a motion.

    Writes ARM.MOTION.simulate.csv, .nc and .json and figures into the folder given by --out, when all is done. Ctrl-C
    during the exact method: what there is, is written.
    """,
    then=stop_if_interrupted,
)
offer(
    spectrum,
    """Show at which frequencies a trace vibrates, and how much.

    Writes FILE.spectrum.json and .png, and with --spectrogram and --orders further figures, into the folder given by
    --out.
    """,
    trace=Annotated[
        Path,
        typer.Argument(metavar="file", help="trace: CSV with time [s], x [mm] or x [m/s^2], ...; as of ident simulate"),
    ],
    arm=flag("arm description: marks its natural frequencies", "--arm"),
    path=flag("joint angles during the trace: CSV with time [s], joint1 [deg], ...; default: the trace's file"),
)
offer(
    sweep,
    """Vary numbers of the arm, or its speed: how the vibration over a motion depends on them (Figures 9 and 10).

    Each parameter alone, the others as they are; two together with --grid. By the fast method. Writes
    ARM.MOTION.PARAMETERS.sweep.csv, .json and .png into the folder given by --out, when all is done.
    """,
)
offer(
    design,
    """Say what to change on the arm so that it vibrates least, within bounds, and what the amplitude depends on most.

    Writes ARM.MOTION.design.json, .toml (the arm with the changed numbers) and figures into the folder given by --out,
    when all is done; with --sensitivities ARM.MOTION.sensitivities.json and .png. See also ident sweep.
    """,
    posterior=flag("posterior of ident sample (.nc): the design shall keep --limit by its draws"),
)


ResultArgument = Annotated[Path, typer.Argument(metavar="file", help="a result: .json, or .nc of sample and diagnose")]


@plain("rerun")
def rerun(
    file: ResultArgument,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="folder for the new files; default: none")] = None,
    force: ForceOption = False,
) -> None:
    """Repeat what a saved result records, and say whether the numbers are the same.

    Its inputs are found by their hash: where they were, beside the file, or in this folder; else the exit status is 2.
    Fits shall agree to 1e-9, chains within their Monte Carlo error; exit status 3 where they do not.
    """
    if out is not None:
        running.check_folder(out)
    running.start()
    from ident.studies.rerun import rerun as repeat

    folder = (out or file.parent) / f"{file.name}.rerun.part"
    try:
        with written_to(None if force else out):
            repeated = repeat(file, folder=folder, progress=running.progress)
    except InputError as error:
        raise InputError(renamed(Options, problem) for problem in error.problems) from None
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    output().say(repeated.report())
    output().document = repeated.document
    if out is not None:
        write(repeated.now, out)
    running.discard_unless_taken(folder, discard)
    if not repeated.same:
        raise typer.Exit(SHORT)
