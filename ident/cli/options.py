"""Arguments and options that several commands take, and how their texts are read."""

from collections.abc import Mapping
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from ident.errors import InputError, Problem

T = TypeVar("T")
UNRECORDED = ("campaign", "arm", "out", "no_prior", "no_figure", "restart")
"""Options that say where things are or what is shown, not what is computed; inputs are recorded by their hashes."""
REPEATED = ("fix", "tie", "free", "prior", "discrepancy", "parameter", "noise", "load", "sigma", "cost")
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
TrustOption = Annotated[bool, typer.Option("--trust-values", help="accept values that look implausible")]


def asked(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a command's options as its result file records them; `given` are the command's `locals()` at its start."""
    record = {name: value for name, value in given.items() if name not in UNRECORDED}
    record |= {name: list(record[name] or ()) for name in REPEATED if name in record}
    return record | {"prior_sd": None if given["no_prior"] else given["prior_sd"]}


def unknowns(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the recorded options that pose the problem, as the arguments of `pose`."""
    from ident.identify.priors import Prior

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
