"""What the commands share that move an arm: its motion, and the values that it takes over."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import options
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.vibrate.motion.motion import Motion

NAMED = {
    "percent": "--speed",
    "profile": "--profile",
    "dwell": "--dwell",
    "smoothing": "--smoothing",
    "method": "--method",
    "rate": "--rate",
}
"""The option that gives each argument of the library."""
STROKE = (
    "add a [stroke] with direction, folded, unfolded, speed, acceleration and jerk to the arm file, as in"
    " data/lcd_arm/arm.toml, or give a joint path (--path)"
)
SpeedOption = Annotated[
    float | None, typer.Option(help="percent of full speed, default 10; with --path of its own speed, default 100")
]
ProfileOption = Annotated[
    str | None, typer.Option(help="of the stroke's speed: s-curve (default), trapezoid or cycloid")
]
RetractOption = Annotated[bool, typer.Option("--retract", help="from unfolded to folded")]
PathOption = Annotated[
    Path | None,
    typer.Option(help="joint path to follow instead of the stroke: CSV with time [s], joint1 [deg], ..."),
]
SmoothingOption = Annotated[float, typer.Option(help="noise of that path, rms [deg]")]
FitOption = Annotated[Path | None, typer.Option(help="result file of ident fit, whose values the arm takes over")]
PosteriorOption = Annotated[
    Path | None, typer.Option(help="posterior of ident sample (.nc): bands of 5 to 95 % by its draws")
]
DrawsOption = Annotated[int, typer.Option(min=1, help="draws of the posterior")]
DrawSeedOption = Annotated[
    int | None, typer.Option(min=0, help="choose the draws at random; default: spread evenly over the chains")
]


def values(
    arm: "Arm", fit: Path | None, posterior: Path | None, draws: int, seed: int | None, changed: dict[str, float]
) -> "tuple[Values | None, Values | None, Arm]":
    """Read fitted values and draws, and return both with the arm that takes them over: of draws, the medians."""
    from ident.arm.drive_check import check_drives
    from ident.studies.motion import drawn_values, fitted_values

    fitted = fitted_values(fit, arm) if fit else None
    found = drawn_values(posterior, arm, draws, seed) if posterior else None
    central = fitted or found
    described = arm.replace((central.medians if central else {}) | changed)
    check_drives(described)
    return fitted, found, described


def drawn(posterior: "Values", changed: dict[str, float]) -> "dict[str, Any]":
    """Return the draws of the numbers that the user has not set."""
    left = posterior.without(changed)
    if not left:
        raise InputError(Problem("--set", "every number of the posterior", "one that is drawn", "drop one of them"))
    return left


def check(asked: dict[str, Any], path: Path | None) -> None:
    """Refuse options that do not go together."""
    if path is not None and (asked["profile"] or asked["retract"]):
        option = "--profile" if asked["profile"] else "--retract"
        raise InputError(Problem(option, "it beside --path", "one of them", "it shapes the stroke: drop one"))
    if path is None and asked["smoothing"]:
        raise InputError(Problem("--smoothing", "it without --path", "a path to smooth", "drop it, or give --path"))


def motion(arm: "Arm", asked: dict[str, Any], path: Path | None) -> "tuple[Motion, Log | None]":
    """Return the stroke, or the path of a log, within the joint limits."""
    from math import radians

    from ident.measure import read_log
    from ident.vibrate.motion.limits import beyond_limits
    from ident.vibrate.motion.replay import replay
    from ident.vibrate.motion.stroke import stroke

    if path is None:
        if arm.stroke is None:
            raise InputError(Problem(arm.name, "no stroke", "what the arm shall carry out", STROKE))
        form = {"profile": asked["profile"] or "s-curve", "retract": asked["retract"], "dwell": asked["dwell"]}
        straight = options.renamed(NAMED, stroke, arm.stroke, percent=percent(asked, path), **form)
        beyond_limits(arm, straight)
        return straight, None
    log = read_log(path, [joint.name for joint in arm.driven])
    import numpy as np

    angles = np.stack(list(log.angles.values()))
    replayed = options.renamed(NAMED, replay, log.time, angles, smoothing=radians(asked["smoothing"]), name=path.name)
    if asked["speed"] is not None:
        replayed = options.renamed(NAMED, replayed.at_speed, asked["speed"])
    replayed = options.renamed(NAMED, replayed.dwell, asked["dwell"])
    beyond_limits(arm, replayed)
    return replayed, log


def percent(asked: dict[str, Any], path: Path | None) -> float:
    """Return the speed [%]: by default 10 of the stroke, and 100 of a path, its own."""
    return float(asked["speed"] if asked["speed"] is not None else 10.0 if path is None else 100.0)


def name(arm: Path, asked: dict[str, Any], path: Path | None) -> str:
    """Return what the files are called: arm, motion, percent."""
    if path is not None:
        own = "" if asked["speed"] is None else f"-{asked['speed']:g}"
        return f"{arm.stem}.{path.stem}{own}"
    form = "" if asked["profile"] in (None, "s-curve") else f"-{asked['profile']}"
    return f"{arm.stem}.{'retract' if asked['retract'] else 'extend'}-{percent(asked, path):g}{form}"
