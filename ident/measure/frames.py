"""Measurement frames such as a laser tracker's: `CAMPAIGN.setups.csv`.

Each row locates the frame of a setup: its origin in the base frame, and the rotation vector that turns the base frame
into it, each with a standard deviation for every component: `0` if known, `free` if unknown. Setups of the campaign
that this file does not list are free.
"""

import hashlib
import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import refuse
from ident.measure.columns import Number, Row, Rule, read_rows
from ident.measure.load import Vector
from ident.measure.table import Findings, csv_text, guarded, parse_number
from ident.text import nearest, quoted
from ident.units import si_factor

FREE = "free"
SETUP_SUFFIX = ".setups.csv"
FRAME_SIGMA = Number(f"a number, 0 for known, or {FREE}", "correct it", 0.0)


def _sigma(text: str, decimal: str) -> float:
    return math.inf if text.lower() == FREE else FRAME_SIGMA(text, decimal)


def _part(names: Iterable[str], unit: str, sigma: str) -> tuple[Rule, ...]:
    """Return the rules of three components, their unit and their standard deviation."""
    components = (Rule(name, parse_number, required=True) for name in names)
    return (*components, Rule(unit, required=True), Rule(sigma, _sigma, required=True))


ORIGIN, TURN = _part("xyz", "unit", "sigma"), _part(("rx", "ry", "rz"), "turn_unit", "turn_sigma")
SETUP_RULES = (Rule("setup", required=True), *ORIGIN, *TURN)
SETUP_COLUMNS = tuple(rule.name for rule in SETUP_RULES)


@dataclass(frozen=True)
class Setup:
    """The frame of a setup.

    Attributes:
        name: name in the campaign's rows.
        origin: (3,) [m] in the base frame; None to fit it.
        turn: (3,) [rad] rotation vector from the base's axes to its own; None to fit it.
        sigma: () [m] standard deviation of each component of the origin, 0 if known, infinite if free.
        turn_sigma: () [rad] standard deviation of a further small turn about each of the base's axes.
    """

    name: str
    origin: Vector | None = None
    turn: Vector | None = None
    sigma: float = math.inf
    turn_sigma: float = math.inf


@dataclass(frozen=True)
class Setups:
    """The setups of a campaign, compared by content.

    Attributes:
        each: the setups.
        path: their file; empty for setups made in code.
        sha256: hash of its bytes.
    """

    each: tuple[Setup, ...]
    path: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def __getitem__(self, name: str) -> Setup:
        """Return the setup of a name; free if it is not listed."""
        return next((setup for setup in self.each if setup.name == name), Setup(name))


NO_SETUPS = Setups(())
"""Setups of a campaign without a setups file: all are free."""


def setups_path(campaign: str | Path) -> Path:
    """Return the path of a campaign's setups file, in the same folder."""
    return Path(campaign).with_suffix(SETUP_SUFFIX)


def parse_setups(data: bytes, path: str | Path, names: Collection[str]) -> Setups:
    """Read setups from the bytes of a CSV file; `path` names it in messages.

    Args:
        data: the bytes.
        path: of the file.
        names: setups in the campaign's rows.

    Raises:
        InputError: the file has errors; all are listed.
    """
    findings = Findings()
    rows = read_rows(data, path, SETUP_RULES, findings, f"one of {', '.join(SETUP_COLUMNS)}", strict=True)
    found: dict[str, Setup] = {}
    for row in rows:
        setup = _setup(row, names)
        if setup and setup.name in found:
            row.add(f"{quoted(setup.name)} again", "each setup once", "delete one", "setup")
        elif setup:
            found[setup.name] = setup
    refuse([*findings, *(problem for row in rows for problem in row.problems)])
    return Setups(tuple(found.values()), str(path), hashlib.sha256(data).hexdigest())


def _setup(row: Row, names: Collection[str]) -> Setup | None:
    """Return the setup of a row; None if the row has an error."""
    name = row["setup"]
    if name not in names:
        remedy = f"write {near}" if (near := nearest(name, names)) else "correct the name, or delete the row"
        row.add(quoted(name), "a setup that rows of the campaign name", remedy, "setup")
    origin, sigma = _placed(row, ORIGIN, "length")
    turn, turn_sigma = _placed(row, TURN, "angle")
    return None if row.problems else Setup(name, origin, turn, sigma, turn_sigma)


def _placed(row: Row, rules: tuple[Rule, ...], quantity: str) -> tuple[Vector | None, float]:
    """Return three numbers [SI] with their standard deviation; None for numbers to fit."""
    *components, unit, sigma = rules
    empty = [rule.name for rule in components if not row[rule.name]]
    if len(empty) == 3 and row[sigma.name].lower() in ("", FREE):
        return None, math.inf
    if empty:
        row.add("nothing", f"a number, as {sigma.name} is not {FREE}", "give all three", empty[0])
        return None, math.inf
    factor = row.attempt(unit.name, si_factor, row[unit.name], quantity) or 0.0
    x, y, z, size = (factor * (row.value(rule) or 0.0) for rule in (*components, sigma))
    return (x, y, z), size


def setups_text(setups: Collection[Setup], campaign: str) -> str:
    """Return setups as CSV text."""
    rows = []
    for setup in setups:
        cells = [setup.name]
        for vector, unit, sigma in ((setup.origin, "m", setup.sigma), (setup.turn, "rad", setup.turn_sigma)):
            cells += [*(["", "", ""] if vector is None else map(repr, vector)), unit]
            cells += [FREE if math.isinf(sigma) else repr(sigma)]
        rows.append(dict(zip(SETUP_COLUMNS, cells, strict=True)))
    return csv_text(SETUP_COLUMNS, rows, [f"{guarded(campaign)}: frames of its setups, in the base frame"])
