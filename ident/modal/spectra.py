"""Spectra of the good hits of a file: cut out, freed of their offset, faded, transformed."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ident.errors import InputError, Problem
from ident.modal.hits import Hit, overload
from ident.modal.modal_test import Rejected
from ident.modal.sources import Source
from ident.modal.windows import exponential_window, force_window
from ident.text import one_line

ANTI_ALIAS = 2.56
"""Sampling rate by the highest frequency that an analyser's filter leaves alone."""
PERIODS = 4
"""Fewest periods of a line that a record holds."""
FALLEN = 0.1
"""Share of its largest value to which the force's spectrum may fall within the band: 20 dB."""
BEFORE = 0.05
"""Largest share of a record that is kept from before the hit: the offset is taken there."""
CALM = 0.1
"""Motion before a hit, as a share of that after it, beyond which the arm had not calmed down."""


@dataclass
class Spectra:
    """Spectra of the good hits of one file, faded by the same window.

    Attributes:
        source: the file.
        force: (H, F) [N s]
        response: (H, O, F) [m/s] of accelerations.
        rejected: hits that do not count.
        moving: (H,) numbers of hits before which the arm had not calmed down.
    """

    source: Source
    force: np.ndarray
    response: np.ndarray
    rejected: list[Rejected] = field(default_factory=list)
    moving: list[int] = field(default_factory=list)


def spectra(source: Source, hits: list[Hit], count: int, decay: float) -> Spectra:
    """Return the spectra of a file's good hits."""
    rejected, good, moving = [], [], []
    for number, hit in enumerate(hits, 1):
        record = _cut(source, hit, count, alone=sum(other.block == hit.block for other in hits) == 1)
        if flaw := hit.flaw or _overloaded(source, record):
            rejected.append(Rejected(source.file, number, flaw))
            continue
        good.append(_transformed(source, record, decay))
        moving += [number] if _moves(record) else []
    if not good:
        reasons = "; ".join(f"hit {each.number}: {each.reason}" for each in rejected) or "no pulse of the force"
        raise InputError(Problem(one_line(source.file), f"no good hit ({reasons})", "at least one", "repeat the hits"))
    force, response = (np.array(each) for each in zip(*good, strict=True))
    return Spectra(source, force, response, rejected, moving)


class _Record(NamedTuple):
    """What was recorded of one hit.

    Attributes:
        force: (T,) [N]
        answers: (O, T) [SI]
        offset: (O + 1,) [SI] of the force and the answers at rest.
        begin: first sample of the pulse.
        end: first sample after it.
        late: (O,) [s] by which the samples of the answers are taken after those of the force; None for not at all.
    """

    force: np.ndarray
    answers: np.ndarray
    offset: np.ndarray
    begin: int
    end: int
    late: np.ndarray | None


def _cut(source: Source, hit: Hit, count: int, *, alone: bool) -> _Record:
    """Return the record of a hit.

    Its offset is that well before it, where filters do not ring yet, or of a whole block that holds several hits.
    """
    assert source.force is not None
    before = min(hit.begin, int(BEFORE * count))
    start = hit.begin - before
    channels = np.stack([source.force[hit.block], *(each.values[hit.block] for each in source.responses)])
    still = channels[:, start : start + before // 2] if alone and before > 7 else channels
    part = channels[:, start : start + count]
    late = np.array([0.0 if each.late is None else each.late[hit.block] for each in source.responses])
    return _Record(part[0], part[1:], still.mean(1), before, hit.end - start, late if late.any() else None)


def _transformed(source: Source, record: _Record, decay: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the spectra of force (F,) and accelerations (O, F), less their offset, faded by what decay is left."""
    count = len(record.force)
    window = exponential_window(count, source.step, decay - source.decay)
    about = force_window(count, record.begin, record.end)
    force = np.fft.rfft(about * window * (record.force - record.offset[0])) * source.step
    faded = np.fft.rfft(window * (record.answers - record.offset[1:, None])) * source.step
    s = decay + 2j * np.pi * np.fft.rfftfreq(count, source.step)
    if record.late is not None:
        faded = faded * np.exp(-s * record.late[:, None])
    return force, faded * np.stack([s**each.order for each in source.responses])


def _moves(record: _Record) -> bool:
    """Tell whether all responses were there before the hit already."""
    before = record.begin - 1
    if before < 4:
        return False
    moved = record.answers - record.offset[1:, None]
    early, late = moved[:, :before].std(1), moved[:, record.end : record.end + 4 * before].std(1)
    return bool((early > CALM * late).all())


def _overloaded(source: Source, record: _Record) -> str:
    """Say which channel of a hit was overloaded; empty for none."""
    if seen := overload(record.force, source.full_scale):
        return f"overload of the force: {seen} N"
    for each, values in zip(source.responses, record.answers, strict=True):
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
    return PERIODS * frequency[1], min(*ends, rate / ANTI_ALIAS)
