"""The prescribed motion of the pins as a value: joint angles over time, as piecewise polynomials."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int
from numpy.polynomial import Polynomial
from ruckig import InputParameter, Result, Ruckig, Trajectory

from ident.arm.arm import Arm, Joint
from ident.arm.chain import Loads
from ident.arm.multibody import Command, Multibody
from ident.arm.parts import Stroke
from ident.errors import ModelError, Problem, refusal, refuse
from ident.programs import AnyArray, library
from ident.text import no_such

JOINED = 1e-9
"""Largest jump of an angle [rad] between two pieces treated as zero."""

FEW = 64
"""Number of breaks up to which comparison with all is faster than a search, within a compiled program."""

QUICKEST = 25.0
"""Frequency [Hz] up to which drives and paths excite vibration; assumed."""
FASTEST = 1000.0
"""Highest speed override [%]."""

State = tuple[Float[AnyArray, "driven *t"], Float[AnyArray, "driven *t"], Float[AnyArray, "driven *t"]]
"""Angles [rad], their velocities [rad/s] and accelerations [rad/s^2], each `(driven, *t.shape)`."""


class Motion(eqx.Module):
    """Joint angles over time as piecewise polynomials; held still before the first break and from the last one on.

    q(t) = sum over n of c_n (t - breaks[k])^n for breaks[k] <= t < breaks[k + 1]. Angles are continuous; velocity and
    acceleration may jump at a break, where a call gives the values after the jump.

    Attributes:
        name: name of the motion.
        breaks: (pieces + 1,) [s] times at which some derivative may jump.
        coefficients: (powers, pieces, driven) [rad/s^n] highest power first, as in `scipy.interpolate.PPoly`.
        arrival: () [s] when the arm arrives and dwell begins, on the clock of `breaks`; the end, when not given.
    """

    name: str = eqx.field(static=True)
    breaks: Float[AnyArray, " breaks"]
    coefficients: Float[AnyArray, "powers pieces driven"]
    arrival: float = eqx.field(static=True)

    def __init__(self, name: str, breaks: Any, coefficients: Any, arrival: float | None = None):
        self.name = name
        self.breaks, self.coefficients = _kept(breaks), _kept(coefficients)
        self.arrival = float(self.breaks[-1] if arrival is None else arrival)

    def __check_init__(self) -> None:
        if isinstance(self.breaks, jax.core.Tracer) or isinstance(self.coefficients, jax.core.Tracer):
            return
        problem = next(_faults(np.asarray(self.breaks), np.asarray(self.coefficients), self.arrival), None)
        if problem:
            raise refusal(self.name, *problem)

    @property
    def duration(self) -> Float[ArrayLike, ""]:
        """Time [s] from the first break to the last."""
        return self.breaks[-1] - self.breaks[0]

    def __call__(self, t: ArrayLike) -> State:
        """Return angles, velocities and accelerations at times t.

        Works under `jit` and `vmap`; differentiable in t (within a piece) and in the coefficients. Where nothing
        is traced the arrays are NumPy's.

        Args:
            t: (*t) [s]

        Returns:
            q, qd, qdd: each (driven, *t) [rad, rad/s, rad/s^2]; at a break the values on the piece after it.
        """
        xp, time, breaks, _ = self._arrays(t)
        first, last = breaks[0], breaks[-1]
        moves = (time >= first) & (time < last)
        piece = last_before(breaks, time)
        at = xp.where(moves, time, xp.where(time < first, first, last))
        q, qd, qdd = self.on_piece(xp.clip(piece, 0, len(breaks) - 2), at)
        return q, xp.where(moves, qd, 0.0), xp.where(moves, qdd, 0.0)

    def on_piece(self, k: int | Int[ArrayLike, "*t"], t: ArrayLike) -> State:
        """Return what a call returns, by the polynomial of piece k: at a break, the values on either side of it.

        Args:
            k: (*t) or () the piece, from 0.
            t: (*t) [s]; beyond the piece its polynomial goes on.

        Returns:
            q, qd, qdd: each (driven, *t) [rad, rad/s, rad/s^2]
        """
        xp, time, breaks, coefficients = self._arrays(t, k)
        piece = xp.broadcast_to(xp.asarray(k), time.shape)
        return _horner(xp, xp.moveaxis(coefficients[:, piece], -1, 1), xp.asarray(time - breaks[piece]))

    def _arrays(self, t: ArrayLike, *more: Any) -> tuple[Any, Any, Any, Any]:
        """Return NumPy, or jax where anything is traced, with times, breaks and coefficients as its arrays."""
        xp = library(t, self.breaks, self.coefficients, *more)
        return xp, xp.asarray(t, float), xp.asarray(self.breaks), xp.asarray(self.coefficients)

    def dwell(self, seconds: float) -> "Motion":
        """Return the motion held still at its end for some time; the arrival stays."""
        if not 0 <= seconds < math.inf:
            expected = "a finite time of at least 0 s"
            raise refusal("", f"{seconds:g} s", expected, "correct the time", "dwell")
        if seconds == 0:
            return self
        q, _, _ = self.on_piece(len(self.breaks) - 2, self.breaks[-1])
        xp, _, breaks, moving = self._arrays(0.0, q)
        still = xp.concatenate([xp.zeros_like(moving[:-1, :1]), q[None, None]])
        coefficients = xp.concatenate([moving, still], axis=1)
        return Motion(self.name, xp.concatenate([breaks, breaks[-1:] + seconds]), coefficients, self.arrival)

    def at_speed(self, percent: float) -> "Motion":
        """Return the same path on another clock: with s = percent / 100, t -> t/s, qd -> s qd, qdd -> s^2 qdd."""
        if not 0 < percent <= FASTEST:
            remedy = "100 is full speed, 10 a tenth of it"
            raise refusal("", f"{percent:g} %", f"above 0 and at most {FASTEST:g} %", remedy, "percent")
        s = percent / 100
        powers = np.arange(len(self.coefficients))[::-1, None, None]
        return Motion(self.name, self.breaks / s, self.coefficients * s**powers, self.arrival / s)


@dataclass(frozen=True)
class MovingTrace:
    """A trace of the moving arm.

    Attributes:
        time: (T,) [s] uniform, on the motion's clock up to a small offset.
        values: (T,) [any] displacement, velocity or acceleration in one direction.
        motion: the commanded motion.
        loads: the load case.
    """

    time: Float[np.ndarray, "T"]
    values: Float[np.ndarray, "T"]
    motion: Motion
    loads: Loads | None = None


def last_before(starts: Float[AnyArray, "n"], time: Float[AnyArray, "*t"]) -> Int[AnyArray, "*t"]:
    """Return the index of the last start not after each time; -1 if all are later."""
    if library(starts, time) is np:
        return np.asarray(np.searchsorted(starts, time, side="right") - 1)
    method = "compare_all" if len(starts) <= FEW else "scan"
    return jnp.searchsorted(jnp.asarray(starts), time, side="right", method=method) - 1


def _horner(
    xp: Any, c: Float[AnyArray, "powers driven *t"], x: Float[AnyArray, "*t"]
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Return the polynomial c (powers, driven, *t) at x (*t), with its first and second derivative."""
    p, d, half_dd = c[0], xp.zeros_like(c[0]), xp.zeros_like(c[0])
    for lower in c[1:]:
        half_dd = half_dd * x + d
        d = d * x + p
        p = p * x + lower
    return p + 0.0 * x, d, 2.0 * half_dd


def _kept(values: Any) -> Any:
    return values if isinstance(values, jax.Array) else np.asarray(values, float)


def _faults(
    breaks: Float[np.ndarray, " breaks"], c: Float[np.ndarray, "powers pieces driven"], arrival: float
) -> Iterator[tuple[str, str, str]]:
    """Yield fault, expectation and remedy, the most basic fault first."""
    if len(breaks) < 2 or c.shape[1] != len(breaks) - 1 or 0 in c.shape:
        shape = f"coefficients {c.shape}"
        yield f"{len(breaks)} breaks and {shape}", "one break more than pieces", "give (powers, pieces, driven)"
    if not (np.isfinite(breaks).all() and np.isfinite(c).all()):
        yield "a break or coefficient that is not finite", "finite numbers", "correct the motion"
    steps = np.diff(breaks)
    if (steps <= 0).any():
        back = int(np.argmax(steps <= 0))
        yield f"a break at {breaks[back + 1]:g} s after {breaks[back]:g} s", "breaks that increase", "sort the pieces"
    ends = reduce(lambda p, lower: p * steps[:, None] + lower, c)
    jumps = np.abs(ends[:-1] - c[-1, 1:])
    if (jumps > JOINED).any():
        k, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
        got = f"a jump of {jumps[k, joint]:.3g} rad of q{joint + 1} at {breaks[k + 1]:g} s"
        yield got, f"angles that join within {JOINED:g} rad", "correct the pieces"
    if not breaks[0] <= arrival <= breaks[-1]:
        yield f"arrival at {arrival:g} s", f"a time from {breaks[0]:g} to {breaks[-1]:g} s", "correct the arrival"


def lengths(angles: Float[np.ndarray, "driven T"]) -> Float[np.ndarray, "T"]:
    """Return the length of a path in the space of joint angles up to each of its points [rad]."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(angles, axis=1), axis=0)))


# -------- Command
# The command of the motors at given times: a motion as input of the equations of motion.


def command(model: Multibody, motion: Motion, times: Float[AnyArray, "T"]) -> Command:
    """Return the command of the motors at times [s], with singleton axes for the model's batch."""
    ones = tuple(range(2, model.offset.ndim - 1))
    return Command(*(library(part).expand_dims(part, ones) for part in motion(times)))


# -------- Limits
# Whether a motion stays within the joint limits, by the extrema of its polynomials.


def beyond_limits(arm: Arm, motion: Motion) -> None:
    """Refuse a motion beyond the joint limits, also between its breaks: checks all extrema, not samples.

    Args:
        arm: the arm.
        motion: of as many joints as the arm drives.
    """
    check_joints(arm, motion)
    refuse(problem for number, joint in enumerate(arm.driven) for problem in _beyond(motion, number, joint))


def check_joints(arm: Arm, motion: Motion) -> None:
    """Refuse a motion whose joints are not the arm's."""
    driven = motion.coefficients.shape[-1]
    if driven != len(arm.driven):
        expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
        raise refusal(motion.name, f"{driven} joint angles", expected, "give every joint's angle")


def _beyond(motion: Motion, number: int, joint: Joint) -> Iterator[Problem]:
    c, breaks = np.asarray(motion.coefficients)[..., number], np.asarray(motion.breaks)
    low, high = joint.limits
    spans, n, times = np.diff(breaks), len(c) - 1, breaks
    # A piece stays within its Bernstein coefficients, b_j = sum over k <= j of C(j, k) / C(n, k) a_k: where these leave
    # the limits it may turn back beyond them. SciPy's take longer to import than a simulation to compute.
    of_powers = np.array([[math.comb(j, k) / math.comb(n, k) for k in range(n + 1)] for j in range(n + 1)])
    bounds = of_powers @ (c[::-1] * spans ** np.arange(n + 1)[:, None])
    for k in np.flatnonzero((bounds.min(axis=0) < low) | (bounds.max(axis=0) > high)).tolist():
        roots = np.roots(np.polyder(c[:, k]))
        within = (abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < spans[k])
        times = np.append(times, breaks[k] + roots.real[within])
    angles = np.asarray(motion(times)[0])[number]
    excess = np.maximum(low - angles, angles - high)
    worst = int(np.argmax(excess))
    if excess[worst] > JOINED:
        angle = math.degrees(angles[worst])
        got = f"a motion beyond the joint limits: {joint.name} at {angle:.6g} deg at {times[worst]:.4g} s"
        expected = f"{math.degrees(low):.4g} to {math.degrees(high):.4g} deg, its limits in the arm file"
        yield Problem(motion.name, got, expected, "shorten the path, or correct the limits")


# -------- Stroke
# The straight stroke of the arm, extension and retraction, as fast as its limits allow.

CYCLOID_PIECES, CYCLOID_DEGREE = 8, 13
"""Number and degree of polynomials for the cycloid: exact to the last digit, and to 1e-13 in acceleration."""
ROUNDING = 1e-12
"""Duration of a piece, as a fraction of the total, below which it is only rounding."""


def stroke(
    path: Stroke, *, percent: float = 100.0, profile: str | None = None, retract: bool = False, dwell: float = 0.0
) -> Motion:
    """Return the motion along the straight path, from rest to rest, the shortest of its profile within the limits.

    `s-curve` has bounded jerk, `trapezoid` ignores the jerk limit, both are time-optimal; `cycloid` is
    alpha = s - sin(2 pi s) / (2 pi), s = t/T, and `minimum-jerk` alpha = 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan,
    J. Neurosci. 5, 1985), of the shortest T within all three limits. Not differentiable in path and limits, which are
    numbers.

    The percentage p slows the clock: speed x p, acceleration x p^2, jerk x p^3, so the same path is passed with the
    same shape of motion over time, only more slowly. So does the speed override of common robot controllers; that
    the controller of the arm at hand does so too is our assumption.

    Args:
        path: the path q = alpha direction on which the hand moves straight, and the limits of alpha at 100 %, that of
            its third derivative may be infinite.
        percent: () [%] speed override, above 0 and at most 1000.
        profile: a name in `PROFILES`; that of the path when None.
        retract: from unfolded to folded instead of the other way.
        dwell: () [s] dwell time at the end.

    Returns:
        The motion of all driven joints; it starts at time 0 and arrives before it dwells.

    Raises:
        InputError: a percentage, profile, dwell, path or limit that can't be.
        ModelError: the library finds no motion.
    """
    limits, profile = _limits(path), path.profile if profile is None else profile
    if profile not in PROFILES:
        raise no_such("", profile, PROFILES, "choose one of them", "profile")
    start, end = (float(path.unfolded), float(path.folded))[:: 1 if retract else -1]
    durations, s = PROFILES[profile](abs(end - start), limits)
    alpha = s * (end - start)
    alpha[-1] += start
    name = f"{'retraction' if retract else 'extension'}, {profile}, {percent:g} %"
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    motion = Motion(name, breaks, alpha[..., None] * np.asarray(path.direction, float))
    return motion.at_speed(percent).dwell(dwell)


class _Limits(NamedTuple):
    speed: float
    acceleration: float
    jerk: float


Pieces = tuple[Float[np.ndarray, " pieces"], Float[np.ndarray, "powers pieces"]]
"""Durations [s] and coefficients [1/s^n] of the way s from 0 to 1."""


def _s_curve(distance: float, limits: _Limits) -> Pieces:
    """Ask the library in units of the cycloid's duration and of the distance, so that no number is far from one."""
    unit = cycloid_duration(distance, limits)
    speed, acceleration, jerk = (limit * unit**n / distance for n, limit in enumerate(limits, start=1))
    request = InputParameter(1)
    request.current_position, request.target_position = [0.0], [1.0]
    request.max_velocity, request.max_acceleration, request.max_jerk = [speed], [acceleration], [jerk]
    answer = Trajectory(1)
    result = Ruckig(1).calculate(request, answer)
    if result != Result.Working:
        raise ModelError(f"no motion over {distance:g} rad within {limits}: {result.name}; correct the limits")
    profile = answer.profiles[0][0]
    s = np.stack([np.divide(profile.j, 6), np.divide(profile.a[:-1], 2), profile.v[:-1], profile.p[:-1]])
    durations = np.asarray(profile.t)
    real = durations > ROUNDING * durations.sum()
    return durations[real] * unit, s[:, real] / unit ** np.arange(3, -1, -1)[:, None]


def _cycloid(distance: float, limits: _Limits) -> Pieces:
    duration = cycloid_duration(distance, limits)
    half = 0.5 / CYCLOID_PIECES
    middles = half * (2 * np.arange(CYCLOID_PIECES) + 1)
    s = np.stack([_about(middle, -half)[::-1] for middle in middles], axis=1)
    powers = np.arange(CYCLOID_DEGREE, -1, -1)[:, None]
    return np.full(CYCLOID_PIECES, duration / CYCLOID_PIECES), s / duration**powers


def _about(middle: float, start: float) -> Float[np.ndarray, " powers"]:
    """Return the cycloid's Taylor polynomial about `middle`, lowest power first, in the way from `middle + start`."""
    n = np.arange(CYCLOID_DEGREE + 1)
    factorials = np.array([math.factorial(k) for k in n], float)
    sine = (2 * np.pi) ** (n - 1.0) * np.sin(2 * np.pi * middle + n * np.pi / 2) / factorials
    taylor = Polynomial([middle, 1.0]) - Polynomial(sine)
    return taylor(Polynomial([start, 1.0])).coef


def _minimum_jerk(distance: float, limits: _Limits) -> Pieces:
    duration = cycloid_duration(distance, limits, (15 / 8, 10 / np.sqrt(3), 60.0))
    s = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) / duration ** np.arange(5, -1, -1)
    return np.array([duration]), s[:, None]


def cycloid_duration(
    distance: float,
    limits: tuple[float, float, float],
    peaks: tuple[float, float, float] = (2.0, 2 * np.pi, 4 * np.pi**2),
) -> float:
    """Return the shortest duration [s] of a cycloid within the limits of speed, acceleration and jerk.

    Its peaks are 2 D/T, 2 pi D/T^2 and 4 pi^2 D/T^3.

    Args:
        distance: () [rad] D.
        limits: [rad/s, rad/s^2, rad/s^3]; an infinite one limits nothing.
        peaks: of a motion over 1 rad in 1 s: the cycloid's, or another's.
    """
    pairs = zip(peaks, limits, strict=True)
    return max((peak * distance / limit) ** (1 / n) for n, (peak, limit) in enumerate(pairs, start=1))


PROFILES: dict[str, Callable[[float, _Limits], Pieces]] = {
    "s-curve": _s_curve,
    "trapezoid": lambda distance, limits: _s_curve(distance, limits._replace(jerk=math.inf)),
    "cycloid": _cycloid,
    "minimum-jerk": _minimum_jerk,
}
"""Profiles of alpha from start to end, by name."""


def _limits(path: Stroke) -> _Limits:
    """Return the limits of alpha, after a look at the path."""
    limits = _Limits(float(path.speed), float(path.acceleration), float(path.jerk))
    expected = ("a finite speed above 0", "a finite acceleration above 0", "a jerk above 0, or inf for none")
    units = ("rad/s", "rad/s^2", "rad/s^3")
    problems = [
        Problem("", f"{limit:g} {unit}", right, "correct the limit", name)
        for name, limit, unit, right in zip(limits._fields, limits, units, expected, strict=True)
        if not limit > 0 or (math.isinf(limit) and name != "jerk")
    ]
    folded, unfolded = float(path.folded), float(path.unfolded)
    if not math.isfinite(folded - unfolded) or folded == unfolded:
        got = f"folded at {math.degrees(folded):g} deg and unfolded at {math.degrees(unfolded):g} deg"
        problems.append(Problem("", got, "two different angles", "correct the stroke", "folded"))
    refuse(problems)
    return limits
