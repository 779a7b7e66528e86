"""The commands: each calls the study of its name, prints the report and writes the files."""

# mypy: disable-error-code="valid-type"
# flags are made by `flag`; mypy does not accept its calls as types

import gc
import os
import platform
import textwrap
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ident.cli import running
from ident.cli.command import (
    ArmOption,
    CampaignArgument,
    FontOption,
    ForceOption,
    NoFigureOption,
    OutOption,
    PathOption,
    command,
    finish,
    flag,
    offer,
    output,
    plain,
    tell,
    write,
)
from ident.cli.output import FOLDED, SHORT
from ident.errors import refusal
from ident.studies.cause.source import SourceOptions, source
from ident.studies.cause.triage import triage
from ident.studies.cure.balance import balance
from ident.studies.cure.design import design
from ident.studies.cure.diagnose import DiagnoseOptions, diagnose, discard_stages, part_folder
from ident.studies.cure.motion import motion
from ident.studies.cure.variants import variants
from ident.studies.following import kept_in
from ident.studies.handout import hand_over
from ident.studies.look.explore import explore
from ident.studies.look.new import KINDS
from ident.studies.look.predict import predict
from ident.studies.measuring.modal import ModalOptions, modal_test, new_channels
from ident.studies.stiffness.check import check
from ident.studies.stiffness.compare import compare
from ident.studies.stiffness.fit import fit
from ident.studies.stiffness.fleet import FleetOptions, fleet
from ident.studies.stiffness.joint import joint
from ident.studies.stiffness.plan import PlanOptions, plan
from ident.studies.stiffness.profile import profile
from ident.studies.stiffness.sample import SampleOptions, discard_checkpoints, sample
from ident.studies.stiffness.validate import validate
from ident.studies.working.resonance import resonance
from ident.studies.working.simulate import simulate
from ident.studies.working.spectrum import spectrum
from ident.studies.working.sweep import sweep
from ident.text import as_word, one_line, read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ident.description.file import ArmFile
    from ident.measure import Campaign
    from ident.studies.cure.diagnose import StageReport
    from ident.studies.result import Result

offer(predict, "Predict natural frequencies, modes and deflections of an arm.", files=False)
offer(
    check,
    """Check before any fit what a campaign can determine.

    A verdict for each one, undetermined combinations, which measurements matter, which modes may be mistaken, and
    whether the kinds of measurement agree. Nothing is written.
    """,
    files=False,
    judged=True,
)
offer(
    fit,
    """Fit joint stiffnesses: values, intervals, what to doubt.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out. Exit status 3 where no optimum was reached.
    """,
    judged=True,
)
offer(
    profile,
    """Check intervals: move each unknown, fit all others again.

    With --no-prior the profiles show what the data alone support. Writes CAMPAIGN.profile.json and
    CAMPAIGN.profile.png into the folder given by --out, when all is done.
    """,
)


def to_fill_in(path: Path, rows: int, then: str) -> None:
    """Print which table was written to be filled in, and the next command."""
    output().wrote(path)
    output().say(f"{rows} channels to fill in; then: ident {then}")


@command(SampleOptions, judged=True)
def sample_command(
    campaign: CampaignArgument,
    options: SampleOptions,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    restart: Annotated[bool, typer.Option("--restart", help="throw away the checkpoints of an unfinished run")] = False,
) -> "Iterator[Result]":
    """Sample the posterior: how certain each stiffness is.

    Continues an earlier run of the same inputs that was stopped. Writes CAMPAIGN.sample.nc (ArviZ InferenceData) and
    figures into the folder given by --out. Exit status 3 where the chains are too short.
    """
    measured, described = running.read(campaign, arm)
    folder = out / f"{measured.name}.sample.part"
    with running.kept(folder):
        result = sample(described, measured, options, folder=folder, restart=restart, progress=running.progress)
    yield result
    if result.enough:
        running.discard_unless_taken(folder, discard_checkpoints)
    else:
        output().say(f"kept {one_line(str(folder))}: the same command with more --steps goes on from there")


@command(PlanOptions)
def plan_command(
    options: PlanOptions,
    campaign: Annotated[
        Path | None, typer.Argument(help="what is measured already, a CSV file; leave it out for nothing")
    ] = None,
    arm: ArmOption = None,
    runs: flag("table of runs to measure on the moving arm (see ident source): what they would tell") = None,
    out: OutOption = Path("out"),
) -> "Iterator[Result]":
    """Rank what to measure next, and the errors to expect.

    Writes CAMPAIGN.plan.json, .csv (a campaign to fill in), .png and, with --sheet, CAMPAIGN.plan.sheet, a folder to
    measure by, into --out. Without CAMPAIGN, name the arm (--arm); the files are then called after its file.
    """
    from ident.measure.table import FOREIGN

    measured: Campaign | None = None
    described: ArmFile | Path | None = arm
    if runs is not None:
        if campaign is not None:
            raise refusal("--runs", "a campaign too", "one of them", "plan them one after the other")
        described = arm or runs.parent / "arm.toml"
    elif campaign is not None:
        if FOREIGN.get(campaign.suffix.lower()) == FOREIGN[".toml"]:
            own = one_line(str(campaign))
            raise refusal(own, FOREIGN[".toml"], "measurements, a CSV file, or none", f"as ident plan --arm {own}")
        measured, described = running.read(campaign, arm)
    elif arm is None:
        raise refusal("", "neither campaign nor arm", "one of them", "as ident plan --arm arm.toml")
    yield plan(described, measured, options, runs=runs, progress=running.progress)


offer(
    resonance,
    """Draw the Campbell diagram of a motion: pulleys against modes.

    Writes ARM.MOTION.resonance.json and .png into the folder given by --out.
    """,
)
offer(
    validate,
    """Test how far a fit can be trusted where nothing was measured.

    Each posture is left out in turn (--leave), the arm is fitted to the rest, and what was left out is predicted. With
    --recover, known robots are fitted by campaigns like this one: would these rows find the truth?
    Writes CAMPAIGN.validate.json and CAMPAIGN.validate.png into the folder given by --out.
    """,
    judged=True,
)
offer(
    compare,
    """Find which stiffness has changed between two campaigns.

    Both campaigns are fitted again together: what they have in common counts once. Writes FIRST-SECOND.compare.json and
    .png into the folder given by --out.
    """,
    first=Annotated[
        Path,
        typer.Argument(metavar="before", help="earlier result of fit or sample, campaign (CSV), or folder of results"),
    ],
    second=Annotated[Path, typer.Argument(metavar="after", help="later one, or a folder")],
)
offer(
    simulate,
    """Simulate how the arm's end vibrates during a motion.

    Writes ARM.MOTION.simulate.csv, .nc and .json and figures into the folder given by --out.
    """,
)
offer(
    spectrum,
    """Show what a recording holds: quality, lines, modes near them.

    Writes FILE.spectrum.json and .png, and with --spectrogram further figures, into the folder given by --out.
    """,
    trace=Annotated[
        Path,
        typer.Argument(metavar="file", help="trace: CSV with time [s], x [mm] or x [m/s^2], ...; as of ident simulate"),
    ],
    arm=flag("arm description: marks its natural frequencies", "--arm"),
    path=flag("joint angles during the trace: CSV with time [s], joint1 [deg], ...; default: the trace's file"),
)


offer(
    triage,
    """Tell what makes a moving arm vibrate: a drive, a mode, a line.

    RUNS is a table: a row for each trace, with how the arm moved (ident source --init); or, with --path, one trace of
    the end point: time [s], x [mm] or x [m/s^2], ... Writes RUNS.triage.json and the order map RUNS.triage.png into the
    folder given by --out.
    """,
    runs=Annotated[Path, typer.Argument(metavar="runs", help="table of runs, a CSV file; with --path a trace")],
    arm=flag("arm description; default: arm.toml beside the table", "--arm"),
    path=flag("joint angles during one trace without a table: CSV with time [s], joint1 [deg], ..."),
)


offer(
    joint,
    """Tell a joint's stiffness, friction and backlash from its logs.

    Writes LOG.joint.json and .png into the folder given by --out.
    """,
    judged=True,
    logs=Annotated[
        list[Path],
        typer.Argument(
            metavar="logs",
            help="logs of the same joints: CSV with time [s], joint1.motor [deg], .link [deg], .torque [N*m]",
        ),
    ],
)


@command(SourceOptions, judged=True)
def source_command(
    runs: Annotated[Path, typer.Argument(help="table of runs, a CSV file; with --init the folder of the recordings")],
    options: SourceOptions,
    arm: flag("arm description; default: arm.toml beside the table", "--arm") = None,
    posterior: flag("posterior of ident sample (.nc), of the stiffnesses") = None,
    init: Annotated[bool, typer.Option("--init", help="write runs.csv to fill in into that folder, and stop")] = False,
    out: OutOption = Path("out"),
) -> "Iterator[Result]":
    """Identify each drive's imbalance and transmission error.

    The table has a row for each trace, and how the arm moved. Writes RUNS.source.json, which --posterior of other
    commands takes, and RUNS.source.png into the folder given by --out. Exit status 3 where the search did not settle.
    """
    if init:
        from ident.measure.runs import write_runs

        path = runs / "runs.csv"
        rows = write_runs(runs, path)
        beside = "" if (runs / "arm.toml").exists() else f" --arm {as_word(arm or 'ARM')}"
        to_fill_in(path, rows, f"source {as_word(path)}{beside}")
        return
    yield source(runs, arm, options, posterior=posterior, progress=running.progress)


offer(
    balance,
    """Balance the drives' rotors: masses, angles, what is left.

    Writes ARM.MOTION.balance.json and .png into the folder given by --out.
    """,
    source=Annotated[Path, typer.Argument(metavar="source", help="result of ident source (.source.json)")],
)


offer(
    sweep,
    """Vary numbers of the arm, or its speed, and see the vibration.

    Each parameter alone, the others as they are; two together with --grid. By the fast method. Writes
    ARM.MOTION.PARAMETERS.sweep.csv, .json and .png into the folder given by --out, when all is done.
    """,
)
offer(
    motion,
    """Choose the speed along a path that keeps a limit of vibration.

    Or one after which the end settles first (--settled). Compares the motion as it is with slower ones, other profiles,
    input shapers, the controller's knobs, and a speed chosen along the path. Writes ARM.MOTION.motion.json, .csv (the
    joint path, for the controller and ident simulate --path) and .png into the folder given by --out. Exit status 3
    where no motion keeps the limit.
    """,
    posterior=flag("posterior of ident sample (.nc): the limit is kept with 95 % by its draws"),
)
offer(
    variants,
    "Compare up to eight arms in one motion, a column each. Writes FIRST-SECOND.variants.json and .png (--out).",
    arms=Annotated[list[Path], typer.Argument(help="arm files, or results of fit, sample or design")],
)
offer(
    design,
    """Find the least change of the arm that keeps a limit.

    Writes ARM.MOTION.design.json, .toml (the changed arm) and figures into the folder given by --out; with
    --sensitivities ARM.MOTION.sensitivities.json and .png. See also ident sweep.
    """,
    posterior=flag("posterior of ident sample (.nc): the design shall keep --limit by its draws"),
)


@plain
def rerun(
    file: Annotated[Path, typer.Argument(metavar="file", help="a result: .json, or .nc of sample and diagnose")],
    out: flag("folder for the new files; default: none", "--out", "-o") = None,
    force: ForceOption = False,
) -> None:
    """Repeat a saved result and check that its numbers are the same.

    Its inputs are found by their hash: where they were, beside the file, or in this folder; an arm or campaign that is
    gone or changed is taken from the text in the file. Without an input the exit status is 2.
    Fits shall agree to 1e-9, chains within their Monte Carlo error; exit status 3 where they do not.
    """
    if out is not None:
        running.check_folder(out)
    running.start()
    from ident.studies.rerun import rerun as repeat

    folder = (out or file.parent) / f"{file.name}.rerun.part"
    with running.kept(folder):
        repeated = repeat(file, folder=folder, progress=running.progress)
    tell(repeated)
    if out is not None:
        write(repeated.now, out)
    running.discard_unless_taken(folder, discard_stages)
    if not repeated.same:
        raise typer.Exit(SHORT)


@plain
def bind(
    results: Annotated[list[Path], typer.Argument(metavar="results", help="saved results, as out/*.json")],
    title: flag("title of the first page", kind=str) = "Report",
    customer: flag("for whom", kind=str) = "",
    by: flag("who measured", kind=str) = "",
    serial: flag("serial number of the robot", kind=str) = "",
    logo: flag("PNG or JPEG image above the title") = None,
    pdf: flag("write it as a PDF in A4, too", kind=bool) = False,
    font: FontOption = None,
    out: OutOption = Path("out"),
) -> None:
    """Bind saved results into one page, with a first page to sign.

    It has verdict, cause and remedy, then the results in the order of the way, with the figures next to them;
    --details adds the details of each. What is not given is left open, to be filled in by hand. Writes report.html and,
    with --pdf, report.pdf into the folder given by --out.
    """
    from ident.studies.bind import bind as bound

    running.check_folder(out)
    lines = {"Customer": customer, "Serial number": serial, "Measured with": "", "By": by, "Date, signature": ""}
    page = bound(results, title=title, signed=lines, logo=logo, details=output().details)
    finish(page, out, pages=[partial(hand_over, page, pdf=pdf, font=font)], files=False)


# -------- Describing
# Commands about files: the content and names of an arm, the report of a result.

NEXT = {
    "show {arm}": "the arm drawn, its numbers checked",
    "show {arm} --names": "the names that commands and campaigns take",
    "check {campaign}": "what the measurements can tell",
    "fit {campaign} --out {folder}": "the stiffnesses",
}
"""Next steps for a new arm, and what they show."""
RESULTS = (".json", ".nc")
"""Endings of result files."""
STARTS = (b"{", b"\x89HDF")
"""First bytes of result files."""


@plain
def show(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="file", help="an arm (.toml, .urdf or .xml), or a result: .json, or .nc of sample and diagnose"
        ),
    ],
    posture: flag("joint angles of the drawn arm in degrees, as 30,-60,30", "--posture", "-q", kind=str | None) = None,
    names: flag(
        "list the names that options, campaigns and --set take, and draw nothing", "--names", kind=bool
    ) = False,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Draw an arm, check its numbers; or print a saved result again.

    Of an arm: masses, reach, first modes, and each number that looks wrong; with --details every number and its origin.
    Writes into the folder given by --out ARM.show.png, and ARM.show.modes.svg, in which the first modes move: any
    browser opens it. With --names: numbers with value, unit and origin, joints, points, loads, modes, kinds of
    measurement, and the words that options choose from. Of a result: the report, as the command printed it that has
    written the file. Names and results write nothing.
    """
    if is_result(file):
        for flag, given in (("--posture", posture is not None), ("--names", names)):
            if given:
                raise refusal(flag, "it for a result", "an arm", "leave it out")
        from ident.studies.saved import load

        tell(load(file))
        return
    if names and posture is not None:
        raise refusal("--posture", "it with --names", "one of them", "drop one")
    if not names:
        running.check_folder(out)
    running.start()
    from ident.studies import reading
    from ident.studies.look.show import names as names_of
    from ident.studies.look.show import show as picture_of

    if names:
        tell(names_of(file))
        return
    picture = picture_of(file, None if posture is None else reading.postures([posture], "--posture")[0])
    kept_in(out)(tell)(picture)
    for path in () if no_figure else picture.save_figures(out):
        output().wrote(path)


def is_result(file: Path) -> bool:
    """Whether a file is a result and no arm, by its ending or else by its first bytes.

    Raises:
        InputError: no such file.
    """
    if file.suffix in RESULTS:
        return True
    expected = "an arm description (TOML, URDF or MJCF) or a result file of ident (.json or .nc)"
    return read_bytes(file, expected).startswith(STARTS)


@plain
def new(
    kind: Annotated[str, typer.Argument(help=f"{' or '.join(KINDS)}; with --robot, the folder")],
    folder: Annotated[Path | None, typer.Argument(help="folder to make")] = None,
    robot: flag("robot description (URDF or MJCF) to take the arm from", "--robot", "--urdf") = None,
    tip: flag(
        "link, body or site of it that the arm ends with; default: the end of the chain", "--tip", kind=str | None
    ) = None,
) -> None:
    """Write an arm and a campaign to run and to fill in.

    As `ident new scara my_robot`, or `ident new my_robot --robot robot.urdf`. Writes arm.toml, in which every number
    has a comment or an origin, and campaign.csv, simulated with stiffnesses that it states.
    """
    from ident.studies.look import new as study

    if robot is not None and folder is None:
        folder = Path(kind)
    elif robot is not None:
        raise refusal("", "a kind and --robot", "one of them", "as ident new my_robot --robot robot.urdf")
    if tip is not None and robot is None:
        raise refusal("--tip", "a tip without --robot", "a robot description that has it", "leave it out")
    if folder is None:
        raise refusal("", "no folder", "the folder to make", f"as ident new {KINDS[0]} my_robot")
    running.check_folder(folder)
    if robot is None:
        made = study.new(kind, folder)
    else:
        running.start()
        made = study.new_from_robot(robot, folder, tip)
    for note in made.notes:
        output().say(textwrap.fill(f"NOTE: {note}", 100, **FOLDED))
    output().document = lambda: {"notes": list(made.notes)} if made.notes else {}
    for path in made.paths:
        output().wrote(path)
    output().say("Example numbers: every one is marked as assumed, or simulated. Next:")
    names = {"arm": as_word(made.paths[0]), "campaign": as_word(made.paths[1]), "folder": as_word(folder / "out")}
    lines = {f"ident {words.format(**names)}": shown for words, shown in NEXT.items()}
    for words, shown in lines.items():
        output().say(f"  {words:{max(map(len, lines))}}  {shown}")


# -------- Diagnosing
# `ident diagnose`: prints each finished stage, and frees the memory of a stage.


@command(DiagnoseOptions, judged=True)
def diagnose_command(
    campaign: CampaignArgument,
    options: DiagnoseOptions,
    arm: ArmOption = None,
    path: PathOption = None,
    runs: flag("table of runs (see ident source), to identify what excites the arm") = None,
    restart: Annotated[bool, typer.Option("--restart", help="throw away the stages of an unfinished run")] = False,
    out: OutOption = Path("out"),
) -> "Iterator[Result]":
    """Go from a campaign to a verdict, a cause and a cure.

    Stiffnesses, natural frequencies along the motion, resonance, vibration against the limit; remedies by their effort:
    another speed, mass centres, torsional stiffness. Continues an earlier run of the same inputs that was stopped.
    Writes CAMPAIGN.diagnose.json, .png (the vibration) and .nc (the posterior) into the folder given by --out; with
    --page or --pdf the figures of all stages. Exit status 3 where the posterior's chains are too short.
    """
    measured, arm_file = running.read(campaign, arm)
    import jax

    folder = part_folder(out, measured)

    def finished(report: "StageReport") -> None:
        if not output().quiet:
            typer.echo(str(report), err=True)
        if report.name in ("trust", "vibration", "sensitivities"):
            jax.clear_caches()  # most programs of the next stage are new
            gc.collect()
        running.glibc("malloc_trim", 0)  # with few heaps (`running.start`) 1.0 instead of 1.3 GB

    with running.kept(folder):
        result = diagnose(
            arm_file,
            measured,
            options,
            path=path,
            runs=runs,
            folder=folder,
            restart=restart,
            progress=running.progress,
            on_stage=finished,
        )
    yield result
    running.discard_unless_taken(folder, discard_stages)


# -------- Exploring
# The command `ident explore`: an arm as a page with sliders.

offer(
    explore,
    """Explore an arm by hand: a page with sliders.

    The page shows the arm and its modes, natural frequencies along the motion against the pulleys', static deflection
    and steady response, and computes them itself: one HTML file, no network, no server. Writes ARM.explore.html into
    the folder given by --out.
    """,
    pages=False,
    measured=flag("measurements to show beside, a CSV file (data/README.md)", "--campaign"),
)


# -------- Exporting
# The command `ident export`: identified numbers in the robot's own description.


@plain
def export(
    result: Annotated[Path, typer.Argument(help="result of ident fit (.fit.json) or ident sample (.sample.nc)")],
    out: flag(
        "file to write: .xml (MJCF), .urdf, .toml or .json; default: out/ARM.fitted, as ARM ends", "--out", "-o"
    ) = None,
    arm: flag("description to write into; default: the one that was fitted", "--arm") = None,
    posture: flag(
        "joint angles in degrees, as 30,-60,30, where MJCF is exact under weight", "--posture", "-q", kind=str | None
    ) = None,
    force: flag("write into the description of another robot, too", "--force", kind=bool) = False,
) -> None:
    """Write identified values into the robot's own description.

    MJCF gets three passive hinges before each driven one, URDF a comment, both .joints.toml beside them, by which ident
    reads them; an arm file the values, with the origin calibrated. Of a posterior the medians are written.
    """
    running.start()
    from ident.studies import reading
    from ident.studies.look.export import export as write
    from ident.studies.saved import load

    at = None if posture is None else reading.postures([posture], "--posture")[0]
    saved = load(result)
    for path in write(saved, out, arm=arm, posture=at, force=force):
        output().wrote(path)
    verdict = saved.sections().verdict
    if verdict and verdict.kind == "bad":
        output().say(textwrap.fill(f"NOTE: {one_line(str(result))} is {verdict.word}: {verdict.reason}", 100, **FOLDED))


# -------- Fleet
# The command `ident fleet`: many robots of one design.


@command(FleetOptions, judged=True)
def fleet_command(
    robots: Annotated[Path, typer.Argument(help="folder with a CSV file, or a folder with one, for each robot")],
    options: FleetOptions,
    arm: flag("arm of robots whose folder has none; default: arm.toml beside them", "--arm") = None,
    out: OutOption = Path("out"),
) -> "Iterator[Result]":
    """Fit each robot of a fleet: their spread, and who stands out.

    Continues an earlier run of the same inputs that was stopped. Writes ROBOTS.fleet.json, .prior (flags of ident fit
    for the next robot) and .png into the folder given by --out. Exit status 3 where a robot failed.
    """
    folder = out / f"{robots.absolute().name}.fleet.robots"
    with running.kept(folder):
        result = fleet(robots, arm, options, folder=folder, progress=running.progress)
    yield result
    output().say(f"kept {one_line(str(folder))}: fits of robots whose files have not changed are taken from there")


# -------- Modal
# The command `ident modal`: from the files of a hammer or ambient test to a campaign.


@command(ModalOptions, judged=True)
def modal_command(
    tests: Annotated[
        Path,
        typer.Argument(help="folder of recordings: UFF, CSV, MAT, LVM, TDMS, WAV or HDF5, see docs/commands/modal.md"),
    ],
    options: ModalOptions,
    channels: flag("channel table, a CSV file; default: channels.csv in the folder") = None,
    arm: flag("arm description; default: arm.toml in the folder", "--arm") = None,
    init: Annotated[bool, typer.Option("--init", help="write the channel table to fill in, and stop")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="judge each file as it comes")] = False,
    out: OutOption = Path("out"),
) -> "Iterator[Result]":
    """Make a campaign of a hammer test, or of one without force.

    Lists the hits that were rejected, lines of rotating parts, and modes without a certain name, with the reason.
    Writes TESTS.modal.csv (a campaign for ident fit), .covariance.csv, .nc, .json and three figures for each posture
    into the folder given by --out.
    """
    if init:
        to_fill_in(*new_channels(tests, channels, arm), f"modal {as_word(tests)}")
        return
    if watch:
        from ident.studies.measuring.modal_watch import Watch

        watched = Watch(tests, channels, arm, options)
        try:
            for line in watched.lines():
                output().say(textwrap.fill(one_line(line), 100, **FOLDED))
        except KeyboardInterrupt:
            if missing := sum(not watched.count.get(step) for step in watched.steps):
                left = f"{missing} of {len(watched.steps)} names of the table without a good recording"
                output().say(f"stopped, {left}; the same command goes on from there")
                raise typer.Exit(130) from None
    yield modal_test(tests, channels, arm, options)


# -------- Doctor
# The command `ident doctor`: information to send with a question.

OPTIONAL = ("mujoco", "yourdfpy", "openpyxl", "pyuff", "npTDMS", "lvm-read", "dynesty", "fpdf2")
"""Libraries for some inputs and options."""


@plain
def doctor() -> None:
    """Print what to send with a question: versions, processor."""
    running.start()
    import jax

    from ident.programs import LIBRARIES

    cache = Path(jax.config.values["jax_compilation_cache_dir"] or ".").parent
    files = [Path(folder) / name for folder, _, names in os.walk(cache) for name in names]  # skips files that vanish
    size = sum(path.stat().st_size for path in files if path.is_file())
    devices = ", ".join(map(str, jax.devices()))
    found = {
        "system": f"Python {platform.python_version()}, {platform.platform()}, {os.cpu_count()} cores",
        "libraries": ", ".join(f"{name} {_version(name)}" for name in ("ident-arm", *LIBRARIES)),
        "optional": ", ".join(f"{name} {_version(name)}" for name in OPTIONAL),
        "backend": f"{jax.default_backend()} ({devices}), double precision {jax.config.values['jax_enable_x64']}",
        "cache": f"{cache}, {size / 1e6:.0f} MB; programs {os.environ['IDENT_PROGRAMS']}",
    }
    for name, words in found.items():
        output().say(textwrap.fill(f"{name}: {words}", 100, **FOLDED))
    output().document = lambda: found


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "-"
