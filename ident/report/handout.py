"""A result as a page to hand over: its report with all details, figures, inputs by hash; no folder of a computer."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ident.report.document import report_data, report_of
from ident.report.page import Page, Picture, Section, provenance
from ident.report.report import LABEL, Part, Report, Table, cut
from ident.report.words import sentence
from ident.text import as_word, one_line

FOLDERS = re.compile(
    r"(?<=')(?:~|[A-Za-z]:)?[/\\][^']*[/\\]"  # of an absolute path in quotes, perhaps with spaces
    r"|(?<![\w.)\]/])(?:~|[A-Za-z]:)?[/\\](?:[^\s/\\'\"]+[/\\])+"  # of an absolute path
    r"|(?<![\w/])[^\s/'=:(][^\s'=:(]*/(?=[^\s/'\"]+\.[A-Za-z])"  # of a file with an ending
)
"""The folders of a path, before the name of its file."""
OUT = re.compile(r""" --out (?:'[^']*'|"'"|[^\s'"])+""")
"""The folder that a proposed command writes to."""
INPUTS = ("what", "file", "SHA-256")
"""Head of the table of input files."""


def page_of(report: Report, head: Mapping[str, Any], pictures: Sequence[Picture] = ()) -> Page:
    """Return a result as a page.

    Args:
        report: what the command prints.
        head: of its file: inputs, options, versions, date.
        pictures: its figures.
    """
    report, head = named_only(report, head)
    subject, *more = report.subject.splitlines()
    return Page(
        cut(subject, 120),
        "; ".join([*map(str.strip, more), str(head["created"])[:10]]),
        report.verdict,
        summary_of(report),
        sections_of(report, pictures),
        inputs_table(head),
        provenance(head),
    )


def summary_of(report: Report) -> tuple[tuple[str, str], ...]:
    """Return the lines next to the verdict: labelled ones of the answer, as the cause, and all findings."""
    labelled = [tuple(part.split(": ", 1)) for part in report.answer if isinstance(part, str) and LABEL.match(part)]
    findings = (" ".join(sentence(words) for words in (each.text, each.remedy) if words) for each in report.findings)
    return *((label, text.strip()) for label, text in labelled), *(("Caution", words) for words in findings)


def sections_of(report: Report, pictures: Sequence[Picture]) -> tuple[Section, ...]:
    """Return the answer of a report, with its figures, and its details; without the lines of `summary_of`."""
    answer = [part for part in report.answer if not (isinstance(part, str) and LABEL.match(part))]
    parts: list[Part] = [part for part in answer if not (report.details and isinstance(part, Table) and part.brief)]
    remarks = [report.remark] * bool(report.remark) + [f"Next: {report.next}"] * bool(report.next)
    details = (Section(each.title, each.parts) for each in report.details)
    return Section("Answer", (*parts, *remarks), tuple(pictures)), *details


def inputs_table(head: Mapping[str, Any]) -> Table:
    """Return the input files of a result, each with its hash."""
    sources = {what: source for what, source in head["inputs"].items() if source}
    files = ((what, Path(source["path"]).name or "-", source["sha256"]) for what, source in sources.items())
    return Table("Inputs", INPUTS, tuple(files))


def named_only(report: Report, head: Mapping[str, Any]) -> tuple[Report, Mapping[str, Any]]:
    """Return a report, and the head of its file, in which files have names but no folders."""
    paths = {source["path"] for source in head["inputs"].values() if source and source["path"]}
    forms = sorted({form(path) for path in paths for form in (as_word, one_line)}, key=len, reverse=True)
    return report_of(_named(report_data(report), forms)), _named(head, forms)


def _named(value: Any, paths: Sequence[str]) -> Any:
    """Return JSON data in which paths, these and absolute ones, are names of files."""
    if isinstance(value, Mapping):
        return {key: _named(each, paths) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_named(each, paths) for each in value]
    if not isinstance(value, str):
        return value
    for path in paths:
        value = value.replace(path, "'" * path.startswith("'") + Path(path).name)
    return FOLDERS.sub("", OUT.sub("", value))
