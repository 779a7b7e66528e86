"""The linearised path: order of its method, agreement with the exact one, and the panels that it works on."""

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from runs import apart, paper, short, swing

from ident.vibrate.motion import Motion, hold_still
from ident.vibrate.panels import NODE_PLACES, NODES, TURN, Panels, interpolate, panels, weights
from ident.vibrate.replay import replay
from ident.vibrate.response import peak
from ident.vibrate.stroke import stroke


def test_order() -> None:
    """Fourth, on a motion with turning masses whose first part is passed in ever shorter steps."""
    durations = np.array([2.5, 1.25, 0.625, 0.3125])
    true, errors = np.asarray(short(lcd_arm(), swing(0.3125 / 4)).displacement)[:, ::5], []
    for duration in durations:
        found = np.asarray(short(lcd_arm(), swing(duration)).displacement)[:, ::5]
        same = true[:, :: round(4 * duration / 0.3125)]
        errors.append(np.abs(found[:, : same.shape[1]] - same).max())
    slopes = np.diff(np.log(errors)) / np.diff(np.log(durations))
    # measured: 3.98, 3.99, 3.95
    assert slopes == pytest.approx(np.full(3, 4.0), abs=0.3)


@pytest.mark.parametrize(
    ("percent", "elastic", "error", "worst"),
    [(10, False, 0.0, 1e-3), (100, False, 0.0, 2e-3), (100, True, 0.0, 3e-3), (100, False, 30.0, 1e-2)],
)
def test_agrees_with_exact(percent: float, elastic: bool, error: float, worst: float) -> None:
    """Within 0.1 % of the largest peak; in each direction, of its own peak, within `worst`."""
    fast, exact = (paper(percent, method, elastic, error) for method in ("fast", "exact"))
    off = apart(fast.displacement - fast.sag, exact.vibration)
    highest = np.asarray(peak(exact.vibration))
    print(percent, elastic, error, off, off * highest / highest.max())
    assert (off * highest < 1e-3 * highest.max()).all()
    assert (off < worst).all()


def test_steps_never_cross_a_jump() -> None:
    """Of the jerk of an s-curve and of the acceleration of a trapezoid."""
    for profile, jumps in (("s-curve", 7), ("trapezoid", 3)):
        motion = stroke(lcd_arm().stroke, percent=100.0, profile=profile, dwell=1.0)
        grid = panels(motion, float(motion.breaks[-1]), 0.005)
        inner = motion.breaks[1:-1]
        assert len(inner) >= jumps - 1
        assert np.abs(grid.start[:, None] - inner).min(0).max() < 1e-12
        covers(grid, motion)


def covers(grid: Panels, motion: Motion) -> None:
    """All the time, without a gap, in steps and turns no longer than asked."""
    ends = np.asarray(grid.ends)
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
    grid = panels(motion, breaks[-1], 0.005)
    assert np.abs(grid.start[:, None] - breaks[:-1]).min(0).max() < 1e-12
    covers(grid, motion)


def test_smooth_log_makes_few_panels() -> None:
    """A spline of hundreds of pieces is smooth: its breaks are no jumps."""
    time = np.linspace(0, 4, 401)
    log = replay(time, np.outer([1, -2, 1], 0.5 * (time / 4 - np.sin(np.pi * time / 2) / (2 * np.pi))))
    assert len(log.breaks) > 300
    assert len(panels(log, 4.0, 0.005).start) < 10
    assert len(panels(hold_still([0.0, 1.0], 3.0), 3.0, 0.005).start) == 3


def test_interpolation() -> None:
    """Exact for polynomials of degree five; 1e-6 for the sine of a turn through a panel; slopes and curvatures too."""
    places = np.linspace(0, 1, 21)
    W = weights(places)
    for degree in range(NODES):
        powers = np.polynomial.Polynomial.basis(degree)
        for k, part in enumerate(W):
            right = powers.deriv(k)(places)
            np.testing.assert_allclose(interpolate(jnp.asarray(powers(NODE_PLACES)), part, 0), right, atol=1e-10)
    error = interpolate(jnp.sin(1.0 + 2 * TURN * NODE_PLACES), W[0], 0) - np.sin(1.0 + 2 * TURN * places)
    assert 1e-10 < np.abs(error).max() < 1e-5
    error = interpolate(jnp.sin(1.0 + TURN * NODE_PLACES), W[0], 0) - np.sin(1.0 + TURN * places)
    assert np.abs(error).max() < 1e-7
