"""From records without force to correlation functions: the ambient tests of a channel table, one for each posture."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.signal import csd, detrend, resample_poly

from ident.errors import InputError, Problem
from ident.modal.ambient_test import AmbientTest, SpectralDensity
from ident.modal.correlations import correlations_of
from ident.modal.harmonics import Harmonic, without_harmonics
from ident.modal.hits import overload
from ident.modal.modal_test import Processing
from ident.modal.records import Record
from ident.modal.spectra import ANTI_ALIAS
from ident.text import one_line, quoted

LOWEST = 1.0
"""Frequency [Hz] from which on modes are sought, unless a band is given."""
OVERSAMPLED = 4.0
"""Sampling rate by the highest frequency of the band, unless one is given: a filter pulls poles near its edge."""
ROWS = 50
"""Block rows of the Hankel matrix: half the lags."""
BLOCKS = 120
"""Blocks of a record at most, which are joined later."""
FEWEST = 20
"""Blocks of twice the lags that a record has at least."""
SEGMENTS = 40
"""Segments of a record, of half their length apart, whose spectra are averaged."""


def ambient_tests(records: Sequence[Record], processing: Processing) -> tuple[AmbientTest, ...]:
    """Return the tests that records make, one for each posture, load and state of the drives.

    Raises:
        InputError: records too short, of different channels, rates or references at one posture.
    """
    groups: dict[tuple[object, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(record.state, []).append(record)
    return tuple(_test(group, processing) for group in groups.values())


def _test(group: list[Record], processing: Processing) -> AmbientTest:
    first = group[0]
    _check_alike(group)
    low, high = processing.band or (LOWEST, 1 / (first.step * OVERSAMPLED))
    high = min(high, 1 / (first.step * ANTI_ALIAS))
    factor = max(int(1 / (first.step * OVERSAMPLED * high)), 1)
    step = first.step * factor
    parts = [(each, part) for each in group for part in _parts(each, factor)]
    _check_length(first, parts, step)
    scale = np.sqrt(np.mean([part.var(1) for _, part in parts], axis=0))
    scaled = [part / scale[:, None] for _, part in parts]
    cleaned = [
        without_harmonics(part, step, each.speeds, (low, 1 / (2 * step)))
        for part, (each, _) in zip(scaled, parts, strict=True)
    ]
    records = [record for record, _ in cleaned]
    harmonics = tuple(dict.fromkeys(line for _, lines in cleaned for line in lines))
    length = max(2 * 2 * ROWS, sum(record.shape[1] for record in records) // BLOCKS)
    return AmbientTest(
        *first.state,
        tuple(each.file for each in group),
        tuple(each.place for each in first.responses),
        first.references,
        scale,
        tuple(each.order for each in first.responses),
        (low, high),
        correlations_of(records, first.references, step, 2 * ROWS, length),
        _density(scaled, step, high),
        tuple(dict.fromkeys(speed for each in group for speed in each.speeds)),
        harmonics,
        tuple(_remarks(group, harmonics)),
    )


def _parts(record: Record, factor: int) -> Iterator[np.ndarray]:
    """Yield the blocks of a record (O, T) without trend, sampled more slowly by a factor."""
    for number, block in enumerate(zip(*(each.values for each in record.responses), strict=True)):
        values = detrend(np.array(block))
        late = np.array([0.0 if each.late is None else each.late[number] for each in record.responses])
        values = _delayed(values, late / record.step) if late.any() else values
        yield resample_poly(values, 1, factor, axis=1) if factor > 1 else values


def _delayed(values: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """Return channels (O, T) that are later by shares (O,) of a step, by the phases of their spectra.

    A spectrum takes what it transforms for periodic. The record less the line between its ends, followed by its mirror
    image of opposite sign, is periodic without a jump in value or slope.
    """
    count = values.shape[1]
    slope = (values[:, -1:] - values[:, :1]) / (count - 1)
    line = values[:, :1] + slope * np.arange(count)
    rest = values - line
    spectrum = np.fft.rfft(np.concatenate([rest, -rest[:, -2:0:-1]], 1))
    phase = np.exp(-2j * np.pi * np.fft.rfftfreq(2 * count - 2) * delay[:, None])
    return np.fft.irfft(spectrum * phase, 2 * count - 2)[:, :count] + line - slope * delay[:, None]


def _check_alike(group: Sequence[Record]) -> None:
    """Refuse files of one posture that measured something else."""
    first = group[0]
    for record in group[1:]:
        for name, alike in (
            ("responses", [each.place for each in record.responses] == [each.place for each in first.responses]),
            ("references", record.references == first.references),
        ):
            if not alike:
                got, remedy = f"other {name} than {quoted(first.file)}", "measure all of a posture at one time"
                raise InputError(Problem(one_line(record.file), got, "the same in files of one posture", remedy))
        if not np.isclose(record.step, first.step, rtol=1e-6):
            got, expected = f"a rate of {1 / record.step:.6g} Hz", f"{1 / first.step:.6g} Hz, as of {first.file}"
            raise InputError(Problem(one_line(record.file), got, expected, "resample one of them"))


def _check_length(first: Record, parts: Sequence[tuple[Record, np.ndarray]], step: float) -> None:
    """Refuse records of which nothing can be said."""
    needed = FEWEST * 4 * ROWS * step
    duration = sum(part.shape[1] for _, part in parts) * step
    if duration < needed or min(part.shape[1] for _, part in parts) < 8 * ROWS:
        got = f"{duration:.4g} s of responses without a force"
        remedy = "record for longer, or give the channel of the hammer the role force"
        raise InputError(Problem(one_line(first.file), got, f"at least {needed:.4g} s without a break", remedy, "role"))


def _density(records: Sequence[np.ndarray], step: float, high: float) -> SpectralDensity:
    """Return singular values of the spectral density matrix, averaged over records by their length."""
    length = min(sum(record.shape[1] for record in records) // SEGMENTS, min(record.shape[1] for record in records))
    weights = [record.shape[1] for record in records]
    matrices = [csd(record[:, None], record[None], 1 / step, nperseg=length)[1] for record in records]
    frequency = np.fft.rfftfreq(length, step)
    kept = (frequency > 0) & (frequency <= high)
    singular = np.linalg.svd(np.average(matrices, axis=0, weights=weights).T[kept], compute_uv=False).T
    return SpectralDensity(frequency[kept], singular)


def _remarks(group: Iterable[Record], harmonics: Sequence[Harmonic]) -> Iterator[str]:
    for record in group:
        yield from (f"{record.file}: {remark}" for remark in record.remarks)
        for each in record.responses:
            if seen := overload(each.values.ravel(), each.full_scale):
                yield f"{record.file}: overload of {each.channel}: {seen}; damping may be off"
        for speed in record.speeds:
            if not any(line.name == speed.name for line in harmonics):
                yield f"{record.file}: no line of {speed.name} at {speed.frequency:.4g} Hz or its multiples is seen"
