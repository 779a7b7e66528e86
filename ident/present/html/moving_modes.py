"""The first modes of an arm as a picture that moves: SVG without a script, still for who wants no motion."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from markupsafe import escape

from ident.assess.arm_view import ArmView
from ident.identify.modal_analysis import ModalAnalysis
from ident.present.figures.arm_drawing import View, views
from ident.present.figures.predict import NAME_STYLES, SWING

MODES = 4
"""Modes that are shown."""
WIDTH, HEIGHT, MODE_WORDS, ROOM = 340.0, 150.0, 44.0, 18.0
"""Size of a mode's picture, the height of its words, and the room about the arm [px]."""
PERIOD = 2.0
"""Duration of a swing [s]: all modes are shown at the same pace, far too slow."""
READABLE = 567
"""Width of the whole at which its smallest letters, of 12 px, are 10 px [px]."""
STYLE = (
    "text{font:13px system-ui,sans-serif;fill:#1b1f24}.soft{fill:#57606a;font-size:12px}"
    "polyline{fill:none;stroke-linejoin:round;stroke-linecap:round}.still{display:none}"
)
REDUCED = "@media (prefers-reduced-motion:reduce),print{.moving{display:none}.still{display:inline}}"
"""Rules of a moving picture for who wants no motion; browsers apply them where it is opened by itself."""
STILL = ".moving{display:none}.still{display:inline}"
"""Rules of a still picture."""


def moving_modes(view: ArmView, *, still: bool = False) -> str:
    """Return the first modes as an SVG document in which each swings, largest displacements alike.

    Args:
        view: an arm whose modes are known.
        still: whether nothing moves, for a page whose reader wants no motion: an image in it does not know of that.
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
    rules = STYLE + (STILL if still else REDUCED)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" width="{size[0]:g}" '
        f'height="{size[1]:g}"><style>{rules}</style><rect width="100%" height="100%" fill="#fff"/>{modes}</svg>\n'
    )


def _modes(analysis: ModalAnalysis, count: int, seen: tuple[View, View]) -> Iterator[str]:
    rest, moved = analysis.outline
    length = float(np.linalg.norm(np.diff(rest, axis=1), axis=0).sum())
    for i in range(count):
        swing = SWING * length * moved[:, :, i] / np.linalg.norm(moved[:, :, i], axis=0).max()
        view = max(seen, key=lambda each: float(np.linalg.norm(each.of(swing))))
        label = analysis.labels[i]
        words = f"{i + 1}: {analysis.modes.frequency[i]:.2f} Hz, {label}"
        yield (
            f'<text x="{ROOM:g}" y="20">{escape(words)}</text>'
            f'<text class="soft" x="{ROOM:g}" y="37">{escape(view.name)}</text>'
            + _swinging(view.of(rest), view.of(swing), str(NAME_STYLES[f"{label.direction} {label.kind}"]["color"]))
        )


def _swinging(rest: Float[np.ndarray, "2 K"], swing: Float[np.ndarray, "2 K"], colour: str) -> str:
    """Draw the arm at rest, and moving between both ends of its swing; still, it is drawn at both ends."""
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
