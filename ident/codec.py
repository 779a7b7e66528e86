"""Values as plain data and back: dataclasses, equinox modules, named tuples and arrays, to the last bit.

A document holds each object once, by the name of its class. What comes back is built without running any code but
that of the classes named, all of which are ident's own: a file from elsewhere can make no others.
"""

import base64
import importlib
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from ident.errors import IdentError

KEPT_APART = 4096
"""Bytes from which an array is kept apart from the document, where there is a place for it."""
ROOMS = ("errors", "arm", "description", "measure", "inference", "identify", "vibrate", "assess", "studies")
"""Where the values lie that a file may hold."""
SEQUENCES: dict[str, Any] = {"tuple": tuple, "set": frozenset}


class CodecError(IdentError):
    """A document is none of ours, or a value can't be written."""


def encode(value: Any, arrays: dict[str, np.ndarray] | None = None) -> dict[str, Any]:
    """Return a value as data that JSON knows.

    Args:
        value: numbers, text, containers, arrays, dataclasses, equinox modules, named tuples and enumerations.
        arrays: takes large arrays, by name; without it all are written into the document.

    Raises:
        CodecError: the value holds something else, such as a function.
    """
    writer = _Writer(arrays)
    return {"value": writer.plain(value), "objects": writer.objects}


def decode(document: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> Any:
    """Return the value that `encode` has written.

    Raises:
        CodecError: the document is none of ours, or of a version of ident whose classes differ.
    """
    try:
        return _Reader(document["objects"], arrays or {}).value(document["value"])
    except CodecError:
        raise
    except Exception as error:  # whatever else a document from elsewhere may do
        raise CodecError(f"{type(error).__name__}: {error}") from None


class _Writer:
    def __init__(self, arrays: dict[str, np.ndarray] | None):
        self.objects: list[dict[str, Any] | None] = []
        self.arrays, self.places, self.alive = arrays, dict[int, int](), list[Any]()

    def plain(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, str):
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"float": repr(value)}
        if isinstance(value, list):
            return [self.plain(item) for item in value]
        if isinstance(value, Mapping):
            return {"map": [[self.plain(key), self.plain(item)] for key, item in value.items()]}
        if isinstance(value, PurePath):
            return {"path": str(value)}
        if isinstance(value, slice):
            return {"slice": [self.plain(part) for part in (value.start, value.stop, value.step)]}
        for name, kind in SEQUENCES.items():
            if type(value) is kind:
                return {name: [self.plain(item) for item in value]}
        if isinstance(value, Enum):
            return {"enum": _name(type(value)), "member": value.name}
        if hasattr(value, "dtype") and hasattr(value, "shape"):
            return self.array(value)
        return self.thing(value)

    def array(self, value: Any) -> dict[str, Any]:
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise CodecError("an array of objects")
        kind = "scalar" if isinstance(value, np.generic) else "numpy" if isinstance(value, np.ndarray) else "jax"
        if self.arrays is not None and array.nbytes > KEPT_APART and array.dtype.kind in "fiub":
            name = f"a{len(self.arrays)}"
            self.arrays[name] = array
            return {kind: name}
        little = array.astype(array.dtype.newbyteorder("<"))
        data = base64.b64encode(little.tobytes()).decode("ascii")
        return {kind: data, "dtype": little.dtype.str, "shape": list(array.shape)}

    def thing(self, value: Any) -> dict[str, Any]:
        """Write an object once, however often it is held."""
        if id(value) not in self.places:
            names = _field_names(type(value))
            if names is None or not type(value).__module__.startswith("ident."):
                raise CodecError(f"{value!r:.60} can't be kept in a file")
            place = self.places[id(value)] = len(self.objects)
            self.objects.append(None)
            self.alive.append(value)  # an identity is one as long as its object lives
            written = {name: self.plain(getattr(value, name)) for name in names}
            self.objects[place] = {"class": _name(type(value)), "fields": written}
        return {"object": self.places[id(value)]}


class _Reader:
    def __init__(self, objects: list[Any], arrays: Mapping[str, np.ndarray]):
        self.objects, self.arrays, self.read = objects, arrays, dict[int, Any]()

    def value(self, plain: Any) -> Any:
        if isinstance(plain, list):
            return [self.value(item) for item in plain]
        if not isinstance(plain, dict):
            return plain
        kind = next(iter(plain))
        content = plain[kind]
        if kind in SEQUENCES:
            return SEQUENCES[kind](self.value(item) for item in content)
        if kind in ("numpy", "jax", "scalar"):
            return self.array(kind, plain)
        readers: dict[str, Any] = {
            "float": float,
            "map": lambda pairs: {self.value(key): self.value(item) for key, item in pairs},
            "path": Path,
            "slice": lambda parts: slice(*map(self.value, parts)),
            "enum": lambda name: _class(name)[plain["member"]],
            "object": self.thing,
        }
        return readers[kind](content)

    def array(self, kind: str, plain: dict[str, Any]) -> Any:
        if "dtype" in plain:
            flat = np.frombuffer(base64.b64decode(plain[kind]), np.dtype(plain["dtype"]))
            array = flat.reshape(plain["shape"]).astype(flat.dtype.newbyteorder("="))
        else:
            array = np.asarray(self.arrays[plain[kind]])
        if kind == "jax":
            import jax.numpy as jnp

            return jnp.asarray(array)
        return array[()] if kind == "scalar" else array

    def thing(self, place: int) -> Any:
        if place not in self.read:
            document = self.objects[place]
            kind, written = _class(document["class"]), document["fields"]
            names = _field_names(kind)
            if names is None or set(names) != set(written):
                raise CodecError(f"{document['class']} of another version of ident")
            values = {name: self.value(item) for name, item in written.items()}
            self.read[place] = kind(**values) if issubclass(kind, tuple) else _restored(kind, values)
        return self.read[place]


def _restored(kind: type, values: Mapping[str, Any]) -> Any:
    """Return an object with these fields; what its constructor would check was checked when it was first made."""
    restored: Any = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(restored, name, value)
    return restored


def _field_names(kind: type) -> list[str] | None:
    if is_dataclass(kind):
        return [field.name for field in fields(kind)]
    return list(kind._fields) if issubclass(kind, tuple) and hasattr(kind, "_fields") else None


def _name(kind: type) -> str:
    return f"{kind.__module__.removeprefix('ident.')}:{kind.__qualname__}"


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    if module.partition(".")[0] not in ROOMS or not qualified.replace("_", "").isalnum():
        raise CodecError(f"no class of ident: {name:.60}")
    kind = getattr(importlib.import_module(f"ident.{module}"), qualified)
    if not (isinstance(kind, type) and kind.__module__ == f"ident.{module}"):
        raise CodecError(f"no class of ident: {name:.60}")
    return kind
