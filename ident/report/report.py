"""The report of a study: a verdict, tables of numbers, findings and details. Terminal and pages render it.

The first screen has, in this order: subject; verdict with its reason; the answer as tables; at most `MOST` findings, by
their effect on the verdict, each with its remedy; the largest residual; the next command. Details follow on request.
"""

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, Literal

from ident.text import one_line

Cell = str | float | int | None
"""Cell of a table: words, a number, or nothing."""
Kind = Literal["good", "caution", "bad"]
"""Colour of a verdict."""
WIDTH = 100
"""Columns of a terminal that every report fits."""
KEPT = "\u00a0"
"""Stands for a space without a line break, until lines are broken."""
MOST = 3
"""Findings on the first screen, at most."""
GAP = "  "
"""Between two columns of a printed table."""
NARROWEST = 12
"""Characters to which a column of words may be cut."""
POWER = 1e4
"""From this size a number is written with a power of ten, `4.7869e4`, for any number of digits."""
NUMBER = re.compile(r"[^\w(]*\d")
"""Beginning of a cell with a number."""
LABEL = re.compile(r"\w+: {2,}")
"""Beginning of a labelled paragraph; further lines align below its words: `Cause:   `."""
COLOURS: dict[Kind, str] = {"good": "32", "caution": "33", "bad": "31"}
"""Green, yellow and red of a terminal."""


@dataclass(frozen=True)
class Table:
    """Rows under a head; the first cell of a row names it.

    Attributes:
        caption: what the table shows; empty if the text above says it.
        head: names of the columns, each with its unit in brackets: `value [N m/rad]`.
        rows: cells (`Cell`), as many in each row as there are columns.
        forms: number format of each column, as `.4g`; empty for words. Not needed without numbers.
        note: how to read it; may be empty.
        strong: indices of the rows to emphasise, from 0.
        brief: whether it is left out if the details follow, which have it in full.

    Raises:
        ValueError: a row, or `forms`, has another number of cells than the head; an emphasised row does not exist.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    forms: tuple[str, ...] = ()
    note: str = ""
    strong: tuple[int, ...] = ()
    brief: bool = False

    def __post_init__(self) -> None:
        for i, row in enumerate((*self.rows, *([self.forms] if self.forms else []))):
            if len(row) != len(self.head):
                raise ValueError(f"row {i} of a table has {len(row)} cells under {len(self.head)} heads")
        if not all(0 <= i < len(self.rows) for i in self.strong):
            raise ValueError(f"strong rows {self.strong} of a table with {len(self.rows)}")

    @property
    def texts(self) -> tuple[tuple[str, ...], ...]:
        """The cells as displayed."""
        forms = self.forms or ("",) * len(self.head)
        return tuple(tuple(written(cell, form) for cell, form in zip(row, forms, strict=True)) for row in self.rows)


def by_row(**columns: Any) -> list[dict[str, Any]]:
    """Return the rows of columns of equal length, numbers in Python types: `by_row(parameter=..., value=...)`."""
    cells = (each.tolist() if hasattr(each, "tolist") else each for each in columns.values())
    return [dict(zip(columns, row, strict=True)) for row in zip(*cells, strict=True)]


def by_head(
    heads: Iterable[str], rows: Iterable[Iterable[Any]], caption: str = "", note: str = "", strong: tuple[int, ...] = ()
) -> Table:
    """Return a table whose heads contain the number format after a bar: `frequency [Hz]|.3f`."""
    head, forms = zip(*(each.partition("|")[::2] for each in heads), strict=True)
    return Table(caption, head, tuple(map(tuple, rows)), forms, note, strong)


Part = str | Table
"""A paragraph, or a table."""


@dataclass(frozen=True)
class Verdict:
    """The overall verdict.

    Attributes:
        word: one of the study's closed set, in capitals; the rule of each is in docs/answers.md.
        reason: with the decisive number.
        kind: its colour.
    """

    word: str
    reason: str
    kind: Kind


@dataclass(frozen=True)
class Finding:
    """A fact that affects the verdict.

    Attributes:
        text: the finding.
        remedy: what to do; may be empty.
    """

    text: str
    remedy: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the details.

    Attributes:
        title: heading.
        parts: paragraphs and tables.
    """

    title: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Report:
    """The complete report of a study.

    Attributes:
        subject: operation and object, in one line.
        verdict: None for a study that judges nothing.
        answer: the tables of the answer, and sentences between them.
        findings: facts that affect the verdict, most important first.
        remark: the largest residual, or another fact worth one line; may be empty.
        next: the next command; may be empty.
        details: printed on request.
    """

    subject: str
    verdict: Verdict | None = None
    answer: tuple[Part, ...] = ()
    findings: tuple[Finding, ...] = ()
    remark: str = ""
    next: str = ""
    details: tuple[Section, ...] = ()

    @property
    def judged(self) -> dict[str, Any]:
        """Verdict, reasons and next command, for programs."""
        said = [*([self.verdict.reason] if self.verdict else []), *(finding.text for finding in self.findings)]
        reasons = [words.replace(KEPT, " ") for words in said]
        return {"verdict": self.verdict.word if self.verdict else None, "reasons": reasons, "next": self.next or None}


# -------- Terminal
# A report as lines of text.


def text_of(report: Report, *, details: bool = False, width: int = WIDTH, colour: bool = False) -> str:
    """Return a report as text: the first screen, or all of it.

    Args:
        report: the report.
        details: whether the details follow, with all findings.
        width: columns.
        colour: whether the verdict's word is coloured for a terminal.
    """
    lines = list(_screen(report, details, width))
    for section in report.details if details else ():
        lines += ["", *folded(section.title, width).splitlines()]
        for part in section.parts:
            lines += _part(part, width, wrap=True)
    text = "\n".join(one_line(line).rstrip() for line in lines) + "\n"  # texts of a result file may hold anything
    if report.verdict and colour:
        word = report.verdict.word
        text = text.replace(f"RESULT: {word}", f"RESULT: \x1b[1;{COLOURS[report.verdict.kind]}m{word}\x1b[0m", 1)
    return text


def _screen(report: Report, details: bool, width: int) -> Iterator[str]:
    yield from (line for part in report.subject.splitlines() for line in folded(part, width).splitlines())
    if report.verdict:
        word, hang = report.verdict.word, " " * len("RESULT: ")
        yield from folded(f"RESULT: {word}{'.' * (word[-1] != '.')} {report.verdict.reason}", width, hang).splitlines()
    parts = [part for part in report.answer if not (details and isinstance(part, Table) and part.brief)]
    for part in parts:
        yield from _part(part, width, wrap=width < WIDTH or (isinstance(part, Table) and part.brief))
    if report.remark:
        yield from folded(report.remark, width, "  ").splitlines()
    shown_findings = report.findings if details else report.findings[:MOST]
    listed = any(isinstance(part, Table) and part.rows and part.rows[0][0] == "1" for part in parts)
    for number, finding in enumerate(shown_findings, 1):
        mark = "-" if listed else f"{number}."  # one list of numbers on a screen
        yield from folded(f"  {mark} {with_remedy(finding)}", width, " " * (3 + len(mark))).splitlines()
    hidden = len(report.findings) - len(shown_findings)
    further = f"{hidden} more finding{'s' * (hidden > 1)} with " if hidden else ""
    more = f"More: {further}--details" if (report.details or hidden) and not details else ""
    following = f"Next: {report.next}" if report.next else ""
    if following or more:
        both = f"{following}     {more}" if following and more else following or more
        yield from [both] if len(both) <= width else filter(None, [following, more])  # a command is copied whole


def with_remedy(finding: Finding) -> str:
    """Return a finding with its remedy."""
    return f"{finding.text} -> {finding.remedy}" if finding.remedy else finding.text


def _part(part: Part, width: int, *, wrap: bool) -> Iterator[str]:
    if isinstance(part, str):
        label = LABEL.match(part)
        yield from folded(f"  {part}", width, " " * (2 + label.end() if label else 2)).splitlines()
    else:
        yield from (f"  {line}" for line in table_lines(part, width - 2, wrap=wrap))


def table_lines(table: Table, width: int = WIDTH, *, wrap: bool = False) -> Iterator[str]:
    """Yield a table as lines: numbers to the right, words to the left, none wider than the terminal; then its note.

    Columns of words shrink, the widest first, if a row is too wide: cells are cut in their middle or, if requested,
    continue on further lines. Heads wider than their columns are broken.
    """
    if table.caption:
        yield from folded(table.caption, width).splitlines()
    rows = [tuple(one_line(cell.replace(KEPT, " ")) for cell in row) for row in table.texts]
    right = [_is_numeric([row[j] for row in rows]) and j > 0 for j in range(len(table.head))]
    sizes = [max((len(row[j]) for row in rows), default=0) for j in range(len(table.head))]
    for most in (1, 2, 9):
        heads = [_broken(head, size, most) for head, size in zip(table.head, sizes, strict=True)]
        broad = [max([size, *map(len, lines)]) for size, lines in zip(sizes, heads, strict=True)]
        if _total(broad) <= width:
            break
    sizes = broad
    while _total(sizes) > width and any(size > NARROWEST and not r for size, r in zip(sizes, right, strict=True)):
        widest = max((size, j) for j, size in enumerate(sizes) if not right[j])[1]
        sizes[widest] -= 1
    depth = max(map(len, heads))
    for line in range(depth):
        cells = [lines[line - depth + len(lines)] if line >= depth - len(lines) else "" for lines in heads]
        yield _line(cells, sizes, right)
    for row in rows:
        if not wrap:
            yield _line(row, sizes, right)
            continue
        wrapped = [textwrap.wrap(cell, max(size, 1)) or [""] for cell, size in zip(row, sizes, strict=True)]
        yield from (_line(line, sizes, right) for line in zip_longest(*wrapped, fillvalue=""))
    if table.note:
        yield from folded(table.note, width).splitlines()


def _total(sizes: Sequence[int]) -> int:
    return sum(sizes) + len(GAP) * (len(sizes) - 1)


def _broken(head: str, size: int, most: int) -> list[str]:
    """Break a column's head into at most this many lines if that narrows it, down to the width of its cells."""
    words, *unit = head.replace(" [", "\n[").split("\n")
    widths = range(max(size, *map(len, unit), *map(len, words.split()), 1), len(head) + 1)
    broken = ([*textwrap.wrap(words, width, break_long_words=False), *unit] for width in widths)
    return next((lines for lines in broken if len(lines) <= most), [head])


def _line(cells: Sequence[str], sizes: Sequence[int], right: Sequence[bool]) -> str:
    columns = [(cut(cell, size), size, r) for cell, size, r in zip(cells, sizes, right, strict=True)]
    return GAP.join(cell.rjust(size) if r else cell.ljust(size) for cell, size, r in columns).rstrip()


def _is_numeric(column: Sequence[str]) -> bool:
    said = [cell for cell in column if cell not in ("", "-")]
    return bool(said) and all(NUMBER.match(cell) for cell in said)


def without_empty_columns(table: Table) -> Table:
    """Return a table without the columns that are empty in all rows."""
    shown = [j for j in range(len(table.head)) if any(row[j] != "" for row in table.rows)]
    head, *rows = (tuple(cells[j] for j in shown) for cells in (table.head, *table.rows))
    forms = tuple(table.forms[j] for j in shown) if table.forms else ()
    return replace(table, head=head, rows=tuple(rows), forms=forms)


# -------- Notebook


def html_of(report: Report) -> str:
    """Return the first screen as HTML for a notebook."""
    from ident.report.templates import template_of

    lines = report.remark, *(with_remedy(each).replace(" -> ", " → ") for each in report.findings[:MOST])
    return template_of("ident.report", "screen.html.jinja").render(report=report, lines=lines)


# -------- Words


def written(cell: Cell, form: str = "") -> str:
    """Return a cell as displayed: an undefined number as `-`, `7.16e+05` as `7.16e5`."""
    if isinstance(cell, str):
        return cell
    if cell is None or not math.isfinite(cell):
        return "-" if cell is None or math.isnan(cell) else "infinite"
    text = format(cell, form)
    if form.endswith("5g") and abs(cell) >= POWER and "e" not in text:
        text = format(cell, ".4e")
    text = f"{text[:-1]} %" if form.endswith("%") else text
    return short_power(re.sub(r"\.(?=$|e)", "", text))


def short_power(text: str) -> str:
    """Write a power of ten without its sign and zeros: `7.16e5` for `7.16e+05`."""
    return re.sub(r"e([+-])0*(\d)", lambda found: f"e{found[1].strip('+')}{found[2]}", text)


def folded(line: str, width: int = WIDTH, hang: str = "") -> str:
    """Break a line at the width of a terminal, but not inside `kept` words.

    Args:
        line: the text; its indentation stays.
        width: columns.
        hang: beginning of further lines.
    """
    if len(line) <= width:
        return line.replace(KEPT, " ")
    indent = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line[len(indent) :],
        width,
        initial_indent=indent,
        subsequent_indent=hang or indent,
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    ).replace(KEPT, " ")


def kept(text: str) -> str:
    """Return words that `folded` keeps on one line."""
    return text.replace(" ", KEPT)


def cut(text: str, length: int) -> str:
    """Return a text on one line, shortened in its middle if it is long."""
    text = one_line(text)
    half = (length - 1) // 2
    return text if len(text) <= length else f"{text[: length - half - 1]}…{text[-half:]}"
