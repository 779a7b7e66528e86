"""Every command on the shipped data, each in a process of its own: how long a person waits, and for what.

`python tests/benchmarks/shell.py [--only fit ...] [--repeat 3]`: with nothing compiled, with everything compiled (the
quickest of some runs), and with everything compiled but for another motion, speed, posture, campaign length or number
of draws. The rest, to the wall clock, is the start and the end of Python. Sizes of the programs are those that XLA
dumps after optimisation, in a further cold run (`--sizes`).

`python tests/benchmarks/shell.py run fit campaign.csv` runs one command and says on standard error where its time went.
"""

import argparse
import builtins
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data" / "lcd_arm"
ARM, CAMPAIGN = DATA / "arm.toml", DATA / "campaign.csv"
RUN = [sys.executable, str(Path(__file__).resolve()), "run"]
KINDS = ("importing", "tracing", "lowering", "loading", "compiling", "computing")
"""Shares of the time of a command; each moment counts once, for the first of these. Computing is what is left."""
EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
    "/jax/compilation_cache/cache_retrieval_time_sec": "loading",
}
"""What jax reports (`jax.monitoring`), and what it is here; a program that is loaded reports a compilation, too."""


def run_timed() -> None:
    """Run a command of ident in this process, and say on standard error where its time went."""
    spans: list[tuple[float, float, str]] = []
    begin, plain, depth = time.perf_counter(), builtins.__import__, 0

    def watched(*args: Any, **more: Any) -> Any:
        nonlocal depth
        depth, start = depth + 1, time.perf_counter()
        try:
            return plain(*args, **more)
        finally:
            depth -= 1
            if not depth:
                spans.append((start, time.perf_counter(), "importing"))

    def on_event(event: str, seconds: float, **_: Any) -> None:
        if kind := EVENTS.get(event):
            spans.append((time.perf_counter() - seconds, time.perf_counter(), kind))

    builtins.__import__ = watched
    from ident.cli import main, running

    start_of_ident = running.start

    def start() -> None:
        start_of_ident()
        import jax.monitoring

        jax.monitoring.register_event_duration_secs_listener(on_event)

    running.start = start
    try:
        main()
    finally:
        end = time.perf_counter()
        parts = ", ".join(f"{kind} {seconds:.2f}" for kind, seconds in shares(spans, begin, end).items())
        programs, loaded = (sum(kind == each for *_, kind in spans) for each in ("compiling", "loading"))
        words = f"{end - begin:.2f} s: {parts}; {programs} programs, {loaded} of them loaded"
        print(words, file=sys.stderr)


def shares(spans: list[tuple[float, float, str]], begin: float, end: float) -> dict[str, float]:
    """Return the seconds of each kind between two moments, of spans that may lie within each other."""
    steps = sorted((t, i, kind) for start, stop, kind in spans for t, i in ((start, 1), (stop, -1)))
    found, open_now, before = dict.fromkeys(KINDS, 0.0), dict.fromkeys(KINDS, 0), begin
    for moment, step, kind in [*steps, (end, 0, KINDS[0])]:
        now = next((each for each in KINDS if open_now[each]), KINDS[-1])
        found[now] += max(min(moment, end) - before, 0.0)
        before = max(before, moment)
        open_now[kind] += step
    return found


@dataclass(frozen=True)
class Command:
    """A command, and the same for something that was not seen before.

    Attributes:
        line: its arguments; `SHORT` stands for a campaign of fewer rows, `FIT` for a result of `ident fit`.
        other: what is added, or what replaces the line if it begins with the command's name.
    """

    line: list[str]
    other: list[str] = field(default_factory=list)

    @property
    def further(self) -> list[str]:
        """The arguments for something that was not seen before."""
        return self.other if self.other[:1] == self.line[:1] else [*self.line, *self.other]


def commands(short: Path) -> dict[str, Command]:
    """Return the commands by name."""
    campaign, arm, few = str(CAMPAIGN), str(ARM), str(short)
    of_campaigns = {name: Command([name, campaign], [name, few, "--arm", arm]) for name in ("check", "fit", "profile")}
    return {
        "help": Command(["--help"], ["fit", "--help"]),
        "refused": Command(["fit", arm], ["fit", str(DATA / "no.csv")]),
        "predict": Command(["predict", arm], ["-q", "30,-60,30", "-q", "10,-20,10"]),
        **of_campaigns,
        "plan": Command(["plan", campaign], ["plan", few, "--arm", arm]),
        "resonance": Command(["resonance", arm], ["--speed", "37"]),
        "simulate": Command(["simulate", arm], ["--speed", "37"]),
        "sweep": Command(["sweep", arm, "--vary", "joint2.k_tors=0.5x:2x:5"], ["--speed", "37"]),
        "sample": Command(["sample", campaign], ["sample", few, "--arm", arm]),
        "design": Command(["design", arm, "--limit", "1"], ["--speed", "37"]),
        "diagnose": Command(["diagnose", campaign, "--limit", "1"], ["diagnose", few, "--arm", arm, "--limit", "1"]),
    }


def run(line: list[str], cache: Path, out: Path, **more: str) -> tuple[float, str, int]:
    """Run a command with a cache of its own; return seconds, what it says of its time, and the exit status."""
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(cache), **more}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # who installs ident has its byte code
    begin = time.perf_counter()
    done = subprocess.run([*RUN, *line], env=environment, cwd=out, capture_output=True, text=True, check=False)
    spent = time.perf_counter() - begin
    said = next((text for text in reversed(done.stderr.splitlines()) if " programs, " in text), "")
    return spent, said, done.returncode


def in_words(spent: float, said: str) -> str:
    """Return a row of the table: seconds in all and by kind, the programs."""
    shares = {kind: float(seconds) for kind, seconds in re.findall(r"(\w+) ([\d.]+)[,;]", said)}
    rest = spent - sum(shares.values())
    programs = re.search(r"(\d+) programs, (\d+)", said)
    counted = f"{programs[1]:>5s}{programs[2]:>5s}" if programs else ""
    return f"{spent:7.2f} " + "".join(f"{shares.get(kind, 0):7.2f}" for kind in KINDS) + f"{rest:7.2f}{counted}"


def sizes(line: list[str], folder: Path) -> str:
    """Return how many programs a cold run compiles, and their instructions after optimisation."""
    dump = folder / "dump"
    dump.mkdir(parents=True)
    run(line, folder / "cold", folder, XLA_FLAGS=f"--xla_dump_to={dump} --xla_dump_hlo_as_text", IDENT_PROGRAMS="off")
    files = list(dump.glob("*after_optimizations.txt"))
    counts = sorted((sum(" = " in row for row in file.open(encoding="utf-8")) for file in files), reverse=True)
    return f"{len(counts)} programs, {sum(counts)} instructions, the largest of {', '.join(map(str, counts[:4]))}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", help="these commands")
    parser.add_argument("--repeat", type=int, default=3, help="runs with everything compiled, of which the quickest")
    parser.add_argument("--sizes", action="store_true", help="count the instructions of the programs")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        short = folder / "short.csv"
        rows = CAMPAIGN.read_text().splitlines(keepends=True)
        short.write_text("".join(rows[:-3]))
        print(f"cores {os.cpu_count()}, load {os.getloadavg()[0]:.1f}; seconds")
        print(f"{'':22s}{'all':>7s} " + "".join(f"{kind[:6]:>7s}" for kind in KINDS) + f"{'rest':>7s} prog load")
        for name, command in commands(short).items():
            if asked.only and name not in asked.only:
                continue
            cache = folder / name
            rounds = {
                "cold": [run(command.line, cache, folder)],
                "compiled": [run(command.line, cache, folder) for _ in range(asked.repeat)],
                "another": [run(command.further, cache, folder)],
            }
            for word, each in rounds.items():
                spent, said, status = min(each)
                note = f"  exit {status}" if status not in (0, 2 if name == "refused" else 0) else ""
                print(f"{name if word == 'cold' else '':12s}{word:10s}{in_words(spent, said)}{note}", flush=True)
            if asked.sizes:
                print(f"{'':12s}{sizes(command.line, folder / ('sizes-' + name))}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["run"]:
        del sys.argv[1]
        run_timed()
    else:
        main()
