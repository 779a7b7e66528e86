"""Directives for a page of a command: its help as the program prints it, its options as the class has them."""

from typing import Any

from docstrings import paragraph
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

WIDTH = 100
"""Columns of the help."""


class CommandHelp(Directive):
    """`{command-help} fit`: what `ident fit --help-all` prints."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the text."""
        text = help_of(self.arguments[0])
        return [nodes.literal_block(text, text, language="none")]


class OptionsTable(Directive):
    """`{options} fit`: the fields of `ident.FitOptions`, one a row."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        from ident.studies import module_of
        from ident.studies.options import default_of, flag_of, specs

        name = self.arguments[0]
        kind = getattr(module_of(name), f"{name.capitalize()}Options")
        rows = [
            [f"`{each.name}`", f"`{flag_of(each)}`", f"`{default_of(each)!r}`", range_of(spec), spec.help]
            for each, spec in specs(kind)
            if each.name not in kind.refuses
        ]
        return [table(["in Python", "flag", "default", "allowed", "meaning"], rows)] if rows else []


def help_of(command: str) -> str:
    """Return the help of a command with all its options, or of the program."""
    from typer.testing import CliRunner

    from ident.cli import main  # noqa: F401  (hangs the commands on the app)
    from ident.cli.command import MAIN, app

    arguments = [command, "--help-all" if command in MAIN else "--help"] if command != "ident" else ["--help"]
    answer = CliRunner().invoke(app, arguments, prog_name="ident", max_content_width=WIDTH, terminal_width=WIDTH)
    if answer.exit_code:
        raise ValueError(f"ident {command} --help: {answer.output}")
    return answer.output.strip()


def range_of(spec: Any) -> str:
    """Return the values that an option may have."""
    if spec.choices:
        return ", ".join(f"`{word}`" for word in spec.choices if word)
    return f"above {spec.above:g}" if spec.above is not None else f"from {spec.low:g}" if spec.low is not None else ""


def table(head: list[str], rows: list[list[str]]) -> nodes.table:
    """Return a table whose cells have code in backticks."""
    group = nodes.tgroup(cols=len(head))
    group += [nodes.colspec(colwidth=width) for width in (2, 2, 2, 2, 5)[: len(head)]]
    heading, body = nodes.thead(), nodes.tbody()
    heading += row(head)
    body += [row(cells) for cells in rows]
    group += [heading, body]
    return nodes.table("", group, classes=["options"])


def row(cells: list[str]) -> nodes.row:
    """Return a row of a table."""
    return nodes.row("", *(nodes.entry("", paragraph(cell)) for cell in cells))


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directives."""
    app.add_directive("command-help", CommandHelp)
    app.add_directive("options", OptionsTable)
    return {"parallel_read_safe": True}
