"""How `PATHS[=LOW:HIGH[:THIRD]]` is read: numbers that go together, bounds in SI or as multiples, a third."""

from typing import TYPE_CHECKING, NamedTuple

from ident.cli import options
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.vibrate.redesign.ranges import Bound


class Range(NamedTuple):
    """Numbers with = between, their bounds if there are any, and what stands behind these."""

    paths: tuple[str, ...]
    bounds: "tuple[Bound, Bound] | None" = None
    third: float | None = None


def read_range(text: str, option: str, third: str) -> Range:
    """Read a range; `third` names what may stand behind the bounds.

    Raises:
        InputError: it can't be read so.
    """
    where = f"{option} {text}"
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
        raise InputError(Problem(where, f"'{last}'", f"LOW:HIGH or LOW:HIGH:{third}", "as 0.5x:2x"))
    behind = options.number(parts[2], where) if len(parts) == 3 else None
    return Range(tuple(paths), (_bound(parts[0], where), _bound(parts[1], where)), behind)


def _bound(text: str, where: str) -> "Bound":
    from ident.vibrate.redesign.ranges import Bound

    times = text.strip().endswith("x")
    return Bound(options.number(text.strip().removesuffix("x"), where), times)
