"""The report of variants of an arm side by side, and its table."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ident.report.report import Finding, Report, Section, Table, by_head, cut, written
from ident.report.words import MM, some
from ident.studies.basis import all_findings, subject
from ident.text import as_word

if TYPE_CHECKING:
    from ident.studies.cure.variants import Variant, VariantsOptions

MARKED = 0.01
"""Relative difference from the first variant that is marked."""
QUANTITIES = {
    "mass": ("mass [kg]", 1.0, ".4g"),
    "frequency1": ("mode 1 at the end [Hz]", 1.0, ".2f"),
    "frequency2": ("mode 2 at the end [Hz]", 1.0, ".2f"),
    "deflection": ("deflection there [mm]", MM, ".3g"),
    "compliance": ("tool compliance [um/N]", 1e6, ".3g"),
    "vibration": ("worst vibration [mm]", MM, ".3g"),
    "settled": ("settled after [s]", 1.0, ".1f"),
    "best_time": ("best motion [s]", 1.0, ".1f"),
}
"""What is compared, by its name in the table: words, factor from SI, format."""


def variants_sections(variants: Sequence["Variant"], options: "VariantsOptions") -> Report:
    """Return the report of variants."""
    arms = [each.motions.basis.arm.numbers() for each in variants]
    every = ((path, *(arm.get(path) for arm in arms)) for path in dict.fromkeys(path for arm in arms for path in arm))
    rows = [row for row in every if len({None if x is None else float(x) for x in row[1:]}) > 1]
    differing = f"Numbers of the arms that differ: {some([str(row[0]) for row in rows])}."
    details = by_head(("Number [SI]", *(f"{head}|.6g" for head in names(variants))), rows)
    answer = _table(variants, options), differing if rows else "The arms have the same numbers."
    title = f"{len(variants)} variants: {subject(variants[0].motions.basis)}"
    sections = (Section("Numbers that differ", (details,)),)[: len(rows)]
    return Report(title, None, answer, tuple(_findings(variants)), next=_next(variants), details=sections)


def names(variants: Sequence["Variant"]) -> list[str]:
    """Return the variants' names with their numbers: `1 arm`."""
    return [f"{i} {cut(each.name, max(7, 40 // len(variants)))}" for i, each in enumerate(variants, 1)]


def _table(variants: Sequence["Variant"], options: "VariantsOptions") -> Table:
    rows = []
    for name, (words, factor, form) in QUANTITIES.items():
        values = [x and factor * x for x in (each.numbers[name] for each in variants)]
        marks = ("* " * differs(x, values[0]) for x in values)
        rows.append((words, *(mark + written(x, form) for mark, x in zip(marks, values, strict=True))))
    note = f"*: more than {100 * MARKED:g} % from the first. Settled: below {options.settled:g} mm for good, worst "
    note += f"phases. Best motion: least time along the path within {options.limit:g} mm, by the exact equations. "
    return by_head(("", *names(variants)), rows, note=f"{note}Compliance: links count as rigid.")


def differs(value: float | None, first: float | None) -> bool:
    """Whether a number differs from that of the first variant."""
    return abs(value / first - 1) > MARKED if value and first else value != first


def _findings(variants: Sequence["Variant"]) -> Iterator[Finding]:
    if sum(bool(each.motions.basis.posterior) for each in variants) > 1:
        text = "no probability of a difference is given: posteriors of one campaign are not independent"
        yield Finding(text, "compare the campaigns (ident compare)")
    yield from all_findings(variants[0].motions.basis)


def _next(variants: Sequence["Variant"]) -> str:
    """Return the motion of the quickest variant; where none keeps the limit, a design of the first."""
    best = min(variants, key=lambda each: each.numbers["best_time"] or float("inf"))
    basis = best.motions.basis
    words = [as_word(basis.arm_file.path or "arm.toml")]
    words += [f"--{name} {as_word(x.path)}" for name, x in (("fit", basis.fit), ("posterior", basis.posterior)) if x]
    file = " ".join(words).replace("{", "{{").replace("}", "}}")
    return f"ident motion {file}" if best.motions.recommended else f"ident design {file}"


def variants_rows(variants: Sequence["Variant"]) -> list[dict[str, Any]]:
    """Return a row for each variant [SI]."""
    return [{"variant": each.name, **each.numbers} for each in variants]
