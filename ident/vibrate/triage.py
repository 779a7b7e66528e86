"""The cause of each strong part of a measured vibration (drive, mode, command, kick or line), by its frequency track.

A hypothesis is a track f(t): order |ratio dq/dt| / (2 pi) of a drive, a natural frequency along the postures, or a
constant. With phi = 2 pi int f dt it explains Re(sum over j of c_j w_j(t) exp(i phi)), with smooth bumps w_j:

- for a drive along its track, and along each mode that it passes, under the envelope b of that mode while it is near,

      db/dt = -2 pi zeta f_k b + f^2 exp(i (phi - phi_k)),

  so that ringing after a resonance is attributed to the drive, with the mode as its amplifier;
- for the command along all modes, from each jump of the commanded acceleration on, damped as the modes are; likewise
  for external kicks, from each sudden rise of the energy without a jump of the command;
- for a mode with another excitation, with bumps a second apart; for a line, four seconds apart, as it is steady.

Least squares on the whitened trace leave a share u of its energy, less noise. The score of a set of hypotheses follows
from u (`ident.vibrate.hypotheses`), with T / FREE independent numbers for a trace of T seconds, less `COST` for each
hypothesis. The probability of a hypothesis follows from the scores of the sets with a competitor in its place.
Phases are not compared with a model, so clock offsets and drive phases don't matter.

References:
    Mallat, Zhang, "Matching pursuits with time-frequency dictionaries", IEEE Trans. Signal Process. 41, 1993. Vold,
    Leuridan, "High resolution order tracking at extreme slew rates", SAE 931288, 1993 (smooth envelope of an order).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter
from scipy.signal import ShortTimeFFT, decimate, find_peaks, hilbert
from scipy.sparse import csr_array, diags_array, hstack
from scipy.special import logit

from ident.arm.arm import Arm, nominal
from ident.vibrate.branches import Branches, branches
from ident.vibrate.hypotheses import COST, TRACKS, probability, score
from ident.vibrate.motion import Motion, MovingTrace
from ident.vibrate.response import runs
from ident.vibrate.spectra import samples

RATE = 200.0
"""Sampling rate [Hz] to which traces are reduced: the mains at 50 Hz and an arm's first modes lie below 80 Hz."""
LOWEST = 0.5
"""Lower limit of the band, relative to the lowest natural frequency: below, an arm follows its command rigidly."""
ORDERS = (1, 2, 4)
"""Multiples of a drive's frequency: imbalance, transmission error, and its first overtone."""
MODES = 5
"""Number of lowest modes in use, up to 20 Hz for the paper's arm; assumed."""
ALIKE = 0.01
"""Relative distance below which tracks count as one: the mounting of a harmonic drive changes its ratio by 1. Below the
band it is that of the band's lower limit: a log is never quite at rest."""
SCALES = np.arange(0.94, 1.0601, 0.005)
"""Trial factors on a mode's frequency, for stiffnesses known to 10 %; assumed."""
NEAR = 0.2
"""Distance from a natural frequency, relative to it, within which a drive rings a mode; assumed."""
TRACK, FREE, STEADY = 2.0, 1.0, 4.0
"""Spacing [s] of the bumps of a drive, of a mode and of a line, within which its amplitude may change; assumed."""
GROWTH = 1.5
"""Growth of the width from bump to bump while a mode rings freely; assumed."""
DAMPED = 0.4
"""Decay of a mode's envelope relative to its damping: bumps can follow a faster decay, not a slower one; assumed."""
FAINT = 0.02
"""Envelope at which a mode has decayed, relative to its largest value."""
JUMP = 0.3
"""Change within half a period of the lowest mode that counts as a jump, relative to the largest acceleration; assumed.
"""
RIDGE = 3e-3
"""Ridge that keeps the coefficients of nearly coincident unit columns small."""
OFTEN = 0.25
"""Quantile of a spectrum over time: a sweep, or a signal present less than three quarters of the time, is no line."""
HEIGHT, LINES = 4.0, 3
"""Least power of a candidate line over the noise, and most lines in a trace; assumed."""
ABOUT = 3.0
"""Half width [Hz] of the median that gives the noise level; assumed."""
RATIOS = np.geomspace(0.1, 10.0, 401)
"""Trial multiples of the fastest drive's frequency for unexplained tracks: about one percent apart."""
ELSEWHERE = 0.03
"""Least relative distance of such a track from all known ones; assumed."""
FURTHER = 2
"""Most tracks to search in the unexplained rest."""
KICK, BEFORE, KICKS = 4.0, 0.25, 12
"""Rise of the energy at a kick, from one window of this length [s] to the next, and most kicks; assumed."""
STANDS_OUT = 5.0
"""Least energy of a vibration, in standard deviations of the noise's energy."""

Kind = Literal["drive", "mode", "kicks", "line", "unexplained"]
Next = Literal["source", "profile", "standstill", "speed", "modes", "kicks"]


@dataclass(frozen=True)
class Hypothesis:
    """A possible cause of a vibration.

    Attributes:
        kind: drive, mode or line; `unexplained` for a track at an unknown multiple of a drive's speed.
        drives: (name, order) of all drives with the same track, the lowest order first.
        mode: number of the mode; None for a drive, a line, and for the command and kicks, which excite all modes.
        frequency: (T_r,) [Hz] over the grid of each trace; none for the command and kicks.
        starts: samples of each trace at which the command, or kicks, excite all modes.
    """

    kind: Kind
    drives: tuple[tuple[str, float], ...]
    mode: int | None
    frequency: tuple[Float[np.ndarray, "_"], ...]
    starts: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True)
class Finding:
    """A strong part of the vibration and its cause.

    Attributes:
        kind: drive, mode, line, or unexplained.
        drives: (name, order) of drives; frequency alone cannot separate several. For an unexplained part at a multiple
            of a drive's speed, that drive and the ratio.
        modes: labels of the excited or amplifying modes with at least a quarter of the part, the strongest first.
        by_command: whether jumps of the commanded acceleration excite a mode.
        share: () [-] of the vibration energy, weighted by the noise at each frequency; the mean over the traces.
        probability: () [-] of this cause against its competitors; 1 for a part without a track.
        track: number of the hypothesis with the closest track; None without a track.
        trace: number of the trace with its largest share.
        frequency: [Hz] lowest and highest in that trace, while above half of its largest amplitude.
        time: () [s] of its largest amplitude in that trace.
        amplitude: () [unit of the values] 0-peak, at that time.
        next: next step: `source` (identify the drive), `profile` (a smoother command), `standstill` (record at rest),
            `speed` (run at another speed, as the cause is ambiguous), `modes` (use more modes), `kicks` (find shocks).
    """

    kind: Kind
    drives: tuple[tuple[str, float], ...]
    modes: tuple[str, ...]
    by_command: bool
    share: float
    probability: float
    track: int | None
    trace: int
    frequency: tuple[float, float]
    time: float
    amplitude: float
    next: Next

    @property
    def told(self) -> bool:
        """Whether its cause is identified."""
        return self.probability >= TRACKS.sure


@dataclass(frozen=True)
class Triage:
    """The causes of the strong parts of some traces.

    Attributes:
        findings: the largest share first, the unexplained rest last; none where nothing exceeds the noise.
        hypotheses: all compared hypotheses.
        labels: (traces) of the modes by their numbers, at the end of each trace.
        time: (T_r,) [s] grid of each trace.
        noise: (traces) [unit of the values] rms of each trace's noise.
    """

    findings: tuple[Finding, ...]
    hypotheses: tuple[Hypothesis, ...]
    labels: tuple[tuple[str, ...], ...]
    time: tuple[Float[np.ndarray, "_"], ...]
    noise: tuple[float, ...]


def triage(arm: Arm, traces: Sequence[MovingTrace], *, orders: Sequence[int] = ORDERS) -> Triage:
    """Find the causes of the strong parts of a moving arm's vibration, without any identified source.

    Args:
        arm: the arm; for a batch its median. Natural frequencies may be off by 5 %.
        traces: of one arm, at any speeds, points and directions; explained jointly.
        orders: multiples of each drive's turning frequency.

    Raises:
        InputError: a trace with gaps, uneven steps or few samples; a motion of other joints.
    """
    arm, motions, grids = nominal(arm), [trace.motion for trace in traces], [_thinned(trace) for trace in traces]
    each = zip(traces, grids, strict=True)
    along = _numbered([branches(arm, t.motion, count=MODES, times=x, loads=t.loads) for t, (x, _) in each])
    records = [_record(*grid, LOWEST * float(a.natural.min())) for grid, a in zip(grids, along, strict=True)]
    along = _scaled(records, along)
    jumps = tuple(_jumps(record, motion) for record, motion in zip(records, motions, strict=True))
    kicks = tuple(_kicks(record, own) for record, own in zip(records, jumps, strict=True))
    hypotheses = [
        *_drives(arm, orders, motions, records),
        *(Hypothesis("mode", (), k, tuple(a.natural[k] for a in along)) for k in range(len(along[0].natural))),
        Hypothesis("mode", (), None, (), jumps),
        *(Hypothesis("kicks", (), None, (), kicks) for _ in range(any(kicks))),
        *_lines(records),
    ]
    fit = _Fit([_system(*own, hypotheses, n) for n, own in enumerate(zip(records, along, strict=True))], hypotheses)
    loud = any(system.energy > STANDS_OUT * np.sqrt(2 * system.noise) for system in fit.systems)
    chosen = fit.seen(fit.search()) if loud else ()
    for _ in range(FURTHER if loud else 0):
        others = [h for h in chosen if not fit.hypotheses[h].drives]
        if fit.left(others).mean() < TRACKS.seen or not (further := _further(fit, others)):
            break
        fit = fit.extended(along, further)
        chosen = fit.seen(fit.search(chosen))
    shares, left = fit.shares(chosen), fit.left(chosen)
    findings = [_finding(fit, along, chosen, h, shares[:, i]) for i, h in enumerate(chosen)]
    findings.sort(key=lambda finding: -finding.share)
    if loud and left.mean() >= TRACKS.seen:
        findings.append(_unexplained(fit, chosen, left))
    labels = tuple(
        tuple(a.label(k, float(r.time[-1])) for k in range(len(a.natural))) for a, r in zip(along, records, strict=True)
    )
    noise = tuple(float(np.sqrt(2 * s.scatter * (s.record.level**2).sum() / len(s.record.time))) for s in fit.systems)
    return Triage(tuple(findings), tuple(fit.hypotheses), labels, tuple(r.time for r in records), noise)


# -------- Records
# Traces on a grid, detrended and whitened.


class _Record(NamedTuple):
    """Times and whitened values (T,), and the noise level (F,), zero outside the band [Hz]."""

    time: np.ndarray
    white: np.ndarray
    level: np.ndarray
    band: tuple[float, float]

    @property
    def step(self) -> float:
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def phase(self, track: np.ndarray) -> np.ndarray:
        """Return 2 pi times the integral of a frequency."""
        return 2 * np.pi * self.step * (np.cumsum(track) - track / 2)


def _thinned(trace: MovingTrace) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a trace at about RATE."""
    given = samples(trace.time, trace.values)
    factor = max(1, int(given.rate / RATE * (1 + 1e-6)))
    values = decimate(given.values, factor) if factor > 1 else given.values
    return given.time[0] + np.arange(len(values)) * given.step * factor, values


def _record(time: np.ndarray, values: np.ndarray, low: float) -> _Record:
    """Subtract the line between the ends, and divide by the noise level of the quieter times."""
    step, count = float(time[1] - time[0]), len(time)
    ends, band = max(1, round(0.25 / step)), (low, 0.4 / step)
    values = values - np.linspace(values[:ends].mean(), values[-ends:].mean(), count)
    quiet, frequency = _often(values, step, TRACK, 2)
    about = 2 * max(1, round(ABOUT / frequency[1])) + 1
    at = np.fft.rfftfreq(count, step)
    level = np.sqrt(np.interp(at, frequency, median_filter(quiet, about, mode="reflect")))
    level = np.maximum(level, 1e-9 * np.abs(values).max() + np.finfo(float).tiny)
    inside = np.clip(1 + (at - band[0]) / (0.25 * band[0]), 0, 1) * np.clip(1 + (band[1] - at) / (0.05 * band[1]), 0, 1)
    return _Record(time, np.fft.irfft(np.fft.rfft(values) * inside / level, count), level * (inside > 0), band)


def _often(values: np.ndarray, step: float, seconds: float, overlap: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the power exceeded for three quarters of the time; 1 for white noise of variance 1."""
    power, at = _power(values, step, seconds, overlap)
    return np.quantile(power, OFTEN, axis=1) / -np.log(1 - OFTEN), at


def _power(values: np.ndarray, step: float, seconds: float, overlap: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the power over frequency and time (mean 1 for white noise of variance 1), and the frequencies [Hz]."""
    length = round(min(seconds / step, len(values) / 6))
    transform = ShortTimeFFT(np.hanning(length), length // overlap, 1 / step, mfft=4 * length, scale_to="psd")
    edge = -(-length // 2 // transform.hop)
    return np.abs(transform.stft(values)[:, edge:-edge]) ** 2 / step, transform.f


# -------- Tracks
# Frequencies over time of all possible causes.


class _Along(NamedTuple):
    """Natural frequencies [Hz] and damping ratios (B, T) of the modes along a trace, and their branches."""

    natural: np.ndarray
    damping_ratio: np.ndarray
    place: np.ndarray
    branches: Branches

    def label(self, k: int, time: float) -> str:
        return str(self.branches.label(int(self.place[k]), time))


def _numbered(along: Sequence[Branches]) -> list[_Along]:
    """Number the modes of all traces consistently: by rank where a trace is closest to a posture of the first one."""
    count, found = min(len(each.labels) for each in along), []
    for each in along:
        apart = np.linalg.norm(along[0].posture[:, ::10, None] - each.posture[:, None, ::10], axis=0)
        i, j = (10 * int(k) for k in np.unravel_index(int(apart.argmin()), apart.shape))
        rank = np.argsort(np.argsort(along[0].median[:, i])[:count])
        place = np.argsort(each.median[:, j])[:count][rank]
        found.append(_Along(each.median[place], each.median_damping_ratio[place], place, each))
    return found


def _scaled(records: Sequence[_Record], along: Sequence[_Along]) -> list[_Along]:
    """Scale each mode's frequencies by the factor that brings most of the traces' bumps above the noise."""
    waves = [_waves(record.time, STEADY) for record in records]
    each = list(zip(along, records, waves, strict=True))

    def factor(k: int) -> float:
        return max(SCALES.tolist(), key=lambda x: sum(_stands_out(x * a.natural[k], r, r.white, w) for a, r, w in each))

    factors = np.array([[factor(k)] for k in range(len(along[0].natural))])
    return [a._replace(natural=a.natural * factors) for a in along]


def _waves(time: np.ndarray, spacing: float) -> csr_array:
    """Return bumps (T, K) over the whole trace, each of norm 1."""
    bumps = _bumps(time, np.arange(time[0], time[-1] + spacing, spacing))
    return csr_array(bumps / np.linalg.norm(bumps, axis=0))


def _stands_out(track: np.ndarray, record: _Record, white: np.ndarray, waves: csr_array) -> float:
    """Return how far a whitened trace exceeds the noise along a track; the logarithm limits a passing drive."""
    return float(np.log1p(np.abs(waves.T @ (white * np.exp(-1j * record.phase(track)))) ** 2).sum())


def _further(fit: "_Fit", chosen: Sequence[int]) -> Hypothesis | None:
    """Return the track at an unknown multiple of a drive's speed that explains most of the residual."""
    drives = [(each, np.concatenate(each.frequency)) for each in fit.hypotheses if each.drives]
    records, left = [s.record for s in fit.systems], [s.left(s.of(chosen)) for s in fit.systems]
    waves, tried = [_waves(r.time, TRACK) for r in records], list[tuple[float, Hypothesis]]()
    drives.sort(key=lambda pair: (-pair[0].drives[0][1], pair[1].mean()))  # the fastest last: where joints move alike
    bases = {tuple(np.round(own[::50] / own.max(), 3)): (each, own) for each, own in drives}
    for each, own in bases.values():
        for ratio in RATIOS.tolist():
            if not any((np.abs(ratio * own - x) <= np.maximum(ELSEWHERE * x, 1 / TRACK)).all() for _, x in drives):
                tracks, (name, order) = tuple(ratio * f for f in each.frequency), each.drives[0]
                height = sum(map(_stands_out, tracks, records, left, waves))
                tried.append((height, Hypothesis("unexplained", ((name, ratio * order),), None, tracks)))
    return max(tried, key=lambda pair: pair[0], default=(0.0, None))[1]


def _kicks(record: _Record, jumps: Sequence[int]) -> tuple[int, ...]:
    """Return the samples of a sudden rise of the energy, without those at jumps of the command."""
    width = round(BEFORE / record.step)
    energy = np.convolve(record.white**2, np.ones(width), "full")[width - 1 :]  # of the samples from here on
    quiet = 2 * (record.band[1] - record.band[0]) * record.step * width
    rise = np.log((energy[width:] + quiet) / (energy[:-width] + quiet))
    places, found = find_peaks(rise, height=np.log(KICK), distance=width)
    places = places[np.argsort(-found["peak_heights"])][:KICKS] + width
    return tuple(sorted(int(k) for k in places if all(abs(k - jump) > 2 * width for jump in jumps)))


def _drives(
    arm: Arm, orders: Sequence[int], motions: Sequence[Motion], records: Sequence[_Record]
) -> Iterator[Hypothesis]:
    """Yield a hypothesis for each track of drive orders that reaches into the band."""
    joints, groups = [joint.name for joint in arm.driven], list[Hypothesis]()
    speeds = [np.abs(np.asarray(motion(record.time)[1])) for motion, record in zip(motions, records, strict=True)]
    for order, drive in ((order, drive) for order in sorted(orders) for drive in arm.drives):
        turns, j = order * abs(float(drive.ratio)) / (2 * np.pi), joints.index(drive.joint)
        track = tuple(turns * speed[j] for speed in speeds)
        for k, group in enumerate(groups):
            pairs = zip(group.frequency, track, records, strict=True)
            if all((np.abs(a - b) <= ALIKE * np.maximum(a, r.band[0])).all() for a, b, r in pairs):
                groups[k] = replace(group, drives=(*group.drives, (drive.name, order)))
                break
        else:
            groups.append(Hypothesis("drive", ((drive.name, order),), None, track))
    for group in groups:
        if any(((f > r.band[0]) & (f < r.band[1])).any() for f, r in zip(group.frequency, records, strict=True)):
            yield group


def _lines(records: Sequence[_Record]) -> Iterator[Hypothesis]:
    """Yield the frequencies present nearly all the time."""
    found = list[float]()
    for record in records:
        often, frequency = _often(record.white, record.step, STEADY, 4)
        often[(frequency < record.band[0]) | (frequency > record.band[1])] = 0
        places, _ = find_peaks(often, height=HEIGHT)
        count = 8 * len(record.time)
        whole = np.abs(np.fft.rfft(record.white * np.hanning(count // 8), count))
        fine = np.fft.rfftfreq(count, record.step)
        for rough in frequency[places[np.argsort(-often[places])][:LINES]]:
            about = np.flatnonzero(np.abs(fine - rough) < 1 / STEADY)
            exact = float(fine[about[whole[about].argmax()]])
            if all(abs(exact - other) > 1 / STEADY for other in found):
                found.append(exact)
    for f in found:
        yield Hypothesis("line", (), None, tuple(np.full(len(r.time), f) for r in records))


# -------- Least squares
# Energy explained by sets of hypotheses.


class _System(NamedTuple):
    """Normal equations of a trace: columns (T, P) with their hypothesis and mode, -1 for none."""

    record: _Record
    matrix: csr_array
    owner: np.ndarray
    mode: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    scatter: float = 1.0  # noise energy per sample: 1 except for errors of the noise level

    @property
    def noise(self) -> float:
        """Energy of the noise in the whitened trace."""
        low, high = self.record.band
        return 2 * (high - low) * self.record.step * len(self.record.time) * self.scatter

    @property
    def energy(self) -> float:
        """Energy of the whitened trace above the noise."""
        return float(self.record.white @ self.record.white) - self.noise

    def of(self, chosen: Sequence[int]) -> np.ndarray:
        """Return the indices of the columns of some hypotheses."""
        return np.flatnonzero(np.isin(self.owner, chosen))

    def solve(self, at: np.ndarray) -> tuple[np.ndarray, float]:
        """Return coefficients of some columns, and their explained energy without the fitted noise."""
        gram, moment = self.gram[np.ix_(at, at)], self.moment[at]
        inverse = np.linalg.inv(gram + RIDGE * np.eye(len(at)))
        found = inverse @ moment
        freedom = len(at) - RIDGE * np.trace(inverse)
        return found, float(2 * found @ moment - found @ gram @ found - self.scatter * freedom)

    def left(self, at: np.ndarray) -> np.ndarray:
        """Return the residual of the whitened trace after some columns."""
        return np.asarray(self.record.white - self.matrix[:, at] @ self.solve(at)[0])


def _system(record: _Record, along: _Along, hypotheses: Sequence[Hypothesis], n: int) -> _System:
    """Set up the normal equations of trace n."""
    parts, owner, mode = [], list[int](), list[int]()
    for h, each in enumerate(hypotheses):
        track = each.frequency[n] if each.frequency else along.natural[0]
        for k, envelope in _envelopes(each, n, track, record, along):
            waves = envelope * np.exp(1j * record.phase(track if k < 0 else along.natural[k]))[:, None]
            parts += [csr_array(waves.real), csr_array(waves.imag)]
            owner += [h] * 2 * waves.shape[1]
            mode += [k if each.mode is None else each.mode] * 2 * waves.shape[1]
    matrix = csr_array(hstack(parts))
    size = np.sqrt(np.asarray(matrix.multiply(matrix).sum(0)).ravel())
    used = np.flatnonzero(size > 1e-9)
    matrix = csr_array(matrix[:, used] @ diags_array(1 / size[used]))
    gram, moment = (matrix.T @ matrix).toarray(), matrix.T @ record.white
    system = _System(record, matrix, np.array(owner)[used], np.array(mode)[used], gram, moment)
    # noise energy per sample: the residual signal is narrow, so the median over the band is noise; the columns have
    # also removed their share of the noise
    power, at = _power(system.left(np.arange(len(used))), record.step, TRACK, 2)
    inside, taken = power[(at > record.band[0]) & (at < record.band[1])], len(used) / system.noise
    scatter = float(np.quantile(inside, (1 + min(taken, 0.8)) / 2, axis=0).mean() / np.log(2))
    return system._replace(scatter=scatter)


def _envelopes(
    each: Hypothesis, n: int, track: np.ndarray, record: _Record, along: _Along
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield envelopes (T, K) for a hypothesis' own track (-1) and for those of the modes it excites."""
    time, step = record.time, record.step
    decays = DAMPED * 2 * np.pi * step * along.natural * along.damping_ratio
    modes = list(enumerate(zip(along.natural, decays, strict=True)))
    spacing = STEADY if each.kind == "line" else TRACK if each.drives else FREE
    bumps = _bumps(time, np.linspace(time[0], time[-1], max(2, round((time[-1] - time[0]) / spacing) + 1)))
    if each.kind == "line" or each.mode is not None:
        yield -1, bumps
    elif each.drives:
        bumps = bumps * ((track > record.band[0] / 2) & (track < record.band[1]))[:, None]
        yield -1, bumps[:, (bumps**2).sum(0) > TRACK / step / 20]
        for k, (natural, decay) in modes:
            for first, last in runs(np.abs(track - natural) < NEAR * natural):
                if last > first + 1 / natural[first] / step:  # near for a cycle
                    near = (track**2 * np.exp(1j * (record.phase(track) - record.phase(natural))))[first : last + 1]
                    yield k, _ringing(time, first, last, near, decay)
    else:
        for first, (k, (_, decay)) in ((first, mode) for first in each.starts[n] for mode in modes):
            yield k, _ringing(time, first, first, np.ones(1), decay)


def _jumps(record: _Record, motion: Motion) -> tuple[int, ...]:
    """Return the samples at which the commanded acceleration jumps, within half a period of the lowest mode."""
    quarter = LOWEST / (4 * record.band[0])
    ahead = int(3 * quarter / record.step)  # so that a jump at the start of a trace is a peak
    time = record.time[0] + record.step * np.arange(-ahead, len(record.time))
    before, after = (np.asarray(motion(time + side)[2]) for side in (-quarter, quarter))
    height = JUMP * np.abs(np.asarray(motion(record.time)[2])).max() + np.finfo(float).tiny
    places, _ = find_peaks(np.abs(after - before).max(0), height=height, plateau_size=1)
    return tuple(sorted({max(0, int(place) - ahead) for place in places}))


def _ringing(time: np.ndarray, first: int, last: int, force: np.ndarray, decay: np.ndarray) -> np.ndarray:
    """Return envelopes (T, K) of a mode that is forced between two samples, then rings freely with widening bumps."""
    state, envelope = 0j, np.zeros(len(time), complex)
    for i, (factor, pushed) in enumerate(zip(np.exp(-decay[first : last + 1]).tolist(), force.tolist(), strict=True)):
        envelope[first + i] = state = factor * state + pushed
    envelope[last:] = state * np.exp(-np.cumsum(decay[last:]) + decay[last])
    size = np.abs(envelope)
    end = int(np.flatnonzero(size > FAINT * size.max())[-1])
    centres, gap = [time[first]], FREE
    while centres[-1] < time[end]:
        gap *= GROWTH if centres[-1] >= time[last] else 1.0
        centres.append(centres[-1] + gap)
    within = (time >= time[first]) & (time <= time[end])
    return _bumps(time, np.array([*centres, centres[-1] + gap])) * (within * envelope / size.max())[:, None]


def _bumps(time: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return raised cosines (T, K) around K centres [s], each from neighbour to neighbour: they add up to 1."""
    gaps = np.diff(centres)
    away = time[:, None] - centres
    away = np.where(away < 0, away / np.append(gaps[0], gaps), away / np.append(gaps, gaps[-1]))
    return 0.5 + 0.5 * np.cos(np.pi * np.clip(away, -1, 1))


class _Fit:
    """Scores of sets of hypotheses over all traces, each computed once."""

    def __init__(self, systems: Sequence[_System], hypotheses: Sequence[Hypothesis]):
        self.systems, self.hypotheses = systems, hypotheses
        self._explained = dict[tuple[int, ...], np.ndarray]()

    def extended(self, along: Sequence[_Along], further: Hypothesis) -> "_Fit":
        """Return the fit with a further hypothesis and the same noise, so that no score changes."""
        hypotheses, each = [*self.hypotheses, further], enumerate(zip(self.systems, along, strict=True))
        systems = [_system(s.record, a, hypotheses, n)._replace(scatter=s.scatter) for n, (s, a) in each]
        new = _Fit(systems, hypotheses)
        new._explained = self._explained
        return new

    def left(self, chosen: Sequence[int]) -> np.ndarray:
        """Return the share of each trace's energy that a set does not explain."""
        return np.clip(1 - self.explained(chosen), 0, 1)

    def explained(self, chosen: Sequence[int]) -> np.ndarray:
        """Return the share of each trace's energy that a set explains."""
        key = tuple(sorted(chosen))
        if key not in self._explained:
            energy = [max(s.energy, STANDS_OUT * np.sqrt(2 * s.noise)) for s in self.systems]
            parts = [s.solve(s.of(key))[1] for s in self.systems]
            self._explained[key] = np.array(parts) / energy
        return self._explained[key]

    def score(self, chosen: Sequence[int]) -> float:
        """Return the score of a set."""
        length = np.array([s.record.step * len(s.record.time) for s in self.systems])
        # a searched track or kicks could be anywhere: each counts as two hypotheses
        count = sum(1 + (self.hypotheses[h].kind in ("unexplained", "kicks")) for h in chosen)
        return score(self.left(chosen), length / FREE, TRACKS) - COST * count

    def search(self, best: tuple[int, ...] = ()) -> tuple[int, ...]:
        """Return the best set from a start by adding, removing or replacing one hypothesis at a time."""
        while True:
            better = max(self._neighbours(best), key=self.score)
            if self.score(better) <= self.score(best):
                return best
            best = tuple(sorted(better))

    def _neighbours(self, chosen: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        others = [k for k in range(len(self.hypotheses)) if k not in chosen]
        yield from ((*chosen, k) for k in others)
        for rest in (tuple(k for k in chosen if k != h) for h in chosen):
            yield rest
            yield from ((*rest, k) for k in others)

    def shares(self, chosen: Sequence[int]) -> np.ndarray:
        """Return each hypothesis' share in each trace: the mean of its explained energy alone and added to the rest."""
        if not len(chosen):
            return np.zeros((len(self.systems), 0))
        whole = np.clip(self.explained(chosen), 0, 1)
        beside = [whole - self.explained([k for k in chosen if k != h]) for h in chosen]
        each = [np.maximum(self.explained([h]) + more, 0) / 2 for h, more in zip(chosen, beside, strict=True)]
        total = np.maximum(np.sum(each, axis=0), 1e-9)
        return np.array([part * whole / total for part in each]).T

    def seen(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Remove, one by one, hypotheses without a share, or hardly needed in addition to the rest."""
        rests = [tuple(k for k in chosen if k != h) for h in chosen]
        needed = np.array([self.score(chosen) - self.score(rest) for rest in rests]) > logit(TRACKS.sure)
        doubtful = np.flatnonzero(~needed | (self.shares(chosen).mean(0) < TRACKS.seen))
        return self.seen(max((rests[i] for i in doubtful), key=self.score)) if len(doubtful) else chosen

    def probability(self, chosen: tuple[int, ...], h: int) -> float:
        """Return the probability of a hypothesis in a set, against every competitor in its place, and none."""
        rest = tuple(k for k in chosen if k != h)
        rivals = [rest, *((*rest, k) for k in range(len(self.hypotheses)) if k not in chosen)]
        return probability([self.score(chosen)], [self.score(each) for each in rivals])


# -------- Findings


def _finding(fit: _Fit, along: Sequence[_Along], chosen: tuple[int, ...], h: int, shares: np.ndarray) -> Finding:
    """Describe one of the hypotheses that explain the traces."""
    each, waves = fit.hypotheses[h], list[np.ndarray]()
    of_mode = np.zeros((len(fit.systems), len(along[0].natural)))
    for n, system in enumerate(fit.systems):
        at = system.of(chosen)
        found, _ = system.solve(at)
        own = at[system.owner[at] == h], found[system.owner[at] == h]
        white = system.matrix[:, own[0]] @ own[1]
        waves.append(np.fft.irfft(np.fft.rfft(white) * system.record.level, len(white)))
        for k in range(of_mode.shape[1]):
            part = system.matrix[:, own[0]] @ (own[1] * (system.mode[own[0]] == k))
            of_mode[n, k] = part @ part / max(white @ white, np.finfo(float).tiny)
    n = int(shares.argmax())
    time, size = fit.systems[n].record.time, np.abs(hilbert(waves[n]))
    strongest = int(size.argmax())
    ranked = [int(k) for k in np.argsort(-of_mode[n]) if of_mode[n, k] >= 0.25]
    by_command = each.kind == "mode" and each.mode is None
    number = h
    if not each.frequency:
        mode = int(of_mode[n].argmax())
        number = next(i for i, other in enumerate(fit.hypotheses) if other.kind == "mode" and other.mode == mode)
    tracks = fit.hypotheses[number].frequency
    likely = min(fit.probability(chosen, h), 1.0 if _moves(fit, each, tracks, waves) else 0.5)
    track = tracks[n][size > 0.5 * size[strongest]]
    follow: dict[str, Next] = {"drive": "source", "mode": "profile", "kicks": "kicks", "line": "standstill"}
    following = follow.get(each.kind, "modes") if likely >= TRACKS.sure else "speed"
    share, when, amplitude = float(shares.mean()), float(time[strongest]), float(size[strongest])
    span, modes = (float(track.min()), float(track.max())), dict.fromkeys(along[n].label(k, when) for k in ranked)
    what = each.kind, each.drives, tuple(modes), by_command
    return Finding(*what, share, likely, number, n, span, when, amplitude, following)


def _unexplained(fit: _Fit, chosen: Sequence[int], left: np.ndarray) -> Finding:
    """Describe the unexplained rest, by its spectrum over time above the noise."""
    n = int(left.argmax())
    system, record = fit.systems[n], fit.systems[n].record
    power, at = _power(system.left(system.of(chosen)), record.step, TRACK, 2)
    power = np.where(power > HEIGHT * HEIGHT * system.scatter, power, 0.0)
    power *= np.interp(at, np.fft.rfftfreq(len(record.time), record.step), record.level)[:, None] ** 2
    upto, over = np.cumsum(power.sum(1)), power.sum(0)
    low, high = (float(at[np.searchsorted(upto, share * upto[-1])]) for share in (0.1, 0.9))
    size = float(np.sqrt(4 * record.step * (at[1] - at[0]) * over.max()))
    when = float(record.time[0] + (over.argmax() + 0.5) / len(over) * (record.time[-1] - record.time[0]))
    of_all = float(left.mean())
    return Finding("unexplained", (), (), False, of_all, 1.0, None, n, (low, high), when, size, "modes")


def _moves(fit: _Fit, each: Hypothesis, tracks: Sequence[np.ndarray], waves: Sequence[np.ndarray]) -> bool:
    """Whether a track moves by more than the traces resolve: a drive's where it is strong, a mode's anywhere.

    For a line, some drive's track must move, otherwise the line may be an unlisted order; without drives some mode's.
    """
    weight = np.concatenate([w**2 if each.drives else np.ones(len(w)) for w in waves])
    drives = [h.frequency for h in fit.hypotheses if h.drives]
    others = drives or [h.frequency for h in fit.hypotheses if h.mode is not None]
    resolution = (weight**2).sum() / weight.sum() ** 2 / fit.systems[0].record.step
    for track in others if each.kind == "line" else [tracks]:
        f = np.concatenate(track)
        mean = (weight * f).sum() / weight.sum()
        if np.sqrt((weight * (f - mean) ** 2).sum() / weight.sum()) > resolution / 4:
            return True
    return False
