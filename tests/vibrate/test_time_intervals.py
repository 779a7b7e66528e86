"""What is computed for some time intervals at a time is what is computed for all of them at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from scipy.interpolate import BarycentricInterpolator

from ident.vibrate.linear import FINEST, NODE_PLACES, ROUGH, TimeIntervals, some_at_a_time, time_intervals
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.replay import replay
from ident.vibrate.shaping import averaged


def of(scale: float, grid: TimeIntervals) -> dict[str, jax.Array]:
    nodes = jnp.asarray(grid.nodes)
    return {"sine": jnp.sin(scale * nodes), "length": scale * jnp.asarray(grid.step * grid.steps)}


@pytest.mark.parametrize("count", [1, 3, 4, 8, 10])
def test_some_at_a_time_are_all_at_once(count: int) -> None:
    grid = TimeIntervals(0.3 * np.arange(count), np.linspace(0.01, 0.02, count), 7)
    together = some_at_a_time(lambda part: of(2.0, part), grid)
    assert list(together) == ["length", "sine"]
    for name, values in of(2.0, grid).items():
        np.testing.assert_allclose(together[name], values, rtol=1e-15)


def test_the_same_derivatives_forwards_and_backwards() -> None:
    grid = TimeIntervals(0.3 * np.arange(8), np.full(8, 0.01), 7)

    def some(scale: jax.Array) -> jax.Array:
        return some_at_a_time(lambda part: of(scale, part), grid)["sine"].sum()

    def whole(scale: jax.Array) -> jax.Array:
        return of(scale, grid)["sine"].sum()

    expected = jax.grad(whole)(2.0)
    assert float(jax.grad(some)(2.0)) == pytest.approx(float(expected), rel=1e-13)
    assert float(jax.jacfwd(some)(2.0)) == pytest.approx(float(expected), rel=1e-13)


def test_nothing_is_computed_for_intervals_that_are_none() -> None:
    """Two that fill up are computed together with the last real ones; the others are zeros."""
    grid = TimeIntervals(0.3 * np.arange(6), np.full(6, 0.01), 7).filled_up()
    lengths = np.asarray(some_at_a_time(lambda part: of(2.0, part), grid)["length"])
    np.testing.assert_allclose(lengths[:6], 0.14)
    assert np.isfinite(lengths).all()
    assert not lengths[8:].any()


def logged(motion: Motion) -> Motion:
    time = np.arange(0.0, motion.arrival + 0.008, 0.008)
    return replay(time, np.asarray(motion(time)[0]))


TRAPEZOID = stroke(lcd_arm().stroke, percent=100.0, profile="trapezoid")


@pytest.mark.parametrize("motion", [averaged(averaged(TRAPEZOID, 0.24), 0.2), logged(TRAPEZOID)])
def test_intervals_are_short_where_the_acceleration_bends(motion: Motion) -> None:
    """The polynomial through an interval's nodes is the acceleration, or the interval is a short one."""
    grid = time_intervals(motion, motion.arrival, 2e-3)
    start, length = np.asarray(grid.start), np.asarray(grid.step) * grid.steps
    np.testing.assert_allclose(start[1:], (start + length)[:-1], atol=1e-9)
    fastest = np.abs(motion(np.linspace(0.0, motion.arrival, 4001))[1]).max()
    for low, size in zip(start, length, strict=True):
        nodes, at = low + size * NODE_PLACES, low + size * np.linspace(0.0, 0.999, 50)
        polynomial = BarycentricInterpolator(nodes, np.asarray(motion(nodes)[2]).T)
        missed = np.abs(polynomial(at) - np.asarray(motion(at)[2]).T).max()
        assert size * missed < 1.3 * ROUGH * fastest or size <= 2 * FINEST + 1e-9


def test_intervals_of_a_smooth_motion_are_as_long_as_it_turns() -> None:
    motion = stroke(lcd_arm().stroke, percent=10.0)
    grid = time_intervals(motion, motion.arrival, 1.0)
    assert np.ptp(np.asarray(grid.step)) < 1e-12
