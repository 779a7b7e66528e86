"""What a program depends on of its arguments, as data: the part of its key that differs from call to call."""

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import FunctionType
from typing import Any

import equinox as eqx
import numpy as np

from ident.errors import IdentError

PLAIN: tuple[type, ...] = (float, complex, bytes, np.dtype)
"""Types whose values say all of themselves in writing."""


class NotKeptError(IdentError):
    """A program depends on something that its key can't name."""


def aval(array: Any) -> tuple[Any, ...]:
    """Return what is traced of an array: shape, dtype, and whether its type is weak."""
    return array.shape, array.dtype, getattr(array, "weak_type", False)


def described(value: Any) -> Any:
    """Return all of a value that a program can depend on, as data for JSON; of an array what is traced of it."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, PLAIN):
        return [type(value).__name__, repr(value)]
    if eqx.is_array(value):
        return ["array", *map(str, aval(value))]
    if isinstance(value, Enum):
        return ["enum", _name(type(value)), value.name]
    if isinstance(value, Mapping):
        return ["map", _name(type(value)), [[described(k), described(v)] for k, v in value.items()]]
    if isinstance(value, tuple | list):
        return [_name(type(value)), *map(described, value)]
    if isinstance(value, type | FunctionType):
        return ["name", _name(value)]
    if is_dataclass(value):
        return [_name(type(value)), {f.name: described(getattr(value, f.name, None)) for f in fields(value)}]
    raise NotKeptError(f"a {type(value).__name__}")


def _name(thing: Any) -> str:
    """Return the name under which a class or a function of the package or of Python itself is found again."""
    module, name = getattr(thing, "__module__", ""), getattr(thing, "__qualname__", "")
    foreign = module.partition(".")[0] not in ("ident", "builtins") or "<" in name
    if foreign or (getattr(thing, "__closure__", None) and not _is_found(thing, module, name)):
        raise NotKeptError(f"{module}.{name}")
    return f"{module}.{name}"


def _is_found(thing: Any, module: str, name: str) -> bool:
    """Return whether a name leads to a function: to what decorates it, and so on to the function itself."""
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    while found is not None and found is not thing:
        found = getattr(found, "__wrapped__", None)
    return found is thing
