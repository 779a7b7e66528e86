"""Unfinished work on disk: values as a tree of plain data and a list of arrays, and the store that keeps their parts.

In the tree a container is `{"list": [...]}`, an array `{"array": its place in the list}`, and a record, which is a
dataclass or named tuple of ident, `{"record": [its name, {field: value, ...}]}`. The name is looked up among the
records that this process has imported: reading a file imports nothing and runs no code, not even a constructor's.
"""

import hashlib
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from ident.errors import IdentError, refusal
from ident.files import claimed, replace_file, write_text
from ident.text import one_line

PLAIN = (type(None), bool, int, float, str)
"""What JSON has a word for; that Python's JSON has one for infinity and NaN, too."""
CONTAINERS: dict[str, tuple[type, Callable[[Any], Any], Callable[[list[Any]], Any]]] = {
    "tuple": (tuple, iter, tuple),
    "list": (list, iter, list),
    "set": (frozenset, lambda items: sorted(items, key=repr), frozenset),
    "map": (Mapping, lambda mapping: mapping.items(), dict),
    "path": (PurePath, lambda path: path.parts, lambda parts: Path(*parts)),
    "slice": (slice, lambda part: (part.start, part.stop, part.step), lambda parts: slice(*parts)),
}
"""Containers by name: type, what one holds, and how it is made of that."""


class CodecError(IdentError):
    """A document is none of ours, or a value can't be written."""


def encode(value: Any, arrays: list[Any]) -> Any:
    """Return a value as data that JSON knows, and append its arrays to a list.

    Args:
        value: numbers, text, containers, arrays, dataclasses, equinox modules, named tuples and enumerations.
        arrays: the list.

    Raises:
        CodecError: the value holds something else, such as a function.
    """
    kind = type(value)
    if kind in PLAIN:
        return value
    if hasattr(value, "shape") and getattr(value, "dtype", np.dtype(object)).kind != "O":
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if kind.__module__.startswith("ident."):
        if isinstance(value, Enum):
            return {"member": [_name(kind), value.name]}
        if (names := _field_names(kind)) is not None:
            return {"record": [_name(kind), {name: encode(getattr(value, name), arrays) for name in names}]}
    for name, (container, parts, _) in CONTAINERS.items():
        if isinstance(value, container) and not hasattr(kind, "_fields"):  # a foreign named tuple would come back bare
            return {name: [encode(part, arrays) for part in parts(value)]}
    raise CodecError(f"{value!r:.60} can't be kept in a file")


def decode(document: Any, arrays: Sequence[Any]) -> Any:
    """Return the value that `encode` has written.

    Raises:
        CodecError: the document is none of ours, or of a version of ident whose records differ.
    """
    try:
        return _decoded(document, arrays)
    except Exception as error:  # whatever a document from elsewhere may do
        raise CodecError(f"{type(error).__name__}: {error}") from None


def value_digest(value: Any) -> str:
    """Return a hash of a value that `encode` can write."""
    arrays = list[Any]()
    hashed = hashlib.sha256(json.dumps(encode(value, arrays)).encode())
    for array in map(np.asarray, arrays):
        hashed.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
    return hashed.hexdigest()


def _decoded(document: Any, arrays: Sequence[Any]) -> Any:
    if type(document) in PLAIN:
        return document
    ((name, content),) = document.items()
    if name == "array":
        return arrays[content]
    if name == "member":
        return _known(content[0], Enum)[content[1]]
    if name == "record":
        kind, values = _known(content[0], object), {key: _decoded(each, arrays) for key, each in content[1].items()}
        if values.keys() != set(_field_names(kind) or ()):
            raise CodecError(f"{content[0]} of another version of ident")
        return kind(**values) if issubclass(kind, tuple) else _restored(kind, values)
    return CONTAINERS[name][2]([_decoded(part, arrays) for part in content])


def _restored(kind: type, values: Mapping[str, Any]) -> Any:
    """Return an object with these fields; what its constructor would check was checked when it was first made."""
    restored: Any = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(restored, name, value)
    return restored


def _field_names(kind: type) -> Sequence[str] | None:
    """Return the fields of a record; None for what is none."""
    return [field.name for field in fields(kind)] if is_dataclass(kind) else getattr(kind, "_fields", None)


def _name(kind: type) -> str:
    return f"{kind.__module__.removeprefix('ident.')}:{kind.__qualname__}"


def _known(name: str, base: type) -> Any:
    """Return the record, or the enumeration, of a name, among those that this process has imported."""
    module, _, own = name.partition(":")
    kind = getattr(sys.modules.get(f"ident.{module}"), own, None)
    if not (isinstance(kind, type) and issubclass(kind, base) and _name(kind) == name):
        raise CodecError(f"no record of ident: {name:.60}")
    return kind


# -------- Items
# A value as a file: an npz archive of its arrays and of the tree that holds them.

TREE = "tree"
SORTS: dict[str, Callable[[np.ndarray], Any]] = {"numpy": np.asarray, "scalar": lambda array: array[()]}
"""How arrays come back; others are of jax."""


def write_item(path: Path, value: Any, *, make_folders: bool = False) -> None:
    """Write a value, whole or not at all.

    Raises:
        InputError: it can't be written; what was there is untouched.
        CodecError: it holds what no file does.
    """
    arrays = list[Any]()
    tree = encode(value, arrays)
    sorts = ["scalar" if isinstance(a, np.generic) else "numpy" if isinstance(a, np.ndarray) else "jax" for a in arrays]
    text = np.frombuffer(json.dumps([tree, sorts]).encode(), np.uint8)
    parts = {TREE: text, **{f"a{i}": np.asarray(array) for i, array in enumerate(arrays)}}
    replace_file(path, lambda out: np.savez(out, allow_pickle=False, **parts), make_folders=make_folders)


def read_item(path: Path) -> Any:
    """Return what was written; None where nothing was, or the file is damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as parts:
            tree, sorts = json.loads(parts[TREE].tobytes())
            arrays = [parts[f"a{i}"] for i in range(len(sorts))]
        return decode(tree, [SORTS.get(sort, _jax)(array) for sort, array in zip(sorts, arrays, strict=True)])
    except Exception:  # whatever a damaged file makes zipfile, NumPy or the tree's reader raise
        return None


def _jax(array: np.ndarray) -> Any:
    import jax.numpy as jnp

    return jnp.asarray(array)


# -------- Store
# Parts of unfinished work on disk: a run that was killed at any moment goes on behind the last of them.

IDENTITY = "run.json"
END = ".item"


class Store:
    """The finished parts of one run, a file each, in a folder of its own; without a folder nothing is kept.

    An item is any value that `encode` takes. It is written whole or not at all, and a damaged one counts as not there.
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
            write_text(self.folder / IDENTITY, json.dumps(dict(identity), indent=1, sort_keys=True))

    def read(self, name: str) -> Any:
        """Return an item; None if it is not there, or damaged."""
        return read_item(self.folder / f"{name}{END}") if self.folder else None

    def write(self, name: str, value: Any) -> None:
        """Keep an item.

        Raises:
            InputError: it can't be written; the items before are untouched.
        """
        if self.folder:
            write_item(self.folder / f"{name}{END}", value)

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
