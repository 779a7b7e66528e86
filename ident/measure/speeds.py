"""What turns at a known speed during a test: pulleys, motors, fans."""

import re
from dataclasses import dataclass

from ident.errors import refusal, require
from ident.measure.table import parse_number
from ident.text import quoted
from ident.units import to_si

SYNTAX = "terms joined by ' + ', each like '2.25 Hz @ pulley 1' or '1450 rpm @ pump'"
_TERM = re.compile(r"(?P<value>[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>[^\W\d_]+)\s*@\s*(?P<name>[^@+]+)")


@dataclass(frozen=True)
class Speed:
    """Something that turns.

    Attributes:
        name: what it is.
        frequency: [Hz] revolutions in a second.
    """

    name: str
    frequency: float


def parse_speeds(text: str, decimal: str = ".") -> tuple[Speed, ...]:
    """Read speeds such as `2.25 Hz @ pulley 1 + 1450 rpm @ pump`; blank is none.

    Raises:
        InputError: the text doesn't follow the syntax.
    """
    return tuple(_speed(term, decimal) for term in text.split(" + ")) if text.strip() else ()


def _speed(term: str, decimal: str) -> Speed:
    match, remedy = _TERM.fullmatch(term.strip()), "correct it, or leave the cell empty"
    if not match:
        raise refusal("", quoted(term), SYNTAX, remedy)
    value = to_si(parse_number(match["value"], decimal), match["unit"], "frequency")
    require(value > 0, "", quoted(term), "a speed above 0", remedy)
    return Speed(match["name"].strip(), value)
