"""Where along a motion a pulley turns at a natural frequency of the arm, or near it, and how long."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.labels import Label
from ident.errors import InputError, Problem
from ident.vibrate.modal.branches import Branches
from ident.vibrate.modal.excitation import Excitation, Source
from ident.vibrate.modal.resonance_passage import magnification, sweep_number

MARGIN = 0.1
"""Distance from a natural frequency, relative to it, that counts as near."""
UNLIKELY = 0.05
"""Share of a batch below which its coming near opens no interval."""
TINY = 1e-9
"""Least sweep rate [Hz/s], so that nothing is divided by zero."""


@dataclass(frozen=True)
class ResonanceCrossing:
    """An interval of time in which an excitation is near a natural frequency.

    With a batch of arms the branch is the median over them, and an interval is opened where 5 % of them are near too.

    Attributes:
        source: what excites.
        branch: which branch.
        label: of the branch at the closest approach.
        start: () [s]
        end: () [s]
        time: () [s] of the closest approach; of several crossings, the slowest.
        posture: (driven,) [rad] then.
        natural: () [Hz] natural frequency then.
        excitation: () [Hz] then.
        damping_ratio: () [-] of the mode then.
        margin: () [-] distance relative to the natural frequency that counts as near, then.
        rate: () [Hz/s] of the excitation relative to the natural frequency then.
        crossings: [s] times at which both frequencies are equal.
        cycles: () [-] cycles of the mode from start to end.
        sweep_number: () [-] rate / (zeta f)^2, see `resonance_passage`.
        magnification: () [-] largest estimated amplitude of the mode, over its static response to the same force.
        probability: () [-] share of the batch that the excitation comes near within the interval; 1 without a batch.
        crossing_probability: () [-] share of the batch whose frequency it crosses there; 1 or 0 without a batch.
        swells_until: () [s] until when the mode may swell, behind the end where it was crossed.
        amplitude: () [m] of the end point by this source alone meanwhile, see `caused_vibration`; NaN if not computed.
    """

    source: Source
    branch: int
    label: Label
    start: float
    end: float
    time: float
    posture: tuple[float, ...]
    natural: float
    excitation: float
    damping_ratio: float
    margin: float
    rate: float
    crossings: tuple[float, ...]
    cycles: float
    sweep_number: float
    magnification: float
    probability: float
    crossing_probability: float
    swells_until: float
    amplitude: float = np.nan

    @property
    def distance(self) -> float:
        """Smallest distance of the frequencies [Hz]; exactly 0 for a crossing."""
        return 0.0 if self.crossings else abs(self.excitation - self.natural)

    @property
    def relative_distance(self) -> float:
        """Smallest distance relative to the natural frequency [-]."""
        return self.distance / self.natural

    @property
    def built_up(self) -> float:
        """Estimated amplitude over that of steady resonance, 1 / (2 zeta) [-]."""
        return self.magnification * 2 * self.damping_ratio

    @property
    def severity(self) -> float:
        """Magnification times probability [-], by which crossings are ordered without amplitudes."""
        return self.magnification * self.probability


def resonance_crossings(
    branches: Branches, excitation: Excitation, *, margin: float = MARGIN
) -> tuple[ResonanceCrossing, ...]:
    """Return the intervals in which an excitation is near a natural frequency, the most severe first.

    Near: |f_exc - f| < max(margin, 2 zeta) f, 2 zeta f the half-power bandwidth. A pulley that does not turn is never
    near. Between two times frequencies are taken for straight lines.

    Args:
        branches: natural frequencies over time.
        excitation: at the same times.
        margin: () [-] above 0 and below 1.
    """
    if not 0 < margin < 1:
        raise InputError(Problem("margin", f"{margin:g}", "above 0 and below 1", "0.1 is 10 % of the frequency"))
    if not np.array_equal(branches.time, excitation.time):
        remedy = "give both the same times"
        raise InputError(Problem("excitation", "other times", "the times of the branches", remedy, "time"))
    crossings = [
        crossing
        for i, source in enumerate(excitation.sources)
        for b in range(len(branches.labels))
        for crossing in _of_pair(branches, b, source, excitation.frequency[i], excitation.rate[i], margin)
    ]
    return tuple(sorted(crossings, key=lambda crossing: (-crossing.severity, crossing.start)))


class _Pair(NamedTuple):
    """One source and one branch over time, (T) each, with the crossings among the times; last the batch (T, S)."""

    time: np.ndarray
    natural: np.ndarray
    damping_ratio: np.ndarray
    margin: np.ndarray
    excitation: np.ndarray
    rate: np.ndarray
    crossing: np.ndarray
    batch_near: np.ndarray
    batch_crosses: np.ndarray

    @property
    def excess(self) -> Float[np.ndarray, "T"]:
        """How far [Hz] the excitation is outside the margin; below 0 it is near."""
        return np.abs(self.excitation - self.natural) - self.margin * self.natural


def _of_pair(
    branches: Branches, b: int, source: Source, frequency: np.ndarray, rate: np.ndarray, margin: float
) -> Iterator[ResonanceCrossing]:
    """Yield the resonance crossings of one source and one branch."""
    pair = _pair(branches, b, frequency, rate, margin)
    near = ((pair.excess < 0) | (pair.batch_near.mean(1) >= UNLIKELY)) & (pair.excitation > 0)
    runs = list(_runs(near))
    if not runs:
        return
    amplitude = magnification(pair.time, pair.natural, pair.damping_ratio, pair.excitation)
    for (first, last), following in zip(runs, [*runs[1:], None], strict=True):
        until = pair.time[following[0] if following else -1]
        yield _crossing(branches, b, source, pair, (first, last), amplitude, float(until))


def _pair(branches: Branches, b: int, frequency: np.ndarray, rate: np.ndarray, margin: float) -> _Pair:
    """Bring one source and one branch onto times that include their crossings."""
    time, natural = branches.time, branches.median[b]
    crossings = _crossings(time, frequency - natural)
    fine = np.union1d(time, crossings)

    def at(values: np.ndarray) -> np.ndarray:
        return np.interp(fine, time, values)

    turning, natural, damping = at(frequency), at(natural), at(branches.median_damping_ratio[b])
    limit = np.maximum(margin, 2 * damping)
    batch = np.stack([at(draw) for draw in branches.draws[b].T], axis=1)
    apart = turning[:, None] - batch
    crossed = np.sign(apart[:-1]) * np.sign(apart[1:]) <= 0
    batch_near = np.abs(apart) < limit[:, None] * batch
    relative = at(rate) - np.gradient(natural, fine)
    return _Pair(fine, natural, damping, limit, turning, relative, np.isin(fine, crossings), batch_near, crossed)


def _crossings(time: Float[np.ndarray, "T"], apart: Float[np.ndarray, "T"]) -> Float[np.ndarray, "crossings"]:
    """Return the times at which a difference is zero; the first one where it stays so."""
    before, after = apart[:-1], apart[1:]
    changes = before * after < 0
    share = before[changes] / (before[changes] - after[changes])
    within = time[:-1][changes] + share * np.diff(time)[changes]
    zero = (apart == 0) & (np.append(1.0, before) != 0)
    return np.union1d(within, time[zero])


def _runs(near: Bool[np.ndarray, "T"]) -> Iterator[tuple[int, int]]:
    """Yield the first and the last place of each run of true values."""
    ends = np.flatnonzero(np.diff(near.astype(int), prepend=0, append=0))
    yield from zip(ends[::2].tolist(), (ends[1::2] - 1).tolist(), strict=True)


def _crossing(
    branches: Branches,
    b: int,
    source: Source,
    pair: _Pair,
    run: tuple[int, int],
    amplitude: np.ndarray,
    until: float,
) -> ResonanceCrossing:
    """Describe the crossing in a run of times; the mode may swell after it, but not longer than until the next."""
    first, last = run
    inside = slice(first, last + 1)
    crossings = first + np.flatnonzero(pair.crossing[inside])
    k = _closest(pair, inside, crossings)
    start, end = _edge(pair, first - 1, first), _edge(pair, last + 1, last)
    rate, natural = float(pair.rate[k]), float(pair.natural[k])
    crossed = pair.batch_crosses[max(first - 1, 0) : last + 1].any(0)
    tail = 1 / np.sqrt(max(abs(rate), TINY)) if len(crossings) else 0.0
    swells_until = max(end, min(end + tail, until))
    swells = (pair.time >= pair.time[first]) & (pair.time <= swells_until)
    return ResonanceCrossing(
        source=source,
        branch=b,
        label=branches.label(b, float(pair.time[k])),
        start=start,
        end=end,
        time=float(pair.time[k]),
        posture=tuple(float(np.interp(pair.time[k], branches.time, angle)) for angle in branches.posture),
        natural=natural,
        excitation=float(pair.excitation[k]),
        damping_ratio=float(pair.damping_ratio[k]),
        margin=float(pair.margin[k]),
        rate=rate,
        crossings=tuple(pair.time[crossings].tolist()),
        cycles=float(pair.natural[inside].mean()) * (end - start),
        sweep_number=sweep_number(rate, natural, float(pair.damping_ratio[k])),
        magnification=float(amplitude[swells].max()),
        probability=float((pair.batch_near[inside].any(0) | crossed).mean()),
        crossing_probability=float(crossed.mean()),
        swells_until=swells_until,
    )


def _closest(pair: _Pair, inside: slice, crossings: np.ndarray) -> int:
    """Return the place of the closest approach: of the crossings the one with the slowest sweep, if there is any."""
    if len(crossings):
        return int(crossings[np.argmin(np.abs(pair.rate[crossings]))])
    return inside.start + int(np.argmin(np.abs(pair.excitation - pair.natural)[inside]))


def _edge(pair: _Pair, outside: int, inside: int) -> float:
    """Return the time [s] at which the margin is entered, between a time outside and its neighbour inside."""
    excess = pair.excess
    if not 0 <= outside < len(excess) or excess[inside] >= 0 or excess[outside] < 0:
        return float(pair.time[inside])
    share = excess[outside] / (excess[outside] - excess[inside])
    return float(pair.time[outside] + share * (pair.time[inside] - pair.time[outside]))
