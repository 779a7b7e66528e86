"""The page "methods": every docstring of the house that names its sources, with its formulas."""

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from docstrings import shown
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

PACKAGE = Path(__file__).parents[2] / "ident"
ROOMS = {
    "arm": "Mechanics of the arm",
    "inference": "Inference",
    "identify": "Identification of an arm",
    "vibrate": "Vibration",
    "studies": "Assessment",
}
"""Folders with methods, in the order of the page."""
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|References|Yields|Note|Example):$", re.MULTILINE)


class Method(NamedTuple):
    """A docstring that names its sources.

    Attributes:
        place: module and name, as `ident.arm.modes.damped_eigenvalues`.
        title: its first line.
        text: the rest but for its sections.
        sources: one a line.
    """

    place: str
    title: str
    text: str
    sources: str


class Methods(Directive):
    """`{methods}`: a section for each folder, an entry for each method in it."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        environment = self.state.document.settings.env
        sections = []
        for folder, title in ROOMS.items():
            section = nodes.section("", nodes.title(title, title), ids=[nodes.make_id(title)], names=[title.lower()])
            for path in sorted((PACKAGE / folder).rglob("*.py")):
                environment.note_dependency(str(path))
                for method in methods(path):
                    section += entry(method)
            if len(section) < 2:
                raise self.error(f"no method of ident/{folder} names its sources")
            sections.append(section)
        return sections


def entry(method: Method) -> nodes.section:
    """Return a method as a section: title, where it is, formulas, sources."""
    heading = nodes.title(method.title, method.title)
    node = nodes.section("", heading, ids=[nodes.make_id(method.place)], classes=["method"])
    node += nodes.paragraph("", "", nodes.literal(method.place, method.place), classes=["place"])
    node += shown(method.text)
    sources = f"Source: {method.sources}"
    node += nodes.paragraph(sources, sources, classes=["source"])
    return node


def methods(path: Path) -> Iterator[Method]:
    """Return the methods of a file, its own docstring first."""
    module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for name, node in documented(tree, module):
        text = ast.get_docstring(node) or ""
        sources = section(text, "References")
        if sources:
            head, _, rest = SECTION.split(text)[0].partition("\n")
            title = re.sub(r"^[a-z]+ ", lambda match: match[0].capitalize(), head.removeprefix("Return ")).rstrip(".")
            yield Method(name, title, rest, sources)


def documented(node: ast.AST, name: str) -> Iterator[tuple[str, ast.Module | ast.ClassDef | ast.FunctionDef]]:
    """Return all that has a docstring, by its full name."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
        yield name, node
        for child in node.body:
            yield from documented(child, f"{name}.{getattr(child, 'name', '')}")


def section(text: str, title: str) -> str:
    """Return a section of a docstring as one line."""
    parts = SECTION.split(text)
    return " ".join(inspect.cleandoc(parts[parts.index(title) + 1]).split()) if title in parts else ""


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("methods", Methods)
    return {"parallel_read_safe": True}
