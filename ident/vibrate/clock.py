"""The clock of a recorder against that of a motion: offset and rate, found from the trace itself.

A trace holds the motion: an accelerometer feels the rigid acceleration of its point and gravity, and every sensor the
vibration that command and drives excite, whose frequencies follow the speed. Both are computed from the motion, up to
a gain for the former and an amplitude and a phase for each source. For each offset at which record and motion overlap,
least squares leave a share u of a trace's energy below `SPLIT`, and one above. The score -1/2 sum n ln(u + m^2), see
`ident.vibrate.hypotheses`, gives a probability over all offsets. At steady speed an offset is a phase, so all offsets
are alike, and none is returned. Gauss-Newton steps then refine offset and rate together.

References:
    Knapp, Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP 24(4), 1976.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, fftconvolve, sosfiltfilt

from ident.arm.arm import Arm
from ident.arm.multibody import possible_orders
from ident.errors import refusal, require
from ident.vibrate.hypotheses import TRACKS
from ident.vibrate.motion import QUICKEST
from ident.vibrate.unit_response import Response, Run, unit_response

SPLIT = 1.0
"""Frequency [Hz] between the motion itself and its vibration; assumed."""
COARSE = 2 * QUICKEST
"""Least sampling rate [Hz] of the offsets that are tried."""
NYQUIST = 0.4
"""Upper end of a band over the sampling rate, at most: the filter needs room below half of it."""
TINY = 1e-300
"""Added to what may be zero and divides."""
FREE = 1.0
"""Time [s] for each independent number of a trace: model errors last as long as a mode rings; assumed."""
NEAR = 0.25
"""Offsets [s] this close count as one: the search of sources tells them apart, and causes need no better; assumed."""
LOBE = 0.05
"""Distance [s] to the next offset at which a vibration below 10 Hz is in phase again, half of it; assumed."""
RATE_SD = 1e-3
"""Standard deviation of a clock's relative rate: cheap ones differ by some 1e-4 from a controller's; assumed."""
EDGE = 1.0
"""Time [s] at both ends of a record that is left out: a vibration cut there leaves a step behind the filters."""
SHORTEST = 2.0
"""Least length [s] of a record whose clock is found; assumed."""
SETTLING = 2.0
"""Time [s] before and after a record within which its filters see the motion."""
NUDGE = 1e-3
"""Step [s] of the finite difference by time."""
RIDGE = 1e-6
"""Share of a column that counts as rounding where sources turn alike."""
ROUNDS = 4
"""Gauss-Newton rounds: three suffice within a quarter of a period."""

Sampled = tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]
"""Even times [s] and values of a trace."""


class Clock(NamedTuple):
    """A recorder's clock against the motion's, which shows t + offset + rate (t - middle) at the recorder's t.

    Attributes:
        offset: [s] in the middle of the record.
        rate: [-]
        offset_sd: [s] standard error.
        rate_sd: [-]
        middle: [s] of the record, by the recorder's clock.
    """

    offset: float
    rate: float
    offset_sd: float
    rate_sd: float
    middle: float

    def on_motion(self, time: Float[np.ndarray, "T"]) -> Float[np.ndarray, "T"]:
        """Return times of the recorder on the clock of the motion."""
        return time + self.offset + self.rate * (time - self.middle)

    def __str__(self) -> str:
        rate = f"rate {1e6 * self.rate:+.0f} ± {1e6 * self.rate_sd:.0f} ppm"
        return f"delay {self.offset:+.4f} ± {self.offset_sd:.1g} s, {rate}"


class _Band(NamedTuple):
    """A trace in one band.

    Attributes:
        sensor: its number in the run.
        time: (T,) [s] even, by the recorder's clock.
        filter: second-order sections.
        thin: every so many samples count.
        values: (T / thin,) behind the filter, about their mean.
        profile: whether the motion alone is in it, without any source.
    """

    sensor: int
    time: np.ndarray
    filter: np.ndarray
    thin: int
    values: np.ndarray
    profile: bool

    @property
    def step(self) -> float:
        """Time [s] between samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def columns(self, response: Response, time: np.ndarray) -> np.ndarray:
        """Return what the motion and each source make of it at even times (T / thin, K); the arm rests outside."""
        seen, direction, felt = response.curves[self.sensor]
        order, at = response.run.sensors[self.sensor].derivative, np.clip(time, response.time[0], response.time[-1])
        values = seen(at, nu=order)
        if order:
            values[time != at] = 0.0
        values = (values if felt is None else values + felt(at)).reshape((len(time), 3, -1))
        columns = np.einsum("sik,si->sk", values[..., :1] if self.profile else values, direction(at))
        return np.asarray(sosfiltfilt(self.filter, columns, axis=0)[:: self.thin])

    def scores(self, response: Response) -> tuple[np.ndarray, np.ndarray]:
        """Return offsets [s] at which record and motion overlap, and the score [nat] of each."""
        step, count = self.thin * self.step, len(self.values)
        low = float(response.time[0]) - float(self.time[-1])
        tried = int((float(response.time[-1]) - float(self.time[0]) - low) / step)
        columns = self.columns(response, self.time[0] + low + self.step * np.arange((tried + count) * self.thin))
        columns /= np.sqrt(np.mean(columns**2, 0)) + TINY
        right = fftconvolve(columns, self.values[::-1, None], mode="valid", axes=0)
        whole = np.concatenate([np.ones((len(columns), 1)), columns], 1)
        sums = np.cumsum(np.vstack([np.zeros((1, *2 * whole.shape[1:])), whole[:, :, None] * whole[:, None]]), 0)
        sums = sums[count:] - sums[:-count]
        normal = sums[:, 1:, 1:] - sums[:, 1:, :1] * sums[:, :1, 1:] / count + RIDGE * count * np.eye(right.shape[1])
        right = np.maximum(right, 0.0) if self.profile else right
        explained = np.einsum("jk,jk->j", right, np.linalg.solve(normal, right[..., None])[..., 0])
        left = np.clip(1 - explained / (self.values @ self.values), 0.0, 1.0)
        return low + step * np.arange(tried + 1), -count * step / FREE / 2 * np.log(left + TRACKS.misfit**2)


def find_clock(arm: Arm, run: Run, traces: Sequence[Sampled]) -> Clock:
    """Return the clock of the recorder of a run.

    Args:
        arm: the arm; natural frequencies that are 5 % off shift the offset by some milliseconds beyond its error.
        run: the motion and its sensors.
        traces: times [s] by the recorder's clock, and values, of each sensor.

    Raises:
        InputError: see `agreeing` and `simulate`.
        ModelError: the arm collapses.
    """
    return agreeing(unit_response(arm, run, possible_orders(arm)), traces)


def agreeing(response: Response, traces: Sequence[Sampled]) -> Clock:
    """Return the clock with which traces agree best with the response of their sensors to motion and sources.

    Raises:
        InputError: no offset agrees better than all others, as at a steady speed.
    """
    bands = [band for sensor, trace in enumerate(traces) for band in _bands(response, sensor, *trace)]
    pairs = [band.scores(response) for band in bands]
    offsets = pairs[-1][0]
    score = np.sum([np.interp(offsets, *pair) for pair in pairs], 0)
    chance = np.exp(score - score.max())
    best = float(offsets[chance.argmax()])
    near = abs(offsets - best) <= NEAR
    if chance[near].sum() < TRACKS.sure * chance.sum():
        other = float(offsets[~near][chance[~near].argmax()])
        got = f"a clock {best:+.2f} or {other:+.2f} s off the motion's, which agree alike"
        remedy = "record from standstill through start and stop, check speed, path and direction, or give `delay`"
        raise refusal(response.run.name, got, "one offset that agrees best", remedy)
    lobes = near & (abs(offsets - best) > LOBE)
    return _refined(response, bands, best, float(np.sqrt(chance[lobes] @ (offsets[lobes] - best) ** 2 / chance.sum())))


def _bands(response: Response, sensor: int, time: np.ndarray, values: np.ndarray) -> Iterator[_Band]:
    """Yield the bands of a trace: of an acceleration the profile as well."""
    rate = (len(time) - 1) / float(time[-1] - time[0])
    thin, edge = max(1, int(rate / COARSE)), min(round(EDGE * rate), len(time) // 8)
    inside = slice(edge, len(time) - edge)
    got, remedy = f"{len(time) / rate:.3g} s of record", "record the whole motion"
    require(len(time) >= SHORTEST * rate, response.run.name, got, f"at least {SHORTEST:g} s to find its clock", remedy)
    for profile in (True, False) if response.run.sensors[sensor].derivative == 2 else (False,):
        edges = SPLIT if profile else (SPLIT, min(QUICKEST, NYQUIST * rate))
        filter = butter(4, edges, "lowpass" if profile else "bandpass", fs=rate, output="sos")
        kept = sosfiltfilt(filter, values - values.mean())[inside][::thin]
        yield _Band(sensor, time[inside], filter, thin, kept - kept.mean(), profile)


def _refined(response: Response, bands: Sequence[_Band], offset: float, lobes: float) -> Clock:
    """Return offset and rate of least residual near an offset, with standard errors.

    Residuals count as white, their variance by so much larger as the scores of blocks of `FREE` vary more than that.
    """
    middle, known = float(bands[0].time.mean()), np.diag([0.0, RATE_SD**-2])
    place = np.array([offset, 0.0])
    for _ in range(ROUNDS):
        normal, blocks = np.zeros((2, 2)), np.zeros((max(1, int(np.ptp(bands[0].time) / FREE)), 2))
        for band in bands:
            beyond = round(SETTLING / band.step / band.thin)
            time = band.time[0] + band.step * np.arange(-beyond * band.thin, len(band.time) + beyond * band.thin)
            at = time + place[0] + place[1] * (time - middle)
            seen = [band.columns(response, at + nudge)[beyond:][: len(band.values)] for nudge in (0.0, -NUDGE, NUDGE)]
            columns, before, after = (each - each.mean(0) for each in seen)
            columns /= (scale := np.sqrt(np.mean(columns**2, 0)) + TINY)
            gram = columns.T @ columns + RIDGE * len(columns) * np.eye(len(scale))
            parts = np.linalg.solve(gram, columns.T @ band.values)
            slope = ((after - before) / scale @ parts / (2 * NUDGE))[:, None] * np.ones((1, 2))
            slope[:, 1] *= band.time[:: band.thin] - middle
            slope -= columns @ np.linalg.solve(gram, columns.T @ slope)
            rest = band.values - columns @ parts
            noise = float(np.mean(rest**2)) + TINY
            normal += slope.T @ slope / noise
            blocks += [each.sum(0) for each in np.array_split(slope * rest[:, None] / noise, len(blocks))]
        wide = max(1.0, *(np.square(blocks).sum(0) / np.diag(normal)).tolist())
        covariance = np.linalg.inv(normal / wide + known)
        place = place + covariance @ (blocks.sum(0) / wide - known @ place)
    sd = np.sqrt(np.diag(covariance))
    return Clock(float(place[0]), float(place[1]), float(np.hypot(sd[0], lobes)), float(sd[1]), middle)
