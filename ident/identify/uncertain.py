"""Numbers of an arm, and a common scale of its loads, that are not exactly known: nuisance with a Gaussian prior."""

from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.fields import field_of
from ident.arm.parts import Body
from ident.errors import InputError, Problem
from ident.inference.parameters import Parameter
from ident.units import width

LOAD = "load"
"""Name of the common scale of all measured load cases: that of a load cell."""
NUISANCE_NARROWEST, NUISANCE_WIDEST = 1e-6, 1.0
"""Relative widths: what is less sure than by its own size is no nuisance."""


def uncertain_parameters(arm: Arm, widths: Mapping[str, str]) -> tuple[Parameter, ...]:
    """Return a nuisance for each uncertain number, its prior centred at the arm's value.

    Args:
        arm: gives the values.
        widths: standard deviation by path, or of `load`, as `5%` of the value or as `2mm`.

    Raises:
        InputError: no such number, no width of its unit, or one that is not small.
    """
    return tuple(_parameter(arm, path, text) for path, text in widths.items())


def scaled_bodies(arm: Arm, paths: Iterable[str]) -> tuple[str, ...]:
    """Return the bodies whose mass is uncertain: their inertia goes with it."""
    names = {part.name for part in arm.parts() if isinstance(part, Body)}
    return tuple(name for path in paths if path.endswith(".mass") and (name := path.removesuffix(".mass")) in names)


def scaled_inertia(arm: Arm, parameters: Mapping[str, Any], bodies: tuple[str, ...]) -> Arm:
    """Return an arm with the inertia of some bodies in proportion to the mass that they are to have."""

    def body(node: Any) -> Any:
        if not isinstance(node, Body) or node.name not in bodies:
            return node
        factor = jnp.asarray(parameters[f"{node.name}.mass"]) / node.mass
        inertia = jnp.reshape(node.inertia, node.inertia.shape + (1,) * factor.ndim) * factor
        return eqx.tree_at(lambda b: b.inertia, node, inertia)

    return jax.tree.map(body, arm, is_leaf=lambda node: isinstance(node, Body)) if bodies else arm


def _parameter(arm: Arm, path: str, text: str) -> Parameter:
    value = 1.0 if path == LOAD else float(arm.get(path))
    field = None if path == LOAD else field_of(path)
    positive, said = path == LOAD or bool(field and field.logarithmic), f"{path}:{text}"
    unit = field.unit if field and field.unit != "-" else ""
    found = width(text, unit)
    if found is None:
        expected = f"a width > 0, as a share (5%){f' or in a unit such as {unit}' if unit else ''}"
        raise InputError(Problem("uncertain", said, expected, "correct it"))
    if value == 0 and (found.share or positive):
        raise InputError(Problem("uncertain", f"{said} of a value of zero", "a value", "give it one"))
    sd = found.size * abs(value) if found.share else found.size
    if positive and not NUISANCE_NARROWEST <= sd / abs(value) <= NUISANCE_WIDEST:
        expected = f"a width from {NUISANCE_NARROWEST:.0e} to {NUISANCE_WIDEST:g} of its value"
        raise InputError(Problem("uncertain", said, expected, "free it (`free`), or drop it"))
    if positive and value > 0:
        return Parameter((path,), True, value, value, sd / value, nuisance=True)
    return Parameter((path,), False, value, value, 1.0, sd, nuisance=True)


def scaled_loads(loads: Loads, scale: Any) -> Loads:
    """Return load cases whose masses, forces and moments are all off by one factor; payloads are the arm's own.

    Args:
        loads: batch `(S, *ones)`.
        scale: `()` or `(*batch)`.
    """
    moment = None if loads.moment is None else loads.moment * scale
    return Loads(loads.payload, loads.mass * scale, loads.force * scale, moment)


def check_measurable(widths: Mapping[str, str], loads: Loads) -> None:
    """Refuse a scale of loads where nothing was loaded but by payloads."""
    measured = (loads.mass, loads.force, loads.moment)
    if LOAD in widths and not any(np.any(part) for part in measured if part is not None):
        got = "load, and no row with a mass, force or moment"
        raise InputError(Problem("uncertain", got, "one at least", "drop it"))
