"""Write `docs/conformance.md`: what agrees with what, from the records of one run of the tests.

    IDENT_CONFORMANCE=/tmp/records python -m pytest -n 2 -m ""
    python docs/conformance_page.py /tmp/records           # writes the page, and the number of lines into README.md
    python docs/conformance_page.py /tmp/records --check   # as `.ci/run` does: is the page that of these records?

`tests/support/conformance.py` keeps a record of each comparison. Those of one formula, source or engine are one line
here, whatever parameters a test has: the number shown is the largest that was compared, the share of the tolerance that
of the worst. The check compares numbers within their tolerance and texts as they are.
"""

import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests" / "support"))

from conformance import GROUPS, NEARLY, records  # noqa: E402
from numbers_in_text import NUMBER, parted  # noqa: E402

PAGE, README = ROOT / "docs" / "conformance.md", ROOT / "README.md"
DIGITS = 7
"""The most that a number shows."""
SMALL = 4
"""Numbers below 10 to the minus this are written with their power of ten."""
CLOSE = 0.02
"""By which share numbers within texts may differ from machine to machine."""
COUNT = re.compile(r"\[(\d+) comparisons")
HEAD = ("what", "from", "expected", "computed", "tolerance", "test")
NO_HEAD = ("it says", "from", "computed", "asserted", "why", "test")
INTRO = """# Conformance

<!-- Written by docs/conformance_page.py from the records of one run of the tests; CI compares the two. -->

What ident computes, against what does not depend on it: a formula, a publication, a standard, another package, or
another method. {count} comparisons of {numbers} numbers agree; [{differing} do not](#what-does-not-agree). Each
line is an assertion of the test in its last column, which writes down what it compared.

Of several numbers in a line, the largest is shown. *Used* is the share of the tolerance that the worst of them takes.
"""
NOT = """
## What does not agree

Statements of the paper that the model contradicts, or that nothing here can judge. Each is asserted to differ as
stated; [the paper and the model](paper.md) has all statements.
"""
AS_SAID = "as it says"
Record = dict[str, Any]
Key = tuple[str, str, str]


def lines_of(folder: str) -> dict[Key, Record]:
    """Return the lines of a page by group, what and source, in the order of the page."""
    lines = {}
    for key, kept in records(folder).items():
        tests = {each["test"].partition("[")[0] for each in kept}
        if len(tests) > 1:
            sys.exit(f"{': '.join(key)}: compared in several tests ({', '.join(sorted(tests))}); name them apart")
        kept.sort(key=lambda each: each["test"])  # stable: within a test, in the order of the comparisons
        sizes = [abs(each["expected"]) if isinstance(each["expected"], float) else 0.0 for each in kept]
        shown = kept[next(i for i, size in enumerate(sizes) if size >= (1 - NEARLY) * max(sizes))]
        whole = {"numbers": sum(each["numbers"] for each in kept), "used": max(each["used"] for each in kept)}
        lines[key] = shown | whole | {"test": tests.pop()}
    return dict(sorted(lines.items(), key=lambda line: (GROUPS.index(line[0][0]), line[1]["test"], line[0])))


def power(value: float) -> int:
    """Return the power of ten of a number's first digit."""
    return int(f"{value:e}".partition("e")[2])


def decimals_of(line: Record) -> int:
    """Return the decimals of a line's numbers: those that its tolerance keeps, a band one more; `DIGITS` at most."""
    order = power(max([abs(x) for x in (line["expected"], line["computed"]) if isinstance(x, float)]))
    if line["tolerance"] == 0:
        return DIGITS - 1 - order
    band = 1 if isinstance(line["expected"], str) else 0
    return min(band - power(line["tolerance"]), DIGITS - 1 - order)


def number(line: Record, name: str) -> str:
    """Write a number with the digits that the tolerance keeps; a text as it is."""
    value = line[name]
    if isinstance(value, str):
        return value
    decimals = decimals_of(line)
    if round(value, decimals) == 0:
        text = "0"
    elif line["tolerance"] == 0 and value == int(value):
        text = str(int(value))
    elif power(value) < -SMALL:
        text = f"{value:.{max(power(value) + decimals, 0)}e}"
    else:
        text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return f"{text} {line['unit']}".rstrip()


def tolerance_of(line: Record) -> str:
    """Return the cell of the tolerance, but for what is used of it."""
    count = f"; {line['numbers']:,} numbers" if line["numbers"] > 1 and "of" not in str(line["computed"]) else ""
    return f"{line['rule']}{count}"


def used(line: Record) -> str:
    """Return the share of the tolerance that the worst number takes, empty where there is none."""
    if line["rule"] == "exact" or not isinstance(line["computed"], float):
        return ""
    return "<br>*used < 1 %*" if line["used"] < 0.01 else f"<br>*used {line['used']:.0%}*".replace("%", " %")


def cells(key: Key, line: Record) -> tuple[str, ...]:
    """Return the cells of a line, with nothing that could end one."""
    _, what, source = key
    file, _, test = line["test"].removeprefix("tests/").partition("::")
    expected, computed = (number(line, name) for name in ("expected", "computed"))
    if line["differs"]:
        values = (computed, line["rule"], line["note"])
    else:
        values = (AS_SAID if expected == what else expected, computed, tolerance_of(line) + used(line))
    row = (what, source, *values, f"`{file}` `{test}`")
    return tuple(re.sub(r"(?<!\\)\|", r"\\|", cell) for cell in row)


def table(lines: dict[Key, Record], head: tuple[str, ...] = HEAD) -> str:
    """Return a table of lines."""
    rows = [head, ("---",) * len(head), *(cells(key, line) for key, line in lines.items())]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def page_of(lines: dict[Key, Record]) -> str:
    """Return the page."""
    agreeing = {key: line for key, line in lines.items() if not line["differs"]}
    differing = {key: line for key, line in lines.items() if line["differs"]}
    total = sum(line["numbers"] for line in agreeing.values())
    parts = [INTRO.format(count=len(agreeing), numbers=f"{total:,}", differing=len(differing))]
    counts = Counter(group for group, _, _ in agreeing)
    sources = {group: len({key[2] for key in agreeing if key[0] == group}) for group in GROUPS}
    parts.append("| group | comparisons | sources |\n|---|---|---|")
    parts += [f"| [{group}](#{group.replace(' ', '-')}) | {counts[group]} | {sources[group]} |" for group in GROUPS]
    parts += [NOT, table(differing, NO_HEAD)]
    for group in GROUPS:
        own = {key: line for key, line in agreeing.items() if key[0] == group}
        parts += [f"\n## {group.capitalize()}\n", table(own)]
    return "\n".join(parts) + "\n"


def rows_of(page: str) -> dict[Key, tuple[str, ...]]:
    """Return the cells of a page's lines by group, what and source; those that do not agree have an empty group."""
    rows, group = {}, ""
    for text in page.splitlines():
        if text.startswith("## "):
            group = text[3:].lower()
        row = tuple(cell.strip() for cell in re.split(r"(?<!\\)\|", text)[1:-1])
        if len(row) == len(HEAD) and row not in (HEAD, NO_HEAD) and set(row) != {"---"}:
            rows[group if group in GROUPS else "", row[0], row[1]] = row
    return rows


def alike(text: str, other: str, *, digit: bool = False) -> bool:
    """Whether words are equal and numbers nearly so; with `digit`, or one apart in the last that is printed."""
    words, numbers = parted(text)
    other_words, others = parted(other)
    units = [10.0 ** decimal_place(match) if digit else 0.0 for match in NUMBER.findall(text)]
    each = zip(numbers, others, units, strict=True) if words == other_words else ()
    return words == other_words and all(abs(a - b) <= max(CLOSE * max(abs(a), abs(b)), unit) for a, b, unit in each)


def decimal_place(printed: str) -> int:
    """Return the power of ten of the last digit of a number."""
    mantissa, _, exponent = printed.partition("e")
    return int(exponent or 0) - len(mantissa.partition(".")[2])


def same(line: Record, page: str, found: str, name: str) -> bool:
    """Whether a cell of the page is that of a record: a number within its tolerance and the last digit shown."""
    value = line[name]
    if isinstance(value, str):
        numbers = [[float(x) for x in re.findall(r"\d+", text)] for text in (page, found)]
        by_count = " of " in page and len(numbers[0]) == len(numbers[1]) == 2 and numbers[0][1] == numbers[1][1]
        return alike(page, found, digit=True) or (by_count and abs(numbers[0][0] - numbers[1][0]) <= line["tolerance"])
    (shown, *unit), (_, *own_unit) = page.split(), found.split()
    return unit == own_unit and abs(float(shown) - value) <= line["tolerance"] + 0.51 * 10.0 ** -decimals_of(line)


def differences(page: str, lines: dict[Key, Record]) -> list[str]:
    """Return what is not alike of a page and the records of a run."""
    shown = rows_of(page)
    new = {("" if line["differs"] else key[0], *cells(key, line)[:2]): (key, line) for key, line in lines.items()}
    found = [f"no comparison any more: {': '.join(key)}" for key in shown.keys() - new.keys()]
    found += [f"not on the page: {': '.join(key)}" for key in new.keys() - shown.keys()]
    for place in new.keys() & shown.keys():
        key, line = new[place]
        old, now = shown[place], cells(key, line)
        for i, name in [(2, "computed")] if line["differs"] else [(2, "expected"), (3, "computed")]:
            if not same(line, old[i], now[i], name):
                found.append(f"{': '.join(place)}: {name} {now[i]}, on the page {old[i]}")
        last = [" ".join(row[3 + (not line["differs"]) : 5]).partition("<br>")[0] for row in (old, now)]
        if not alike(*last) or old[5] != now[5]:
            found.append(f"{': '.join(place)}: {last[1]} {now[5]}, on the page {last[0]} {old[5]}")
    return sorted(found)


def main(folder: str, check: str = "") -> int:
    """Write the page, or compare it; return 1 if it is not that of the records."""
    lines = lines_of(folder)
    if not lines:
        sys.exit(f"{folder}: no records; run the tests with IDENT_CONFORMANCE={folder}")
    if check:
        found = differences(PAGE.read_text(encoding="utf-8"), lines)
        print(*found, sep="\n")
        if found:
            print(f"{len(found)} differences; write the page again: python docs/conformance_page.py {folder}")
        return int(bool(found))
    PAGE.write_text(page_of(lines), encoding="utf-8")
    agreeing = sum(not line["differs"] for line in lines.values())
    text = README.read_text(encoding="utf-8")
    README.write_text(COUNT.sub(f"[{agreeing} comparisons", text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
