"""Times, tables and the machine they were taken on."""

import os
import platform
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np


def timed(f: Callable[[], Any], repeat: int, per: int = 1) -> tuple[float, float]:
    """Return minimum and median time [us] of one of `per` results."""
    f()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(f())
        times.append((time.perf_counter() - start) / per * 1e6)
    return min(times), float(np.median(times))


def least(f: Callable[[], Any], repeat: int) -> tuple[float, float]:
    """Return the least time and the least CPU time [s] of f, which has run before."""
    times = []
    for _ in range(repeat):
        start, cpu = time.perf_counter(), time.process_time()
        f()
        times.append((time.perf_counter() - start, time.process_time() - cpu))
    wall, cpu = map(min, zip(*times, strict=True))
    return wall, cpu


def table(title: str, rows: list[tuple[str, tuple[float, float]]], reference: int = 0) -> None:
    """Print times and their ratio to one of the rows."""
    print(f"\n{title}\n{'':58s}{'min us':>11s}{'median us':>11s}{'ratio':>9s}")
    for name, (low, middle) in rows:
        print(f"  {name:56s}{low:11.4g}{middle:11.4g}{low / rows[reference][1][0]:9.3g}")


def machine() -> str:
    """Say what the times were taken on."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    model = next((line.split(": ")[1] for line in lines if line.startswith("model name")), platform.processor())
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    versions = f"Python {platform.python_version()}, jax {jax.__version__}, numpy {np.__version__}"
    return f"{model}, {os.cpu_count()} cores, load {load}; {versions}"


def commit() -> str:
    """Return the commit that is measured."""
    line = ("git", "rev-parse", "--short", "HEAD")
    return subprocess.run(line, cwd=Path(__file__).parent, capture_output=True, text=True, check=False).stdout.strip()
