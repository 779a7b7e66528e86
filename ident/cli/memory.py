"""What a long command has needed and needs no more, given back to the system."""

import ctypes
import gc
import sys
from collections.abc import Callable
from typing import Any

ARENA_MAX = -8
"""Number of glibc's option for how many heaps there may be (malloc.h)."""
FORGOTTEN = ("trust", "vibration", "sensitivities")
"""Stages of a diagnosis behind which most programs are new."""


def use_few_heaps() -> None:
    """Let threads share two heaps: with one for each thread, what one has freed no other takes, a sixth more in all."""
    _call("mallopt", ARENA_MAX, 2)


def let_go(stage: str) -> None:
    """Give back what a stage of a diagnosis leaves behind; its compiled programs too, where others follow."""
    if stage in FORGOTTEN:
        import jax

        jax.clear_caches()
        gc.collect()
    _call("malloc_trim", 0)


def _call(name: str, *arguments: int) -> None:
    """Call a function of glibc; elsewhere nothing happens."""
    if sys.platform == "linux":  # elsewhere there may be no such library to open
        function: Callable[..., Any] | None = getattr(ctypes.CDLL(None), name, None)
        if function is not None:
            function(*arguments)
