"""Numbers of an arm put into a TOML document that stays as it is written otherwise."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.fields import COMPONENTS
from ident.arm.parts import Body
from ident.description.quantities import Origin, si
from ident.errors import InputError, Problem

NEAR = 1e-9
"""Share of an inertia within which two are the same: that of twelve digits."""


def set_numbers(tables: Mapping[str, Any], values: Mapping[str, float], origin: Origin, where: str) -> None:
    """Put numbers [SI] into tables, by paths as in `Arm.paths()`, and their origin.

    Raises:
        InputError: the tables have no such number.
    """
    for path, value in values.items():
        entry, holder, key = _slot(tables, path, where)
        holder[key] = _in_unit(entry, value)
        entry["origin"] = origin


def changed_numbers(before: Arm, after: Arm) -> dict[str, float]:
    """Return the numbers [SI] of an arm that another one has otherwise, inertias left out: see `set_inertias`."""
    own = before.numbers()
    numbers = ((path, float(value)) for path, value in after.numbers().items() if ".inertia." not in path)
    return {path: value for path, value in numbers if path not in own or value != float(own[path])}


def changed_bodies(before: Arm, after: Arm) -> list[Body]:
    """Return the bodies of an arm that have another mass, mass centre or inertia than in another one."""
    own = {body.name: body for body in bodies_of(before)}
    return [body for body in bodies_of(after) if body.name in own and not _alike(own[body.name], body)]


def set_inertias(tables: Mapping[str, Any], before: Arm, after: Arm, origin: Origin) -> None:
    """Put the inertias of bodies into tables where they differ, in place of a shape if that would give another one.

    Args:
        tables: by name; what has no table stays out.
        before: the arm that the tables describe.
        after: the arm that they are to describe.
        origin: of these inertias.
    """
    own = {body.name: np.asarray(body.inertia) for body in bodies_of(before)}
    for body in bodies_of(after):
        tensor, old = np.asarray(body.inertia), own.get(body.name)
        if body.name in tables and old is not None and np.abs(tensor - old).max() > NEAR * np.abs(tensor).max():
            _set_inertia(tables[body.name], tensor, origin)


def bodies_of(arm: Arm) -> list[Body]:
    """Return all bodies of an arm, those of its payloads last."""
    return [part for part in arm.parts() if isinstance(part, Body)]


def _alike(one: Body, other: Body) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("mass", "com", "inertia"))


def _set_inertia(table: Any, tensor: Float[np.ndarray, "3 3"], origin: Origin) -> None:
    if "inertia" not in table:
        del table["shape"]
        table["inertia"] = tomlkit.inline_table()
        table["inertia"]["unit"] = "kg*m^2"
    entry = table["inertia"]
    diagonal = not (tensor - np.diag(np.diag(tensor))).any()
    rows = [[_in_unit(entry, x) for x in row] for row in tensor]
    entry["value"] = [rows[n][n] for n in range(3)] if diagonal else rows
    entry["origin"] = origin


def _in_unit(entry: Any, value: float) -> float:
    unit = si(1.0, entry["unit"]) if "unit" in entry else 1.0
    return float(f"{value / unit:.12g}")


def _slot(tables: Mapping[str, Any], path: str, where: str) -> tuple[Any, Any, Any]:
    """Return the quantity's table, and the container and key of the number in it."""
    try:
        name, field, *rest = path.split(".")
        entry = holder = tables[name][field]
        key: Any = rest.pop(0) if field == "shape" else "value"
        index = COMPONENTS[rest[0]] if rest else ()
        if len(index) == 2 and not isinstance(entry[key][0], list):
            index = index[:1]
        for step in index:
            holder, key = holder[key], step
        float(holder[key])
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(Problem(where, path, "a number of this file", "see `Arm.paths()`")) from None
    return entry, holder, key
