"""Frames in which something was measured, such as a laser tracker's: `CAMPAIGN.setups.csv`.

Each row says where the frame of a setup is: its origin in the base frame, and the rotation vector that turns the base
frame into it, each with a standard deviation for every component: `0` where it is known, `free` where it is not known
at all. A setup that rows of the campaign name, and that this file does not, is free.
"""

import hashlib
import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ident.errors import InputError, Problem
from ident.measure.load import Vector
from ident.measure.table import Findings, misfit, read_records, sniff_delimiter, table_text
from ident.measure.text import parse_number
from ident.text import NAME, nearest, one_line, quoted
from ident.units import si_factor

SETUP_COLUMNS = ("setup", "x", "y", "z", "unit", "sigma", "rx", "ry", "rz", "turn_unit", "turn_sigma")
SETUP_SUFFIX = ".setups.csv"
FREE = "free"


@dataclass(frozen=True)
class Setup:
    """The frame of a setup.

    Attributes:
        name: as rows of the campaign name it.
        origin: (3,) [m] where it is in the base frame; None where that is to be found.
        turn: (3,) [rad] rotation vector that turns the base's axes into its own; None likewise.
        sigma: () [m] standard deviation of each component of the origin, 0 if known, infinite if free.
        turn_sigma: () [rad] the same of a further small turn about each of the base's axes.
    """

    name: str
    origin: Vector | None = None
    turn: Vector | None = None
    sigma: float = math.inf
    turn_sigma: float = math.inf


@dataclass(frozen=True)
class Setups:
    """The setups of a campaign; two are equal when they say the same.

    Attributes:
        each: the setups.
        path: the file that they are from; empty for those made in code.
        sha256: hash of its bytes.
    """

    each: tuple[Setup, ...]
    path: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def __getitem__(self, name: str) -> Setup:
        """Return the setup of a name: free where nothing is said of it."""
        return next((setup for setup in self.each if setup.name == name), Setup(name))


NO_SETUPS = Setups(())
"""Of a campaign of which nothing is said: all are free."""


def setups_path(campaign: str | Path) -> Path:
    """Return the file beside a campaign in which its setups stand."""
    return Path(campaign).with_suffix(SETUP_SUFFIX)


def parse_setups(data: bytes, path: str | Path, names: Collection[str]) -> Setups:
    """Read setups from the bytes of a CSV file; `path` names it in messages.

    Args:
        data: the bytes.
        path: of the file.
        names: setups that rows of the campaign name.

    Raises:
        InputError: something in it is wrong; every problem is listed.
    """
    file, findings = one_line(str(path)), Findings()
    text = table_text(data, file)
    delimiter = sniff_delimiter(text, lambda name: name in SETUP_COLUMNS)
    records = list(read_records(text, delimiter, file, findings))
    header = tuple(cell.lower() for cell in records[0][1]) if records else ()
    if sorted(header) != sorted(SETUP_COLUMNS):
        remedy = "see data/README.md; leave a cell empty where its number is to be found"
        raise InputError([*findings, Problem(file, "other columns", ", ".join(SETUP_COLUMNS), remedy)])
    found: dict[str, Setup] = {}
    for where, cells in records[1:]:
        if len(cells) != len(header):
            findings.append(misfit(where, len(cells), len(header), delimiter))
            continue
        row = dict(zip(header, cells, strict=True))
        setup = findings.attempt(where, "", _setup, row, names)
        if setup and setup.name in found:
            findings.append(Problem(where, f"{quoted(setup.name)} again", "each setup once", "delete one", "setup"))
        elif setup:
            found[setup.name] = setup
    if findings:
        raise InputError(findings)
    return Setups(tuple(found.values()), str(path), hashlib.sha256(data).hexdigest())


def _setup(row: dict[str, str], names: Collection[str]) -> Setup:
    name = row["setup"]
    if name not in names:
        near = nearest(name, list(names))
        remedy = f"write {near}" if near else "correct the name, or delete the row"
        raise InputError(Problem("", quoted(name), "a setup that rows of the campaign name", remedy, "setup"))
    origin, sigma = _placed(row, ("x", "y", "z"), "unit", "sigma", "length")
    turn, turn_sigma = _placed(row, ("rx", "ry", "rz"), "turn_unit", "turn_sigma", "angle")
    return Setup(name, origin, turn, sigma, turn_sigma)


def _placed(
    row: dict[str, str], names: tuple[str, str, str], unit: str, sigma: str, quantity: str
) -> tuple[Vector | None, float]:
    """Return three numbers [SI] with their standard deviation; none where they are to be found."""
    given = [name for name in names if row[name]]
    if not given and row[sigma].lower() in ("", FREE):
        return None, math.inf
    if len(given) < 3:
        missing = next(name for name in names if not row[name])
        raise InputError(Problem("", "nothing", f"a number, as {sigma} is not {FREE}", "give all three", missing))
    factor = _in(unit, si_factor, row[unit], quantity)
    x, y, z = (factor * _in(name, parse_number, row[name], ".") for name in names)
    return (x, y, z), _sd(row[sigma], sigma, factor)


def _in(column: str, read: Callable[..., float], *args: Any) -> float:
    """Read a cell, and name its column in what is wrong with it."""
    findings = Findings()
    value = findings.attempt("", column, read, *args)
    if value is None:
        raise InputError(findings)
    return value


def _sd(text: str, column: str, factor: float) -> float:
    if text.lower() == FREE:
        return math.inf
    number = _in(column, parse_number, text, ".")
    if number < 0:
        raise InputError(Problem("", quoted(text), f"a number, 0 for known, or {FREE}", "correct it", column))
    return factor * number


def check_name(name: str) -> None:
    """Refuse a name of a setup that no parameter could bear.

    Raises:
        InputError: it has other than letters, digits, `_` and `-`.
    """
    if name and not re.fullmatch(NAME, name):
        remedy = "use letters, digits, _ and -"
        raise InputError(Problem("", quoted(name), "a name such as tracker or tracker-2", remedy, "setup"))


def setups_text(setups: Collection[Setup], campaign: str) -> str:
    """Return setups as CSV text."""
    rows = [",".join(SETUP_COLUMNS), *(_row(setup) for setup in setups)]
    return "\n".join([f"# {campaign}: frames of its setups, in the base frame", *rows, ""])


def _row(setup: Setup) -> str:
    place = [*(["", "", ""] if setup.origin is None else map(repr, setup.origin)), "m", _written(setup.sigma)]
    turn = [*(["", "", ""] if setup.turn is None else map(repr, setup.turn)), "rad", _written(setup.turn_sigma)]
    return ",".join([setup.name, *place, *turn])


def _written(sigma: float) -> str:
    return FREE if math.isinf(sigma) else repr(sigma)
