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
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from contextvars import Context
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, wraps
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from types import FunctionType
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
from jax import export

from ident.codec import CodecError, decode, encode, read_item, write_item
from ident.errors import IdentError
from ident.text import LOG

# -------- Program keys
# What a program depends on of its arguments, as data: the part of its key that differs from call to call.

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


# -------- Programs


def _log(event: str, duration_secs: float, **of: Any) -> None:
    if event == "/jax/core/compile/backend_compile_duration":  # from jax's cache, too
        LOG.info("compiled %s in %.2f s", of.get("fun_name", "a program"), duration_secs)


jax.monitoring.register_event_duration_secs_listener(_log)
LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy")
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
        if not are_kept():
            return None
        leaves, tree = flat or jax.tree.flatten((args, more))
        arrays = tuple(aval(leaf) for leaf in leaves if eqx.is_array(leaf))
        settings = tuple(jax.config.values.values())
        key = tree, tuple((type(leaf), leaf) for leaf in leaves if not eqx.is_array(leaf)), arrays, settings
        try:
            with self.lock:
                if key not in self.loaded and hash(key) not in self.refused:
                    program = self._program(args, more)
                    if program:
                        self.loaded[key] = program
                    else:
                        self.refused.add(hash(key))
                return self.loaded.get(key)
        except TypeError:  # a static value that has no hash, or what the function itself will raise again
            return None

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
        with suppress(Exception):  # whatever a file from elsewhere may do
            known, document, exported = read_item(path)
            if known == key:
                return self._callable(exported.tobytes(), document) if exported.size else None
        try:
            serialized, document = self._traced(args, more)
        except (CodecError, _NoExportError):
            serialized, document = b"", ""
        except ValueError:  # the function's own, of these numbers perhaps: nothing is said of the program
            return None
        if sources(Path(__file__).parent) == SOURCES:
            with suppress(IdentError):  # a full disk, say
                # in a context of its own: a program is kept whatever becomes of the set of files being written now
                Context().run(write_item, path, (key, document, np.frombuffer(serialized, np.uint8)))
        return self._callable(serialized, document) if serialized else None

    def _traced(self, args: tuple[Any, ...], more: Mapping[str, Any]) -> tuple[bytes, str]:
        arrays, static = eqx.partition((args, more), eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        shapes: list[str] = []

        def flat(*leaves: Any) -> list[Any]:
            args, more = eqx.combine(jax.tree.unflatten(tree, leaves), static)
            arrays, rest = eqx.partition(self.f(*args, **more), eqx.is_array)
            outputs, out_tree = jax.tree.flatten(arrays)
            places = jax.tree.unflatten(out_tree, [Place(i) for i in range(len(outputs))])
            marks = list[Any]()
            shapes.append(json.dumps([encode(eqx.combine(places, rest), marks), [int(mark) for mark in marks]]))
            return outputs

        program = jax.jit(flat)
        program.trace(*leaves)  # kept by jax: the export traces nothing again
        try:
            exported = export.export(program, disabled_checks=UNCHECKED)(*leaves)
            return bytes(exported.serialize()), shapes[0]
        except (ValueError, NotImplementedError) as error:
            raise _NoExportError(str(error)) from None

    def _callable(self, exported: bytes, document: str) -> Callable[[list[Any]], Any]:
        run = jax.jit(export.deserialize(bytearray(exported)).call, **self.options, **_one_place())
        plain, places = json.loads(document)
        marks, tree = jax.tree.flatten(decode(plain, [Place(i) for i in places]))

        def call(leaves: list[Any]) -> Any:
            arrays = run(*filter(eqx.is_array, leaves))
            return jax.tree.unflatten(tree, [arrays[int(m)] if isinstance(m, np.generic) else m for m in marks])

        return call


def _one_place() -> dict[str, Any]:
    """Return jax's option for arguments on the only device; without, it compiles again for those of a kept program."""
    devices = jax.local_devices()
    return {"in_shardings": jax.sharding.SingleDeviceSharding(devices[0])} if len(devices) == 1 else {}


def are_kept() -> bool:
    """Tell whether programs are kept beside jax's compilation cache."""
    switched_off = os.environ.get("IDENT_PROGRAMS", "").strip().lower() in OFF
    return bool(jax.config.values["jax_compilation_cache_dir"]) and not switched_off


def own_folder() -> Path | None:
    """Return the folder for programs under these circumstances; None where there is none, or others can write it."""
    if not are_kept():
        return None
    above = Path(jax.config.values["jax_compilation_cache_dir"]) / "ident-programs"
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


# -------- Jit
# `jit` for programs of many small kernels, as all of the arm's are.

AnyArray = jax.Array | np.ndarray

Progress = Callable[[Iterable[int]], Iterator[int]]
"""Shows how far a loop is that runs over the numbers."""
F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")
SMALL_KERNELS: Any = {
    "compiler_options": {
        "xla_backend_optimization_level": 1,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_use_fusion_emitters": False,
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_CONVOLUTION",
    }
}
"""Less optimisation, which takes a quarter off the compilation and costs these programs nothing. XLA's other CPU code
generator (jax 0.10): 20 % fewer kernels, compiled together, so a third faster to compile. Vectors as wide as
the processor has: XLA asks for half of AVX-512's, by which a prediction takes 4 to 16 % longer. And nothing left to its
library of neural networks, which hands out sums of a few terms to threads: convolutions, of which there are none."""
LONG_LOOPS: Any = {
    "compiler_options": {
        **SMALL_KERNELS["compiler_options"],
        "xla_backend_optimization_level": 3,
        "xla_llvm_disable_expensive_passes": False,
    }
}
"""For a program that goes round one loop a hundred thousand times: a third less time for no more of compilation. For
the samples of the fast method, too: a seventh less. Its integration gains nothing, slopes lose a tenth."""
RUNS_ONCE: Any = {"compiler_options": {**SMALL_KERNELS["compiler_options"], "xla_backend_optimization_level": 0}}
"""For a program that runs once or twice, on few numbers: half the compilation."""


def cores() -> int:
    """Return how many cores this process may use: a container or `taskset` may leave it fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def jit(f: F, options: Any = SMALL_KERNELS) -> F:
    """Compile f at its first call; arrays in its arguments are traced, all else is static.

    What was traced in an earlier process is read from a file, see `ident.programs`. Within another program that is
    being traced or differentiated, f is a part of that: jax admits compiler options at the outermost one only.
    """
    within, known, compiled = eqx.filter_jit(f), Programs(f, options), dict[Any, Callable[..., Any]]()

    @wraps(f)
    def call(*args: Any, **more: Any) -> Any:
        leaves, tree = jax.tree.flatten((args, more))  # once: of a model it takes longer than its prediction
        if is_traced(leaves):
            return within(*args, **more)
        program = known.find(args, more, (leaves, tree))
        if program:
            return program(leaves)
        key = tree, tuple(None if eqx.is_array(leaf) else (type(leaf), leaf) for leaf in leaves)
        run = compiled.get(key) or compiled.setdefault(key, _outermost(f, *key, options))
        arrays, rest = run(*filter(eqx.is_array, leaves))
        return arrays if rest.value is None else eqx.combine(arrays, rest.value)

    return cast("F", call)


class _Static(eqx.Module):
    """What a function returns beside arrays: a tree, None where there is nothing."""

    value: Any = eqx.field(static=True)


def _outermost(f: Callable[..., Any], tree: Any, static: tuple[Any, ...], options: Any) -> Callable[..., Any]:
    """Compile f for arguments of one structure, given as their arrays: by `eqx.filter_jit` a call takes 1 ms more.

    Args:
        f: the function.
        tree: structure of its arguments.
        static: of each leaf its type and value; None for an array.
        options: for `jax.jit`.
    """

    def flat(*arrays: Any) -> Any:
        given = iter(arrays)
        args, more = jax.tree.unflatten(tree, [next(given) if leaf is None else leaf[1] for leaf in static])
        arrays, rest = eqx.partition(f(*args, **more), eqx.is_array)
        return arrays, _Static(rest if jax.tree.leaves(rest) else None)

    flat.__name__ = f.__name__
    return jax.jit(flat, **options)


def in_batches(f: Callable[[Any], Any], columns: Any, size: int, progress: Progress = iter) -> Any:
    """Return what f gives for columns, so many at a time, the last one repeated: one program serves any number of them.

    Args:
        f: takes and returns trees of arrays (..., size), each column by itself.
        columns: a tree of arrays (..., K), one column at least.
        size: columns at a time.
        progress: wraps the numbers of the batches, to show a bar.
    """
    count, parts = jax.tree.leaves(columns)[0].shape[-1], []
    for k in progress(range(-(-count // size))):
        some = np.minimum(np.arange(k * size, (k + 1) * size), count - 1)
        parts.append(jax.device_get(f(jax.tree.map(lambda x, some=some: x[..., some], columns))))
    return jax.tree.map(lambda *each: np.concatenate(each, -1)[..., :count], *parts)


def beside_each_other(f: Callable[[int], T], count: int, progress: Progress = iter) -> list[T]:
    """Return f of each number below a count, computed in a thread for each core; Ctrl-C waits for those at work."""
    pool = ThreadPoolExecutor(cores())
    try:
        return [each for _, each in zip(progress(range(count)), pool.map(f, range(count)), strict=True)]
    finally:
        pool.shutdown(cancel_futures=True)


def is_traced(leaves: list[Any]) -> bool:
    """Return whether any of these is traced, or a program is being: then what is newly made is a tracer, too."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in leaves) or isinstance(_made_now(), jax.core.Tracer)


@jax.jit
def _made_now() -> jax.Array:
    return jnp.zeros(())


def library(*values: Any) -> Any:
    """Return jax's NumPy where anything is traced, else NumPy: each operation of jax would be a program of its own."""
    return jnp if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values)) else np


def concrete(tree: Any) -> Any:
    """Return a tree with NumPy's arrays, where nothing is traced."""
    return tree if library(tree) is jnp else jax.tree.map(np.asarray, tree)
