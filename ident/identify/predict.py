"""The one function that all inference calls: from an arm's numbers to what a campaign would measure."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Chain, Loads, at_posture
from ident.arm.equilibrium import StaticEquilibrium, deflection, static_equilibrium
from ident.arm.labels import fits
from ident.arm.modes import (
    Modes,
    damped_eigenvalues,
    linearize,
    lowest_eigenpairs,
    modes_about,
    to_hertz,
)
from ident.identify.conditions import Conditions, Modal


class ArmModel(eqx.Module):
    """An arm and the conditions of a campaign, as the model of an `InverseProblem`."""

    arm: Arm
    conditions: Conditions

    def __call__(self, parameters: Mapping[str, Any]) -> Float[Array, "D *batch"]:
        """Predict the campaign's values [SI] for these numbers of the arm."""
        return predict(self.arm, parameters, self.conditions)


def predict(arm: Arm, parameters: Mapping[str, Any], conditions: Conditions) -> Float[Array, "D *batch"]:
    """Predict what the campaign would measure on an arm with these numbers; differentiable.

    Args:
        arm: the arm.
        parameters: numbers by path, `()` or `(*batch)` each, in place of the arm's own.
        conditions: from `bind`.

    Returns:
        `(D, *batch)` in the campaign's order: frequencies [Hz], deflections [m], damping ratios [-]. NaN where the arm
        has no stable equilibrium, or no mode that a label names.
    """
    chain = chains(arm, parameters, conditions)
    at = static_equilibrium(chain)
    rows: list[int] = []
    values: list[Array] = []
    if conditions.frequency.rows:
        rows += conditions.frequency.rows
        values.append(_frequencies(chain, at, conditions.frequency))
    if conditions.damping.rows:
        rows += conditions.damping.rows
        values.append(_damping_ratios(chain, at, conditions.damping))
    if conditions.deflected:
        rows += conditions.deflected
        values.append(read_points(deflection(chain, at.phi), conditions))
    return jnp.concatenate(values)[np.argsort(rows)]


def chains(arm: Arm, parameters: Mapping[str, Any], conditions: Conditions) -> Chain:
    """Hold the arm with these numbers in every state of the campaign; batch `(S, *batch)`."""
    rank = max((jnp.ndim(value) for value in parameters.values()), default=0)

    def lift(x: Array) -> Array:
        return x.reshape(x.shape + (1,) * rank)

    loads = conditions.loads
    loads = Loads(lift(loads.payload), lift(loads.mass), lift(loads.force))
    return at_posture(arm.replace(parameters), lift(conditions.posture), loads)


def _frequencies(chain: Chain, at: StaticEquilibrium, modal: Modal) -> Float[Array, "D *batch"]:
    if not any(modal.labels):
        count = max(modal.ordinals)
        hertz = to_hertz(lowest_eigenpairs(chain, at, count=count)[0])
        return hertz[np.array(modal.ordinals) - 1, np.array(modal.states)]
    modes = modes_about(chain, at)
    return pick(modes.frequency, mode_choice(modal, modes), modal)


def _damping_ratios(chain: Chain, at: StaticEquilibrium, modal: Modal) -> Float[Array, "D *batch"]:
    s = damped_eigenvalues(linearize(chain, at))
    ratio = -s.real / jnp.abs(s)
    return pick(ratio, mode_choice(modal, modes_about(chain, at)), modal)


def mode_choice(modal: Modal, modes: Modes) -> Float[Array, "m D *batch"]:
    """Return one for the mode that each value belongs to, zero for the others.

    A labelled value belongs to the n-th mode with its direction and kind; those without a label, to the lowest of the
    modes that no label of the same state has taken, in ascending order.
    """
    state, ordinal = np.array(modal.states), np.array(modal.ordinals)
    rank = modes.frequency.ndim - 2
    ordinal = ordinal.reshape((-1,) + (1,) * rank)
    named = np.array([label is not None for label in modal.labels])
    admitted = jnp.stack(
        [
            (fits(label, modes) if label else jnp.ones(modes.frequency.shape, bool))[:, s]
            for label, s in zip(modal.labels, modal.states, strict=True)
        ],
        1,
    )
    chosen = admitted & (jnp.cumsum(admitted, 0) == ordinal)
    together = ((state[:, None] == state) & named[:, None] & ~named).astype(float)
    taken = jnp.einsum("mr...,rs->ms...", chosen.astype(float), together) > 0
    free = admitted & ~taken
    return (free & (jnp.cumsum(free, 0) == ordinal)).astype(float)


def pick(values: Float[Array, "m S *batch"], choice: Array, modal: Modal) -> Float[Array, "D *batch"]:
    """Return of each value's state what belongs to its mode; NaN where there is none."""
    picked = (values[:, np.array(modal.states)] * choice).sum(0)
    return jnp.where(choice.sum(0) > 0, picked, jnp.nan)


def read_points(moved: Float[Array, "3 P S *batch"], conditions: Conditions) -> Float[Array, "D *batch"]:
    """Return what is read of the points' motions: along a direction, or against another state."""
    point, reference = np.array(conditions.point), np.array(conditions.reference)
    rank = moved.ndim - 3
    direction = conditions.direction.reshape(conditions.direction.shape + (1,) * rank)
    against = (reference >= 0).reshape((-1,) + (1,) * rank)
    read = moved[:, point, np.array(conditions.state)]
    start = jnp.where(against, moved[:, point, np.maximum(reference, 0)], 0.0)
    return ((read - start) * direction).sum(0)
