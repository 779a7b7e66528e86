"""Traced programs that are kept from run to run: a known one is neither traced nor lowered again.

A program is exported (`jax.export`, StableHLO) into a file beside jax's compilation cache, with the tree that its
arrays come back in. A later process reads it by a key of all that it may depend on: the structure of the arguments with
their shapes, dtypes, weak types and static values; the compiler's options; and the circumstances, such as the package's
own source files. What the key can't name, a function from outside the package say, is not kept.

Only where `IDENT_PROGRAMS` is set, and not to one of `OFF`, as the command line does, and jax has a compilation
cache: a process of Python may have changed a constant of the package, which no key can see. Nothing is unpickled; a
folder that others can write is not used, and a damaged or foreign file is passed over.
"""

import hashlib
import json
import os
import platform
import re
import shutil
import stat
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from contextvars import Context
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax import export

from ident.codec import CodecError, decode, encode
from ident.errors import IdentError
from ident.files import replace_file
from ident.program_keys import NotKeptError, aval, described

LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "diffrax", "numpy")
"""What programs are made with."""
UNIMPORTANT = ("cache", "log", "dump", "traceback", "profil")
"""Words in the names of jax's settings that no program depends on."""
UNCHECKED = [export.DisabledSafetyCheck.custom_call(name) for name in ("lapack_dormqr_ffi",)]
"""What jax may change from version to version: the key names the version."""
OFF = ("", "0", "off", "no", "n", "false", "f")
"""What switches off what an environment variable switches on."""
OLD = 30 * 86400
"""Age [s] from which a folder to which no program was added is thrown away."""
Place = np.uint16
"""Marks, in the tree of what comes back, where the array of this number belongs."""


class _NoExportError(IdentError):
    """What jax can't export, such as a callback."""


class Programs:
    """The programs of one function, by the structure of its arguments.

    Args:
        f: the function.
        options: for `jax.jit`.
    """

    def __init__(self, f: Callable[..., Any], options: Mapping[str, Any]):
        self.f, self.options = f, options
        self.loaded: dict[Any, Callable[[list[Any]], Any]] = {}
        self.refused: set[int] = set()  # hashes only: what can't be kept must not be held on to either
        self.lock = RLock()  # of several threads that ask for one program, the first makes it

    def find(
        self, args: tuple[Any, ...], more: Mapping[str, Any], flat: tuple[list[Any], Any] | None = None
    ) -> Callable[[list[Any]], Any] | None:
        """Return what computes f of these arguments without tracing it, or None where there is no such thing.

        Args:
            args: of f.
            more: the named ones.
            flat: the leaves of both, and their structure, where these are known; what is returned takes such leaves.
        """
        leaves, tree = flat or jax.tree.flatten((args, more))
        arrays = tuple(aval(leaf) for leaf in leaves if eqx.is_array(leaf))
        settings = tuple(jax.config.values.values())
        key = tree, tuple((type(leaf), leaf) for leaf in leaves if not eqx.is_array(leaf)), arrays, settings
        try:
            with self.lock:
                if key not in self.loaded and hash(key) not in self.refused:
                    self._take(key, self._program(args, more))
                return self.loaded.get(key)
        except TypeError:  # a static value that has no hash, or what the function itself will raise again
            return None

    def _take(self, key: Any, program: Callable[[list[Any]], Any] | None) -> None:
        if program:
            self.loaded[key] = program
        else:
            self.refused.add(hash(key))

    def _program(self, args: tuple[Any, ...], more: Mapping[str, Any]) -> Callable[[list[Any]], Any] | None:
        """Read a program from its file, or trace it and write it there."""
        folder = own_folder()
        if folder is None:
            return None
        try:
            key = json.dumps([described(self.f), described((args, more)), described(dict(self.options))])
        except NotKeptError:
            return None
        path = folder / f"{self.f.__name__}-{hashlib.sha256(key.encode()).hexdigest()[:24]}.program"
        found = _read(path, key)
        if found is not None:
            with suppress(Exception):  # whatever a file from elsewhere may do
                return self._callable(*found) if found[0] else None
        try:
            exported, document = self._traced(args, more)
        except (CodecError, _NoExportError):
            exported, document = b"", None
        except ValueError:  # the function's own, of these numbers perhaps: nothing is said of the program
            return None
        if sources(Path(__file__).parent) == SOURCES:
            with suppress(IdentError):  # a full disk, say
                # in a context of its own: a program is kept whatever becomes of the set of files being written now
                Context().run(replace_file, path, lambda file: file.write(_packed(key, exported, document)))
        return self._callable(exported, document) if exported else None

    def _traced(self, args: tuple[Any, ...], more: Mapping[str, Any]) -> tuple[bytes, Any]:
        arrays, static = eqx.partition((args, more), eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        shapes: list[Any] = []

        def flat(*leaves: Any) -> list[Any]:
            args, more = eqx.combine(jax.tree.unflatten(tree, leaves), static)
            arrays, rest = eqx.partition(self.f(*args, **more), eqx.is_array)
            outputs, out_tree = jax.tree.flatten(arrays)
            places = jax.tree.unflatten(out_tree, [Place(i) for i in range(len(outputs))])
            shapes.append(encode(eqx.combine(places, rest)))
            return outputs

        program = jax.jit(flat)
        program.trace(*leaves)  # kept by jax: the export traces nothing again
        try:
            exported = export.export(program, disabled_checks=UNCHECKED)(*leaves)
            return bytes(exported.serialize()), shapes[0]
        except (ValueError, NotImplementedError) as error:
            raise _NoExportError(str(error)) from None

    def _callable(self, exported: bytes, document: Any) -> Callable[[list[Any]], Any]:
        run = jax.jit(export.deserialize(bytearray(exported)).call, **self.options)
        marks, tree = jax.tree.flatten(decode(document))

        def call(leaves: list[Any]) -> Any:
            arrays = run(*filter(eqx.is_array, leaves))
            return jax.tree.unflatten(tree, [arrays[int(m)] if isinstance(m, np.generic) else m for m in marks])

        return call


def own_folder() -> Path | None:
    """Return the folder for programs under these circumstances; None where there is none, or others can write it."""
    cache_folder = jax.config.values["jax_compilation_cache_dir"]
    if not cache_folder or os.environ.get("IDENT_PROGRAMS", "").strip().lower() in OFF:
        return None
    above = Path(cache_folder) / "ident-programs"
    folder = above / environment()
    try:
        above.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _only_ours(above):
            return None
        if not folder.exists():
            folder.mkdir(mode=0o700, exist_ok=True)
            _throw_away_old(above)
        return folder if _only_ours(folder) else None
    except (OSError, AttributeError):  # no such place, or a system that knows no owners
        return None


def _only_ours(folder: Path) -> bool:
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022


def _throw_away_old(above: Path) -> None:
    """Delete folders of programs, and nothing else, to which none was added for a long time."""
    for folder in above.iterdir():
        ours = re.fullmatch("[0-9a-f]{24}", folder.name) and _only_ours(folder)
        if (
            ours
            and time.time() - folder.stat().st_mtime > OLD
            and all(f.suffix == ".program" for f in folder.iterdir())
        ):
            shutil.rmtree(folder, ignore_errors=True)


def environment() -> str:
    """Return a hash of what all programs depend on."""
    every = {"sources": SOURCES, **circumstances()}
    return hashlib.sha256(json.dumps(every, sort_keys=True).encode()).hexdigest()[:24]


def circumstances() -> dict[str, Any]:
    """Return what all programs depend on beside the sources: libraries, configuration, machine."""
    settings = jax.config.values.items()
    return {
        "libraries": _versions(),
        "python": sys.version,
        "jax": {name: str(value) for name, value in settings if not any(word in name for word in UNIMPORTANT)},
        "flags": [os.environ.get(name) for name in ("XLA_FLAGS", "EQX_ON_ERROR")],
        "machine": [jax.default_backend(), platform.machine(), _processor()],
    }


def sources(package: Path) -> str:
    """Return a hash of all source files of a package."""
    own = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        own.update(f"{path.relative_to(package)}\0".encode() + path.read_bytes() + b"\0")
    return own.hexdigest()


SOURCES = sources(Path(__file__).parent)
"""Of this package, when it was imported: what is changed later has not been traced."""


@cache
def _versions() -> tuple[str, ...]:
    return tuple(version(name) for name in LIBRARIES)


@cache
def _processor() -> str:
    """Return what the processor can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())


def _packed(key: str, exported: bytes, document: Any) -> bytes:
    head = {"key": key, "sha256": _sealed(exported, document), "out": document}
    return json.dumps(head).encode() + b"\n" + exported


def _sealed(exported: bytes, document: Any) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode() + b"\n" + exported).hexdigest()


def _read(path: Path, key: str) -> tuple[bytes, Any] | None:
    """Return what a file holds: a program, empty where there can be none, and the tree of what it returns."""
    try:
        text, _, exported = path.read_bytes().partition(b"\n")
        head = json.loads(text)
        whole = head["key"] == key and head["sha256"] == _sealed(exported, head["out"])
        return (exported, head["out"]) if whole else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
