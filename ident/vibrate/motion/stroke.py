"""The straight stroke of the arm, extension and retraction, as fast as its limits allow."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial
from ruckig import InputParameter, Result, Ruckig, Trajectory

from ident.errors import InputError, ModelError, Problem
from ident.text import did_you_mean, quoted
from ident.vibrate.motion.motion import Motion

CYCLOID_PIECES, CYCLOID_DEGREE = 8, 13
"""Polynomials that stand for the cycloid; they agree with it to the last digit, and its acceleration to 1e-13."""


ROUNDING = 1e-12
"""Duration of a piece, as a fraction of all, below which it is there by rounding only."""


@runtime_checkable
class StraightPath(Protocol):
    """The path q = alpha direction on which the hand moves straight, and the limits of alpha at 100 %.

    Attributes:
        profile: a name in `PROFILES`.
        direction: (driven,) angles of the joints per alpha.
        folded: () [rad] alpha of the folded arm.
        unfolded: () [rad] alpha of the unfolded arm.
        speed: () [rad/s] limit of alpha's first derivative.
        acceleration: () [rad/s^2] limit of its second derivative.
        jerk: () [rad/s^3] limit of its third derivative; infinite for none.
    """

    @property
    def profile(self) -> str: ...  # noqa: D102
    @property
    def direction(self) -> Any: ...  # noqa: D102
    @property
    def folded(self) -> Any: ...  # noqa: D102
    @property
    def unfolded(self) -> Any: ...  # noqa: D102
    @property
    def speed(self) -> Any: ...  # noqa: D102
    @property
    def acceleration(self) -> Any: ...  # noqa: D102
    @property
    def jerk(self) -> Any: ...  # noqa: D102


def stroke(
    path: StraightPath,
    *,
    percent: float = 100.0,
    profile: str | None = None,
    retract: bool = False,
    dwell: float = 0.0,
) -> Motion:
    """Return the motion along the straight path, from rest to rest, the shortest of its profile within the limits.

    `s-curve` has bounded jerk, `trapezoid` ignores the jerk limit, both are time-optimal; `cycloid` is
    alpha = s - sin(2 pi s) / (2 pi), s = t/T, of the shortest T within all three limits. Not differentiable in path
    and limits, which are numbers.

    The percentage p slows the clock: speed x p, acceleration x p^2, jerk x p^3, so the same path is passed with the
    same shape of motion over time, only more slowly. So does the speed override of common robot controllers; that
    the controller of the arm at hand does so too is our assumption.

    Args:
        path: the path and its limits at 100 %.
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
        remedy = did_you_mean(profile, PROFILES, "choose one of them")
        raise InputError(Problem("", quoted(profile), f"one of {', '.join(PROFILES)}", remedy, "profile"))
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


def _trapezoid(distance: float, limits: _Limits) -> Pieces:
    return _s_curve(distance, limits._replace(jerk=math.inf))


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


def cycloid_duration(distance: float, limits: tuple[float, float, float]) -> float:
    """Return the shortest duration [s] of a cycloid within the limits of speed, acceleration and jerk.

    Its peaks are 2 D/T, 2 pi D/T^2 and 4 pi^2 D/T^3.

    Args:
        distance: () [rad] D.
        limits: [rad/s, rad/s^2, rad/s^3]; an infinite one limits nothing.
    """
    peaks = zip((2.0, 2 * np.pi, 4 * np.pi**2), limits, strict=True)
    return max((peak * distance / limit) ** (1 / n) for n, (peak, limit) in enumerate(peaks, start=1))


PROFILES: dict[str, Callable[[float, _Limits], Pieces]] = {
    "s-curve": _s_curve,
    "trapezoid": _trapezoid,
    "cycloid": _cycloid,
}
"""How alpha goes from start to end, by name."""


def _limits(path: StraightPath) -> _Limits:
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
    if problems:
        raise InputError(problems)
    return limits
