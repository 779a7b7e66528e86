"""A logged joint path as a motion: a quintic spline through the samples, or near them where they are noisy."""

import math
from contextlib import suppress

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, generate_knots, make_interp_spline
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from ident.arm.arm import Arm
from ident.errors import InputError, refusal
from ident.vibrate.motion import QUICKEST, Motion, check_joints

DEGREE = 5
"""Degree of the spline: its fourth derivative is continuous, so the acceleration that excites the arm is smooth."""

AT_REST = 0.1
"""Speed at an end, as a fraction of the largest, up to which the data count as at rest there.

Assumed: a smooth start of twenty samples has 5 % of its top speed in the middle of its first two intervals.
"""
STEPS = (1e-9, 1e9)
"""Shortest and longest time step [s] between samples: beyond these the spline's derivatives overflow."""
FASTEST = 100.0
"""Acceleration [rad/s^2] reached only by errors of a log, for joints without a limit in the arm file; assumed."""
NOISY = 2.0
"""Largest acceleration of a log over the arm file's limit: small noise adds to that of the motion; assumed."""
MOST_KNOTS = 600
"""Most knots of a smoothing spline; unsmoothed noise needs as many as there are samples, and takes minutes."""


def replay(
    time: Float[np.ndarray, " T"],
    angles: Float[np.ndarray, "driven T"],
    *,
    smoothing: float = 0.0,
    name: str = "log",
    arm: Arm | None = None,
) -> Motion:
    """Return the motion of logged joint angles: a C4 spline of degree five that starts at time 0.

    Without smoothing the spline passes all samples. The acceleration is then a second difference of them: encoder
    noise of s rad at intervals of h s becomes an acceleration of several s/h^2, which for 1e-5 rad at 1 ms is tens of
    rad/s^2, more than the arm's own, and it excites all modes. So give the noise as `smoothing`: the spline then
    has as few pieces as keep the residuals at that size. Where the data are at rest at an end, the velocity
    is zero there, without smoothing the acceleration too; elsewhere the arm is held before and after, and its speed
    jumps.

    Args:
        time: (T,) [s] increasing, at least 4 samples, with smoothing 6.
        angles: (driven, T) [rad]
        smoothing: () [rad] root mean square of the residuals, all joints together; 0 to pass all samples.
        name: name of the motion.
        arm: the arm that performs the motion.

    Returns:
        The motion; its arrival is its end.

    Raises:
        InputError: no samples, or an acceleration impossible for the arm; the message names a sufficient smoothing.
    """
    _check(time, angles, smoothing, name)
    t = np.asarray(time, float) - time[0]
    spline = _smooth(t, angles, smoothing) if smoothing else _through(t, angles)
    breaks = np.unique(spline.t)
    powers = range(DEGREE, -1, -1)
    motion = Motion(name, breaks, np.stack([spline(breaks[:-1], nu=n) / math.factorial(n) for n in powers]))
    if arm is not None:
        _refuse_rough(arm, motion, time, angles, smoothing)
    return motion


def noise_of(motion: Motion, rate: float) -> tuple[float, float]:
    """Return the rms noise [rad] of a motion's angles, and the acceleration that it commands relative to the motion's.

    Noise of independent samples has fourth differences of 70 times its variance, in which a smooth motion hardly
    shows. Below f = `QUICKEST` its acceleration has the variance 2 h (2 pi)^4 f^5 / 5 times that, with h = 1 / rate.

    Args:
        motion: through the samples of a log.
        rate: [Hz] of the log; below twice `QUICKEST` nothing is found.
    """
    times = np.arange(float(motion.breaks[0]), motion.arrival, 1 / rate)
    wide = round(rate / (2 * math.pi))
    if rate < 2 * QUICKEST or len(times) < 4 * wide:
        return 0.0, 0.0
    angles = np.asarray(motion(times)[0])
    fourth = np.sort(np.diff(angles, 4) ** 2, axis=1)[:, : int(KEPT * len(times))]  # without corners of the path
    noise = np.sqrt(fourth.mean(1) / 70)
    own = np.diff(angles[:, ::wide], 2).std(1) * (rate / wide) ** 2
    commanded = noise * math.sqrt(2 / rate * (2 * math.pi) ** 4 * QUICKEST**5 / 5)
    return float(noise.max()), float((commanded / np.maximum(own.max(), np.finfo(float).tiny)).max())


def _refuse_rough(arm: Arm, motion: Motion, time: np.ndarray, angles: np.ndarray, smoothing: float) -> None:
    """Refuse a motion with an acceleration impossible for a joint."""
    check_joints(arm, motion)
    most = np.array([[NOISY * a if a < math.inf else FASTEST] for a in (joint.rates[1] for joint in arm.driven)])
    times = np.append(motion.breaks, motion.breaks[:-1] + np.diff(motion.breaks) / 2)
    shares = np.abs(np.asarray(motion(times)[2])) / most
    joint, place = np.unravel_index(shares.argmax(), shares.shape)
    if shares.max() <= 1:
        return
    remedy = "check the units of time and angles, or correct the samples there"
    noise = np.diff(angles, 2).std() / math.sqrt(6)
    with suppress(InputError):
        if not smoothing:
            replay(time, angles, smoothing=1.5 * noise, arm=arm)
            remedy = f"smooth the angles by their noise (`smoothing` {math.degrees(1.5 * noise):.2g} deg), or {remedy}"
    got = f"{shares.max() * most[joint, 0]:.3g} rad/s^2 of {arm.driven[joint].name} at {time[0] + times[place]:.4g} s"
    raise refusal(motion.name, got, f"at most {most[joint, 0]:.3g} rad/s^2", remedy)


KEPT = 0.98
"""Share of a path that counts for its noise; assumed."""
Ends = tuple[bool, bool]
"""Whether the data are at rest at the start and at the end."""


def _at_rest(velocities: Float[np.ndarray, "driven times"]) -> Ends:
    speeds = np.linalg.norm(velocities, axis=0)
    slow = speeds <= AT_REST * speeds.max()
    return bool(slow[0]), bool(slow[-1])


def _through(t: Float[np.ndarray, " T"], angles: Float[np.ndarray, "driven T"]) -> BSpline:
    """Return the interpolating spline; at a moving end its third and fourth derivatives are zero, for want of data."""
    ends = _at_rest((angles[:, 2:] - angles[:, :-2]) / (t[2:] - t[:-2]))
    still = np.zeros(len(angles))
    conditions = [[(order, still) for order in ((1, 2) if rest else (3, 4))] for rest in ends]
    return make_interp_spline(t, angles.T, k=DEGREE, bc_type=conditions)


def _smooth(t: Float[np.ndarray, " T"], angles: Float[np.ndarray, "driven T"], rms: float) -> BSpline:
    """Return the least-squares spline with as few knots as the residuals allow, at rest where it nearly is."""
    *_, knots = generate_knots(t, angles.T, k=DEGREE, s=angles.size * rms**2, nest=MOST_KNOTS)
    if len(knots) >= MOST_KNOTS:
        expected, remedy = "at least the noise of the angles", "give a larger one, or 0 to pass all samples"
        raise refusal("", f"{rms:g} rad", expected, remedy, "smoothing")
    free = _least_squares(t, angles, knots, (False, False))
    return _least_squares(t, angles, knots, _at_rest(free(t, nu=1).T))


def _least_squares(
    t: Float[np.ndarray, " T"], angles: Float[np.ndarray, "driven T"], knots: Float[np.ndarray, " knots"], ends: Ends
) -> BSpline:
    """Return the spline on these knots that is nearest to samples (driven, T), with no speed at ends that are at rest.

    A clamped spline has no speed at an end where its two outermost coefficients are equal. The acceleration is left to
    the data there: a log that starts with the motion may start with a jump of it, which noise hides.
    """
    group = np.arange(len(knots) - DEGREE - 1)
    group[1] -= ends[0]
    group[-1] -= ends[1]
    _, group = np.unique(group, return_inverse=True)
    tie = csr_array((np.ones(len(group)), (np.arange(len(group)), group)))
    A = BSpline.design_matrix(t, knots, DEGREE) @ tie
    coefficients = spsolve((A.T @ A).tocsc(), A.T @ angles.T)
    return BSpline(knots, tie @ coefficients.reshape(-1, len(angles)), DEGREE)


def _check(time: Float[np.ndarray, " T"], angles: Float[np.ndarray, "driven T"], smoothing: float, name: str) -> None:
    fewest = DEGREE + 1 if smoothing else 4
    if len(time) < fewest:
        raise refusal(name, f"{len(time)} samples", f"at least {fewest}", "give a longer log", "time")
    if not np.isfinite(angles).all():
        raise refusal(name, "a sample that is not finite", "finite numbers", "remove it", "angles")
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(time)
    if bad := np.flatnonzero(~((steps >= STEPS[0]) & (steps <= STEPS[1]))).tolist():
        got, remedy = f"{time[bad[0] + 1]:.9g} s after {time[bad[0]]:.9g} s", "sort the samples, or give the times in s"
        raise refusal(name, got, f"steps of {STEPS[0]:g} to {STEPS[1]:g} s", remedy, "time")
    if not 0 <= smoothing < math.inf:
        remedy = "give the noise of the angles, or 0 to pass all samples"
        raise refusal("", f"{smoothing:g} rad", "a finite angle of at least 0", remedy, "smoothing")
