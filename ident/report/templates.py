"""Templates of HTML; every text in them is escaped, and control characters become visible.

The texts of pages and notebooks come from files of unknown authors.
"""

from functools import cache
from importlib.resources import files

from jinja2 import Environment, StrictUndefined, Template

from ident.report.report import KEPT
from ident.text import one_line


@cache
def template_of(package: str, file: str) -> Template:
    """Return a template of a package, by its file there."""
    environment = Environment(
        autoescape=True, finalize=shown, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string((files(package) / file).read_text("utf-8"))


def shown(value: object) -> object:
    """Return a text as the page shows it: control characters and changes of text direction become visible.

    Output of the template itself stays unchanged.
    """
    return value if hasattr(value, "__html__") else one_line(str(value).replace(KEPT, " "))
