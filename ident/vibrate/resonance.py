"""Where along a motion a pulley turns at a natural frequency of the arm, or near it, and how long."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm, nominal
from ident.arm.chain import Loads, at_posture
from ident.arm.modes import Label, modes
from ident.arm.multibody import ExcitingOrder, exciting_orders, orders_of
from ident.arm.parts import ORDER_MAX
from ident.errors import refusal
from ident.programs import AnyArray, in_batches, jit
from ident.vibrate.branches import Branches, check, motion_times
from ident.vibrate.motion import Motion
from ident.vibrate.response import runs
from ident.vibrate.simulate import Superposition, superposition

# -------- Excitation
# The frequencies at which the pulleys of an arm excite it along a motion.


@dataclass(frozen=True)
class Source:
    """What excites: a multiple of a pulley's turning frequency.

    Attributes:
        drive: name of the drive.
        joint: name of its joint.
        pulley: its number, that of the joint among the driven ones, from 1.
        order: multiple of the turning frequency: 1 the eccentric mass, 2 and `Drive.errors` transmission errors.
    """

    drive: str
    joint: str
    pulley: int
    order: float

    def __str__(self) -> str:
        return f"pulley {self.pulley}" + (f" x {self.order:g}" if self.order != 1 else "")


@dataclass(frozen=True)
class Excitation:
    """Frequencies that excite the arm along a motion.

    Attributes:
        sources: what excites.
        time: (T,) [s]
        frequency: (sources, T) [Hz]
        rate: (sources, T) [Hz/s] its change over time.
    """

    sources: tuple[Source, ...]
    time: Float[np.ndarray, "T"]
    frequency: Float[np.ndarray, "sources T"]
    rate: Float[np.ndarray, "sources T"]


def excitation(arm: Arm, motion: Motion, *, times: Any = None, orders: Sequence[int] | None = None) -> Excitation:
    """Return the frequencies that the pulleys of an arm excite along a motion.

    Args:
        arm: the arm; of a batch the median.
        motion: of its driven joints.
        times: (T,) [s] ascending; 1001 over the motion when None.
        orders: multiples of every pulley's turning frequency; when None, 1 and its transmission errors'.
    """
    time = motion_times(motion, times)
    check(arm, motion)
    _check_orders(arm, orders)
    joints = [joint.name for joint in arm.driven]
    _, qd, qdd = (np.asarray(x) for x in motion(time))
    sources, frequency, rate = [], [], []
    for drive in nominal(arm).drives:
        j, turns = joints.index(drive.joint), abs(float(drive.ratio)) / (2 * np.pi)
        for order in map(int, orders) if orders else orders_of(nominal(arm))[drive.name]:
            sources.append(Source(drive.name, drive.joint, j + 1, order))
            frequency.append(order * turns * np.abs(qd[j]))
            rate.append(order * turns * np.sign(qd[j]) * qdd[j])
    return Excitation(tuple(sources), time, np.stack(frequency), np.stack(rate))


def _check_orders(arm: Arm, orders: Sequence[int] | None) -> None:
    if not arm.drives:
        remedy = "add a [[drive]] with its ratio to the arm file"
        raise refusal(arm.name, "no drive", "one or more, whose pulleys excite the arm", remedy)
    if orders is not None and (not len(orders) or any(order < 1 or order != int(order) for order in orders)):
        got = ", ".join(f"{order:g}" for order in orders) or "none"
        raise refusal("orders", got, "whole numbers from 1", "1 is the eccentric mass, 2 the error")
    if orders is not None and (max(orders) > ORDER_MAX or len(orders) > ORDER_MAX):
        got = f"{max(orders):g}" if max(orders) > ORDER_MAX else f"{len(orders)} of them"
        raise refusal("orders", got, f"at most {ORDER_MAX}", "leave out what turns so fast")


# -------- Resonance passage
# How far a mode builds up while an excitation passes its natural frequency.

QUASI_STEADY = 3.6
"""Sweep number up to which a mode's response is nearly that to a steady excitation: 216 f^2 zeta^2 Hz a minute."""
STEPS = 20.0
"""Time steps in a cycle of the largest difference of frequencies."""
RATIO = 1e-12
"""Least damping ratio, so that nothing is divided by zero."""


def sweep_number(rate: Float[np.ndarray, ""] | float, frequency: float, damping_ratio: float) -> float:
    """Return eta = |rate| / (zeta f)^2 [-], the sweep rate over the square of half the half-power bandwidth.

    The bandwidth 2 zeta f is passed in 2 zeta f / rate, the mode builds up in 1 / (2 pi zeta f): in 4 pi / eta times
    its time constant. Up to 3.6 (a linear sweep of 216 f^2 zeta^2 Hz a minute) modal testing takes the response for
    steady; far above, the damping hardly matters and an undamped mode reaches 3.67 f / sqrt(rate) times the static
    response.

    Args:
        rate: () [Hz/s] of the excitation relative to the mode.
        frequency: () [Hz] natural frequency.
        damping_ratio: () [-]

    References:
        Lewis, "Vibration during acceleration through a critical speed", Trans. ASME 54, 1932. Ewins, "Modal Testing",
        2nd ed., 2000, 3.9 (the limit of ISO 7626-2).
    """
    return abs(float(rate)) / (max(damping_ratio, RATIO) * frequency) ** 2


def magnification(
    time: Float[np.ndarray, "T"],
    natural: Float[np.ndarray, "T"],
    damping_ratio: Float[np.ndarray, "T"],
    excitation: Float[np.ndarray, "T"],
) -> Float[np.ndarray, "T"]:
    """Return the amplitude of a mode over that of its static response to the same force, from rest at the start.

    One mode with the slowly varying envelope A of its response to a force of constant amplitude, near resonance:

        dA/dt = -2 pi f (zeta - i (1 - f_exc / f)) A + pi f

    so that steady excitation at resonance gives 1 / (2 zeta). Exact in each time step for constant frequencies.

    Args:
        time: (T,) [s] ascending.
        natural: (T,) [Hz]
        damping_ratio: (T,) [-]
        excitation: (T,) [Hz]

    References:
        Lewis, "Vibration during acceleration through a critical speed", Trans. ASME 54, 1932. Nayfeh, Mook, "Nonlinear
        Oscillations", 1979, 2.1 (slowly varying amplitude and phase).
    """
    apart = float(np.abs(natural - excitation).max()) + float(natural.max()) / STEPS
    fine = np.unique(np.concatenate([time, np.arange(time[0], time[-1], 1 / (STEPS * apart))]))
    middle, step = (fine[:-1] + fine[1:]) / 2, np.diff(fine)
    f, zeta, turning = (np.interp(middle, time, x) for x in (natural, damping_ratio, excitation))
    z = 2 * np.pi * (-np.maximum(zeta, RATIO) * f + 1j * (f - turning)) * step
    forced = np.pi * f * step * np.expm1(z) / z
    amplitudes = [0.0]
    state = 0j
    for factor, added in zip(np.exp(z).tolist(), forced.tolist(), strict=True):
        state = factor * state + added
        amplitudes.append(abs(state))
    return np.asarray(amplitudes)[np.searchsorted(fine, time)]


# -------- Resonance

MARGIN = 0.1
"""Distance from a natural frequency, relative to it, that counts as near; assumed."""
UNLIKELY = 0.05
"""Share of a batch below which its coming near opens no interval; assumed."""
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
        """Magnification times probability [-], to rank crossings without amplitudes."""
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
        raise refusal("margin", f"{margin:g}", "above 0 and below 1", "0.1 is 10 % of the frequency")
    if not np.array_equal(branches.time, excitation.time):
        raise refusal("excitation", "other times", "the times of the branches", "give both the same times", "time")
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
    intervals = list(runs(near))
    if not intervals:
        return
    amplitude = magnification(pair.time, pair.natural, pair.damping_ratio, pair.excitation)
    for (first, last), following in zip(intervals, [*intervals[1:], None], strict=True):
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


def _crossing(
    branches: Branches, b: int, source: Source, pair: _Pair, run: tuple[int, int], amplitude: np.ndarray, until: float
) -> ResonanceCrossing:
    """Describe the crossing in a run of times; the mode may swell after it, but not longer than until the next."""
    first, last = run
    inside = slice(first, last + 1)
    crossings = first + np.flatnonzero(pair.crossing[inside])
    if len(crossings):  # the closest approach: of several crossings the one with the slowest sweep
        k = int(crossings[np.argmin(np.abs(pair.rate[crossings]))])
    else:
        k = first + int(np.argmin(np.abs(pair.excitation - pair.natural)[inside]))
    start, end = _edge(pair, first - 1, first), _edge(pair, last + 1, last)
    known = ("time", "natural", "excitation", "damping_ratio", "margin", "rate")
    here = {name: float(getattr(pair, name)[k]) for name in known}
    crossed = pair.batch_crosses[max(first - 1, 0) : last + 1].any(0)
    tail = 1 / np.sqrt(max(abs(here["rate"]), TINY)) if len(crossings) else 0.0
    swells_until = max(end, min(end + tail, until))
    swells = (pair.time >= pair.time[first]) & (pair.time <= swells_until)
    return ResonanceCrossing(
        source=source,
        branch=b,
        label=branches.label(b, here["time"]),
        start=start,
        end=end,
        posture=tuple(float(np.interp(pair.time[k], branches.time, angle)) for angle in branches.posture),
        crossings=tuple(pair.time[crossings].tolist()),
        cycles=float(pair.natural[inside].mean()) * (end - start),
        sweep_number=sweep_number(here["rate"], here["natural"], here["damping_ratio"]),
        magnification=float(amplitude[swells].max()),
        probability=float((pair.batch_near[inside].any(0) | crossed).mean()),
        crossing_probability=float(crossed.mean()),
        swells_until=swells_until,
        **here,
    )


def _edge(pair: _Pair, outside: int, inside: int) -> float:
    """Return the time [s] at which the margin is entered, between a time outside and its neighbour inside."""
    excess = pair.excess
    if not 0 <= outside < len(excess) or excess[inside] >= 0 or excess[outside] < 0:
        return float(pair.time[inside])
    share = excess[outside] / (excess[outside] - excess[inside])
    return float(pair.time[outside] + share * (pair.time[inside] - pair.time[outside]))


# -------- Caused vibration
# The vibration that a resonance crossing causes: how far the end point moves by one pulley alone while it is near.

RATE = 250.0
"""Sampling rate [Hz], sufficient for an envelope, which changes slowly."""
TOGETHER = 32
"""Postures that are filled up to a multiple, so that one program serves nearly all motions."""


def with_amplitudes(
    crossings: Sequence[ResonanceCrossing], arm: Arm, motion: Motion, loads: Loads | None = None
) -> tuple[ResonanceCrossing, ...]:
    """Return resonance crossings with the vibration that each causes, the largest first, each times its probability.

    While the pulley is near and the mode swells: the largest sqrt(c^2 + s^2) of its imbalance (order 1) and its
    transmission error of that order, see `superposition`, in the direction in which the mode moves the end. Other modes
    that the pulley excites meanwhile are in it as far as they move that way.

    Args:
        crossings: along the motion.
        arm: of a batch the median.
        motion: of its driven joints.
        loads: what hangs on the arm.

    Raises:
        InputError, ModelError: see `simulate`.
    """
    if not crossings:
        return ()
    arm = nominal(arm)
    # the phases of all that excites the arm: the same for each motion, as the programs are
    exciting = exciting_orders(arm)
    whole = superposition(arm, motion, [each.phase for each in exciting], loads=loads, rate=RATE)
    ways = _ways(arm, crossings, loads)
    pairs = zip(crossings, ways, strict=True)
    found = (replace(crossing, amplitude=_largest(whole, exciting, crossing, way)) for crossing, way in pairs)
    return tuple(sorted(found, key=lambda crossing: (-crossing.amplitude * crossing.probability, crossing.start)))


def _largest(
    whole: Superposition, exciting: Sequence[ExcitingOrder], crossing: ResonanceCrossing, way: Float[np.ndarray, "3"]
) -> float:
    """Return the largest vibration along a way [m] while a crossing lasts; zero where nothing excites at its order."""
    source, sized = (crossing.source.drive, crossing.source.order), np.zeros(1)
    first, end = np.searchsorted(whole.time, (crossing.start, crossing.swells_until))
    inside = slice(max(int(first) - 1, 0), int(end) + 1)
    for k, each in enumerate(exciting):
        if (each.drive, each.order) == source:
            sized = sized + np.hypot(way @ whole.cosine[k][:, inside], way @ whole.sine[k][:, inside])
    return float(sized.max())


def _ways(arm: Arm, crossings: Sequence[ResonanceCrossing], loads: Loads | None) -> Float[np.ndarray, "crossings 3"]:
    """Return in which direction the mode of each crossing moves the end point."""
    posture = np.array([crossing.posture for crossing in crossings]).T
    frequency, motion = in_batches(lambda some: _modes(arm, some, loads), posture, TOGETHER)
    natural = np.array([crossing.natural for crossing in crossings])
    mode = np.abs(frequency - natural).argmin(0)
    way = motion[:, mode, np.arange(len(crossings))].T
    return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))


@jit
def _modes(
    arm: Arm, posture: Float[AnyArray, "driven K"], loads: Loads | None
) -> tuple[Float[Array, "m K"], Float[Array, "3 m K"]]:
    """Return natural frequencies [Hz] and how each mode moves the end point."""
    each = modes(at_posture(arm, jnp.asarray(posture), loads))
    return each.frequency, each.motion[:, -1]
