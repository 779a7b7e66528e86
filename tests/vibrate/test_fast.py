"""The linearised path: order of its method, and the panels that it works on."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, random_arm
from conformance import agrees
from runs import hold_still, named, swing, with_error

from ident.arm.multibody import multibody
from ident.vibrate.fast import TWICE, FastMethod, each_of, end_point_of, excited, numbers_of, samples_of, step_for
from ident.vibrate.linear import (
    GAUSS,
    NODE_PLACES,
    NODES,
    TURN,
    TURN_WITH_ERROR,
    TimeIntervals,
    evaluate,
    interpolate,
    linearised,
    step_weights,
    time_intervals,
    weights,
)
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.replay import replay
from ident.vibrate.simulate import RATE, fast_method


@pytest.mark.slow
def test_order() -> None:
    """Sixth: coordinates at the starts of ten panels of more and more steps, turning masses and all."""
    arm, motion, starts = lcd_arm(), swing(), np.linspace(0, 5, 11)[:-1]
    gathered = multibody(arm, rank=1)
    counts, found = np.array([30, 60, 400]), []
    for count in counts:
        grid = TimeIntervals(starts, np.full(10, 0.5 / count), int(count))
        at = step_weights(int(count))
        linear = linearised(arm, gathered, motion, grid, at)
        found.append(np.asarray(excited(gathered, motion, grid, at, linear).state)[:, 0, :3])
    errors = [np.abs(x - found[-1]).max() for x in found[:-1]]
    order = np.log2(errors[0] / errors[1])
    agrees(order, 6.0, "vibration", "order of the fast method", "order of the formula", atol=0.3)


@pytest.mark.slow
def test_kinematic_error_needs_no_shorter_steps_and_intervals() -> None:
    """Half the step and half the turn change the vibration by less than 0.1 % of its largest peak."""
    arm, motion = with_error(60.0), named(stroke(lcd_arm().stroke, percent=100, dwell=0.5))  # by programs of `paper`
    step = step_for(arm, motion)
    solve = fast_method(arm, motion, None, False, RATE, step)
    halved = time_intervals(motion, float(solve.samples.time[-1]), step / 2, turn=TURN_WITH_ERROR / 2)
    finer = dataclasses.replace(solve, grid=halved.filled_up(), weights=step_weights(int(halved.steps)))
    numbers = {path: np.asarray(x)[None] for path, x in numbers_of(arm).items()}

    def vibration(method):
        """By three programs, as `simulate` has them."""
        moved = each_of(arm, numbers, method, FastMethod.solution)
        return (moved.displacement - moved.quasi_static)[..., 0, 0]

    usual, converged = vibration(solve), vibration(finer)
    off = np.abs(usual - converged).max(1) / np.abs(converged).max()
    assert (off < 1e-3).all()


def test_end_point_by_known_sines() -> None:
    """Those of the samples are those of the motion, and a joint without a drive has no angle."""
    rng = np.random.default_rng(8)
    model, time = multibody(random_arm(rng, 4, undriven=(1,)), rank=1), np.linspace(0.0, 1.0, 50)
    motion, y = Motion("any", np.array([0.0, 1.0]), rng.normal(size=(4, 1, 3))), 1e-2 * rng.normal(size=(12, 50))
    turn = samples_of(motion, time).turn[..., :50]
    known, computed = (end_point_of(model, motion, time, jnp.asarray(y), *given) for given in ([turn], []))
    np.testing.assert_allclose(known, computed, rtol=0, atol=1e-14)


@pytest.mark.parametrize("n", [3, 4, 6, 10])
def test_way_under_a_fast_force(n: int) -> None:
    """x'' = e^(iz u) over a step of 1/n period, z = 2 pi/n: x = (1 + i z u - e^(i z u))/z^2, within z^5/13400 / z^2."""
    u, z = np.linspace(0, 1, 201), 2 * np.pi / n
    x = (evaluate(TWICE, jnp.asarray(u)) * np.exp(1j * z * GAUSS)).sum(1)
    off = np.abs(z**2 * x - (1 + 1j * z * u - np.exp(1j * z * u))).max()
    what, source = "error under a fast force", "z^5 / 13400, series of the step"
    agrees(off, z**5 / 13400, "vibration", what, source, rtol=0.25 * (3 / n) ** 2)


def test_steps_never_cross_a_jump() -> None:
    """Of the jerk of an s-curve and of the acceleration of a trapezoid."""
    for profile, jumps in (("s-curve", 7), ("trapezoid", 3)):
        motion = stroke(lcd_arm().stroke, percent=100.0, profile=profile, dwell=1.0)
        grid = time_intervals(motion, float(motion.breaks[-1]), 0.005)
        inner = motion.breaks[1:-1]
        assert len(inner) >= jumps - 1
        assert np.abs(grid.start[:, None] - inner).min(0).max() < 1e-12
        covers(grid, motion)


def covers(grid: TimeIntervals, motion: Motion) -> None:
    """All the time, without a gap, in steps and turns no longer than asked."""
    ends = grid.start[:, None] + grid.step[:, None] * np.arange(grid.steps + 1)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, -1], rtol=1e-12)
    assert ends[0, 0] == motion.breaks[0]
    assert ends[-1, -1] == pytest.approx(motion.breaks[-1])
    assert grid.step.max() <= 0.005 * (1 + 1e-9)
    q = np.asarray(motion(ends.ravel())[0]).reshape(-1, *ends.shape)
    assert (np.ptp(q, axis=-1) < 1.01 * TURN).all()


@pytest.mark.parametrize("seed", range(8))
def test_panels_of_any_motion(seed: int) -> None:
    """Pieces of random length and jerk: every break is a panel's start."""
    rng = np.random.default_rng(seed)
    pieces = int(rng.integers(1, 9))
    breaks = rng.uniform(-2, 2) + np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, pieces))])
    c, at = rng.normal(size=(4, pieces, 2)), np.zeros((4, 2))
    for k, length in enumerate(np.diff(breaks)):
        c[3, k] = at[3]
        at = np.array([c[3, k] + c[2, k] * length + c[1, k] * length**2 + c[0, k] * length**3] * 4)
    motion = Motion("random", breaks, c)
    grid = time_intervals(motion, breaks[-1], 0.005)
    assert np.abs(grid.start[:, None] - breaks[:-1]).min(0).max() < 1e-12
    covers(grid, motion)


def test_smooth_log_makes_few_panels() -> None:
    """A spline of hundreds of pieces is smooth: its breaks are no jumps."""
    time = np.linspace(0, 4, 401)
    log = replay(time, np.outer([1, -2, 1], 0.5 * (time / 4 - np.sin(np.pi * time / 2) / (2 * np.pi))))
    assert len(log.breaks) > 300
    assert len(time_intervals(log, 4.0, 0.005).start) < 10
    assert len(time_intervals(hold_still([0.0, 1.0], 3.0), 3.0, 0.005).start) == 3


def test_interpolation() -> None:
    """Exact for polynomials of degree five; 1e-6 for the sine of a turn through a panel; slopes and curvatures too."""
    places = np.linspace(0, 1, 21)
    W = weights(places)
    for degree in range(NODES):
        powers = np.polynomial.Polynomial.basis(degree)
        for k, part in enumerate(W):
            right = powers.deriv(k)(places)
            np.testing.assert_allclose(interpolate(jnp.asarray(powers(NODE_PLACES)), part), right, atol=1e-10)
    error = [
        np.abs(interpolate(jnp.sin(1.0 + turn * NODE_PLACES), W[0]) - np.sin(1.0 + turn * places)).max()
        for turn in (TURN, 2 * TURN)
    ]
    assert error[0] < 1e-6 < error[1]
