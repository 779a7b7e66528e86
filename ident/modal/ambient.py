"""From records without force to correlation functions: the ambient tests of a channel table, one for each posture."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import minimize_scalar
from scipy.signal import csd, detrend, resample_poly
from scipy.special import chdtri

from ident.errors import Problem, noted, refuse, require
from ident.measure.channels import AMBIENT, RELEASE, TAP, ChannelTable
from ident.measure.recordings import Recording
from ident.measure.speeds import Speed
from ident.modal.frf import HeldArm, ModalTest, Place, Processing
from ident.modal.hammer import ANTI_ALIAS, MAINS, modal_tests, overload
from ident.modal.recorded import Record, ambient_files, records
from ident.modal.taps import free_decays, innovations
from ident.text import by_key, one_line, quoted

# -------- Correlations
# Correlation functions of responses, block by block: a sufficient summary of an ambient record.


FIRST_PART, PARTS = 6, 3
"""Samples of the first part of a free decay, and how many times longer it is with each further one; assumed."""


@dataclass(frozen=True)
class Correlations:
    """Correlation functions of responses with references, one term for each block of the record.

    R(k) = sum over t of y(t + k) y_ref(t)', t within the block; its sum over blocks is that of the record.

    Attributes:
        step: [s] between lags.
        blocks: (B, O, R, K) [channel units squared] at lags 0 to K - 1.
        samples: (B,) samples in each block.
    """

    step: float
    blocks: Float[np.ndarray, "B O R K"]
    samples: Float[np.ndarray, "B"]

    @property
    def mean(self) -> Float[np.ndarray, "O R K"]:
        """Correlation functions of the record."""
        return self.blocks.sum(0) / self.samples.sum()

    @property
    def duration(self) -> float:
        """[s] of the record."""
        return float(self.samples.sum()) * self.step

    def without(self, block: int) -> Float[np.ndarray, "O R K"]:
        """Return the correlation functions of all but one block."""
        return np.delete(self.blocks, block, 0).sum(0) / np.delete(self.samples, block).sum()

    def joined(self, count: int) -> "Correlations":
        """Return the same with neighbouring blocks joined to `count` blocks."""
        starts = np.unique(np.linspace(0, len(self.blocks), count + 1).astype(int))[:-1]
        return replace(self, blocks=np.add.reduceat(self.blocks, starts), samples=np.add.reduceat(self.samples, starts))


def correlations_of(
    records: Sequence[Float[np.ndarray, "O T"]], references: Sequence[int], step: float, lags: int, length: int
) -> Correlations:
    """Return the correlation functions of records, in blocks of at least some length.

    Args:
        records: of the same channels, without their mean.
        references: (R,) indices of the reference responses.
        step: [s] between samples.
        lags: K.
        length: samples of a block, at least.

    References:
        Bendat and Piersol, "Random Data", 4th ed. 2010, section 11.4.2 (by Fourier transforms).
    """
    blocks, samples = [], []
    for record in records:
        usable = record.shape[1] - lags + 1
        edges = np.linspace(0, usable, max(usable // length, 1) + 1).astype(int)
        for start, end in pairwise(edges.tolist()):
            blocks.append(_correlated(record, references, (start, end), lags))
            samples.append(float(end - start))
    return Correlations(step, np.array(blocks), np.array(samples))


def _correlated(
    record: Float[np.ndarray, "O T"], references: Sequence[int], span: tuple[int, int], lags: int
) -> Float[np.ndarray, "O R K"]:
    """Return the sum over t within a span of y(t + k) y_ref(t)'."""
    start, end = span
    if start >= end:
        return np.zeros((len(record), len(references), lags))
    count = next_fast_len(end - start + lags - 1, real=True)
    ahead = rfft(record[:, start : end + lags - 1], count)
    here = rfft(record[list(references), start:end], count)
    product: np.ndarray = irfft(ahead[:, None] * here.conj()[None], count)[..., :lags]
    return product


def decay_correlations(
    decays: Sequence[Float[np.ndarray, "O _"]], references: Sequence[int], step: float, lags: int
) -> Correlations:
    """Return the correlation functions of free decays, one block for each part of a decay, decay by decay.

    In a free decay y(t + k) = C A^k x(t), so that the sum over any times t of y(t + k) y_ref(t)' is C A^k G. It adds
    over taps of any sign, place and strength. Parts of a decay count separately, `PARTS` times as long as the one
    before: fast modes are in the first ones, without the noise of the later ones. Each function is in units of the
    root energy of its reference, so that all have the same noise.

    Args:
        decays: of the same channels, in standard deviations of their noise.
        references: (R,) indices of the reference responses.
        step: [s] between samples.
        lags: K.

    References:
        Ibrahim, Mikulcik, "A method for the direct identification of vibration parameters from the free response",
        Shock and Vibration Bulletin 47, 1977. Juang, Cooper, Wright, "An eigensystem realization algorithm using data
        correlations", Control Theory and Advanced Technology 4, 1988.
    """
    usable = [decay.shape[1] - lags + 1 for decay in decays]
    edges = [0, FIRST_PART]
    while edges[-1] < max(usable):
        edges.append(PARTS * edges[-1])
    spans = [[(a, min(b, last)) for a, b in pairwise(edges)] for last in usable]
    sums = np.array(
        [[_correlated(decay, references, span, lags) for span in own] for decay, own in zip(decays, spans, strict=True)]
    )  # (B, P, O, R, K)
    own = np.arange(len(references))
    energy = sums[:, :, list(references), own, 0].sum(0)  # (P, R)
    weighed = sums / np.sqrt(np.where(energy > 0, energy, 1.0))[:, None, :, None]
    samples = [max(end - start, 0.0) for own in spans for start, end in own]
    return Correlations(step, weighed.reshape(-1, *sums.shape[2:]), np.array(samples, float))


# -------- Harmonics
# Harmonics of parts that turn at known speeds: find them, remove them from the records, and name them.

MULTIPLES = 10
"""Number of multiples of a speed at which to search for lines."""
SPEED_SLIP = 0.01
"""Largest relative error of a given speed; assumed."""
NOISE_CHANCE = 1e-10
"""False-alarm probability of a line by noise alone, at one frequency; assumed."""
NARROW, ABOUT = 2.5, 24.0
"""Half width of a line, and of its surroundings, in reciprocals of the duration."""


@dataclass(frozen=True)
class Harmonic:
    """A line of a turning part.

    Attributes:
        name: of the turning part.
        multiple: of its speed.
        frequency: [Hz] of the line.
        share: [-] of the power of the response with the strongest line.
        response: number of that response.
    """

    name: str
    multiple: int
    frequency: float
    share: float
    response: int

    def __str__(self) -> str:
        return f"{times(self.multiple)}{self.name} at {self.frequency:.4g} Hz"


def times(multiple: int) -> str:
    """Return a multiple in words; empty for one."""
    return f"{multiple} x " if multiple > 1 else ""


def without_harmonics(
    record: Float[np.ndarray, "O T"], step: float, speeds: Sequence[Speed], band: tuple[float, float]
) -> tuple[Float[np.ndarray, "O T"], tuple[Harmonic, ...]]:
    """Return a record without the lines of turning parts, and the removed lines.

    Searches the record's spectrum for a line at each multiple of a speed within the band, and at the mains: power above
    its close surroundings, where a resonance is smooth. The line is modelled as a sine of constant frequency and
    linearly changing amplitude. Least squares subtracts it, and removes no more of a mode than its content within the
    reciprocal of the record's duration.

    Args:
        record: responses, without their mean.
        step: [s] between samples.
        speeds: turning parts and their speeds.
        band: [Hz] of the search for lines.

    References:
        Peeters, Cornelis, Janssens, Van der Auweraer, "Removing disturbing harmonics in operational modal analysis",
        IOMAC 2007.
    """
    lines: list[Harmonic] = []
    spectrum = _Spectrum.of(record, step)
    sought = [(speed.name, n, n * speed.frequency, SPEED_SLIP) for speed in speeds for n in range(1, MULTIPLES + 1)]
    sought += [("the mains", 1, line, SPEED_SLIP / 10) for line in MAINS]
    for name, multiple, nominal, slip in [each for each in sought if band[0] <= each[2] <= band[1]]:
        rough = spectrum.line(nominal * (1 - slip), nominal * (1 + slip))
        if rough is None or any(abs(each.frequency - rough) < 2 * spectrum.resolution for each in lines):
            continue
        frequency = _refined(record, step, rough, spectrum.resolution)
        sine = _sine(record, step, frequency)
        share = (sine**2).sum(1) / (record**2).sum(1)
        record = record - sine
        lines.append(Harmonic(name, multiple, frequency, float(share.max()), int(share.argmax())))
    return record, tuple(lines)


def turning(speeds: Sequence[Speed], frequency: float) -> str:
    """Return the part that turns at a frequency [Hz], or at a fraction of it; empty if none does."""
    pairs = [(speed, multiple) for speed in speeds for multiple in range(1, MULTIPLES + 1)]
    apart = [abs(speed.frequency * multiple / frequency - 1) for speed, multiple in pairs]
    if min(apart, default=1.0) > SPEED_SLIP:
        return ""
    speed, multiple = pairs[int(np.argmin(apart))]
    return f"{times(multiple)}{speed.name}, which turns at {speed.frequency:.4g} Hz"


@dataclass(frozen=True)
class _Spectrum:
    """Power (O, F) of responses at lines [Hz] closer than the record resolves."""

    frequency: np.ndarray
    power: np.ndarray
    resolution: float

    @classmethod
    def of(cls, record: np.ndarray, step: float) -> "_Spectrum":
        samples = record.shape[1]
        count = next_fast_len(2 * samples, real=True)
        power = np.abs(np.fft.rfft(record * np.hanning(samples), count)) ** 2
        return cls(np.fft.rfftfreq(count, step), power, 1 / (samples * step))

    def line(self, low: float, high: float) -> float | None:
        """Return the frequency of the most prominent line between two frequencies; None if there is no line."""
        level = chdtri(2, NOISE_CHANCE) / chdtri(2, 0.5)
        at = np.flatnonzero((self.frequency >= low) & (self.frequency <= high))
        best = max((int(at[each.argmax()]) for each in self.power[:, at]), key=self._stands_out, default=None)
        return float(self.frequency[best]) if best is not None and self._stands_out(best) > level else None

    def _stands_out(self, i: int) -> float:
        """Return the largest power at a line over the median of its surroundings."""
        apart = np.abs(self.frequency - self.frequency[i]) / self.resolution
        about = (apart > NARROW) & (apart < ABOUT)
        return float((self.power[:, i] / np.median(self.power[:, about], axis=1)).max())


def _refined(record: np.ndarray, step: float, rough: float, resolution: float) -> float:
    """Return the frequency at which a sine explains most of a record."""
    ends = rough - resolution, rough + resolution

    def taken(frequency: float) -> float:
        return -float((_sine(record, step, frequency) ** 2).sum())

    return float(minimize_scalar(taken, bounds=ends, method="bounded", options={"xatol": 1e-3 * resolution}).x)


def _sine(record: np.ndarray, step: float, frequency: float) -> Float[np.ndarray, "O T"]:
    """Return the least-squares sine of linearly changing amplitude and phase for each response."""
    time = np.linspace(-1.0, 1.0, record.shape[1])
    turn = 2 * np.pi * frequency * step * np.arange(record.shape[1])
    basis = np.array([np.cos(turn), np.sin(turn), time * np.cos(turn), time * np.sin(turn)])
    fitted: np.ndarray = np.linalg.solve(basis @ basis.T, basis @ record.T).T @ basis
    return fitted


# -------- Ambient test
# An ambient test as a value: responses to unmeasured forces.


@dataclass(frozen=True)
class SpectralDensity:
    """Singular values of the spectral density matrix of the responses, each in its own standard deviations.

    Attributes:
        frequency: (F,) [Hz]
        singular: (S, F) [1/Hz] descending.
    """

    frequency: Float[np.ndarray, "F"]
    singular: Float[np.ndarray, "S F"]


@dataclass(frozen=True)
class AmbientTest(HeldArm):
    """Test at one posture under one load without a measured force: ambient, or with taps or releases.

    Attributes:
        responses: (O,) point and direction of each response.
        references: indices of the reference responses.
        scale: (O,) [SI] divisor of each response: its standard deviation, with taps that of its noise.
        order: (O,) number of differentiations of each to an acceleration.
        band: [Hz] of the search for modes.
        correlations: of the scaled responses, without harmonics.
        density: of the scaled responses, harmonics included.
        speeds: turning parts and their speeds.
        harmonics: removed lines.
        remarks: other remarks for the report.
        decays: the scaled responses after each tap or release; none in an ambient test.
        decay: [1/s] that a window of the analyser adds to each of them.
    """

    responses: tuple[Place, ...]
    references: tuple[int, ...]
    scale: Float[np.ndarray, "O"]
    order: tuple[int, ...]
    band: tuple[float, float]
    correlations: Correlations
    density: SpectralDensity
    speeds: tuple[Speed, ...]
    harmonics: tuple[Harmonic, ...]
    remarks: tuple[str, ...]
    decays: tuple[Float[np.ndarray, "O _"], ...] = ()
    decay: float = 0.0


# -------- Ambient

LOWEST = 1.0
"""Default lower limit [Hz] of the search for modes."""
OVERSAMPLED = 4.0
"""Default sampling rate over the highest frequency of the band: a filter shifts poles near its edge."""
ROWS = 50
"""Block rows of the Hankel matrix: half the lags."""
BLOCKS = 120
"""Most blocks of a record; they are joined later."""
FEWEST = 20
"""Least length of a record, in blocks of twice the lags."""
SEGMENTS = 40
"""Number of averaged segments of a record, with an overlap of half their length."""
FEWEST_TAPS = 2
"""Fewest free decays of a test: one is left when the other is left out."""
TAP_ROWS = 36
"""Block rows for taps: fast modes have died away after more lags, and noise is left."""
SHORTEST = 3 * TAP_ROWS
"""Fewest samples of a free decay: the lags, and half as many to sum over."""


APART = (
    "WARNING: sensors of other files of this posture have no common shape with these: without a force, files are not "
    "joined (clocks of their own, a roving sensor); each is named by itself: record all sensors together"
)
"""Remark on files of one posture with other responses."""


def ambient_tests(records: Sequence[Record], processing: Processing) -> tuple[AmbientTest, ...]:
    """Return the tests of records, one for each posture, load, state of the drives, excitation and set of sensors.

    Raises:
        InputError: records too short, of different rates, windows or references in one test.
    """
    places = [frozenset(each.place for each in record.responses) for record in records]
    groups = by_key(((each.state, each.excitation, own), each) for each, own in zip(records, places, strict=True))
    tests = [_test(group, processing) for group in groups.values()]
    sensors: dict[object, set[frozenset[Place]]] = {}
    for state, _, own in groups:
        sensors.setdefault(state, set()).add(own)
    return tuple(
        replace(test, remarks=(*test.remarks, APART)) if len(sensors[state]) > 1 else test
        for test, (state, *_) in zip(tests, groups, strict=True)
    )


def _test(group: list[Record], processing: Processing) -> AmbientTest:
    first = group[0]
    for each in group[1:]:
        _check_alike(each, first)
    low, high = processing.band or (LOWEST, 1 / (first.step * OVERSAMPLED))
    high = min(high, 1 / (first.step * ANTI_ALIAS))
    shortest = min(each.responses[0].values.shape[1] for each in group)
    factor = max(min(int(1 / (first.step * OVERSAMPLED * high)), shortest), 1)
    step = first.step * factor
    parts = [(each, part) for each in group for part in _parts(each, factor)]
    samples = [part.shape[1] for _, part in parts]
    scale = np.sqrt(np.mean([part.var(1) for _, part in parts], axis=0))
    tapped = _may_be_tapped(first, samples, step)
    scaled = [part / scale[:, None] for _, part in parts]
    cleaned = [
        without_harmonics(part, step, each.speeds, (low, 1 / (2 * step)))
        for part, (each, _) in zip(scaled, parts, strict=True)
    ]
    records = [record for record, _ in cleaned]
    harmonics = tuple(dict.fromkeys(line for _, lines in cleaned for line in lines))
    remarks, decays = list(_remarks(group, harmonics)), list[np.ndarray]()
    if tapped:
        decays, noise = _decays(records, round(processing.rest / step))
        _check_taps(first, samples, step, len(decays))
        scale, scaled = scale * noise, decays
        correlations = decay_correlations(decays, first.references, step, 2 * TAP_ROWS)
        if not first.excitation:
            remarks.append(f"too short for an ambient test: taken as {len(decays)} taps (column `excitation`)")
    else:
        got, remedy = f"a window of {first.decay:.3g} 1/s", "record without a window"
        require(not first.decay, one_line(first.file), got, "an ambient record without one", remedy, "decay")
        length = max(2 * 2 * ROWS, sum(record.shape[1] for record in records) // BLOCKS)
        correlations = correlations_of(records, first.references, step, 2 * ROWS, length)
    places, order = (tuple(getattr(each, key) for each in first.responses) for key in ("place", "order"))
    files, speeds = (each.file for each in group), dict.fromkeys(speed for each in group for speed in each.speeds)
    return AmbientTest(
        *first.state, tuple(files), places, first.references, scale, order, (low, high), correlations,
        _density(scaled, step, high, 1 if decays else SEGMENTS), tuple(speeds), harmonics, tuple(remarks),
        tuple(decays), first.decay if decays else 0.0,
    )  # fmt: skip


def _may_be_tapped(first: Record, samples: Sequence[int], step: float) -> bool:
    """Whether to look for taps: where the table says so, or where the record is too short for an ambient test."""
    long = sum(samples) >= FEWEST * 4 * ROWS and min(samples) >= 8 * ROWS
    if not long and (first.excitation == AMBIENT or sum(samples) < FEWEST_TAPS * SHORTEST):
        _check_taps(first, samples, step, 0)
    return first.excitation in (TAP, RELEASE) or not (first.excitation or long)


def _check_taps(first: Record, samples: Sequence[int], step: float, count: int) -> None:
    """Refuse a record with too few taps, and too short for an ambient test."""
    got, needed = f"{sum(samples) * step:.4g} s of responses without a force", FEWEST * 4 * ROWS * step
    expected = f"{FEWEST_TAPS} taps with free decays of {SHORTEST * step:.3g} s"
    remedy, column = "tap again, and wait 2 to 5 s after each tap", "excitation" if first.excitation else "role"
    if first.excitation in (TAP, RELEASE):
        got = f"{count} {first.excitation}{'s' * (count != 1)} in {got}"
    else:
        expected = f"at least {needed:.4g} s without a break, or {expected}"
        remedy = "record for longer, or give the channel of the hammer the role force"
    require(count >= FEWEST_TAPS, one_line(first.file), got, expected, remedy, column)


def _decays(records: Sequence[np.ndarray], rest: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the free decays (O, T) of records in standard deviations (O,) of their noise, and these."""
    left, noise = innovations(records)
    ends = free_decays(left, noise, rest)
    pairs = zip(records, ends, strict=True)
    cut = [record[:, begin:end] / noise[:, None] for record, own in pairs for begin, end in own]
    return [each for each in cut if each.shape[1] >= SHORTEST], noise


def _parts(record: Record, factor: int) -> Iterator[np.ndarray]:
    """Yield the blocks of a record (O, T) without trend, downsampled by a factor."""
    for number, block in enumerate(zip(*(each.values for each in record.responses), strict=True)):
        values = detrend(np.array(block))
        late = np.array([0.0 if each.late is None else each.late[number] for each in record.responses])
        values = _delayed(values, late / record.step) if late.any() else values
        yield resample_poly(values, 1, factor, axis=1) if factor > 1 else values


def _delayed(values: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """Return channels (O, T) delayed by fractions (O,) of a step, by the phases of their spectra.

    A spectrum implies a periodic signal. The record minus the line between its ends, followed by its mirror image of
    opposite sign, is periodic without a jump in value or slope.
    """
    count = values.shape[1]
    slope = (values[:, -1:] - values[:, :1]) / (count - 1)
    line = values[:, :1] + slope * np.arange(count)
    rest = values - line
    spectrum = np.fft.rfft(np.concatenate([rest, -rest[:, -2:0:-1]], 1))
    phase = np.exp(-2j * np.pi * np.fft.rfftfreq(2 * count - 2) * delay[:, None])
    return np.fft.irfft(spectrum * phase, 2 * count - 2)[:, :count] + line - slope * delay[:, None]


def _check_alike(record: Record, first: Record) -> None:
    """Refuse a file with another order of sensors, other references, another window or rate than the first one."""
    where, remedy = one_line(record.file), "measure all of a posture at one time"
    places = [[each.place for each in own.responses] for own in (record, first)]
    for name, same in (
        ("another order of sensors", places[0] == places[1]),
        ("other references", record.references == first.references),
        ("another window", record.decay == first.decay),
    ):
        require(same, where, f"{name} than {quoted(first.file)}", "the same in files of one posture", remedy)
    got, expected = f"a rate of {1 / record.step:.6g} Hz", f"{1 / first.step:.6g} Hz, as of {first.file}"
    require(np.isclose(record.step, first.step, rtol=1e-6), where, got, expected, "resample one of them")


def _density(records: Sequence[np.ndarray], step: float, high: float, segments: int) -> SpectralDensity:
    """Return singular values of the spectral density matrix, averaged over records by their length."""
    weights = [record.shape[1] for record in records]
    length = min(sum(weights) // segments, *weights)
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


# -------- Measured
# The tests of a channel table, one for each posture and load: ambient tests where no force was measured.


def measured_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], processing: Processing
) -> tuple[ModalTest | AmbientTest, ...]:
    """Return the tests of a channel table, one for each posture, load and state of the drives.

    A posture without a force in any file was excited by its surroundings: an ambient test.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        processing: windows, estimator and band.

    Raises:
        InputError: see `ident.modal.recorded`; also a record that is too short or has no hit.
    """
    ambient = ambient_files(table, recordings)
    quiet = {name: each for name, each in recordings.items() if name in ambient}
    pushed = {name: each for name, each in recordings.items() if name not in ambient}
    rows = [row for row in table.rows if not any(fnmatchcase(name, row.file) for name in quiet)]
    tests: tuple[ModalTest | AmbientTest, ...] = ()
    problems: list[Problem] = []
    with noted(problems):
        tests += ambient_tests(records(table, quiet), processing)
    with noted(problems):
        if any(row.counts for row in rows) or not quiet:
            tests = modal_tests(replace(table, rows=tuple(rows)), pushed, processing) + tests
    refuse(problems)
    return tests
