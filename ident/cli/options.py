"""Arguments and options that several commands take, and how their texts are read."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf, isfinite, radians
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from ident.errors import InputError, Problem

T = TypeVar("T")
UNRECORDED = ("campaign", "arm", "out", "no_prior", "no_figure", "restart")
"""Options that say where things are or what is shown, not what is computed; inputs are recorded by their hashes."""
REPEATED = (
    "fix",
    "tie",
    "free",
    "prior",
    "discrepancy",
    "parameter",
    "noise",
    "load",
    "sigma",
    "cost",
    "change",
    "vary",
    "assigned",
)
"""Options that may be given several times."""
StartsOption = Annotated[int, typer.Option(min=1, help="starts of the fit, at least")]
CampaignArgument = Annotated[Path, typer.Argument(help="measurements, a CSV file (data/README.md)")]
ArmOption = Annotated[Path | None, typer.Option("--arm", help="arm description; default: arm.toml beside the campaign")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for what is written")]
NoFigureOption = Annotated[bool, typer.Option("--no-figure", help="write no figure")]
SeedOption = Annotated[int, typer.Option(min=0, help="seed of all that is drawn at random")]
FixOption = Annotated[
    list[str] | None, typer.Option(help="parameter to keep at the arm file's value, as joint1.k_bend; may be repeated")
]
TieOption = Annotated[
    list[str] | None, typer.Option(help="parameters fitted as one, as joint2.k_tors=joint3.k_tors; may be repeated")
]
FreeOption = Annotated[
    list[str] | None,
    typer.Option(
        help="further unknown with the width of its prior, as link2.mass:0.1 (10 %) or "
        "joint2.offset.x:0.01 (m); without a width it has no prior"
    ),
]
PriorSdOption = Annotated[float, typer.Option(help="width of the prior: standard deviation of ln(stiffness)")]
NoPriorOption = Annotated[bool, typer.Option("--no-prior", help="no prior on stiffness and damping")]
PriorOption = Annotated[
    list[str] | None,
    typer.Option(
        help="prior of one parameter in SI, as joint1.k_tors=catalogue:K1:K2:K3 (of its harmonic drive), "
        "=log-uniform:LOW:HIGH or =log-normal:MEDIAN:SD; may be repeated"
    ),
]
DiscrepancyOption = Annotated[
    list[str] | None,
    typer.Option(
        help="kind of measurement that the model may get wrong by a common factor, with the width of ln(factor), "
        "as deflection:0.1 (10 %); may be repeated"
    ),
]
ArmArgument = Annotated[Path, typer.Argument(help="arm description, a TOML file (data/README.md)")]
LoadOption = Annotated[str, typer.Option(help="load case, as 'glass' or '5 kg @ tip'")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="number to change, in SI, as link2.mass=30 (inertia stays as it is); may be repeated"),
]
TrustOption = Annotated[bool, typer.Option("--trust-values", help="accept values that look implausible")]


def asked(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a command's options as its result file records them; `given` are the command's `locals()` at its start."""
    return recorded(given) | {"prior_sd": None if given["no_prior"] else given["prior_sd"]}


def recorded(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a command that poses no inverse problem as its result file records them."""
    record = {name: value for name, value in given.items() if name not in UNRECORDED and not isinstance(value, Path)}
    return record | {
        name: list(record[name] or ()) for name in REPEATED if name in record and not isinstance(record[name], str)
    }


def unknowns(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the recorded options that pose the problem, as the arguments of `pose`."""
    from ident.inference.priors import Prior

    priors = [_named(text, f"--prior {text}") for text in asked["prior"]]
    return {
        "fixed": asked["fix"],
        "tied": [_tied(group) for group in asked["tie"]],
        "free": _once("--free", [_with_width(text, "--free") for text in asked["free"]]),
        "prior_sd": inf if asked["prior_sd"] is None else asked["prior_sd"],
        "priors": {name: Prior.parse(form) for name, form in _once("--prior", priors).items()},
        "discrepancy": _once("--discrepancy", [_with_width(text, "--discrepancy") for text in asked["discrepancy"]]),
    }


def number(text: str, where: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not isfinite(value):
        raise InputError(Problem(where, f"'{text}'", "a finite number", "correct it, see --help"))
    return value


def numbers(texts: list[str] | None, option: str) -> dict[str, float]:
    """Read options of the form NAME=NUMBER."""
    pairs = (_named(text, f"{option} {text}") for text in texts or ())
    return {name: number(value, f"{option} {name}={value}") for name, value in pairs}


def assignments(texts: list[str] | None) -> dict[str, float]:
    """Read `--set PATH=VALUE`; what the number cannot be is refused."""
    from ident.arm.fields import EXPECTED, field_of

    found = numbers(texts, "--set")
    for path, value in found.items():
        if (field := field_of(path)) and not field.allows(value):
            raise InputError(Problem(f"--set {path}={value:g}", f"{value:g}", EXPECTED[field.sign], "correct it"))
    return found


def posture(text: str) -> tuple[float, ...]:
    """Read joint angles in degrees, as `30,-60,30`, into radians."""
    return tuple(radians(number(part, f"--posture {text}")) for part in text.split(","))


def several(text: str, option: str) -> tuple[float, ...]:
    """Read numbers with commas between."""
    return tuple(number(part, f"{option} {text}") for part in text.split(","))


def frequency_band(text: str, option: str) -> tuple[float, float]:
    """Read a band of frequencies LOW:HIGH [Hz]."""
    parts = [number(part, f"{option} {text}") for part in text.split(":")]
    if len(parts) != 2 or not 0 <= parts[0] < parts[1]:
        raise InputError(Problem(f"{option} {text}", "no band", "LOW:HIGH in Hz, 0 <= LOW < HIGH", "as 4:8"))
    return parts[0], parts[1]


def check_positive(value: float | None, option: str) -> None:
    """Refuse a number that is not above zero, or not finite."""
    if value is not None and not 0 < value < inf:
        raise InputError(Problem(option, f"{value:g}", "a number above 0", "correct it"))


def renamed(names: Mapping[str, str], function: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """Call a function; its complaints about arguments speak of the options that `names` gives for them."""
    try:
        return function(*arguments, **named)
    except InputError as error:
        raise InputError(_renamed(names, problem) for problem in error.problems) from None


def _renamed(names: Mapping[str, str], problem: Problem) -> Problem:
    option = names.get(problem.column or problem.where)
    return replace(problem, where=option, column="") if option else problem


def _once(option: str, pairs: list[tuple[str, T]]) -> dict[str, T]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(Problem(option, f"{twice} twice", "each once", "keep one of them"))
    return found


def _named(text: str, where: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise InputError(Problem(where, "no NAME=VALUE", "a name, = and what it is given", "correct it, see --help"))
    return name, value


def _tied(text: str) -> tuple[str, ...]:
    paths = tuple(text.split("="))
    if len(paths) < 2:
        remedy = "as a.k_tors=b.k_tors"
        raise InputError(Problem(f"--tie {text}", "one parameter", "two or more with = between", remedy))
    return paths


def _with_width(text: str, option: str) -> tuple[str, float]:
    path, _, width = text.partition(":")
    return path, number(width, f"{option} {text}") if width else inf
