"""What a measured frequency is of its damped mode: undamped, of the pole, damped, or of a peak; see `DEFINITIONS`."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from ident.arm.chain import Chain
from ident.arm.equilibrium import StaticEquilibrium
from ident.arm.modes import damped_eigenvalues, linearize
from ident.inference.parameters import AnyArray
from ident.measure import DEFINITIONS, Measurement

MOST_DAMPED = 0.7
"""Damping ratio up to which a mode counts as having a peak; from 0.707 on there is none, and near it it is flat."""

NotAllUndamped = Int[AnyArray, "F"] | None
"""What each frequency is, those with a label first, as places in `DEFINITIONS`; None where all are undamped."""


def definitions_of(values: Sequence[Measurement]) -> Int[np.ndarray, "F"] | None:
    """Return what each of these measurements that is a frequency is of its damped mode; None where all are undamped."""
    definitions = [DEFINITIONS.index(m.of or DEFINITIONS[0]) for m in values if m.kind == "frequency"]
    return np.array(definitions, int) if any(definitions) else None


def frequencies_of_pole(s: Complex[Array, "*shape"]) -> tuple[Float[Array, "*shape"], ...]:
    """Return |s|, Im s and the peaks of receptance and accelerance of a mode alone with the pole s, all [Hz].

    A peak is 0 where there is none, beyond a damping ratio of `MOST_DAMPED`; so is Im s of an overdamped mode.
    """
    hertz = jnp.abs(s) / (2 * jnp.pi)
    squared = 1 - 2 * (s.real / jnp.abs(s)) ** 2
    peaked = squared >= 1 - 2 * MOST_DAMPED**2
    ratio = jnp.sqrt(jnp.where(peaked, squared, 1.0))
    peaks = (jnp.where(peaked, hertz * ratio, 0.0), jnp.where(peaked, hertz / ratio, 0.0))
    return hertz, s.imag / (2 * jnp.pi), *peaks


def by_definition(
    hertz: Float[Array, "m S *batch"], chain: Chain, at: StaticEquilibrium, definitions: NotAllUndamped
) -> Float[Array, "K m S *batch"]:
    """Return the frequencies of the lowest modes by each definition, from the undamped ones; only these where all are.

    The poles are those of the damped arm, exact for dampers of any distribution.
    """
    if definitions is None:
        return hertz[None]
    poles = damped_eigenvalues(linearize(chain, at))[: len(hertz)]
    return jnp.stack([hertz, *frequencies_of_pole(poles)])


def defined(
    table: Float[Array, "K m S *batch"], states: Int[AnyArray, "R"], definitions: NotAllUndamped
) -> Float[Array, "m R *batch"]:
    """Return the frequencies of each value's state, as the value is defined; undamped from where definitions end."""
    if definitions is None:
        return table[0][:, states]
    own = jnp.pad(jnp.asarray(definitions), (0, len(states) - len(definitions)))
    return jnp.moveaxis(table[own, :, states], 0, 1)
