"""Which mode each measured value belongs to, as ones among zeros, and what is picked by it."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ident.arm.modes import Modes
from ident.identify.conditions import Conditions
from ident.identify.mode_assignment import most_probable
from ident.inference.parameters import AnyArray


def mode_choice(
    conditions: Conditions, modes: Modes, chosen: Float[AnyArray, "m R *batch"] | None = None
) -> tuple[Float[Array, "m R *batch"], Float[Array, "m n *batch"]]:
    """Return one for the mode that each named value, and each unnamed one, belongs to.

    Args:
        conditions: from `bind`.
        modes: all modes of all states.
        chosen: one for the mode of each named value; by default as the labels alone have it.
    """
    if chosen is None:
        values = conditions.named
        chosen = most_probable(values, modes, None, 0.0) if len(values.states) else jnp.zeros((len(modes.frequency), 0))
    return jnp.asarray(chosen), lowest_left(conditions, jnp.asarray(chosen))


def lowest_left(
    conditions: Conditions, chosen: Float[Array, "m R *batch"], beyond: int = 0
) -> Float[Array, "m n *batch"]:
    """Return one for the mode of each unnamed value: the lowest ones that no label of the same state has taken.

    Or for the mode so many places beyond it among these.
    """
    named, unnamed, first = conditions.named, conditions.unnamed, conditions.named.frequencies
    none = jnp.zeros((len(chosen), 1, *chosen.shape[2:]))
    own = jnp.concatenate([chosen[:, :first], none], 1)
    free = (own[:, named.at].sum(1) == 0)[:, unnamed.states]
    ordinal = jnp.reshape(unnamed.ordinals + beyond, (-1,) + (1,) * (chosen.ndim - 2))
    return (free & (jnp.cumsum(free, 0) == ordinal)).astype(float)


def pick(
    values: Float[Array, "m S *batch"], choice: Float[Array, "m D *batch"], states: Int[AnyArray, "D"]
) -> Float[Array, "D *batch"]:
    """Return of each value's state what belongs to its mode; NaN where there is none."""
    return picked(values[:, states], choice)


def picked(values: Float[Array, "m D *batch"], choice: Float[Array, "m D *batch"]) -> Float[Array, "D *batch"]:
    """Return of each value's modes the one that is chosen; NaN where there is none."""
    return jnp.where(choice.sum(0) > 0, (values * choice).sum(0), jnp.nan)
