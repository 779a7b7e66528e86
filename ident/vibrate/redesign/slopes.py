"""Exact slopes of an amplitude by any numbers of an arm, by two compiled programs that all of its evaluators share."""

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

WIDTH = 3
"""Derivatives that are pushed forward together: with more variables the same program runs several times."""


def directions(
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

    def along(direction: dict[str, Any]) -> tuple[Linearised, Linearised]:
        return jax.jvp(lambda now: solve.linearised(arm.replace(now)), (values,), (direction,))

    pair: tuple[Linearised, Linearised] = jax.vmap(along, out_axes=(None, 0))(directions)
    return pair


@jit
def parts_along(
    arm: Arm,
    values: dict[str, Any],
    directions: dict[str, Any],
    linear: tuple[Linearised, Linearised],
    solve: FastMethod,
    measure: Amplitude,
) -> tuple[Float[Array, "3 W"], Float[Array, "V 3 W"]]:
    """Return the parts of which an arm's amplitude is the largest, and their slopes along directions.

    They are the largest samples of the windows, each smooth where it is the only one, and an RMS itself: slopes of a
    peak are computed at those samples alone.
    """

    def excited(now: dict[str, Any], linear: Linearised) -> Fast:
        return solve.excited(arm.replace(now), linear)

    def excited_along(direction: dict[str, Any], changing: Linearised) -> tuple[Fast, Fast]:
        return jax.jvp(excited, (values, linear[0]), (direction, changing))

    solved, changing = jax.vmap(excited_along, out_axes=(None, 0))(directions, linear[1])
    peaks = measure.measure != "rms"
    places = measure.places(solve.sampled(arm.replace(values), linear[0], solved, vibration_of)) if peaks else None

    def parts(now: dict[str, Any], linear: Linearised, solved: Fast) -> Array:
        changed = arm.replace(now)
        if places is None:
            return jnp.asarray(measure.root_mean_square(solve.sampled(changed, linear, solved, vibration_of)))
        whole = vibration_of(solve.at(changed, linear, solved, jnp.asarray(solve.time)[places.ravel()]))
        return jnp.abs(jnp.stack([row[k] for k, row in enumerate(whole.reshape((3, *places.shape)))]))

    def parts_along(*tangents: Any) -> tuple[Array, Array]:
        return jax.jvp(parts, (values, linear[0], solved), tangents)

    pair: tuple[Array, Array] = jax.vmap(parts_along, out_axes=(None, 0))(directions, linear[1], changing)
    return pair
