"""Exact slopes of an amplitude by numbers of an arm: two programs for all evaluators of an arm, a motion, a measure."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.jit import jit
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.response.amplitude import Amplitude
from ident.vibrate.response.fast import Fast
from ident.vibrate.response.fast_method import FastMethod, Linearised, vibration_of
from ident.vibrate.response.time_intervals import TimeIntervals, some_at_a_time

WIDTH = 3
"""Derivatives that are pushed forward together: with more variables the same program runs several times."""


def directions_of(
    numbers: Mapping[str, Float[np.ndarray, ""]], variables: Sequence[Variable]
) -> dict[str, Float[np.ndarray, "WIDTH"]]:
    """Return how the numbers of an arm change with each variable; zero for those that fill up."""
    ways = {path: np.zeros(WIDTH) for path in numbers}
    for k, variable in enumerate(variables):
        for path in variable.paths:
            ways[path][k] = 1.0 if variable.shifted else numbers[path]
    return ways


@jit
def linear_along(
    arm: Arm, values: dict[str, Any], directions: dict[str, Any], solve: FastMethod
) -> tuple[Linearised, Linearised]:
    """Return an arm's linearised equations, and how they change along directions, pushed forward together."""

    def some(grid: TimeIntervals) -> tuple[Linearised, Linearised]:
        def along(direction: dict[str, Any]) -> tuple[Linearised, Linearised]:
            return jax.jvp(lambda now: solve.linearised(arm.replace(now), grid), (values,), (direction,))

        pair: tuple[Linearised, Linearised] = jax.vmap(along, out_axes=(None, 1))(directions)
        return pair

    linear, changing = some_at_a_time(some, solve.grid)
    return linear, jax.tree.map(lambda x: jnp.moveaxis(x, 1, 0), changing)


@jit
def parts_along(
    arm: Arm,
    values: dict[str, Any],
    directions: dict[str, Any],
    linear: tuple[Linearised, Linearised],
    solve: FastMethod,
    measure: Amplitude,
) -> tuple[Float[Array, "3 more"], Float[Array, "WIDTH 3 more"]]:
    """Return the largest sample of each window, or the RMS, and their slopes along directions.

    Slopes of samples are computed at the largest alone: they are those of the maxima where it is the only one. There
    may be more windows than `measure.count`, see `Amplitude.places`.
    """

    def excited(now: dict[str, Any], linear: Linearised) -> Fast:
        return solve.excited(arm.replace(now), linear)

    def excited_along(direction: dict[str, Any], changing: Linearised) -> tuple[Fast, Fast]:
        return jax.jvp(excited, (values, linear[0]), (direction, changing))

    solved, changing = jax.vmap(excited_along, out_axes=(None, 0))(directions, linear[1])
    places = None
    if measure.measure != "rms":
        places = measure.places(solve.sampled(arm.replace(values), linear[0], solved, vibration_of))

    def parts(now: dict[str, Any], linear: Linearised, solved: Fast) -> Array:
        changed = arm.replace(now)
        if places is None:
            return jnp.asarray(measure.root_mean_square(solve.sampled(changed, linear, solved, vibration_of)))
        whole = vibration_of(solve.at(changed, linear, solved, jnp.asarray(solve.time)[places.ravel()]))
        return jnp.abs(whole.reshape((3, *places.shape))[np.arange(3), np.arange(3)])

    def along(*tangents: Any) -> tuple[Array, Array]:
        return jax.jvp(parts, (values, linear[0], solved), tangents)

    pair: tuple[Array, Array] = jax.vmap(along, out_axes=(None, 0))(directions, linear[1], changing)
    return pair
