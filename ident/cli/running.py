"""Common start of every command: set up jax, read the inputs, show progress."""

import atexit
import ctypes
import gc
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

import typer

from ident.cli.output import output
from ident.errors import InputError, refusal
from ident.text import one_line

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.measure import Campaign


NEW_PROGRAM = "/jax/compilation_cache/cache_misses"
"""Event of jax for a newly compiled program, which was not in the cache."""
PACE = 10.0
"""Seconds between two progress lines, without a terminal."""
LONGEST_PATH = 200
"""Longest path in a message [characters]."""


def start() -> None:
    """Set up jax: double precision, and a cache of compiled programs across runs."""
    # warnings of libraries are no news to a user of ident; -W overrides this
    warnings.simplefilter("ignore", append=True)
    glibc("mallopt", -8, 2)  # M_ARENA_MAX: threads share two heaps, a sixth less memory than with one each
    gc.set_threshold(1_000_000, 20, 100)  # imports and tracing make many objects that stay: a second less to start
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA logs slow compilation as an error
    atexit.register(gc.freeze)  # and 0.6 s less to stop: the remaining objects go with the process
    import jax

    folder = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        jax.config.update("jax_compilation_cache_dir", str(Path(folder) / "ident" / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    os.environ.setdefault("IDENT_PROGRAMS", "on")
    os.environ.setdefault("EQX_ON_ERROR", "nan")  # the checks of equinox else call Python, which no cache can keep
    if sys.stderr.isatty() and not output().quiet:
        import jax.monitoring

        jax.monitoring.register_event_listener(_look_out_for_new_programs)


def glibc(name: str, *numbers: int) -> None:
    """Call a memory function of glibc; on other systems nothing happens."""
    with suppress(Exception):
        getattr(ctypes.CDLL(None), name)(*numbers)


def _look_out_for_new_programs(event: str, **_: Any) -> None:
    if event == NEW_PROGRAM:
        _say_that_it_compiles()


@cache
def _say_that_it_compiles() -> None:
    """Say once why this run takes longer than the next one will."""
    typer.echo("compiling, once: the next run like this one starts at once", err=True)


def read(campaign: Path, arm: Path | None) -> tuple["Campaign", "ArmFile"]:
    """Read a campaign and its arm, by default arm.toml in the campaign's folder; set up jax between them.

    So a refused campaign need not wait for jax.
    """
    from ident.measure import read_campaign

    measured = read_campaign(campaign)
    start()
    from ident.description.file import read_arm

    return measured, read_arm(arm or campaign.parent / "arm.toml")


def check_folder(out: Path) -> None:
    """Refuse a folder that can't be written, before any computation for it.

    Raises:
        InputError: it is a file, or its place can't be written.
    """
    there, got = out, ""
    try:
        there = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
        if there.is_dir():
            with TemporaryFile(dir=there):  # permissions alone do not show it: root has them in /proc, too
                pass
        else:
            got = "a file"
    except (OSError, ValueError) as error:
        got = f"no place to write ({(getattr(error, 'strerror', None) or str(error)).lower()})"
    if got:
        where = one_line(str(there)[:LONGEST_PATH])
        raise refusal(where, got, "a folder that can be written", "choose another (`folder`)")


@contextmanager
def kept(folder: Path) -> Iterator[None]:
    """On an interruption by the user, print what is stored for resuming, and exit with the code of an interruption."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {one_line(str(folder))}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None


def discard_unless_taken(folder: Path, discard: Callable[[Path], None]) -> None:
    """Remove the checkpoints of a finished run; if another run has resumed from them, it will remove them."""
    with suppress(InputError):
        discard(folder)


@contextmanager
def at_work(command: str) -> Iterator[None]:
    """Print once in a log that long work inside this context goes on; progress is shown besides."""
    words = f"ident {command}: at work for {PACE:g} s"
    timer = threading.Timer(min(PACE, threading.TIMEOUT_MAX), typer.echo, [words], {"err": True})
    timer.daemon = True
    if not (output().quiet or sys.stderr.isatty()):
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


def progress(description: str, total: int | None = None) -> Callable[[Iterable[int]], Iterator[int]]:
    """Return a wrapper that shows progress: a bar on a terminal, which vanishes; elsewhere a line now and then."""
    if output().quiet:
        return iter
    if not sys.stderr.isatty():
        return partial(_in_lines, description, total)
    from rich.console import Console
    from rich.progress import track

    def shown(numbers: Iterable[int]) -> Iterator[int]:
        return iter(track(numbers, description, total, console=Console(stderr=True), transient=True))

    return shown


def _in_lines(description: str, total: int | None, numbers: Iterable[int]) -> Iterator[int]:
    """Pass numbers on, and print their count every `PACE` seconds; nothing for shorter work."""
    size = total if total is not None else len(numbers) if isinstance(numbers, Sized) else None
    began = said = time.monotonic()
    for count, number in enumerate(numbers):
        now = time.monotonic()
        if now - said >= PACE:
            said = now
            of = f" of {size}" if size is not None else ""
            typer.echo(f"{description}: {count}{of}, {now - began:.0f} s", err=True)
        yield number
