"""The first modes of an arm in motion, as an SVG document."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from markupsafe import escape

from ident.report.style import colour_of
from ident.studies.look.predict_figure import swing_of
from ident.studies.look.show_figure import MODES, View, most_seen, views

if TYPE_CHECKING:
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.studies.look.arm_view import ArmView

WIDTH, HEIGHT, MODE_WORDS, ROOM = 340.0, 150.0, 44.0, 18.0
"""Size of a mode's picture, the height of its words, and the margin around the arm [px]."""
PERIOD = 2.0
"""Period of the animation [s]: the same for all modes, much slower than real."""
STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#1b1f24}.soft{fill:#57606a;font-size:12px}"
    "polyline{fill:none;stroke-linejoin:round;stroke-linecap:round}.still{display:none}"
)
STILL = ".moving{display:none}.still{display:inline}"
"""Rules of a still picture."""


def moving_modes(view: "ArmView") -> str:
    """Return the first modes as an animated SVG document, with equal largest displacements.

    Args:
        view: an arm with known modes.
    """
    assert view.analysis is not None
    analysis = view.analysis
    count = min(MODES, len(analysis.labels))
    columns = min(2, count)
    size = columns * WIDTH, -(-count // columns) * (HEIGHT + MODE_WORDS)
    modes = "".join(
        f'<g transform="translate({i % columns * WIDTH:g} {i // columns * (HEIGHT + MODE_WORDS):g})">{mode}</g>'
        for i, mode in enumerate(_modes(analysis, count, views(view)))
    )
    # browsers apply the rule of reduced motion to an animation opened by itself
    rules = f"{STYLE}@media (prefers-reduced-motion:reduce),print{{{STILL}}}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" width="{size[0]:g}" '
        f'height="{size[1]:g}"><style>{rules}</style><rect width="100%" height="100%" fill="#fff"/>{modes}</svg>\n'
    )


def _modes(analysis: "ModalAnalysis", count: int, seen: tuple[View, View]) -> Iterator[str]:
    for i, label in enumerate(analysis.labels[:count]):
        swing = swing_of(analysis, i)
        view = most_seen(seen, swing)
        words = f"{i + 1}: {analysis.modes.frequency[i]:.2f} Hz, {label}"
        yield (
            f'<text x="{ROOM:g}" y="20">{escape(words)}</text>'
            f'<text class="soft" x="{ROOM:g}" y="37">{escape(view.name)}, exaggerated, slowed down</text>'
            + _swinging(view.of(analysis.outline[0]), view.of(swing), colour_of(label))
        )


def _swinging(rest: Float[np.ndarray, "2 K"], swing: Float[np.ndarray, "2 K"], colour: str) -> str:
    """Draw the arm at rest, and moving between both ends of its swing; if still, at both ends."""
    every = np.concatenate([rest, rest + swing, rest - swing], 1)
    low, high = every.min(1), every.max(1)
    scale = min((WIDTH - 2 * ROOM) / max(high[0] - low[0], 1e-9), (HEIGHT - 2 * ROOM) / max(high[1] - low[1], 1e-9))
    middle = (low + high) / 2

    def points(places: Float[np.ndarray, "2 K"]) -> str:
        x = WIDTH / 2 + scale * (places[0] - middle[0])
        y = MODE_WORDS + HEIGHT / 2 - scale * (places[1] - middle[1])
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    ends = points(rest + swing), points(rest - swing)
    pace = f'dur="{PERIOD:g}s" repeatCount="indefinite" calcMode="spline" keyTimes="0;0.5;1"'
    sine = 'keySplines="0.37 0 0.63 1;0.37 0 0.63 1"'
    return (
        f'<polyline points="{points(rest)}" stroke="#c8c8c8" stroke-width="5"/>'
        f'<polyline class="moving" points="{ends[0]}" stroke="{colour}" stroke-width="2.5">'
        f'<animate attributeName="points" values="{ends[0]};{ends[1]};{ends[0]}" {pace} {sine}/></polyline>'
        f'<g class="still"><polyline points="{ends[1]}" stroke="{colour}" stroke-width="1" opacity="0.4"/>'
        f'<polyline points="{ends[0]}" stroke="{colour}" stroke-width="2.5"/></g>'
    )
