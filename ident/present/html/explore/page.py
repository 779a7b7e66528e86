"""The page of `ident explore`: template, style and script as one file that asks for nothing.

Names come from files that anybody may have written. In the page's data every `<` is escaped, the script puts words
into the page as text alone, and a content security policy admits this one script and this one style, by their hashes.
"""

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from ident.assess.exploration import Exploration
from ident.description.file import ArmFile
from ident.identify.values import Values
from ident.present.html.explore.data import page_data
from ident.present.html.page import shown
from ident.present.text.basis import changes_in_words, values_in_words

SCRIPTS = ("mechanics.js", "response.js", "readings.js", "drawing.js", "state.js", "sliders.js", "page.js", "views.js")
"""Parts of the script, in this order."""


@dataclass(frozen=True)
class Start:
    """Where a page begins, and with which options its commands go on.

    Attributes:
        posture: (driven,) [deg]
        speed: [%] of full speed.
        soft_base: [m] height of a base that gives, or None.
        changed: numbers that were set, by path [SI].
    """

    posture: tuple[float, ...]
    speed: float = 10.0
    soft_base: float | None = None
    changed: Mapping[str, float] = field(default_factory=dict)


def explore_page(
    exploration: Exploration,
    arm_file: ArmFile,
    start: Start,
    *,
    fit: Values | None = None,
    posterior: Values | None = None,
) -> str:
    """Return the page as HTML; the same arm gives the same text.

    Args:
        exploration: what it knows of the arm.
        arm_file: where the arm is from.
        start: where it begins.
        fit: fitted values that the arm has taken over.
        posterior: draws that the marks are from.
    """
    script, style = _script(), _source("explore.css")
    sources = {"fit": fit, "posterior": posterior}
    data = page_data(exploration) | {
        "start": {"posture_deg": list(start.posture), "speed": start.speed},
        "command": list(_arguments(arm_file, start, sources)),
        "set": dict(start.changed),
    }
    environment = Environment(
        autoescape=True, finalize=shown, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    text = environment.from_string(_source("page.html.jinja")).render(
        title=exploration.arm.name,
        remarks=[line.strip() for line in _remarks(exploration, start, fit, posterior)],
        version=version("ident"),
        files=_files({"arm": arm_file, **sources, "campaign": exploration.measured}),
        data=Markup(_json(data)),
        script=Markup(script),
        style=Markup(style),
        script_hash=Markup(script_hash()),
        style_hash=Markup(_hash(style)),
    )
    return f"{text}\n"


def script_hash() -> str:
    """Return the hash of the page's script, as a content security policy names it."""
    return _hash(_script())


def _remarks(exploration: Exploration, start: Start, fit: Values | None, posterior: Values | None) -> Iterator[str]:
    yield "Drag, and see what the arm does."
    if exploration.arm.drives and not exploration.stroke:
        yield "The arm file has no [stroke]: how fast the pulleys turn is not known, so they are left out."
    if exploration.fixed:
        yield f"always on it: {exploration.fixed}"
    yield from values_in_words(fit, posterior)
    yield from changes_in_words(start.changed)


def _arguments(arm_file: ArmFile, start: Start, sources: Mapping[str, Values | None]) -> Iterator[str]:
    """Yield what every command about this arm begins with."""
    yield arm_file.path or "arm.toml"
    for name, values in sources.items():
        if values is not None and values.path:
            yield f"--{name}={values.path}"
    if start.soft_base is not None:
        yield f"--soft-base={start.soft_base!r}"


def _files(sources: Mapping[str, Any]) -> str:
    known = {what: source for what, source in sources.items() if source is not None and source.path}
    return "; ".join(
        f"{what}: {source.path}" + (f", SHA-256 {source.sha256[:12]}…" if source.sha256 else "")
        for what, source in known.items()
    )


def _script() -> str:
    return "\n".join(['"use strict";', *map(_source, SCRIPTS)])


def _source(name: str) -> str:
    return (files("ident.present.html.explore") / name).read_text("utf-8")


def _json(data: Mapping[str, Any]) -> str:
    """Return data as JSON in which nothing ends a script or begins a comment."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
