"""How `--vary PATHS[=LOW:HIGH[:COUNT]]` is read."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import options
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.vibrate.ranges import Bound, Range
    from ident.vibrate.sweep import Axis
    from ident.vibrate.variable import Extents

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


def axes(
    arm: "Arm", texts: Sequence[str], asked: "Sequence[Range]", percent: float, extents: "Extents", usual: int
) -> "list[Axis]":
    """Return the axes of the ranges; complaints tell the option."""
    from ident.vibrate.ranges import axis_of

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
    from ident.vibrate.ranges import MOST_ON_MAP

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


def _range(text: str) -> "Range":
    from ident.vibrate.ranges import Range

    where = f"--vary {text}"
    *paths, last = (part.strip() for part in text.split("="))
    if last[:1].isalpha() and ":" not in last:
        paths, last = [*paths, last], ""
    elif not last or not paths:
        raise InputError(Problem(where, "no PATH=LOW:HIGH", "a number, = and its bounds", "as fingers.com.x=1:2"))
    if not all(paths):
        raise InputError(Problem(where, "an empty name", "names with = between", "as a.k_tors=b.k_tors"))
    if not last:
        return Range(tuple(paths))
    parts = last.split(":")
    if len(parts) not in (2, 3):
        raise InputError(Problem(where, f"'{last}'", "LOW:HIGH or LOW:HIGH:COUNT", "as 0.5x:2x or 1.0:2.2:13"))
    count: Any = None
    if len(parts) == 3:
        count = options.number(parts[2], where)
        if count != int(count):
            raise InputError(Problem(where, f"{count:g} values", "a whole number", "correct the count"))
        count = int(count)
    return Range(tuple(paths), (_bound(parts[0], where), _bound(parts[1], where)), count)


def _bound(text: str, where: str) -> "Bound":
    from ident.vibrate.ranges import Bound

    times = text.strip().endswith("x")
    return Bound(options.number(text.strip().removesuffix("x"), where), times)
