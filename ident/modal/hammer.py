"""From hits to frequency responses: the tests of a channel table, one for each posture and load."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.channels import ChannelTable
from ident.measure.recordings import Recording
from ident.modal.checks import checks
from ident.modal.estimates import coherence, contributions
from ident.modal.frf import Frf, Place
from ident.modal.hits import Hit, find_hits
from ident.modal.mains import mains_lines
from ident.modal.modal_test import ModalTest, Processing
from ident.modal.sources import Source, sources
from ident.modal.spectra import Spectra, excited, spectra
from ident.modal.windows import exponential_decay
from ident.text import one_line, quoted

FEWEST = 32
"""Fewest samples of a record behind a hit."""


def modal_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], processing: Processing | None = None
) -> tuple[ModalTest, ...]:
    """Return the tests of a channel table, one for each posture, load and state of the drives.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        processing: windows, estimator and band.

    Raises:
        InputError: see `sources`; or a test without a good hit, or with responses that were not measured by all forces.
    """
    groups: dict[tuple[object, ...], list[Source]] = {}
    for source in sources(table, recordings):
        groups.setdefault(source.state, []).append(source)
    return tuple(_test(group, processing or Processing()) for group in groups.values())


def _test(group: list[Source], processing: Processing) -> ModalTest:
    finished = [source for source in group if source.force is None]
    if finished and len(finished) < len(group):
        got, remedy = (
            f"samples and frequency responses of one posture, {quoted(group[0].file)} among them",
            "keep one kind",
        )
        raise InputError(Problem(one_line(finished[0].file), got, "one of them", remedy))
    _check_steps(group)
    return _of_responses(group, processing) if finished else _of_samples(group, processing)


def _of_samples(group: list[Source], processing: Processing) -> ModalTest:
    """Return the test of recorded forces and responses."""
    step = group[0].step
    hits = [find_hits(source.force, step, processing.rest) for source in group if source.force is not None]
    for source, each in zip(group, hits, strict=True):
        if not any(hit.end for hit in each):
            remedy = "look at the cable of the hammer and which channel is the force, or hit harder"
            raise InputError(Problem(one_line(source.file), "no pulse of the force", "at least one hit", remedy))
    count = min(_samples(hit) for each in hits for hit in each if not hit.flaw or hit.end)
    if count < FEWEST:
        got = f"{max(count, 0)} samples behind a hit"
        raise InputError(
            Problem(one_line(group[0].file), got, f"at least {FEWEST}", "record for longer after each hit")
        )
    decay = max(source.decay for source in group)
    decay += exponential_decay(count * step, processing.window_end, decay)
    every = [spectra(source, each, count, decay) for source, each in zip(group, hits, strict=True)]
    rejected = tuple(one for each in every for one in each.rejected)
    frequency = np.fft.rfftfreq(count, step)
    low, high = processing.band or excited(every, frequency, 1 / step)
    kept = (frequency >= max(low, frequency[1])) & (frequency <= high)
    if kept.sum() < 2:
        got = f"{kept.sum()} lines from {low:.4g} to {high:.4g} Hz"
        raise InputError(Problem(one_line(group[0].file), got, "at least two", "widen the band (`band`)"))
    frf, quality, remarks = _assembled(every, frequency[kept], kept, decay, processing.estimator)
    remarks += [*_moving(every), *mains_lines(group, frequency[kept]), *_of_sources(group)]
    return ModalTest(*group[0].state, _files(group), frf, quality, count * step, rejected, checks(frf), tuple(remarks))


def _of_sources(group: Iterable[Source]) -> list[str]:
    """Return what is said of the files, each once."""
    return list(dict.fromkeys(remark for source in group for remark in source.remarks))


def _moving(every: Iterable[Spectra]) -> Iterator[str]:
    """Yield before which hits the arm still moved."""
    for each in every:
        if each.moving:
            hits = f"hit{'s' * (len(each.moving) > 1)} {', '.join(map(str, each.moving))}"
            yield f"{each.source.file}: the arm still moved before {hits}; wait for longer"


def _files(group: Iterable[Source]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(source.file for source in group))


def _check_steps(group: Sequence[Source]) -> None:
    """Refuse files of one test that were sampled differently."""
    for source in group:
        if not np.isclose(source.step, group[0].step, rtol=1e-6):
            rates = f"{1 / source.step:.6g}", f"{1 / group[0].step:.6g} Hz, as of {quoted(group[0].file)}"
            remedy = "files of one posture need one sampling: resample them"
            raise InputError(Problem(one_line(source.file), f"a rate of {rates[0]} Hz", rates[1], remedy))


def _samples(hit: Hit) -> int:
    """Return how many samples there are of a hit, from its beginning."""
    return hit.until - hit.begin


def _assembled(
    every: list[Spectra], frequency: np.ndarray, kept: np.ndarray, decay: float, estimator: str
) -> tuple[Frf, np.ndarray, list[str]]:
    """Return the frequency responses of all files of a test together, with coherence and remarks."""
    references = tuple(dict.fromkeys(each.source.reference for each in every))
    responses = tuple(dict.fromkeys(one.place for each in every for one in each.source.responses))
    sets = [_pooled([each for each in every if each.source.reference == place], kept) for place in references]
    _check_complete(every, sets, responses, references)
    counts = [len(force) for by_response in sets for force, _ in by_response.values()]
    count = min(counts)
    parts = [
        [(force[:count], answer[:count, None]) for force, answer in (by_response[place] for place in responses)]
        for by_response in sets
    ]
    hits = np.stack([np.concatenate([contributions(f, a, estimator) for f, a in each], 1) for each in parts], 2)
    quality = np.stack([np.concatenate([coherence(f, a) for f, a in each], 0) for each in parts], 1)
    remarks = []
    if max(counts) > count:
        remarks.append(
            f"{count} hits count at each point, as many as at the one with fewest; others have up to {max(counts)}"
        )
    if count == 1:
        remarks.append("one hit at each point: its scatter, and so the coherence, is not known")
    return Frf(frequency, hits, responses, references, decay), quality, remarks


_ByResponse = dict[Place, tuple[np.ndarray, np.ndarray]]
"""Force (H, F) and response (H, F) by the place of the response."""


def _pooled(parts: list[Spectra], kept: np.ndarray) -> _ByResponse:
    """Return the hits at one reference by response, those of several files after each other."""
    pooled: _ByResponse = {}
    for part in parts:
        for i, each in enumerate(part.source.responses):
            force, answer = part.force[:, kept], part.response[:, i, kept]
            if each.place in pooled:
                before = pooled[each.place]
                force, answer = np.concatenate([before[0], force]), np.concatenate([before[1], answer])
            pooled[each.place] = (force, answer)
    return pooled


def _check_complete(
    every: list[Spectra], sets: list[_ByResponse], responses: tuple[Place, ...], references: tuple[Place, ...]
) -> None:
    """Refuse a response that was not measured by each force."""
    for by_response, force in zip(sets, references, strict=True):
        for place in responses:
            if place not in by_response:
                got = f"no response at {place.point} to the force at {force.point}"
                remedy = "measure it, or give that response the role ignore in the other files"
                where = one_line(next(each.source.file for each in every if each.source.reference == force))
                raise InputError(Problem(where, got, "each response to each force of a posture", remedy))


def _of_responses(group: list[Source], processing: Processing) -> ModalTest:
    """Return the test of finished frequency responses; the blocks of a file are its hits."""
    lines = {source.responses[0].values.shape[1] for source in group} | {source.start for source in group}
    if len(lines) > 2:
        remedy = "export all of one posture with the same lines"
        raise InputError(Problem(one_line(group[0].file), "files of different lines", "the same lines", remedy))
    first = group[0]
    frequency = first.start + first.step * np.arange(first.responses[0].values.shape[1])
    low, high = processing.band or (frequency[0], frequency[-1])
    kept = (frequency >= max(low, first.step / 2)) & (frequency <= high)
    every = [
        Spectra(
            source,
            np.ones((len(source.responses[0].values), len(frequency))),
            np.stack(
                [each.values * (source.decay + 2j * np.pi * frequency) ** each.order for each in source.responses], 1
            ),
        )
        for source in group
    ]
    frf, quality, remarks = _assembled(every, frequency[kept], kept, max(s.decay for s in group), "h1")
    remarks += _of_sources(group)
    return ModalTest(*first.state, _files(group), frf, quality, 0.0, (), checks(frf), tuple(remarks))
