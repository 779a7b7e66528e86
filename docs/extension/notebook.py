"""Pages of the notebooks, out of their executed copies; nothing is executed here.

A page in docs/notebooks/ is one comment; its text comes from the notebook of the same name.
"""

import json
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
FENCE = "``````"
ICONS = {
    "fa-minus": "-",
    "fa-fast-backward": "|&lt;",
    "fa-step-backward": "&lt;",
    "fa-play fa-flip-horizontal": "&#9664;",
    "fa-pause": "II",
    "fa-play": "&#9654;",
    "fa-step-forward": "&gt;",
    "fa-fast-forward": "&gt;|",
    "fa-plus": "+",
}
"""Buttons of matplotlib's animation, whose pictures would come from the network."""


def read(app: Sphinx, name: str, content: list[str]) -> None:
    """Put a notebook in place of its page's text."""
    path = NOTEBOOKS / f"{Path(name).name}.ipynb"
    if name.startswith("notebooks/") and path.exists():
        app.env.note_dependency(str(path))
        content[0] = page(json.loads(path.read_text(encoding="utf-8")))


def page(notebook: dict[str, Any]) -> str:
    """Return a notebook as Markdown."""
    return "\n\n".join(block for cell in notebook["cells"] for block in blocks(cell))


def blocks(cell: dict[str, Any]) -> list[str]:
    """Return what a cell shows."""
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return [source]
    return [fenced("python", source), *(output(each) for each in cell.get("outputs", []))]


def output(result: dict[str, Any]) -> str:
    """Return one result of a cell: a picture, an animation or text."""
    data = result.get("data", {})
    if "text/html" in data:
        html = alone("".join(data["text/html"]))
        return fenced("{raw} html", f'<div class="animation">{html}</div>')
    if "image/png" in data:
        return f"![figure](data:image/png;base64,{''.join(data['image/png']).strip()})"
    return fenced("text", "".join(result.get("text", data.get("text/plain", ""))).rstrip())


def alone(html: str) -> str:
    """Return an animation that asks nothing of the network."""
    html = re.sub(r"<link[^>]*>", "", html)
    for icon, text in ICONS.items():
        html = html.replace(f'<i class="fa {icon}"></i>', text)
    return html


def fenced(kind: str, text: str) -> str:
    """Return a block of code."""
    return f"{FENCE}{kind}\n{text}\n{FENCE}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Listen to what is read."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True}
