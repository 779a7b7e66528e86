"""Short texts that figures and reports share."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ident.identify.information import Direction
from ident.measure import Measurement
from ident.present.report import NOTABLE
from ident.present.units import shown
from ident.text import one_line


def degrees(posture: Iterable[float]) -> str:
    """Write joint angles [rad] as `(30, -60, 30) deg`."""
    return f"({', '.join(f'{math.degrees(angle) + 0.0:.4g}' for angle in posture)}) deg"


def cut(text: str, length: int) -> str:
    """Return a text on one line, shortened in its middle if it is long."""
    text = one_line(text)
    half = (length - 1) // 2
    return text if len(text) <= length else f"{text[: length - half - 1]}…{text[-half:]}"


def direction_name(direction: Direction, names: Sequence[str]) -> str:
    """Name a direction by its main parameters: a product, or a ratio where they are traded against each other."""
    order = [i for i in np.argsort(-np.abs(direction.weights)) if abs(direction.weights[i]) > NOTABLE]
    first, *others = order[:2]
    signs = [" / " if direction.weights[i] * direction.weights[first] < 0 else " · " for i in others]
    more = " …" if len(order) > 2 else ""
    return cut(names[first], 24) + "".join(s + cut(names[i], 24) for s, i in zip(signs, others, strict=True)) + more


def short(m: Measurement) -> str:
    """Say in a few words what was measured, with its value."""
    value, unit = shown(m.kind, m.value)
    what = m.mode or m.point or ""
    loads = f", {m.load}" if m.load else ""
    against = f" - {m.reference_load}" if m.kind == "deflection_difference" else ""
    return f"{f'{what}:' if what else ''} {value:.4g} {unit}{loads}{against} at {degrees(m.posture)}".strip()
