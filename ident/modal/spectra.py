"""Spectra of the good hits of a file: cut out, freed of their offset, faded, transformed."""

from dataclasses import dataclass, field

import numpy as np

from ident.errors import InputError, Problem
from ident.modal.hits import Hit, overload
from ident.modal.modal_test import Rejected
from ident.modal.sources import Source
from ident.modal.windows import exponential_window, force_window
from ident.text import one_line

ANTI_ALIAS = 2.56
"""Sampling rate by the highest frequency that an analyser's filter leaves alone."""
FALLEN = 0.1
"""Share of its largest value to which the force's spectrum may fall within the band: 20 dB."""
BEFORE = 0.05
"""Largest share of a record that is kept from before the hit: the offset is taken there."""


@dataclass
class Spectra:
    """Spectra of the good hits of one file: force (H, F), responses (H, O, F), both faded by the same window."""

    source: Source
    force: np.ndarray
    response: np.ndarray
    rejected: list[Rejected] = field(default_factory=list)


def spectra(source: Source, hits: list[Hit], count: int, decay: float) -> Spectra:
    """Return the spectra of a file's good hits."""
    assert source.force is not None
    rejected, force, response = [], [], []
    window = exponential_window(count, source.step, decay - source.decay)
    for number, hit in enumerate(hits, 1):
        before = min(hit.begin, int(BEFORE * count))
        begin = hit.begin - before
        part = slice(begin, begin + count)
        pushed = source.force[hit.block, part]
        answers = np.stack([each.values[hit.block, part] for each in source.responses])
        if flaw := hit.flaw or _overloaded(source, pushed, answers):
            rejected.append(Rejected(source.file, number, flaw))
            continue
        alone = sum(other.block == hit.block for other in hits) == 1
        offset = slice(begin, begin + before - 1) if alone and before > 3 else slice(None)
        about = force_window(count, hit.begin - begin, hit.end - begin)
        force.append(np.fft.rfft(about * window * (pushed - source.force[hit.block, offset].mean())) * source.step)
        levels = [each.values[hit.block, offset].mean() for each in source.responses]
        faded = np.fft.rfft(window * (answers - np.array(levels)[:, None])) * source.step
        response.append(faded * _differentiation(source, count, decay))
    if not force:
        reasons = "; ".join(f"hit {each.number}: {each.reason}" for each in rejected) or "no pulse of the force"
        raise InputError(Problem(one_line(source.file), f"no good hit ({reasons})", "at least one", "repeat the hits"))
    return Spectra(source, np.array(force), np.array(response), rejected)


def _differentiation(source: Source, count: int, decay: float) -> np.ndarray:
    """Return the factors (O, F) that make accelerations of velocities and displacements, on the window's line."""
    s = decay - source.decay + 2j * np.pi * np.fft.rfftfreq(count, source.step)
    return np.stack([s**each.order for each in source.responses])


def _overloaded(source: Source, force: np.ndarray, answers: np.ndarray) -> str:
    """Say which channel of a hit was overloaded; empty for none."""
    if seen := overload(force, source.full_scale):
        return f"overload of the force: {seen} N"
    for each, values in zip(source.responses, answers, strict=True):
        if seen := overload(values, each.full_scale):
            return f"overload of {each.channel}: {seen}"
    return ""


def excited(every: list[Spectra], frequency: np.ndarray, rate: float) -> tuple[float, float]:
    """Return the band that all hits excite [Hz]: from the first line to where the force has fallen by 20 dB."""
    ends = []
    for each in every:
        size = np.abs(each.force).mean(0)
        weak = np.flatnonzero(size < FALLEN * size.max())
        weak = weak[weak > np.argmax(size)]
        ends.append(frequency[weak[0] - 1] if len(weak) else frequency[-1])
    return frequency[1], min(*ends, rate / ANTI_ALIAS)
