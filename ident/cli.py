"""The command line: reads, calls, writes. Exit code 2 for bad input, 1 when the model has no answer."""

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ident import __version__
from ident.errors import IdentError, InputError, Problem

if TYPE_CHECKING:
    from ident.arm.file import ArmFile
    from ident.measure import Campaign

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="How stiff is each joint of a robot arm? ident fits joint stiffnesses to measured natural frequencies "
    "and static deflections, and says how far each one can be trusted.",
)

CampaignArgument = Annotated[Path, typer.Argument(help="measurements, a CSV file (data/README.md)")]
ArmOption = Annotated[Path | None, typer.Option("--arm", help="arm description; default: arm.toml beside the campaign")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for result file and figure")]


@app.command("fit")
def fit_command(
    campaign: CampaignArgument,
    arm: ArmOption = None,
    out: OutOption = Path("out"),
    fix: Annotated[
        list[str] | None,
        typer.Option(help="parameter to keep at the arm file's value, as joint1.k_bend; may be repeated"),
    ] = None,
    tie: Annotated[
        list[str] | None, typer.Option(help="parameters fitted as one, as joint2.k_tors=joint3.k_tors; may be repeated")
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="further unknown with the width of its prior, as link2.mass:0.1 (10 %) or "
            "joint2.offset.x:0.01 (m); without a width it has no prior"
        ),
    ] = None,
    prior_sd: Annotated[float, typer.Option(help="width of the prior: standard deviation of ln(stiffness)")] = 1.0,
    no_prior: Annotated[bool, typer.Option("--no-prior", help="no prior on stiffness and damping")] = False,
    starts: Annotated[int, typer.Option(min=1, help="starts of the search, at least")] = 16,
    seed: Annotated[int, typer.Option(min=0, help="seed of the starts")] = 0,
    trust_values: Annotated[bool, typer.Option("--trust-values", help="accept values that look implausible")] = False,
    no_figure: Annotated[bool, typer.Option("--no-figure", help="write no figure")] = False,
) -> None:
    """Fit the joint stiffnesses to a campaign and say what the data support.

    Damping is fitted too where damping ratios were measured. Writes CAMPAIGN.fit.json and CAMPAIGN.fit.png into the
    folder given by --out.
    """
    _start()
    import math

    from ident.identify.campaign_fit import fit_campaign
    from ident.present.report import fit_report
    from ident.present.result import fit_document, write_json

    measured, arm_file = _read(campaign, arm)
    width = math.inf if no_prior else prior_sd
    result = fit_campaign(
        arm_file.arm,
        measured,
        fixed=fix or (),
        tied=[_tied(group) for group in tie or ()],
        free=dict(_with_width(text) for text in free or ()),
        prior_sd=width,
        starts=starts,
        seed=seed,
        trust_values=trust_values,
        progress=_progress,
    )
    options = {
        "fix": fix or [],
        "tie": tie or [],
        "free": free or [],
        "prior_sd": None if no_prior else prior_sd,
        "starts": starts,
        "seed": seed,
        "trust_values": trust_values,
    }
    typer.echo(fit_report(result))
    path = out / f"{measured.name}.fit.json"
    write_json(fit_document(result, arm_file, options), path)
    typer.echo(f"wrote {path}")
    if not no_figure:
        from ident.present.figures import fit_figure, save

        save(fit_figure(result), path.with_suffix(".png"))
        typer.echo(f"wrote {path.with_suffix('.png')}")


@app.command("predict")
def predict_command(
    arm: Annotated[Path, typer.Argument(help="arm description, a TOML file (data/README.md)")],
    posture: Annotated[
        list[str] | None,
        typer.Option("--posture", "-q", help="joint angles in degrees, as 30,-60,30; may be repeated"),
    ] = None,
    load: Annotated[str, typer.Option(help="load case, as 'glass' or '5 kg @ tip'")] = "",
    modes: Annotated[int, typer.Option(min=1, help="number of modes")] = 6,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", help="number to change, in SI, as link2.mass=30 (inertia stays as it is)"),
    ] = None,
) -> None:
    """Predict natural frequencies, modes and static deflection of an arm."""
    _start()
    from ident.arm.file import read_arm
    from ident.identify.survey import survey
    from ident.measure import Load
    from ident.present.survey_report import survey_report

    described = read_arm(arm)
    described = described.replace(dict(_assignment(text) for text in change or ()))
    postures = [_posture(text) for text in posture or ()] or [(0.0,) * len(described.driven)]
    for held in postures:
        typer.echo(survey_report(survey(described, held, Load.parse(load), modes)))


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and stop", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Options of the program itself."""


def main() -> None:
    """Run the command line."""
    try:
        app()
    except InputError as error:
        _stop(error, 2)
    except IdentError as error:
        _stop(error, 1)


def _stop(error: IdentError, code: int) -> None:
    for line in str(error).splitlines():
        typer.echo(f"ident: {line}", err=True)
    sys.exit(code)


def _start() -> None:
    """Set up jax: double precision, and compiled programs kept from one run to the next."""
    import jax

    folder = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        jax.config.update("jax_compilation_cache_dir", str(Path(folder) / "ident" / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _read(campaign: Path, arm: Path | None) -> tuple["Campaign", "ArmFile"]:
    from ident.arm.file import read_arm_file
    from ident.measure import read_campaign

    measured = read_campaign(campaign)
    return measured, read_arm_file(arm or campaign.parent / "arm.toml")


def _progress(numbers: Iterable[int]) -> Iterator[int]:
    """Show a bar on a terminal; it vanishes at the end."""
    from rich.console import Console
    from rich.progress import track

    return iter(
        track(
            numbers,
            description="starts",
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
    )


def _tied(text: str) -> tuple[str, ...]:
    paths = tuple(text.split("="))
    if len(paths) < 2:
        raise InputError(
            Problem(f"--tie {text}", "one parameter", "two or more with = between", "as a.k_tors=b.k_tors")
        )
    return paths


def _with_width(text: str) -> tuple[str, float]:
    path, _, width = text.partition(":")
    return path, _number(width, f"--free {text}") if width else float("inf")


def _assignment(text: str) -> tuple[str, float]:
    path, _, value = text.partition("=")
    number, field = _number(value, f"--set {text}"), path.split(".")[1:2]
    if field and field[0] in ("mass", "k_bend", "k_tors", "tau_bend", "tau_tors") and number < 0:
        raise InputError(Problem(f"--set {text}", f"{number:g}", "a value >= 0", "correct it"))
    return path, number


def _posture(text: str) -> tuple[float, ...]:
    from math import radians

    return tuple(radians(_number(part, f"--posture {text}")) for part in text.split(","))


def _number(text: str, where: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if number - number != 0:
        raise InputError(Problem(where, f"'{text}'", "a finite number", "correct it, see --help"))
    return number
