"""Values as plain data and back: dataclasses, equinox modules, named tuples and arrays, to the last bit.

An object is written where it is first met, {"class": its name, field: value, ...}; where an equal one is met again, the
first is marked by a number, "as", and referred to by {"same": that number}. So a document depends on values alone, not
on which of them were one object in memory. An array is {"numpy": nested lists}, or "jax", with
its dtype unless that is float64; floats are written so that the same come back. A tuple is a list; what JSON has no
word for says what it is: {"map": ...}, {"list": ...}, {"set": ...}, {"path": ...}, {"float": "inf"}.

What comes back is built without running any code but that of the classes named, all of which are ident's own: a file
from elsewhere can make no others.
"""

import hashlib
import importlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path, PurePath
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ident.errors import IdentError, refusal
from ident.files import claimed, replace_file
from ident.text import one_line

KEPT_APART = 512
"""Numbers from which an array is kept apart from the document, where there is a place for it."""
ROOMS = ("errors", "arm", "description", "measure", "inference", "modal", "identify", "vibrate", "assess", "studies")
"""Where the values lie that a file may hold."""
KINDS = "fiubcU"
"""Kinds of numbers and text that an array may hold, as numpy has them."""


class CodecError(IdentError):
    """A document is none of ours, or a value can't be written."""


def encode(value: Any, arrays: dict[str, np.ndarray] | None = None) -> Any:
    """Return a value as data that JSON knows.

    Args:
        value: numbers, text, containers, arrays, dataclasses, equinox modules, named tuples and enumerations.
        arrays: takes large arrays, by name; without it all are written into the document.

    Raises:
        CodecError: the value holds something else, such as a function.
    """
    writer = _Writer(arrays)
    plain = writer.plain(value)
    for document in writer.written.values():
        if document["as"] is None:
            del document["as"]
    return plain


def decode(document: Any, arrays: Mapping[str, np.ndarray] | None = None) -> Any:
    """Return the value that `encode` has written.

    Raises:
        CodecError: the document is none of ours, or of a version of ident whose classes differ.
    """
    try:
        return _Reader(arrays or {}).value(document)
    except CodecError:
        raise
    except Exception as error:  # whatever else a document from elsewhere may do
        raise CodecError(f"{type(error).__name__}: {error}") from None


class _Writer:
    def __init__(self, arrays: dict[str, np.ndarray] | None):
        self.arrays, self.shared, self.keys = arrays, 0, _Keys()
        self.written: dict[str, dict[str, Any]] = {}

    def plain(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, str):
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"float": repr(value)}
        if type(value) is tuple:
            return [self.plain(item) for item in value]
        if isinstance(value, list):
            return {"list": [self.plain(item) for item in value]}
        if type(value) is frozenset:
            ordered = sorted(value, key=lambda item: json.dumps(self.keys.plain(item)))
            return {"set": [self.plain(item) for item in ordered]}
        if isinstance(value, Mapping):
            return {"map": self.mapping(value)}
        if isinstance(value, PurePath):
            return {"path": str(value)}
        if isinstance(value, slice):
            return {"slice": [self.plain(part) for part in (value.start, value.stop, value.step)]}
        if isinstance(value, Enum):
            return {"enum": _name(type(value)), "member": value.name}
        if hasattr(value, "dtype") and hasattr(value, "shape"):
            return self.array(value)
        return self.thing(value)

    def mapping(self, value: Mapping[Any, Any]) -> Any:
        if all(type(key) is str for key in value):
            return {key: self.plain(item) for key, item in value.items()}
        return [[self.plain(key), self.plain(item)] for key, item in value.items()]

    def array(self, value: Any) -> dict[str, Any]:
        array, kind = np.asarray(value), _array_kind(value)
        if self.arrays is not None and array.size > KEPT_APART and array.dtype.kind in "fiubc":
            name, parts = f"a{len(self.arrays)}", array.dtype.kind == "c"
            self.arrays[name] = _in_parts(array) if parts else array
            return {kind: {"apart": name}} | ({"dtype": array.dtype.newbyteorder("=").str} if parts else {})
        document = {kind: _nested(array)}
        if array.dtype != np.float64:
            document["dtype"] = array.dtype.newbyteorder("=").str
        return document | ({} if array.size else {"shape": list(array.shape)})

    def thing(self, value: Any) -> dict[str, Any]:
        """Write an object once, however often it or an equal one is held."""
        key = self.keys.thing(value)
        if document := self.written.get(key):
            if document["as"] is None:
                self.shared += 1
                document["as"] = self.shared
            return {"same": document["as"]}
        self.written[key] = document = {"class": _name(type(value)), "as": None}
        document |= self.fields(value)
        return document

    def fields(self, value: Any) -> dict[str, Any]:
        names = _field_names(type(value))
        if names is None or not type(value).__module__.startswith("ident."):
            raise CodecError(f"{value!r:.60} can't be kept in a file")
        return {name: self.plain(getattr(value, name)) for name in names}


class _Keys(_Writer):
    """Writes of an object, or an array, only a hash of its contents: the same for equal ones."""

    def __init__(self) -> None:
        self.keys = self
        self.known: dict[int, tuple[Any, str]] = {}  # with the objects: an identity is one while it lives

    def array(self, value: Any) -> Any:
        array = np.asarray(value)
        array = array.astype(array.dtype.newbyteorder("="), copy=False)
        contents = _nested(array) if array.dtype.kind == "U" else hashlib.sha256(array.tobytes()).hexdigest()
        return [_array_kind(value), array.dtype.str, array.shape, contents]

    def thing(self, value: Any) -> Any:
        if id(value) not in self.known:
            text = json.dumps([_name(type(value)), self.fields(value)])
            self.known[id(value)] = value, hashlib.sha256(text.encode()).hexdigest()
        return self.known[id(value)][1]


class _Reader:
    def __init__(self, arrays: Mapping[str, np.ndarray]):
        self.arrays, self.shared = arrays, dict[int, Any]()

    def value(self, plain: Any) -> Any:
        if isinstance(plain, list):
            return tuple(self.value(item) for item in plain)
        if not isinstance(plain, dict):
            return plain
        if "class" in plain:
            return self.thing(plain)
        readers: dict[str, Any] = {
            "same": lambda number: self.shared[number],
            "float": float,
            "list": lambda items: [self.value(item) for item in items],
            "set": lambda items: frozenset(map(self.value, items)),
            "map": self.mapping,
            "path": Path,
            "slice": lambda parts: slice(*map(self.value, parts)),
            "enum": lambda name: _class(name)[plain["member"]],
            "numpy": lambda content: self.array(content, plain),
            "scalar": lambda content: self.array(content, plain)[()],
            "jax": lambda content: _jax(self.array(content, plain)),
        }
        kind = next(name for name in plain if name in readers)
        return readers[kind](plain[kind])

    def mapping(self, content: Any) -> dict[Any, Any]:
        pairs = content.items() if isinstance(content, dict) else [(self.value(key), item) for key, item in content]
        return {key: self.value(item) for key, item in pairs}

    def array(self, content: Any, plain: Mapping[str, Any]) -> np.ndarray:
        dtype = np.dtype(plain.get("dtype", "f8"))
        if dtype.kind not in KINDS:
            raise CodecError(f"an array of {dtype}")
        parts = dtype.kind == "c"
        if isinstance(content, dict):
            apart = np.ascontiguousarray(self.arrays[content["apart"]])
            return apart.view(dtype)[..., 0] if parts else apart
        array = np.array(content, f"f{dtype.itemsize // 2}" if parts else dtype)
        array = array.reshape(*plain["shape"], *([2] if parts else [])) if "shape" in plain else array
        return array.view(dtype)[..., 0] if parts else array

    def thing(self, plain: dict[str, Any]) -> Any:
        kind, written = _class(plain["class"]), plain.keys() - {"class", "as"}
        if written != set(_field_names(kind) or ()):
            raise CodecError(f"{plain['class']} of another version of ident")
        values = {name: self.value(plain[name]) for name in plain if name in written}
        value = kind(**values) if issubclass(kind, tuple) else _restored(kind, values)
        if "as" in plain:
            self.shared[plain["as"]] = value
        return value


def _array_kind(value: Any) -> str:
    """Return the word for an array.

    Raises:
        CodecError: it holds what no file does.
    """
    if np.asarray(value).dtype.kind not in KINDS:
        raise CodecError(f"an array of {value.dtype}")
    return "scalar" if isinstance(value, np.generic) else "numpy" if isinstance(value, np.ndarray) else "jax"


def _nested(array: np.ndarray) -> Any:
    """Return an array as nested lists: complex numbers as pairs, what is not finite as text."""
    if array.dtype.kind == "c":
        array = _in_parts(array)
    if array.dtype.kind != "f" or np.isfinite(array).all():
        return array.tolist()
    finite, items = np.isfinite(array), array.astype(object)
    items[~finite] = array[~finite].astype(str)
    return items.tolist()


def _in_parts(array: np.ndarray) -> np.ndarray:
    """Return complex numbers as pairs of their parts, along a further axis."""
    return np.stack([array.real, array.imag], -1)


def _jax(array: np.ndarray) -> Any:
    import jax.numpy as jnp

    return jnp.asarray(array)


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


# -------- Store
# Parts of unfinished work on disk: a run that was killed at any moment goes on behind the last of them.

IDENTITY = "run.json"
END = ".item"
TREE = "tree"
BROKEN = (OSError, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError, BadZipFile, CodecError)
"""What reading a damaged item may raise."""


class Store:
    """The finished parts of one run, a file each, in a folder of its own; without a folder nothing is kept.

    An item is any value that `ident.codec` can write: an npz file of its large arrays and of the tree that holds them.
    It is written whole or not at all, and a damaged one counts as not there.
    """

    def __init__(self, folder: Path | None, identity: Mapping[str, str]):
        """Claim a folder for a run.

        Args:
            folder: where the items go; None to keep nothing.
            identity: what the run depends on, by name: all of it must be equal for the run to be gone on with.

        Raises:
            InputError: the folder holds another run, or can't be written to; what is there is untouched.
        """
        self.folder = folder
        if folder is not None and os.path.exists(folder / IDENTITY):
            _compare(folder, identity)
        self.depends_on(identity)

    def depends_on(self, identity: Mapping[str, str]) -> None:
        """Keep what the items that are there depend on; what is not named may change before the run goes on."""
        if self.folder is not None:
            text = json.dumps(dict(identity), indent=1, sort_keys=True)
            replace_file(self.folder / IDENTITY, lambda out: out.write(text.encode("utf-8")), make_folders=True)

    def read(self, name: str) -> Any:
        """Return an item; None if it is not there, or damaged."""
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / f"{name}{END}", allow_pickle=False) as parts:
                arrays = {key: parts[key] for key in parts.files}
            return decode(json.loads(arrays.pop(TREE).tobytes()), arrays)
        except BROKEN:
            return None

    def write(self, name: str, value: Any) -> None:
        """Keep an item.

        Raises:
            InputError: it can't be written; the items before are untouched.
        """
        if self.folder is None:
            return
        arrays: dict[str, Any] = {}
        tree = json.dumps(encode(value, arrays)).encode("utf-8")
        arrays[TREE] = np.frombuffer(tree, np.uint8)
        replace_file(self.folder / f"{name}{END}", lambda out: np.savez(out, **arrays))

    def remove(self, name: str) -> None:
        """Remove an item, if it is there."""
        if self.folder is not None:
            (self.folder / f"{name}{END}").unlink(missing_ok=True)

    @staticmethod
    def empty(folder: Path) -> None:
        """Remove the items of a folder in which a run has kept some; nothing else."""
        if os.path.exists(folder / IDENTITY):
            for file in [*folder.glob(f"*{END}"), *folder.glob(".ident-*.part"), folder / IDENTITY]:
                file.unlink(missing_ok=True)

    @staticmethod
    def discard(folder: Path) -> None:
        """Remove the items of a folder in which a run has kept some, and the folder if nothing else is in it.

        Raises:
            InputError: another run is at work there.
        """
        if os.path.exists(folder / IDENTITY):
            with claimed(folder):
                Store.empty(folder)


def _compare(folder: Path, wanted: Mapping[str, str]) -> None:
    """Refuse a folder of a run with another identity, or with one that can't be read."""
    try:
        identity = dict(json.loads((folder / IDENTITY).read_text("utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        identity = dict.fromkeys(wanted)
    if other := [name for name in wanted if identity.get(name, wanted[name]) != wanted[name]]:
        got = f"the checkpoints of a run with another {', another '.join(other)}"
        remedy = (
            "take the inputs and options of that run, or start again (`restart`), or choose another folder (`folder`)"
        )
        raise refusal(one_line(str(folder)), got, "those of this run", remedy)
