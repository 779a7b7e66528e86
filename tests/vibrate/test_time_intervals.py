"""What is computed for some time intervals at a time is what is computed for all of them at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ident.vibrate.linear import TimeIntervals, some_at_a_time


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
