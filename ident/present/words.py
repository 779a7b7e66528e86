"""Short texts that figures and reports share."""

import math
from collections.abc import Iterable

from ident.text import one_line


def degrees(posture: Iterable[float]) -> str:
    """Write joint angles [rad] as `(30, -60, 30) deg`."""
    return f"({', '.join(f'{math.degrees(angle) + 0.0:.4g}' for angle in posture)}) deg"


def cut(text: str, length: int) -> str:
    """Return a text on one line, shortened in its middle if it is long."""
    text = one_line(text)
    half = (length - 1) // 2
    return text if len(text) <= length else f"{text[: length - half - 1]}…{text[-half:]}"
