"""Examples of the manual: the `sh` and `python` blocks of a page in order, and what a `text` block says of one."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LANGUAGES = ("sh", "python", "text")
SHOWN_ONLY = re.compile(r"<!-- shown only: .{10,} -->$")
"""The comment, with a reason, above an example that the tests pass over."""


class Example(NamedTuple):
    """An example of a page.

    Attributes:
        language: `sh`, `python`, or `text` for what the example before it prints.
        text: what stands in the block.
        line: where, counted from 1.
        shown_only: whether the tests pass it over.
    """

    language: str
    text: str
    line: int
    shown_only: bool

    @property
    def commands(self) -> list[list[str]]:
        """What is called, each as a list of words; `a && b` is two."""
        parts = [part for line in self.text.splitlines() for part in line.split(" && ")]
        return [shlex.split(part.replace(".venv/bin/", ""), comments=True) for part in parts if part.strip()]


def pages() -> list[Path]:
    """All pages that are written by hand."""
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def examples(page: Path) -> list[Example]:
    """Return the examples of a page."""
    lines, blocks = page.read_text(encoding="utf-8").splitlines(), []
    fences = [number for number, line in enumerate(lines) if line.lstrip().startswith("```")]
    for start, end in zip(fences[::2], fences[1::2], strict=True):
        language = lines[start].strip().strip("`")
        if language in LANGUAGES:
            shown_only = start > 0 and bool(SHOWN_ONLY.match(lines[start - 1]))
            blocks.append(Example(language, "\n".join(lines[start + 1 : end]), start + 1, shown_only))
    return blocks
