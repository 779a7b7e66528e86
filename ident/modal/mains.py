"""Lines of the mains in the responses, at 50 or 60 Hz and twice that, which are no modes."""

from collections.abc import Iterable

import numpy as np
from scipy.special import chdtri

from ident.modal.sources import Source

MAINS = (50.0, 60.0, 100.0, 120.0)
"""Frequencies [Hz] at which the mains may be heard."""
CHANCE = 1e-6
"""Chance of noise alone to stand out so far, at one line of one channel."""
ABOUT = 3.0
"""Width [Hz] to either side of the line of what lies about it."""


def mains_lines(group: Iterable[Source], frequency: np.ndarray) -> list[str]:
    """Say which lines of the mains the last quarters of the records show, when the arm has calmed down.

    Args:
        group: what was recorded.
        frequency: (F,) [Hz] lines that are kept.
    """
    seen: dict[float, list[str]] = {}
    for source in group:
        for each in source.responses:
            quiet = each.values[:, -(each.values.shape[1] // 4) :]
            for line in _lines(quiet, source.step):
                seen.setdefault(line, []).append(each.channel)
    return [_remark(line, list(dict.fromkeys(names)), frequency) for line, names in sorted(seen.items())]


def _lines(quiet: np.ndarray, step: float) -> list[float]:
    """Return the lines that stand out of what lies about them."""
    blocks, count = quiet.shape
    level = chdtri(2 * blocks, CHANCE) / chdtri(2 * blocks, 0.5)  # of a sum of squares of Gaussian noise
    power = (np.abs(np.fft.rfft(np.hanning(count) * (quiet - quiet.mean(1, keepdims=True)))) ** 2).mean(0)
    frequency, resolution = np.fft.rfftfreq(count, step), 1 / (count * step)
    lines = []
    for line in MAINS:
        at = abs(frequency - line) <= 1.5 * resolution
        about = (abs(frequency - line) <= max(ABOUT, 12 * resolution)) & (abs(frequency - line) > 3 * resolution)
        if at.any() and about.sum() > 4 and power[at].max() > level * np.median(power[about]):
            lines.append(line)
    return lines


def _remark(line: float, names: list[str], frequency: np.ndarray) -> str:
    inside = frequency[0] <= line <= frequency[-1]
    where = "within the band: a mode found there is none" if inside else "outside the band"
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return f"a line of the mains at {line:g} Hz in {shown}, {where}"
