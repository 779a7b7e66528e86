"""From hits to frequency responses: the tests of a channel table, one for each posture and load."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from ident.errors import refusal, require
from ident.measure.channels import ChannelTable
from ident.measure.recordings import Recording
from ident.modal.frf import (
    MOVING,
    Frf,
    ModalTest,
    Place,
    Processing,
    Rejected,
    checks,
    coherence,
    contributions,
    exponential_decay,
    exponential_window,
)
from ident.modal.recorded import Source, sources
from ident.text import by_key, one_line, quoted

# -------- Hits
# Hammer hits in a record of the force: the start and end of each, and which do not end or are overloaded.

PULSE = 0.1
"""Level of a pulse, as a share of the largest force of the record; assumed."""
REBOUND = 0.05
"""Level down to which the force belongs to a hit, as a share of its peak; assumed."""
QUIET = 8
"""Parts of a record, in the quietest of which the noise is found: a burst may fill most of it; assumed."""
SILENT = "no pulse of the force"
ENDLESS = "the force does not end within its record"
ONGOING = 0.02
"""Share at the end of a record in which a force counts as one that does not end; assumed."""
NOISE = 8.0
"""Least height of a pulse in standard deviations of the noise; assumed."""
FLAT = 3
"""Equal samples in a row at the largest value that indicate an overload; assumed."""
STEPS = 50
"""Fewest different values of a channel for a flat top to indicate an overload: with fewer it is just coarse; assumed.
"""
FULL = 0.999
"""Level of an overload, as a share of full scale; assumed."""


@dataclass(frozen=True)
class Hit:
    """A force that ends: one pulse, several of them or a burst.

    Attributes:
        block: number of its block.
        begin: first sample of its first pulse.
        end: first sample after its last pulse.
        until: first sample of the next hit, or the block's length.
        level: [N] above which the force acts.
        flaw: why it is rejected; empty for a good hit.
    """

    block: int
    begin: int
    end: int
    until: int
    level: float = 0.0
    flaw: str = ""


def find_hits(force: np.ndarray, step: float, rest: float) -> list[Hit]:
    """Find the hits in blocks of the force.

    A triggered block holds one hit. A single block holds all hits of a record: pulses closer than `rest` to the
    previous one belong to its hit. The input is the whole force of a hit, however many pulses it has.

    Args:
        force: (B, T) [N]
        step: [s] between samples.
        rest: [s] least time between hits.

    Returns:
        The hits in order; one whose force does not end, or a record without any, with its flaw.
    """
    if len(force) == 1:
        return list(_of_record(force[0], step, rest)) or [Hit(0, 0, 0, force.shape[1], flaw=SILENT)]
    level = PULSE * np.median(np.abs(force).max(1))
    return [
        _hit(number, (0, len(block)), block, NOISE * _noise(block))
        if np.abs(block).max() > max(level, NOISE * _noise(block)) and _stands_out(block)
        else Hit(number, 0, 0, len(block), flaw=SILENT)
        for number, block in enumerate(force)
    ]


def _of_record(force: np.ndarray, step: float, rest: float) -> Iterator[Hit]:
    noise = NOISE * _noise(force)
    level = max(PULSE * float(np.abs(force).max()), noise)
    starts, last = list[int](), 0
    for begin, end in runs(np.abs(force) > level) if _stands_out(force) else ():
        starts += [begin] if not starts or (begin - last) * step >= rest else []
        last = end
    for begin, until in pairwise([*starts, len(force)]):
        before = math.ceil(rest / step / 2) if until < len(force) else 0  # the next hit's filter rings ahead of it
        yield _hit(0, (begin, until), force[begin : until - before], noise)


def _hit(block: int, span: tuple[int, int], near: np.ndarray, noise: float) -> Hit:
    """Return the hit of a span of samples, given those before the next hit's filter rings.

    Only pulses with the sign of the largest one count: the opposite sign is filter ringing, as a hammer cannot pull. In
    a burst this moves the ends by a pulse at most.
    """
    size, sign = np.abs(near), np.sign(near[np.argmax(np.abs(near))])
    level = max(REBOUND * float(size.max()), noise)
    pulses = runs(size > level)
    pulses = [(a, b) for a, b in pulses if (sign * near[a:b]).max() > level] or pulses[:1]
    end = pulses[-1][1]
    flaw = ENDLESS if end > (1 - ONGOING) * len(near) else ""
    return Hit(block, span[0] + pulses[0][0], span[0] + end, span[1], level, flaw)


def _stands_out(force: np.ndarray) -> bool:
    """Whether the force rises above its noise around the median: a constant offset is not a pulse."""
    return bool(np.abs(force - np.median(force)).max() > NOISE * _noise(force))


def _noise(force: np.ndarray) -> float:
    """Return the standard deviation of the quietest part, by the median of deviations from the median."""
    parts = np.array_split(np.abs(force - np.median(force)), QUIET)
    return 1.4826 * min(float(np.median(part)) for part in parts if len(part))


def overload(values: np.ndarray, full_scale: float | None) -> str:
    """Describe an overload of a channel: it reaches full scale, or its largest value repeats in a row.

    Args:
        values: (T,) [SI] of one hit.
        full_scale: [SI] of the input; None if unknown.

    Returns:
        The evidence; empty for no overload.
    """
    size = np.abs(values)
    largest = float(size.max())
    if full_scale is not None and largest >= FULL * full_scale:
        return f"{largest:.3g} of a full scale of {full_scale:.3g}"
    if len(np.unique(values[:: max(len(values) // 2000, 1)])) < STEPS:
        return ""
    run = max((b - a for a, b in runs(size >= largest * (1 - 1e-9))), default=0)
    return f"{run} equal samples in a row at its largest number, {largest:.3g}" if run >= FLAT else ""


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return begin and end of each run of true values in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# -------- Mains
# Mains lines in the responses, at 50 or 60 Hz and twice that, which are not modes.

MAINS = (50.0, 60.0, 100.0, 120.0)
"""Possible frequencies [Hz] of mains lines."""
NOISE_CHANCE = 1e-6
"""False-alarm probability of a line by noise alone, at one line of one channel; assumed."""
ABOUT = 3.0
"""Half width [Hz] of the surroundings of a line."""


def mains_lines(group: Iterable[Source], frequency: np.ndarray) -> list[str]:
    """Describe mains lines in the last quarters of the records, where the arm has calmed down.

    Args:
        group: the records.
        frequency: (F,) [Hz] lines in use.
    """
    seen: dict[float, list[str]] = {}
    for source in group:
        for each in source.responses:
            quiet = each.values[:, -(each.values.shape[1] // 4) :]
            for line in _lines(quiet, source.step):
                seen.setdefault(line, []).append(each.channel)
    return [_remark(line, list(dict.fromkeys(names)), frequency) for line, names in sorted(seen.items())]


def _lines(quiet: np.ndarray, step: float) -> list[float]:
    """Return the mains lines that stand out of their surroundings."""
    blocks, count = quiet.shape
    level = chdtri(2 * blocks, NOISE_CHANCE) / chdtri(2 * blocks, 0.5)  # of a sum of squares of Gaussian noise
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


# -------- Spectra
# Spectra of the good hits of a file: cut out, remove the offset, apply the window, transform.

ANTI_ALIAS = 2.56
"""Sampling rate over the highest frequency in the pass band of an analyser's filter."""
PERIODS = 4
"""Fewest periods of a line in a record."""
FALLEN = 0.1
"""Least force spectrum within the band, relative to its largest value: 20 dB below."""
BEFORE = 0.05
"""Largest share of a record before the hit, used for the offset."""
MARGIN = 3.0
"""Duration of the force window's flat part after a pulse, and of its fall, each in durations of the longest pulse."""
CALM = 0.1
"""Velocity before a hit, relative to that after it, above which the arm was still moving; assumed."""


@dataclass
class Spectra:
    """Spectra of the good hits of one file, with the same window.

    Attributes:
        source: the file.
        force: (H, F) [N s]
        response: (H, O, F) [m/s] of accelerations.
        rejected: rejected hits.
        moving: (H,) numbers of hits that began while the arm was still moving.
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
        longer = hit.end - hit.begin > (1 - ONGOING) * count  # records are as long as the shortest one
        if flaw := hit.flaw or (ENDLESS if longer else "") or _overloaded(source, record):
            rejected.append(Rejected(source.file, number, flaw))
            continue
        good.append(_transformed(source, record, decay))
        moving += [number] if _moves(record) else []
    lines = count // 2 + 1
    force = np.reshape([each for each, _ in good], (-1, lines))
    response = np.reshape([each for _, each in good], (-1, len(source.responses), lines))
    return Spectra(source, force, response, rejected, moving)


class _Record(NamedTuple):
    """Record of one hit.

    Attributes:
        force: (T,) [N]
        answers: (O, T) [SI]
        offset: (O + 1,) [SI] of the force and the answers at rest.
        begin: first sample of the force.
        end: first sample after it.
        level: [N] above which it acts.
        late: (O,) [s] delay of the answers' samples after those of the force; None for no delay.
    """

    force: np.ndarray
    answers: np.ndarray
    offset: np.ndarray
    begin: int
    end: int
    level: float
    late: np.ndarray | None


def _cut(source: Source, hit: Hit, count: int, *, alone: bool) -> _Record:
    """Return the record of a hit.

    Its offset is taken well before the hit, where filters do not ring yet, or over a whole block with several hits.
    """
    assert source.force is not None
    before = min(hit.begin, int(BEFORE * count))
    start = hit.begin - before
    channels = np.stack([source.force[hit.block], *(each.values[hit.block] for each in source.responses)])
    still = channels[:, start : start + before // 2] if alone and before > 7 else channels
    part = channels[:, start : start + count]
    late = np.array([0.0 if each.late is None else each.late[hit.block] for each in source.responses])
    return _Record(part[0], part[1:], still.mean(1), before, hit.end - start, hit.level, late if late.any() else None)


def _transformed(source: Source, record: _Record, decay: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the spectra of force (F,) and accelerations (O, F), without offset, windowed with the remaining decay."""
    count = len(record.force)
    window = exponential_window(count, source.step, decay - source.decay)
    about = force_window(np.abs(record.force[: record.end]) > record.level, record.begin, count)
    force = np.fft.rfft(about * window * (record.force - record.offset[0])) * source.step
    faded = np.fft.rfft(window * (record.answers - record.offset[1:, None])) * source.step
    s = decay + 2j * np.pi * np.fft.rfftfreq(count, source.step)
    if record.late is not None:
        faded = faded * np.exp(-s * record.late[:, None])
    return force, faded * np.stack([s**each.order for each in source.responses])


def force_window(acts: np.ndarray, begin: int, count: int) -> np.ndarray:
    """Return a window (T,) [-] that is one up to and about each pulse of a force, and zero where it rests longer.

    Args:
        acts: (end,) whether the force acts, up to its last sample.
        begin: first sample of the force.
        count: samples T.
    """
    pulses, samples = runs(acts & (np.arange(len(acts)) >= begin)), np.arange(count)
    begins, ends = np.array(pulses).T
    longest, latest = (ends - begins).max(), np.searchsorted(begins, samples, "right") - 1
    after = (samples - ends[np.maximum(latest, 0)]) / math.ceil(MARGIN * longest) - 1
    ahead = (np.append(begins, 2 * count)[latest + 1] - samples) / longest - 1
    outside = np.where(samples < begin, 0.0, np.clip(np.minimum(after, ahead), 0.0, 1.0))
    window: np.ndarray = (1 + np.cos(np.pi * outside)) / 2
    return window


def _moves(record: _Record) -> bool:
    """Whether all responses to the hit were moving before it, as velocities, since long ringing is slow."""
    before = record.begin - 1
    if before < 4 or record.end + 4 * before > record.answers.shape[1]:
        return False
    early, *parts = (_swing(record.answers[:, at : at + before]) for at in (0, *record.end + before * np.arange(4)))
    late = np.mean(parts, axis=0)
    moved = (early > CALM**2 * late)[late > 0]
    return bool(moved.size and moved.all())


def _swing(answers: np.ndarray) -> np.ndarray:
    """Return the variance (O,) of the sums of samples (O, T), less twice the contribution of white noise."""
    summed = np.cumsum(answers - answers.mean(1, keepdims=True), 1)
    white: np.ndarray = (np.diff(answers, 2, axis=1) ** 2).mean(1) / 6
    return summed.var(1) - white * answers.shape[1] / 6


def _overloaded(source: Source, record: _Record) -> str:
    """Describe the overloaded channel of a hit; empty for none."""
    if seen := overload(record.force, source.full_scale):
        return f"overload of the force: {seen} N"
    for each, values in zip(source.responses, record.answers, strict=True):
        if seen := overload(values, each.full_scale):
            return f"overload of {each.channel}: {seen}"
    return ""


def excited(every: list[Spectra], band: tuple[float, float] | None, frequency: np.ndarray, rate: float) -> np.ndarray:
    """Return which lines (F,) count: those within the band that the hits at each point excite.

    By default the band ends where the summed force of all hits at a point falls 20 dB below its peak for good; a given
    band is kept to its end. A line before is left out only where that sum is weak: where one double hit has a gap in
    its spectrum, another one has none.
    """
    low, high = band or (PERIODS * frequency[1], rate / ANTI_ALIAS)
    within = (frequency >= max(low, frequency[1])) & (frequency <= high)
    kept = within
    for place in dict.fromkeys(each.source.reference for each in every):
        forces = np.concatenate([each.force for each in every if each.source.reference == place])
        size = np.sqrt((np.abs(forces) ** 2).sum(0)) * within
        strong = size >= FALLEN * size.max()
        ends = np.flatnonzero(strong)
        kept = kept & (strong if band is None else strong | (np.arange(len(size)) > ends.max(initial=0)))
    return kept


# -------- Hammer

FEWEST = 32
"""Fewest samples of a record after a hit."""


def modal_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], processing: Processing | None = None
) -> tuple[ModalTest, ...]:
    """Return the tests of a channel table, one for each posture, load and state of the drives.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        processing: windows, estimator and band.

    Raises:
        InputError: see `sources`; or a test without a good hit, or with a response missing for some force.
    """
    groups = by_key((source.state, source) for source in sources(table, recordings)).values()
    return tuple(_test(group, processing or Processing()) for group in groups)


def _test(group: list[Source], processing: Processing) -> ModalTest:
    finished = [source for source in group if source.force is None]
    if finished and len(finished) < len(group):
        got = f"samples and frequency responses of one posture, {quoted(group[0].file)} among them"
        raise refusal(one_line(finished[0].file), got, "one of them", "keep one kind")
    expected = f"{1 / group[0].step:.6g} Hz, as of {quoted(group[0].file)}"
    for source in group:
        got, remedy = f"a rate of {1 / source.step:.6g} Hz", "files of one posture need one sampling: resample them"
        is_same = np.isclose(source.step, group[0].step, rtol=1e-6)
        require(is_same, one_line(source.file), got, expected, remedy)
    return _of_responses(group, processing) if finished else _of_samples(group, processing)


def _of_samples(group: list[Source], processing: Processing) -> ModalTest:
    """Return the test of recorded forces and responses."""
    step = group[0].step
    hits = [find_hits(source.force, step, processing.rest) for source in group if source.force is not None]
    remedy = "look at the cable of the hammer and which channel is the force, or hit harder"
    any_hit = any(hit.end for each in hits for hit in each)
    require(any_hit, one_line(group[0].file), SILENT, "at least one hit", remedy)
    count = min(hit.until - hit.begin for each in hits for hit in each if not hit.flaw or hit.end)
    where, got = one_line(group[0].file), f"{max(count, 0)} samples behind a hit"
    require(count >= FEWEST, where, got, f"at least {FEWEST}", "record for longer after each hit")
    decay = max(source.decay for source in group)
    decay += exponential_decay(count * step, processing.window_end, decay)
    every = [spectra(source, each, count, decay) for source, each in zip(group, hits, strict=True)]
    pairs = (((each.source.reference, one.place), each) for each in every for one in each.source.responses)
    for own in by_key(pairs).values():
        reasons = "; ".join(f"hit {each.number}: {each.reason}" for part in own for each in part.rejected)
        any_good, file = any(len(part.force) for part in own), one_line(own[0].source.file)
        require(any_good, file, f"no good hit ({reasons})", "at least one", "repeat the hits")
    frequency = np.fft.rfftfreq(count, step)
    kept = excited(every, processing.band, frequency, 1 / step)
    require(kept.sum() >= 2, where, f"{kept.sum()} excited lines", "at least two", "widen the band (`band`)")
    mains = mains_lines(group, frequency[kept])
    return _assembled(every, frequency[kept], kept, (decay, processing.estimator, count * step), mains)


def _assembled(
    every: list[Spectra], frequency: np.ndarray, kept: np.ndarray, how: tuple[float, str, float], mains: list[str]
) -> ModalTest:
    """Return the joint test of all files of a posture, with remarks.

    Args:
        every: the spectra of each file.
        frequency: (F,) [Hz] lines in use.
        kept: their indices in the spectra.
        how: decay rate added by the windows [1/s], estimator, duration of a record [s].
        mains: remarks on mains lines.
    """
    decay, estimator, duration = how
    references = tuple(dict.fromkeys(each.source.reference for each in every))
    responses = tuple(dict.fromkeys(one.place for each in every for one in each.source.responses))
    sets = [_pooled([each for each in every if each.source.reference == place], kept) for place in references]
    for by_response, force in zip(sets, references, strict=True):
        where = one_line(next(each.source.file for each in every if each.source.reference == force))
        for place in responses:
            got = f"no response at {place.point} to the force at {force.point}"
            remedy = "measure it, or give that response the role ignore in the other files"
            require(place in by_response, where, got, "each response to each force of a posture", remedy)
    counts = [len(force) for by_response in sets for force, _ in by_response.values()]
    count = min(counts)
    parts = [
        [(force[:count], answer[:count, None]) for force, answer in (by_response[place] for place in responses)]
        for by_response in sets
    ]
    hits = np.stack([np.concatenate([contributions(f, a, estimator) for f, a in each], 1) for each in parts], 2)
    quality = np.stack([np.concatenate([coherence(f, a) for f, a in each], 0) for each in parts], 1)
    remarks, most = list[str](), max(counts)
    if most > count:
        remarks.append(f"{count} hits count at each point, as many as at the one with fewest; others have up to {most}")
    if count == 1:
        remarks.append("one hit at each point: its scatter, and so the coherence, is not known")
    for each in every:
        numbers = f"hit{'s' * (len(each.moving) > 1)} {', '.join(map(str, each.moving))}"
        remarks += [f"{each.source.file}: {MOVING} {numbers}"] if each.moving else []
    remarks += [*mains, *dict.fromkeys(remark for each in every for remark in each.source.remarks)]
    files = tuple(dict.fromkeys(each.source.file for each in every))
    rejected = tuple(one for each in every for one in each.rejected)
    frf = Frf(frequency, hits, responses, references, decay)
    return ModalTest(*every[0].source.state, files, frf, quality, duration, rejected, checks(frf), tuple(remarks))


_ByResponse = dict[Place, tuple[np.ndarray, ...]]
"""Force (H, F) and response (H, F) by the place of the response."""


def _pooled(parts: list[Spectra], kept: np.ndarray) -> _ByResponse:
    """Return the hits at one reference by response, joined over files."""
    pooled: _ByResponse = {}
    for part in parts:
        for i, each in enumerate(part.source.responses):
            before, own = pooled.get(each.place), (part.force[:, kept], part.response[:, i, kept])
            pooled[each.place] = tuple(map(np.concatenate, zip(before, own, strict=True))) if before else own
    return pooled


def _of_responses(group: list[Source], processing: Processing) -> ModalTest:
    """Return the test of finished frequency responses; the blocks of a file are its hits."""
    first, remedy = group[0], "export all of one posture with the same lines"
    is_same = len({(source.responses[0].values.shape[1], source.start) for source in group}) == 1
    require(is_same, one_line(first.file), "files of different lines", "the same lines", remedy)
    frequency = first.start + first.step * np.arange(first.responses[0].values.shape[1])
    low, high = processing.band or (frequency[0], frequency[-1])
    kept = (frequency >= max(low, first.step / 2)) & (frequency <= high)
    every = []
    for source in group:
        s = source.decay + 2j * np.pi * frequency
        responses = np.stack([each.values * s**each.order for each in source.responses], 1)
        every.append(Spectra(source, np.ones((len(responses), len(frequency))), responses))
    return _assembled(every, frequency[kept], kept, (max(source.decay for source in group), "h1", 0.0), [])
