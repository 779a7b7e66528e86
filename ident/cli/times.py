"""Where the time of a command goes: with `IDENT_TIMES=1` one line at its end says so, on standard error.

Each moment counts once, for the first of `KINDS` that was going on: importing, reading, tracing and lowering by jax,
loading compiled programs and compiling others, drawing, writing; what is left is computing. Not counted is the start of
Python and of the command line itself, a fifth of a second, and what comes after the line.
"""

import atexit
import builtins
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ident.text import is_on

KINDS = ("importing", "tracing", "lowering", "loading", "compiling", "reading", "drawing", "writing")
EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
    "/jax/compilation_cache/cache_retrieval_time_sec": "loading",
}
"""What jax reports (`jax.monitoring`), and what it is here; a program that is loaded reports a compilation, too."""


class Times:
    """What a process has spent its time on.

    Args:
        start: when it began, by `time.perf_counter` [s].
    """

    def __init__(self, start: float = 0.0):
        self.start, self.depth = start, 0
        self.spans: list[tuple[float, float, str]] = []

    @contextmanager
    def on(self, kind: str) -> Iterator[None]:
        """Count the time within as one of `KINDS`."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.spans.append((begin, time.perf_counter(), kind))

    def event(self, event: str, duration_secs: float, **_: Any) -> None:
        """Count what jax reports at its end."""
        if kind := EVENTS.get(event):
            now = time.perf_counter()
            self.spans.append((now - duration_secs, now, kind))

    def watch_imports(self) -> None:
        """Count the time of all imports from now on."""
        plain = builtins.__import__

        def watched(*args: Any, **more: Any) -> Any:
            self.depth += 1
            begin = time.perf_counter()
            try:
                return plain(*args, **more)
            finally:
                self.depth -= 1
                if not self.depth and (now := time.perf_counter()) - begin > 1e-4:
                    self.spans.append((begin, now, "importing"))

        builtins.__import__ = watched

    def shares(self, end: float) -> dict[str, float]:
        """Return the seconds of each kind until then, each moment once, and of `computing`, what is left."""
        steps = sorted((t, i, kind) for begin, stop, kind in self.spans for t, i in ((begin, 1), (stop, -1)))
        found, open_now, before = dict.fromkeys((*KINDS, "computing"), 0.0), dict.fromkeys(KINDS, 0), self.start
        for moment, step, kind in [*steps, (end, 0, KINDS[0])]:
            now = next((each for each in KINDS if open_now[each]), "computing")
            found[now] += max(min(moment, end) - before, 0.0)
            before = max(before, moment)
            open_now[kind] += step
        return found

    def line(self, end: float) -> str:
        """Say where the time went, and how many programs there were."""
        parts = ", ".join(f"{kind} {seconds:.2f}" for kind, seconds in self.shares(end).items())
        programs, loaded = (sum(kind == each for *_, kind in self.spans) for each in ("compiling", "loading"))
        return f"ident: {end - self.start:.2f} s: {parts}; {programs} programs, {loaded} of them loaded"


TIMES = Times()
"""Those of this process."""


def begin() -> None:
    """Watch from now on, if that was asked for."""
    if is_on("IDENT_TIMES"):
        TIMES.start = time.perf_counter()
        TIMES.watch_imports()
        atexit.register(lambda: print(TIMES.line(time.perf_counter()), file=sys.stderr))


def watch_jax() -> None:
    """Watch what jax traces and compiles, if that was asked for."""
    if is_on("IDENT_TIMES"):
        import jax.monitoring

        jax.monitoring.register_event_duration_secs_listener(TIMES.event)
