"""Readers of option texts: numbers, names, and pairs of both."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from ident.errors import refusal, require
from ident.inference.priors import Prior
from ident.units import STIFFNESS_UNITS


def number(text: str, flag: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    require(math.isfinite(value), flag, f"'{text}'", "a finite number", "correct it, see --help")
    return value


def names(texts: Sequence[str], flag: str) -> tuple[str, ...]:
    """Read names, one a text."""
    return tuple(texts)


def each_of(texts: Sequence[str], flag: str = "") -> tuple[str, ...]:
    """Read items given one by one or separated by commas: a comma before a letter or `*` starts another name."""
    return tuple(part.strip() for text in texts for part in re.split(r",(?=\s*[A-Za-z*])", text))


def words(text: str, flag: str) -> tuple[str, ...]:
    """Read words separated by commas, in lower case."""
    return tuple(part.strip().lower() for part in text.split(","))


def several(text: str, flag: str) -> tuple[float, ...]:
    """Read numbers separated by commas."""
    return tuple(number(part, f"{flag} {text}") for part in text.split(","))


def ties(texts: Sequence[str], flag: str) -> tuple[tuple[str, ...], ...]:
    """Read groups of names joined by =."""
    for text in (texts := each_of(texts)):
        require("=" in text, f"{flag} {text}", "one parameter", "two or more with = between", "as a.k_tors=b.k_tors")
    return tuple(tuple(text.split("=")) for text in texts)


def numbers(texts: Sequence[str], flag: str) -> dict[str, float]:
    """Read NAME=NUMBER, each name once."""
    pairs = [(text, *named(text, f"{flag} {text}")) for text in each_of(texts)]
    return once(flag, [(name, number(value, f"{flag} {text}")) for text, name, value in pairs])


def by_name(texts: Sequence[str], flag: str) -> dict[str, float]:
    """Read NAME=NUMBER, each name once; a number alone, under the empty name, applies to all others."""
    parts = [part.strip() for text in texts for part in text.split(",")]
    alone = [("", number(part, f"{flag} {part}")) for part in parts if "=" not in part]
    return once(flag, [*alone, *numbers([part for part in parts if "=" in part], flag).items()])


EACH: Any = {"repeated": True, "read": by_name}
"""Reader of an option that may differ between drives, or between joints."""


def shares(texts: Sequence[str], flag: str) -> dict[str, float]:
    """Read NAME=NUMBER, several separated by commas, each name once; a number alone is of frequencies."""
    parts = [part.strip() for text in texts for part in text.split(",")]
    return numbers([part if "=" in part else f"frequency={part}" for part in parts], flag)


def frequencies(texts: Sequence[str], flag: str) -> dict[str, tuple[float, ...]]:
    """Read NUMBER=HERTZ,HERTZ,..., each number once."""
    pairs = [(text, *named(text, f"{flag} {text}")) for text in texts]
    for text, name, _ in pairs:
        require(name.isdigit(), f"{flag} {text}", f"'{name}'", "the number of a posture", "as 2=4.45,5.01")
    return once(flag, [(name, several(value, f"{flag} {text}")) for text, name, value in pairs])


def widths(texts: Sequence[str], flag: str) -> dict[str, float]:
    """Read NAME:WIDTH, or NAME alone for an infinite width, each name once."""
    parts = [(text, *text.partition(":")[::2]) for text in each_of(texts)]
    return once(flag, [(name, number(width, f"{flag} {text}") if width else math.inf) for text, name, width in parts])


def uncertain(texts: Sequence[str], flag: str) -> dict[str, str]:
    """Read NAME:WIDTH, WIDTH with its unit, separated by commas; each name once."""
    parts = [(text, *each.strip().partition(":")[::2]) for text in texts for each in text.split(",")]
    for text, name, width in parts:
        require(name and width, f"{flag} {text}", "no NAME:WIDTH", "as link2.mass:5%,load:1%", "correct it")
    return once(flag, [(name, width.strip()) for _, name, width in parts])


def stiffness_unit(text: str, flag: str) -> str:
    """Read a unit of stiffness with any blanks and dots: `Nmm/deg`, `N*mm/deg`; another text unchanged."""
    plain = {re.sub(r"[\s*·]", "", name): name for name in STIFFNESS_UNITS}
    return plain.get(re.sub(r"[\s*·]", "", text), text)


def columns(texts: Sequence[str], flag: str) -> dict[str, str]:
    """Read NAME IN THE FILE=NAME:UNIT, separated by commas; each name once."""
    parts = [part.strip() for text in texts for part in text.split(",")]
    pairs = [(own.strip(), header.strip()) for own, header in (named(part, f"{flag} {part}") for part in parts)]
    headers = [(own, *(word.strip() for word in header.partition(":")[::2])) for own, header in pairs]
    return once(flag, [(own, f"{name} [{unit}]" if unit else name) for own, name, unit in headers])


def columns_in_words(headers: Mapping[str, str]) -> str:
    """Write headers by a file's names as `columns` reads them."""
    return ",".join(f"{own}={header.replace(' [', ':').removesuffix(']')}" for own, header in headers.items())


def named(text: str, where: str) -> tuple[str, str]:
    """Split NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise refusal(where, "no NAME=VALUE", "a name, = and what it is given", "correct it, see --help")
    return name, value


def once(flag: str, pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a mapping."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        every = [name for name, _ in pairs]
        twice = next(name for name in every if every.count(name) > 1)
        raise refusal(flag, f"{twice} twice", "each once", "keep one of them")
    return mapping


def band(text: str, flag: str) -> tuple[float, float]:
    """Read a band of frequencies LOW:HIGH [Hz]."""
    parts = [number(part, f"{flag} {text}") for part in text.split(":")]
    if len(parts) != 2 or not 0 <= parts[0] < parts[1]:
        raise refusal(f"{flag} {text}", "no band", "LOW:HIGH in Hz, 0 <= LOW < HIGH", "as 4:8")
    return parts[0], parts[1]


def peak_to_peak(text: str, flag: str) -> tuple[float, float]:
    """Read transmission errors LOW:HIGH [arc seconds, peak to peak]; one number gives both."""
    parts = [number(part, f"{flag} {text}") for part in text.split(":")]
    if len(parts) not in (1, 2) or not 0 <= parts[0] <= parts[-1]:
        expected = "LOW:HIGH in arc seconds peak to peak, 0 <= LOW <= HIGH"
        raise refusal(f"{flag} {text}", "no such range", expected, "as 30:60")
    return parts[0], parts[-1]


def whole_numbers(text: str, flag: str) -> tuple[int, ...]:
    """Read whole numbers from 1, separated by commas."""
    values = several(text, flag)
    if any(value != int(value) or value < 1 for value in values):
        raise refusal(f"{flag} {text}", f"'{text}'", "whole numbers from 1", "as 1,2")
    return tuple(int(value) for value in values)


def priors(texts: Sequence[str], flag: str) -> dict[str, Prior]:
    """Read NAME=PRIOR, each name once."""
    pairs = once(flag, [named(text, f"{flag} {text}") for text in each_of(texts)])
    return {name: Prior.parse(form) for name, form in pairs.items()}


def postures(texts: Sequence[str], flag: str) -> tuple[tuple[float, ...], ...]:
    """Read joint angles separated by commas, one posture a text."""
    return tuple(several(text, flag) for text in texts)
