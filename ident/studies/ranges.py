"""Format of number ranges: `PATHS[=LOW:HIGH[:THIRD]]` as text, {"PATHS": (LOW, HIGH, THIRD)} in Python."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from ident.errors import InputError, Problem, placed, refusal
from ident.studies.reading import each_of, number, once

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.vibrate.sweep import Bound, Range

T = TypeVar("T")
Limits = tuple[float | str, ...]
"""Nothing, or two bounds, each in SI or as text "0.5x", a multiple of the present value, and perhaps a third number."""


def ranges(texts: Sequence[str], flag: str) -> dict[str, Limits]:
    """Read `PATHS[=LOW:HIGH[:THIRD]]`; PATHS are names joined by =."""
    return once(flag, [_split(text, f"{flag} {text}") for text in each_of(texts)])


def problems(option: str, given: Mapping[str, Limits], third: str) -> list[Problem]:
    """Return the errors in the ranges of an option that do not depend on the arm; `third` names the third number."""
    found = []
    for paths, limits in given.items():
        where = _where(option, paths, limits)
        if not all(paths.split("=")):
            found.append(Problem(where, "an empty name", "names with = between", "as a.k_tors=b.k_tors"))
        if len(limits) not in (0, 2, 3):
            found.append(Problem(where, f"'{_text(limits)}'", f"LOW:HIGH or LOW:HIGH:{third}", "as 0.5x:2x"))
            continue
        try:
            range_of(paths, limits, where)
        except InputError as error:
            found += error.problems
    return found


def range_of(paths: str, limits: Limits, where: str = "") -> "Range":
    """Return a range in the form of the arm's own calculations."""
    from ident.vibrate.sweep import Range

    third = number(str(limits[2]), where) if len(limits) > 2 else None
    bounds = (_bound(limits[0], where), _bound(limits[1], where)) if limits else None
    return Range(tuple(paths.split("=")), bounds, third)


def each(option: str, given: Mapping[str, Limits], arm: "Arm", make: "Callable[[Range], T]") -> list[T]:
    """Return `make` of each range, by default of the torsional stiffness of every joint."""
    made = []
    for paths, limits in (given or {f"{j.name}.k_tors": () for j in arm.joints if j.k_tors is not None}).items():
        with placed(_where(option, paths, limits)):
            made.append(make(range_of(paths, limits)))
    return made


def _split(text: str, where: str) -> tuple[str, Limits]:
    *paths, last = (part.strip() for part in text.split("="))
    if last[:1].isalpha() and ":" not in last:
        paths, last = [*paths, last], ""
    elif not last or not paths:
        raise refusal(where, "no PATH=LOW:HIGH", "a number, = and its bounds", "as fingers.com.x=1:2")
    return "=".join(paths), tuple(_plain(part.strip()) for part in last.split(":")) if last else ()


def _plain(text: str) -> float | str:
    """Return a number if it is one, else the text."""
    try:
        return float(text)
    except ValueError:
        return text


def _bound(limit: float | str, where: str) -> "Bound":
    from ident.vibrate.sweep import Bound

    text = str(limit)
    return Bound(number(text.removesuffix("x"), where), times=text.endswith("x"))


def _where(option: str, paths: str, limits: Limits) -> str:
    return f"`{option}` {paths}{'=' * bool(limits)}{_text(limits)}"


def _text(limits: Limits) -> str:
    return ":".join(limit if isinstance(limit, str) else f"{limit:.12g}" for limit in limits)
