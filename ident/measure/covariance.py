"""The correlation of a campaign's errors: `CAMPAIGN.covariance.csv`.

Each row of that file gives the error correlation of two rows of a group: `group,i,j,correlation`, i and j their places
in the group from 1, in the campaign's order. The standard deviations stand in the campaign. Pairs that are not listed
are not correlated.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ident.errors import Problem, refusal, refuse
from ident.measure.columns import Number, Row, Rule, read_rows
from ident.measure.table import Findings, csv_text, guarded
from ident.text import by_key, one_line, quoted

CORRELATION = Number("a number from -1 to 1", "give a correlation, not a covariance", -1.0, 1.0)
COVARIANCE_RULES = (
    *(Rule(name, required=True) for name in ("group", "i", "j")),
    Rule("correlation", CORRELATION, required=True),
)
COVARIANCE_COLUMNS = tuple(rule.name for rule in COVARIANCE_RULES)
COVARIANCE_SUFFIX = ".covariance.csv"
CLOSEST = 1e-8
"""Least distance of a correlation from 1: closer, the difference of two rows is known 10,000 times better than each of
them, which no instrument achieves, and a fit to it does not converge."""
LARGEST = 2000
"""Rows of a group at most: its correlation matrix has their square."""
COMMON = 0.5
"""Share of the variance between tests of one posture that all values of a kind in one test share; assumed."""

Correlated = tuple[tuple[int, ...], tuple[tuple[float, ...], ...]]
"""Places of rows, (n,), and the correlation of their errors, (n, n)."""


@dataclass(frozen=True)
class Group:
    """Rows of a campaign with correlated errors.

    Attributes:
        name: name in the campaign's rows.
        correlation: (n, n) [-] of the errors of its rows, in their order.
    """

    name: str
    correlation: tuple[tuple[float, ...], ...]

    def __len__(self) -> int:
        return len(self.correlation)


@dataclass(frozen=True)
class Covariance:
    """The groups of a campaign, compared by content.

    Attributes:
        groups: in the order of the campaign.
        path: their file; empty for groups made in code.
        sha256: hash of its bytes.
    """

    groups: tuple[Group, ...]
    path: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def __getitem__(self, name: str) -> Group:
        return next(group for group in self.groups if group.name == name)

    def has(self, name: str, member: int) -> bool:
        """Whether a group has that many rows."""
        return any(group.name == name and 1 <= member <= len(group) for group in self.groups)


def correlated(rows: Sequence[tuple[str, int]], covariance: Covariance | None) -> tuple[Correlated, ...]:
    """Return the places of the rows of each group of several, and the correlation of their errors.

    Args:
        rows: the group of each row, empty for none, and its place there from 1; in any order, possibly with gaps.
        covariance: of the whole groups.
    """
    found = []
    for name, places in by_key((name, i) for i, (name, _) in enumerate(rows) if name).items():
        whole, members = covariance[name].correlation if covariance else (), [rows[i][1] - 1 for i in places]
        if len(places) > 1:
            found.append((tuple(places), tuple(tuple(whole[i][j] for j in members) for i in members)))
    return tuple(found)


def covariance_path(path: str | Path) -> Path:
    """Return the path of a campaign's covariance file, in the same folder."""
    return Path(path).with_suffix(COVARIANCE_SUFFIX)


def parse_covariance(data: bytes, path: Path, sizes: Mapping[str, int]) -> Covariance:
    """Read correlations from the bytes of a file; `path` names it in messages."""
    findings = Findings()
    rows = read_rows(data, path, COVARIANCE_RULES, findings, ",".join(COVARIANCE_COLUMNS), strict=True)
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
    """Return group, places from 1 and correlation of a row; note its errors."""
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
    """Return correlations as CSV text, without uncorrelated pairs."""
    pairs = (
        dict(zip(COVARIANCE_COLUMNS, (group.name, str(i), str(j), repr(value)), strict=True))
        for group in groups
        for i, row in enumerate(group.correlation, 1)
        for j, value in enumerate(row, 1)
        if j > i and value
    )
    head = f"{guarded(campaign)}: rows i and j of each group, counted from 1; sigma stands there"
    return csv_text(COVARIANCE_COLUMNS, pairs, [head])
