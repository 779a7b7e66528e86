"""The clock of a recording: stamps that jitter, values that repeat, missing samples; and even times from them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ident.errors import require
from ident.measure.grade import clipped
from ident.measure.samples import TIME

UNEVEN = 0.01
"""Largest deviation of a sampling interval from the mean one, as a fraction of it."""
COARSE = 0.2
"""Largest deviation from even times by rounding, as a fraction of their interval."""
GAP = 3.0
"""Pause, in intervals, from which samples count as missing: interpolation would invent them; assumed."""
ROUNDED = 0.05
"""Largest error of an interval stated with few digits: 0.000020 s for 1 / 51.2 kHz has 2.4 %."""
JUDGED_MIN = 50
"""Fewest samples, and changes of values, to judge a clock: a list of points has fewer."""
HELD_STEP = 4
"""Jump of repeated values, in steps of the last digit; a slow encoder's jump is one or two."""
SMOOTHER = 8.0
"""Excess of roughness over one from which one of two clocks is believed, times the root of the samples; assumed."""
JITTER_MAX = 0.3
"""Largest rms error of the times that resampling mends, as a fraction of the interval; assumed."""
LOST_MAX = 0.5
"""Largest share of a recording that may be cut off at gaps; assumed."""
WINDOW = 50
"""Intervals whose median tells a clock that drifts, as at lost samples, from one that jitters; assumed."""
DRIFT_SE = 6.0
"""Such a median from which it is a drift, in standard errors of a mean: 4.8 of its own; assumed."""
WANDER = 0.13
"""Rms of a random walk of N steps about its trend, over sqrt(N) steps: half of its mean, 1 / sqrt(15)."""
WANDER_MIN = 1.5
"""Rms about the trend, over that of the steps, from which it may be a walk; independent errors have 1 / sqrt(2);
assumed."""
ERROR_MAX = 0.01
"""Error of an amplitude at the upper end of the band that a resampled recording can be trusted in."""
CHUNK = 2048
"""Samples by which that band is judged."""
LINE = 8.0
"""Frequency [Hz] for which the cost of a clock that can't be told is stated: drives excite vibration below it."""
DEGREE = 5
"""Degree of the spline through unevenly sampled values."""


@dataclass(frozen=True)
class Even:
    """Samples at even times.

    Attributes:
        start: [s] of the first sample.
        step: [s] between samples.
        values: (C, T) of C channels.
        remarks: what was done to the times, and what it costs.
        error: relative standard error of the step, where it was fitted to stamps that jitter.
        band: [Hz] up to which resampling has kept the amplitudes.
    """

    start: float
    step: float
    values: np.ndarray
    remarks: tuple[str, ...] = ()
    error: float = 0.0
    band: float = np.inf


def evened(time: np.ndarray, values: np.ndarray, file: str) -> Even:
    """Return channels at even times, from the longest part without a gap.

    Two clocks are told apart. Where the sampling was even and the stamps jitter, as times of arrival do, the time is
    fitted against the number of the sample; where the stamps are right and the sampling jitters, as of phones, the
    values are resampled by a spline. What is wrong makes a smooth signal rough; where that can't be seen, the times
    are taken as even and both possibilities are stated.

    Args:
        time: (T,) [s] stamps.
        values: (C, T) of channels.
        file: for messages.

    Raises:
        InputError: times that are no numbers or do not increase, or too irregular.
    """
    remarks = list[str]()
    rows = held_rows(values)
    if rows is not None:
        rate = 1 / float(np.median(np.diff(time[rows])))
        remarks.append(f"{file}: values repeat, {len(time) / len(rows):.3g} rows each; read at their own {rate:.4g} Hz")
        time, values = time[rows], values[:, rows]
    if (step := steady_step(time, file)) is not None:
        return Even(float(time[0]), step, values, tuple(remarks))
    got, expected, remedy = _oddest(time)
    late = int(np.argmin(np.diff(time)))
    again, order = f"{time[late + 1]:.9g} s after {time[late]:.9g} s", "sort the rows or delete the repeated one"
    require(time[late + 1] > time[late], file, again, "times that increase", order, TIME)
    require(len(time) >= JUDGED_MIN, file, got, expected, remedy, TIME)
    if (even := _unrounded(time)) is not None:
        digit, length = last_digit(time), float(np.ptp(even))
        step = length / (len(time) - 1)
        words = f"even steps of {1e3 * step:.5g} ms were taken instead"
        remarks.append(f"{file}: times are rounded to {digit:g} s; {words}")
        # slope of a line through N stamps, each off by digit / sqrt(12)
        return Even(float(even[0]), step, values, tuple(remarks), digit / np.sqrt(len(time)) / length)
    part = _longest_part(time)
    if part != slice(0, len(time)):
        lost, (first, last) = 1 - (part.stop - part.start) / len(time), time[[part.start, part.stop - 1]]
        got = f"gaps and a drifting clock that leave {100 - 100 * lost:.0f} % of it in one piece"
        require(lost <= LOST_MAX, file, got, f"at least {100 * LOST_MAX:.0f} %", remedy, TIME)
        words = f"read from {first:.6g} to {last:.6g} s, the longest part without a gap or a drift of the clock"
        remarks.append(f"{file}: {words}; {100 * lost:.2g} % of the samples are left out")
        time, values = time[part], values[:, part]
    return _resampled(time, values, file, remarks)


def _resampled(time: np.ndarray, values: np.ndarray, file: str, remarks: list[str]) -> Even:
    from scipy.interpolate import make_interp_spline

    number, fitted = even_clock(time)
    believed = believed_clock(time, fitted, values)
    step, late = float(fitted[-1] - fitted[0]) / number[-1], float((time - fitted).std())
    rms = float(np.diff(time - fitted).std()) if believed == "true" else late
    got = f"{'steps' if believed == 'true' else 'times'} off even ones by {1e3 * rms:.3g} ms rms"
    expected, remedy = f"at most {1e3 * JITTER_MAX * step:.3g} ms", "let the sensor stamp the samples, or sample faster"
    require(rms <= JITTER_MAX * step or believed == "even", file, got, expected, remedy, TIME)
    error = late * np.sqrt(12 / len(time)) / float(fitted[-1] - fitted[0])
    if believed == "true":
        remarks.append(f"{file}: {got}; the times are taken as true, and the values were resampled")
        source, error = time, 0.0
    else:
        source = fitted
        if late > UNEVEN * step:
            low = f"amplitudes at {LINE:g} Hz are low by {50 * (2 * np.pi * LINE * late) ** 2:.2g} % and noise is added"
            other = "" if believed else f"; if they are true, {low}"
            remarks.append(f"{file}: {got}; even steps of {1e3 * step:.5g} ms were taken instead{other}")
        if number[-1] + 1 == len(time):
            return Even(float(fitted[0]), step, values, tuple(remarks), error)
        remarks.append(f"{file}: single missing samples were interpolated, {number[-1] + 1 - len(time):.0f} in all")
    if longest := max(map(clipped, values)):
        remarks.insert(0, f"{file}: clipped, up to {longest} samples in a row at an extreme value")
    even = source[0] + step * np.arange(int((source[-1] - source[0]) / step + 1e-6) + 1)
    values = make_interp_spline(source, values.T, k=DEGREE)(even).T
    band = trusted_band(source, even)
    cost = f"amplitudes are right within {100 * ERROR_MAX:g} % up to {band:.3g} Hz"
    return Even(float(even[0]), step, values, (*remarks[:-1], f"{remarks[-1]}: {cost}"), error, band)


def held_rows(values: np.ndarray) -> np.ndarray | None:
    """Return the rows with new values of channels (C, T) that repeat each value; None where they do not."""
    sizes = abs(np.diff(values))
    changes = np.flatnonzero(sizes.any(0))
    if len(changes) < JUDGED_MIN:
        return None
    apart = np.diff(changes, prepend=-values.shape[1], append=2 * values.shape[1])
    least = np.where(sizes > 0, sizes, np.inf).min(1, keepdims=True)
    alone = (np.minimum(apart[:-1], apart[1:]) > 1) & (sizes > HELD_STEP * least)[:, changes].any(0)
    if alone.mean() <= 0.5:
        return None
    each, new = float(np.median(apart)), changes + 1
    ends = [new[0] - each * (new[0] // each), *new, values.shape[1]]
    parts = [np.linspace(a, b, max(round((b - a) / each), 1), endpoint=False) for a, b in pairwise(ends)]
    return np.unique(np.concatenate(parts).round().astype(int))


def _longest_part(time: np.ndarray) -> slice:
    """Return the longest part without a gap, or a clock that drifts as where samples were lost."""
    from scipy.ndimage import median_filter

    steps = np.diff(time)
    usual = float(np.median(steps))
    if _in_bursts(steps):
        return slice(0, len(time))
    off = steps / usual - np.maximum(np.rint(steps / usual), 1)
    spread = 1.4826 * float(np.median(abs(off - np.median(off))))
    drift = median_filter(off, WINDOW, mode="constant", cval=float(np.median(off)))  # single late stamps are none
    odd = (steps >= GAP * usual) | (abs(drift) > max(UNEVEN, DRIFT_SE * spread / np.sqrt(WINDOW)))
    ends = np.concatenate([[-1], np.flatnonzero(odd), [len(steps)]])
    longest = int(np.argmax(np.diff(ends)))
    return slice(int(ends[longest]) + 1, int(ends[longest + 1]) + 1)


def even_clock(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of each sample's step (T,), and even times (T,) [s] fitted to the stamps.

    Samples are missing where steps are twice the usual ones; stamps in bursts can't tell, and count one by one.
    """
    steps = np.diff(time)
    counts = np.ones_like(steps) if _in_bursts(steps) else np.rint(steps / np.median(steps))
    number = np.append(0.0, np.cumsum(counts))
    step, start = np.polyfit(number, time, 1)
    return number, start + step * number


def truer_times(time: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Return even times (T,) [s] to take instead of stamps that are rounded, or late; None if the stamps will do."""
    steps = np.diff(time)
    if len(time) < JUDGED_MIN or not (steps > 0).all() or abs(steps - steps.mean()).max() <= UNEVEN * steps.mean():
        return None
    if (unrounded := _unrounded(time)) is not None:
        return unrounded
    _, even = even_clock(time)
    exact = abs(time - even).max() < UNEVEN**2 * steps.mean()
    return even if not exact and believed_clock(time, even, values) == "even" else None


def _unrounded(time: np.ndarray) -> np.ndarray | None:
    """Return even times (T,) [s] to which stamps are rounded, however coarsely; None where they are no such ones."""
    number = np.arange(len(time))
    even = np.polyval(np.polyfit(number, time, 1), number)
    return even if abs(time - even).max() <= last_digit(time) else None  # False for no digit, nan


def _in_bursts(steps: np.ndarray) -> bool:
    """Whether stamps come in bursts, as packets arrive: most of the time lies between few of them."""
    counts = np.rint(steps / np.median(steps))
    return bool(counts.min() < 1 or len(counts) < (1 - LOST_MAX) * counts.sum())


def believed_clock(time: np.ndarray, even: np.ndarray, values: np.ndarray) -> str:
    """Return which times make values (C, T) smoother, `true` or `even`; empty where neither does.

    Compares second differences, each divided by the noise of its three samples, so that pure noise gives no preference.
    Stamps that wander off even ones, as the sum of independent errors of the intervals does, can only be true.
    """
    off = time - even
    if off.std() < UNEVEN**2 * np.median(np.diff(time)):
        return "even"
    if off.std() > max(WANDER_MIN, WANDER * np.sqrt(len(off))) * np.diff(off).std() > 0:
        return "true"
    scaled = values / np.where(np.ptp(values, axis=1) > 0, np.ptp(values, axis=1), 1.0)[:, None]
    true_one, even_one = (_roughness(t, scaled) for t in (time, even))
    least = 1 + SMOOTHER / np.sqrt(len(time))
    return "even" if true_one > least * even_one else "true" if even_one > least * true_one else ""


def _roughness(time: np.ndarray, values: np.ndarray) -> float:
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    weights = np.stack([after, -before - after, before]) / np.sqrt(2 * (before**2 + before * after + after**2))
    return float(np.square(sum(weights[k] * values[:, k : len(time) - 2 + k] for k in range(3))).sum())


def trusted_band(time: np.ndarray, even: np.ndarray) -> float:
    """Return the frequency [Hz] up to which a spline from times to even ones keeps amplitudes within `ERROR_MAX`."""
    from scipy.interpolate import make_interp_spline

    time, even = time[:CHUNK], even[:CHUNK]
    even = even[(even >= time[0]) & (even <= time[-1])]
    rate, good = (len(even) - 1) / float(even[-1] - even[0]), 0.0
    for share in np.arange(0.05, 0.5, 0.05):
        turn = 2j * np.pi * share * rate
        waves = np.exp(turn * time)
        splined = make_interp_spline(time, np.stack([waves.real, waves.imag]).T, k=DEGREE)(even)
        amplitude = abs(np.vdot(np.exp(turn * even), splined[:, 0] + 1j * splined[:, 1])) / len(even)
        if abs(amplitude - 1) > ERROR_MAX:
            break
        good = float(share * rate)
    return good


def even_step(time: np.ndarray, file: str, column: str = "time") -> float:
    """Return the mean interval of times [s], or of frequencies [Hz].

    Raises:
        InputError: they are not numbers, do not increase, or are uneven by more than 1 % and by more than their last
            digit.
    """
    step = steady_step(time, file, column)
    require(step is not None, file, *_oddest(time), column)
    assert step is not None
    return step


def steady_step(time: np.ndarray, file: str, column: str = "time") -> float | None:
    """Return the mean interval of times; None where they are uneven, see `even_step`."""
    is_finite = np.isfinite(time).all()
    require(is_finite, file, "times that are no numbers", "times that increase", "export it again", column)
    steps = np.diff(time)
    mean = float(steps.mean())
    if mean > 0 and abs(steps - mean).max() <= UNEVEN * mean:
        return mean
    digit = last_digit(time) + 4 * float(np.spacing(abs(time).max()))
    return mean if rounded_step(time, digit) is not None else None


def _oddest(time: np.ndarray) -> tuple[str, str, str]:
    """Return the interval farthest from the median one, the expectation, and the remedy."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    worst = int(np.argmax(abs(steps - usual)))
    remedy = "record it again, with the sensor's own clock; if only its times are rounded, write more digits"
    if abs(np.delete(steps, worst) - usual).max(initial=0.0) <= UNEVEN * usual and steps[worst] > GAP * usual:
        remedy = "cut the recording there, or record it again"
    got = f"an interval of {steps[worst]:.6g} s before sample {worst + 2}, from {time[worst]:.6g} s"
    return got, f"{usual:.6g} s within 1 %, the median interval", remedy


def last_digit(time: np.ndarray) -> float:
    """Return the largest power of ten that divides all times [s] as printed; nan for none above 1e-12 s."""
    for power in range(13):
        scaled = time * 10.0**power
        if (abs(scaled - np.rint(scaled)) <= 1e-9 * np.maximum(abs(scaled), 1.0)).all():
            return 10.0**-power
    return float("nan")


def rounded_step(time: np.ndarray, digit: float, said: float | None = None, fine: float = 0.0) -> float | None:
    """Return the step of times [s] that are even within their last printed digit; None if they are not.

    Args:
        time: (T,) [s]
        digit: [s] last printed digit of the times.
        said: [s] step stated in the file, returned if the times agree with it.
        fine: [s] last digit of the stated step.
    """
    number, passed = np.arange(len(time)), time - time[0]
    if said is not None and float(abs(passed - said * number).max()) <= digit:
        return said
    if len(time) < 2:
        return float("nan")
    mean = float(passed[-1]) / (len(time) - 1)
    agrees = said is None or abs(mean - said) <= min(fine / 2 + digit / (len(time) - 1), ROUNDED * said)
    return mean if agrees and float(abs(passed - mean * number).max()) <= min(digit, COARSE * mean) else None
