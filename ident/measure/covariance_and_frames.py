"""Files beside a campaign: the correlation of its errors, and the measurement frames of its setups."""

import hashlib
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import Problem, refusal, refuse
from ident.measure.columns import Number, Row, Rule, read_rows
from ident.measure.load import Vector
from ident.measure.table import Findings, csv_text, grouped, guarded, parse_number
from ident.text import nearest, one_line, quoted
from ident.units import si_factor

# -------- Covariance
# Correlated errors of a campaign's rows: `CAMPAIGN.covariance.csv` into a correlation for each group, and back.
#
# Each row of that file says how the errors of two rows of a group are correlated: `group,i,j,correlation`, i and j
# their places in the group from 1, in the campaign's order. The standard deviations stand in the campaign. Pairs that
# are not named are not correlated.

CORRELATION = Number("a number from -1 to 1", "give a correlation, not a covariance", -1.0, 1.0)
COVARIANCE_RULES = (
    *(Rule(name, required=True) for name in ("group", "i", "j")),
    Rule("correlation", CORRELATION, required=True),
)
COVARIANCE_COLUMNS = tuple(rule.name for rule in COVARIANCE_RULES)
COVARIANCE_SUFFIX = ".covariance.csv"
CLOSEST = 1e-8
"""Distance from 1 that a correlation of two rows keeps: nearer, their difference is known 10,000 times better than each
of them, which no instrument does, and a fit to it finds no end."""
LARGEST = 2000
"""Rows of a group at most: its correlation has their square."""


COMMON = 0.5
"""Share of the variance between tests of one posture which all values of a kind in one test have in common; assumed."""

Correlated = tuple[tuple[int, ...], tuple[tuple[float, ...], ...]]
"""Places of rows, (n,), and the correlation of their errors, (n, n)."""


@dataclass(frozen=True)
class Group:
    """Rows of a campaign with correlated errors.

    Attributes:
        name: as the rows name it.
        correlation: (n, n) [-] of the errors of its rows, in their order.
    """

    name: str
    correlation: tuple[tuple[float, ...], ...]

    def __len__(self) -> int:
        return len(self.correlation)


@dataclass(frozen=True)
class Covariance:
    """The groups of a campaign; two are equal when they say the same.

    Attributes:
        groups: in the order of the campaign.
        path: the file they were read from; empty for groups made in code.
        sha256: hash of its bytes.
    """

    groups: tuple[Group, ...]
    path: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def __getitem__(self, name: str) -> Group:
        return next(group for group in self.groups if group.name == name)

    def has(self, name: str, member: int) -> bool:
        """Tell whether a group has that many rows."""
        return any(group.name == name and 1 <= member <= len(group) for group in self.groups)


def correlated(rows: Sequence[tuple[str, int]], covariance: Covariance | None) -> tuple[Correlated, ...]:
    """Return the places of the rows of each group that has several, and the correlation of their errors.

    Args:
        rows: the group of each row, empty for none, and its place there from 1; in any order, and some may be missing.
        covariance: of the whole groups.
    """
    found = []
    for name, places in grouped([i for i, (name, _) in enumerate(rows) if name], lambda i: rows[i][0]).items():
        whole, members = covariance[name].correlation if covariance else (), [rows[i][1] - 1 for i in places]
        if len(places) > 1:
            found.append((tuple(places), tuple(tuple(whole[i][j] for j in members) for i in members)))
    return tuple(found)


def covariance_path(path: str | Path) -> Path:
    """Return where the correlations of a campaign's file lie: beside it."""
    return Path(path).with_suffix(COVARIANCE_SUFFIX)


def parse_covariance(data: bytes, path: Path, sizes: Mapping[str, int]) -> Covariance:
    """Read correlations from the bytes of a file; `path` names it in messages."""
    findings = Findings()
    rows = read_rows(data, path, COVARIANCE_RULES, findings, ",".join(COVARIANCE_COLUMNS))
    for name, n in sizes.items():
        if n > LARGEST:
            where, got = one_line(str(path)), f"a group {quoted(name)} of {n} rows"
            findings.append(Problem(where, got, f"at most {LARGEST}", "split it"))
    made = {name: [[float(i == j) for j in range(n)] for i in range(n)] for name, n in sizes.items()}
    pairs = set[tuple[str, int, int]]()
    for row in rows:
        name, i, j, value = _pair(row, sizes)
        if row.problems:
            continue
        if (name, i, j) in pairs:
            row.add("the pair again", "each pair once", "delete one of them")
        pairs |= {(name, i, j), (name, j, i)}
        made[name][i - 1][j - 1] = made[name][j - 1][i - 1] = value
    refuse([*findings, *(problem for row in rows for problem in row.problems)])
    groups = tuple(Group(name, tuple(map(tuple, rows))) for name, rows in made.items())
    return Covariance(groups, str(path), hashlib.sha256(data).hexdigest())


def _pair(row: Row, sizes: Mapping[str, int]) -> tuple[str, int, int, float]:
    """Return group, places from 1 and correlation of a row; what is wrong with it is noted."""
    name = " ".join(row["group"].split())
    if name not in sizes:
        row.add(quoted(name), "a group that rows of the campaign name", "correct it", "group")
        return name, 0, 0, 0.0
    i, j = (row.attempt(column, _place, row[column], sizes[name]) or 0 for column in "ij")
    value = row.value(COVARIANCE_RULES[-1]) or 0.0
    if not row.problems and i == j and value != 1:
        row.add(f"{value:g} of a row with itself", "1", "leave it out", "correlation")
    if not row.problems and i != j and 1 - abs(value) < CLOSEST:
        remedy = "leave one of the two rows out: they are one reading"
        row.add(f"{value!r} between two rows", f"at most 1 - {CLOSEST:g}", remedy, "correlation")
    return name, i, j, value


def _place(text: str, rows: int) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10 and 1 <= int(text) <= rows):
        expected = f"the place of a row in its group, 1 to {rows}"
        raise refusal("", quoted(text), expected, "count the group's rows in the campaign")
    return int(text)


def covariance_text(groups: Sequence[Group], campaign: str) -> str:
    """Return correlations as CSV text; pairs that are not correlated are left out."""
    pairs = (
        dict(zip(COVARIANCE_COLUMNS, (group.name, str(i), str(j), repr(value)), strict=True))
        for group in groups
        for i, row in enumerate(group.correlation, 1)
        for j, value in enumerate(row, 1)
        if j > i and value
    )
    head = f"{guarded(campaign)}: rows i and j of each group, counted from 1; sigma stands there"
    return csv_text(COVARIANCE_COLUMNS, pairs, [head])


# -------- Setups
# Frames in which something was measured, such as a laser tracker's: `CAMPAIGN.setups.csv`.
#
# Each row says where the frame of a setup is: its origin in the base frame, and the rotation vector that turns the
# base frame into it, each with a standard deviation for every component: `0` where it is known, `free` where it is
# not known at all. A setup that rows of the campaign name, and that this file does not, is free.

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
    findings = Findings()
    rows = read_rows(data, path, SETUP_RULES, findings, f"one of {', '.join(SETUP_COLUMNS)}")
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
    """Return the setup of a row; None where something is wrong with it."""
    name = row["setup"]
    if name not in names:
        remedy = f"write {near}" if (near := nearest(name, names)) else "correct the name, or delete the row"
        row.add(quoted(name), "a setup that rows of the campaign name", remedy, "setup")
    origin, sigma = _placed(row, ORIGIN, "length")
    turn, turn_sigma = _placed(row, TURN, "angle")
    return None if row.problems else Setup(name, origin, turn, sigma, turn_sigma)


def _placed(row: Row, rules: tuple[Rule, ...], quantity: str) -> tuple[Vector | None, float]:
    """Return three numbers [SI] with their standard deviation; none where they are to be found."""
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
