"""Docstrings as the manual shows them: formulas, which stand indented in the source, as they are."""

import inspect
import re
from collections.abc import Iterator
from functools import partial

from docutils import nodes
from sphinx.application import Sphinx

import ident
from ident.studies.result import Alias


def paragraphs(text: str) -> Iterator[tuple[str, bool]]:
    """Return the paragraphs of a text, each with whether it is a formula: indented after a blank line."""
    for block in re.split(r"\n\s*\n", text.strip("\n")):
        if block.strip():
            yield block, block.startswith("    ")


def shown(text: str) -> list[nodes.Node]:
    """Return a text in Markdown's least: paragraphs, formulas, and code in backticks."""
    return [formula(block) if is_formula else paragraph(block) for block, is_formula in paragraphs(text)]


def formula(block: str) -> nodes.literal_block:
    """Return a formula as it stands."""
    lines = block.splitlines()
    margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
    text = "\n".join(line[margin:] for line in lines)
    return nodes.literal_block(text, text, language="none", classes=["formula"])


def paragraph(text: str) -> nodes.paragraph:
    """Return a paragraph with its code."""
    node = nodes.paragraph()
    for number, part in enumerate(re.split(r"`+([^`]+)`+", " ".join(text.split()))):
        if part:
            node += nodes.literal(part, part) if number % 2 else nodes.Text(part)
    return node


def mark_formulas(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Make literal blocks of a docstring's formulas, and plain text of what reStructuredText would read into it."""
    marked: list[str] = []
    indent = 0
    for number, line in enumerate(lines):
        own = len(line) - len(line.lstrip())
        blank_before = number > 0 and not lines[number - 1].strip()
        if line.strip() and blank_before and own >= indent + 4 and not lines[number].lstrip().startswith(":"):
            marked += [" " * indent + "::", ""]
        if line.strip():
            indent = own
        marked.append(line)
    lines[:] = marked


def aliases_once(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Drop aliases from the attributes of a result: each is shown as a property, with its type."""
    aliases = {name for name, each in vars(thing).items() if isinstance(each, Alias)} if what == "class" else ()
    kept: list[str] = []
    hidden = False
    for line in lines:
        attribute = re.match(r"    (\w+): ", line)
        hidden = attribute[1] in aliases if attribute else hidden and line.startswith("        ")
        kept += [] if hidden else [line]
    lines[:] = kept


def inputs_alone(app: Sphinx) -> None:
    """Leave the options of a study out of its signature: the page of its command has them."""
    for thing in map(partial(getattr, ident), ident.__all__):
        if isinstance(getattr(thing, "__signature__", None), inspect.Signature) and hasattr(thing, "__wrapped__"):
            own, shown = inspect.signature(thing.__wrapped__).parameters, thing.__signature__
            kept = [each for name, each in shown.parameters.items() if name in own]
            thing.__signature__ = shown.replace(parameters=kept)


def without_keywords(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Leave them out of its docstring, too."""
    if "Keyword Args:" in lines:
        del lines[lines.index("Keyword Args:") :]


def hide_fields(
    app: Sphinx, what: str, name: str, thing: object, options: object, signature: str | None, returned: str
) -> tuple[str, str] | None:
    """Show no signature for a value: its fields are in its docstring, or in the table of its command."""
    return ("", returned or "") if what in ("class", "exception") and signature else None


def dash(app: Sphinx, doctree: nodes.document) -> None:
    """Set napoleon's two hyphens behind a name as a dash."""
    for text in list(doctree.findall(nodes.Text)):
        if text.startswith(" -- "):
            text.parent.replace(text, nodes.Text(f" \N{EN DASH} {text.removeprefix(' -- ')}"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to autodoc, before napoleon does."""
    app.connect("builder-inited", inputs_alone)
    app.connect("autodoc-process-docstring", without_keywords, priority=300)
    app.connect("autodoc-process-docstring", aliases_once, priority=300)
    app.connect("autodoc-process-docstring", mark_formulas, priority=400)
    app.connect("autodoc-process-signature", hide_fields)
    app.connect("doctree-read", dash)
    return {"parallel_read_safe": True}
