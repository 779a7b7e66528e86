"""How `--vary PATHS[=LOW:HIGH[:COUNT]]` is read."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from ident.cli.ranges import read_range
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.vibrate.redesign.ranges import Range
    from ident.vibrate.redesign.sweep import Axis
    from ident.vibrate.redesign.variable import Extents

VaryOption = Annotated[
    list[str],
    typer.Option(
        help="number to vary, with bounds in SI, or in multiples of the present value with an x behind, and a count: "
        "joint1.k_tors, bracket.com.x=0:0.29, speed=4:20:17 (percent), link1.mass=0.5x:2x; several by one common "
        "factor: a.k_tors=b.k_tors=0.5x:2x; may be repeated"
    ),
]
NAMED_MOST = 3
"""Parameters that the names of files tell one by one."""


def ranges(texts: Sequence[str]) -> "list[Range]":
    """Read the options."""
    return [_range(text) for text in texts]


def _range(text: str) -> "Range":
    from ident.vibrate.redesign.ranges import Range

    paths, bounds, count = read_range(text, "--vary", "COUNT")
    if count is not None and count != int(count):
        raise InputError(Problem(f"--vary {text}", f"{count:g} values", "a whole number", "correct the count"))
    return Range(paths, bounds, None if count is None else int(count))


def axes(
    arm: "Arm", texts: Sequence[str], asked: "Sequence[Range]", percent: float, extents: "Extents", usual: int
) -> "list[Axis]":
    """Return the axes of the ranges; complaints tell the option."""
    from ident.vibrate.redesign.ranges import axis_of

    found = []
    for text, one in zip(texts, asked, strict=True):
        try:
            found.append(axis_of(arm, one, percent, extents, usual))
        except InputError as error:
            where = f"--vary {text}"
            raise InputError(replace(problem, where=where, column="") for problem in error.problems[:1]) from None
    return found


def check_map(asked: "Sequence[Range]") -> None:
    """Refuse what is no map."""
    if len(asked) != 2:
        got = f"{len(asked)} parameter{'s' if len(asked) > 1 else ''}"
        raise InputError(Problem("--grid", got, "two", "give --vary twice, or drop --grid"))


def check_points(found: "Sequence[Axis]") -> None:
    """Refuse a map of too many points."""
    from ident.vibrate.redesign.ranges import MOST_ON_MAP

    first, second = (len(axis.values) for axis in found)
    if first * second > MOST_ON_MAP:
        got, expected = f"{first} x {second} = {first * second} points", f"at most {MOST_ON_MAP}"
        raise InputError(Problem("--grid", got, expected, "give smaller counts (--vary PATH=LOW:HIGH:COUNT)"))


def label(asked: "Sequence[Range]", grid: bool) -> str:
    """Return what the names of files tell of the parameters."""
    names = [one.paths[0] + ("-etc" if len(one.paths) > 1 else "") for one in asked]
    if grid:
        return "-by-".join(names)
    shown = names if len(names) <= NAMED_MOST else [names[0], f"{len(names) - 1}-more"]
    return "+".join(shown)
