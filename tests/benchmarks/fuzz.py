"""Mutated inputs over all commands: `python tests/benchmarks/fuzz.py --seed 0 --count 2000 [--workers 2] [--case N]`.

Each case is drawn from the seed and its number alone: a command, one of its files (or its options, or the defaults
beside them), and one to three mutations of it. It must end with a documented exit status and without a traceback, say
what is wrong in whole lines that name a place, take less than 60 s of one core (a whole `source` 120 s, `diagnose`
240 s) and 2 GB, and leave nothing half-written (`tests/test_fuzz.py` has fifty of them).
"""

import argparse
import contextlib
import json
import math
import os
import queue
import re
import resource
import runpy
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / "support")]

import numpy as np
from broken import NUMBERS, WORDS, broken_bytes, broken_texts, damaged, pick

DATA, SAVED = ROOT / "data", ROOT / "tests" / "data" / "results" / "10"
SECONDS, MEMORY, STUCK = 60, 2_000, 900
"""CPU time [s] and memory [MB] that a case may take, and the time [s] after which a silent worker is ended."""
WHOLE_RUNS = {"diagnose": 240, "source": 120}
"""CPU time [s] of commands that search, sample and simulate where an input is taken, most of it to compile."""
STATUSES = (0, 1, 2, 3)
LONGEST = 1200
"""Characters of a line that says what is wrong."""
LEFTOVER = re.compile(r"\.ident-[0-9a-f]+\.part|\.tmp$")
UNPLACED = re.compile(r"ident: got ")
RESTART = 150
"""Cases after which a worker is replaced: programs that jax has compiled stay in memory."""
SHORT = ("--speed", "200", "--dwell", "0.2", "--no-figure")
FAST = (*SHORT, "--rate", "50")


# -------- Inputs
# Good ones, small, in one folder; a case has a copy of it.


def build(folder: Path) -> None:
    """Write good inputs of every kind."""
    from commands import log, posterior
    from recording_files import files
    from three_joints import WITH_HAND, WITHOUT_MESHES

    lcd = DATA / "lcd_arm"
    for name in ("arm.toml", "table1.csv", "campaign.csv"):
        shutil.copy(lcd / name, folder)
    shutil.copytree(lcd / "runs", folder / "runs", ignore=shutil.ignore_patterns("*.py"))
    shutil.copy(lcd / "arm.toml", folder / "runs")
    (folder / "hammer").mkdir()
    for name in ("arm.toml", "alpha00_y.unv", "alpha00_z.unv"):
        shutil.copy(lcd / "hammer" / name, folder / "hammer")
    lines = (lcd / "hammer" / "channels.csv").read_text().splitlines()
    kept = [line for line in lines if line.startswith(("file", "alpha00"))]
    (folder / "hammer" / "channels.csv").write_text("\n".join(kept) + "\n")
    for path in files(folder):
        (folder / f"{path.suffix[1:]}-recordings").mkdir(exist_ok=True)
        path.rename(folder / f"{path.suffix[1:]}-recordings" / path.name)
    log(folder / "path.csv")
    posterior(folder / "posterior.nc")
    (folder / "robot.urdf").write_text(WITH_HAND)
    (folder / "robot.xml").write_text(WITHOUT_MESHES)
    trace = [f"{k / 50:g},{math.sin(k):.6f},{math.cos(k):.6f}" for k in range(60)]
    (folder / "trace.csv").write_text("\n".join(["time [s],x [mm],z [mm]", *trace]) + "\n")
    for name in "ab":
        rows = (DATA / "kr300" / f"{name}.csv").read_text().splitlines()
        (folder / f"{name}.csv").write_text("\n".join(rows[:600]) + "\n")
    for path in SAVED.iterdir():
        shutil.copy(path, folder / path.name)
    generate = runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"]
    generate(folder / "robots", robots=2, faulty=0)
    (folder / "cov.csv").write_text((lcd / "table1.csv").read_text())
    (folder / "cov.covariance.csv").write_text("group,i,j,correlation\na,1,2,0.3\n")


@dataclass(frozen=True)
class Call:
    """A command with good arguments, and the files of it that are mutated; `more` are options to draw from."""

    words: tuple[str, ...]
    files: tuple[str, ...]
    weight: int = 4


def call(words: str, *files: str, weight: int = 4) -> Call:
    return Call(tuple(words.split()), files, weight)


MOVING = " ".join(SHORT)
CALLS = (
    call("show arm.toml --no-figure", "arm.toml", weight=8),
    call("show arm.toml --names", "arm.toml"),
    call("show robot.urdf --no-figure", "robot.urdf", weight=8),
    call("show robot.xml --no-figure", "robot.xml", weight=8),
    *(call(f"show {path.name}", path.name, weight=2) for path in sorted(SAVED.iterdir())),
    call("predict arm.toml", "arm.toml", weight=8),
    call("predict arm.toml --fit campaign.fit.json", "campaign.fit.json"),
    call("predict arm.toml --posterior posterior.nc", "posterior.nc"),
    call("predict arm.toml --posterior runs.source.json", "runs.source.json"),
    call("check table1.csv", "table1.csv", "arm.toml", weight=16),
    call("check cov.csv --arm arm.toml", "cov.covariance.csv"),
    call("fit table1.csv --starts 1 --no-figure", "table1.csv", "arm.toml", weight=16),
    call("profile table1.csv --parameter joint1.k_bend --starts 1 --no-figure", "table1.csv", weight=2),
    call("sample table1.csv --steps 500 --walkers 14 --starts 1 --no-figure", "table1.csv", weight=1),
    call("validate table1.csv --starts 1 --no-figure", "table1.csv", weight=2),
    call("plan table1.csv --step 60 --count 1 --starts 1 --no-figure", "table1.csv", weight=2),
    call("plan --runs runs/runs.csv --arm arm.toml --no-figure", "runs/runs.csv", weight=2),
    call("compare campaign.fit.json campaign.sample.nc --no-figure", "campaign.fit.json", "campaign.sample.nc"),
    call("fleet robots --starts 1 --no-figure --workers 1", "robots/robot1.csv", weight=2),
    call(f"resonance arm.toml --path path.csv {MOVING.replace('--dwell 0.2', '')}", "path.csv", "arm.toml"),
    call(f"simulate arm.toml {' '.join(FAST)}", "arm.toml"),
    call(f"simulate arm.toml --path path.csv --trace trace.csv --rate 50 {MOVING}", "path.csv", "trace.csv", weight=6),
    call("spectrum trace.csv --no-figure", "trace.csv", weight=6),
    call("spectrum trace.csv --arm arm.toml --path path.csv --no-figure", "trace.csv", "path.csv"),
    call(f"sweep arm.toml --vary joint1.k_tors=0.5x:2x:2 {MOVING}", "arm.toml", weight=2),
    call("triage runs/runs.csv --no-figure", "runs/runs.csv", "runs/run7.csv", weight=8),
    call("source runs/runs.csv --draws 5 --no-figure", "runs/runs.csv", "runs/run7.csv", weight=3),
    call("source runs --init", "runs/run7.csv", weight=2),
    call(f"balance runs.source.json {MOVING}", "runs.source.json", weight=2),
    call("joint a.csv b.csv --inertia 700 --no-figure", "a.csv", weight=6),
    call(f"motion arm.toml --path path.csv --limit 0.5 {MOVING}", "path.csv", weight=2),
    call(f"design arm.toml --change joint1.k_tors=1x:2x --no-curve --starts 1 {MOVING}", "arm.toml", weight=1),
    call("modal hammer --no-figure", "hammer/channels.csv", "hammer/alpha00_y.unv", weight=10),
    *(
        call(f"modal {end}-recordings --init", f"{end}-recordings", weight=6)
        for end in ("uff", "mat", "h5", "lvm", "tdms", "wav")
    ),
    call("diagnose table1.csv --speed 200 --limit 1", "table1.csv", weight=1),
    call("diagnose table1.csv --runs runs/runs.csv --speed 200", "runs/runs.csv", weight=1),
    call("explore arm.toml --campaign table1.csv", "table1.csv", "arm.toml", weight=2),
    call("export campaign.fit.json --arm arm.toml -o out/f.toml", "campaign.fit.json", weight=3),
    call("export campaign.sample.nc --arm arm.toml -o out/f.json", "campaign.sample.nc", weight=3),
    call("rerun arm.predict.json", "arm.predict.json"),
    call("rerun arm.extend-10.resonance.json", "arm.extend-10.resonance.json", weight=1),
    call("new made --robot robot.urdf", "robot.urdf", weight=2),
    call("new made --robot robot.xml", "robot.xml", weight=2),
    call("doctor", "ident.toml", weight=1),
)


HEAVY = (
    "balance",
    "check",
    "compare",
    "design",
    "diagnose",
    "fit",
    "fleet",
    "motion",
    "new",
    "plan",
    "profile",
    "rerun",
)
HEAVY += ("profile", "rerun", "sample", "source", "sweep", "validate")
"""Commands that compile much, or compute long, where an input is taken."""

# -------- Mutations

UNITS = (
    "mm",
    "m",
    "deg",
    "rad",
    "Hz",
    "kHz",
    "rpm",
    "s",
    "ms",
    "ns",
    "kg",
    "g",
    "N",
    "%",
    "mil",
    "",
    "°",
    "m/s^2",
    "?",
)
EXTREMES = ("nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "", "0", "-1", "1e9", "1e400", "999999999999", "-0.5")


def _table(change: Callable[[np.random.Generator, list[list[str]]], None]) -> Callable[..., bytes]:
    """Return a mutation of a table's cells; comments above stay."""

    def mutated(rng: np.random.Generator, data: bytes) -> bytes:
        lines = data.decode("latin-1").splitlines()
        comments = [line for line in lines if line.startswith("#")]
        mark = max(",;\t", key=lambda each: sum(line.count(each) for line in lines[:20]))
        cells = [line.split(mark) for line in lines if not line.startswith("#")] or [[""]]
        change(rng, cells)
        return "\n".join([*comments, *(mark.join(row) for row in cells)]).encode("latin-1") + b"\n"

    return mutated


def _at(rng: np.random.Generator, cells: list[list[str]]) -> tuple[int, int]:
    row = int(rng.integers(len(cells)))
    return row, int(rng.integers(max(len(cells[row]), 1)))


def _columns(rng: np.random.Generator, cells: list[list[str]]) -> None:
    _, j = _at(rng, cells)
    what, k = rng.integers(3), _at(rng, cells)[1]
    for row in cells:
        if what == 0 and j < len(row):
            del row[j]
        elif what == 1 and j < len(row):
            row.insert(j, row[j])
        elif j < len(row) and k < len(row):
            row[j], row[k] = row[k], row[j]


def _rows(rng: np.random.Generator, cells: list[list[str]]) -> None:
    i, _ = _at(rng, cells)
    what, k = rng.integers(4), _at(rng, cells)[0]
    if what == 0:
        del cells[i]
    elif what == 1:
        cells.insert(k, list(cells[i]))
    elif what == 2:
        cells[i], cells[k] = cells[k], cells[i]
    else:
        cells.extend(list(row) for row in cells[1:] * 3)


def _cells(rng: np.random.Generator, cells: list[list[str]]) -> None:
    for _ in range(rng.integers(1, 4)):
        i, j = _at(rng, cells)
        if cells[i]:
            cells[i][min(j, len(cells[i]) - 1)] = pick(rng, EXTREMES)


def _whole_column(rng: np.random.Generator, cells: list[list[str]]) -> None:
    _, j = _at(rng, cells)
    value, factor = pick(rng, EXTREMES), pick(rng, (None, -1.0, 1e-3, 1e3, 1e6, 57.3))
    for row in cells[1:]:
        if j < len(row):
            with contextlib.suppress(ValueError):
                row[j] = value if factor is None else f"{float(row[j]) * factor:.9g}"


def _units(rng: np.random.Generator, cells: list[list[str]]) -> None:
    i, j = _at(rng, cells)
    i = i if rng.random() < 0.5 else 0
    if cells[i]:
        j = min(j, len(cells[i]) - 1)
        cells[i][j] = re.sub(r"\[.*?\]|[A-Za-z/%]+$", lambda _: f"[{pick(rng, UNITS)}]", cells[i][j], count=1)


def _text(rng: np.random.Generator, data: bytes) -> bytes:
    return next(iter(broken_texts(rng, data.decode("latin-1"), 1)))


def _numbers(rng: np.random.Generator, data: bytes) -> bytes:
    """Replace some numbers of a text, as those of an arm, by extremes or by themselves in another unit."""
    text = data.decode("latin-1")
    found = list(re.finditer(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?", text))
    for place in sorted((pick(rng, found) for _ in range(rng.integers(1, 4)) if found), key=lambda m: -m.start()):
        factor = pick(rng, (1e-3, 1e3, -1.0, 57.3, 1e-9, 1e9))
        new = pick(rng, EXTREMES) if rng.random() < 0.5 else f"{float(place[0]) * factor:.9g}"
        text = text[: place.start()] + new + text[place.end() :]
    return text.encode("latin-1")


def _encoded(rng: np.random.Generator, data: bytes) -> bytes:
    form = pick(rng, ("utf-16", "utf-32", "utf-8-sig", "cp037", "latin-1"))
    return data.decode("latin-1").replace("e", "é", int(rng.integers(0, 3))).encode(form, "replace")


def _document(rng: np.random.Generator, data: bytes) -> bytes:
    try:
        document = json.loads(data)
    except ValueError:
        return _text(rng, data)
    if not isinstance(document, dict | list) or not document:
        return _text(rng, data)
    return json.dumps(next(iter(damaged(rng, document, 1)))).encode()


MUTATIONS: dict[str, Callable[[np.random.Generator, bytes], bytes]] = {
    "columns": _table(_columns),
    "rows": _table(_rows),
    "cells": _table(_cells),
    "column": _table(_whole_column),
    "units": _table(_units),
    "text": _text,
    "numbers": _numbers,
    "document": _document,
    "truncated": lambda rng, data: data[: rng.integers(len(data) + 1)],
    "bits": lambda rng, data: next(iter(broken_bytes(rng, data or b"\0", 1))),
    "noise": lambda rng, data: rng.bytes(int(rng.integers(1, 4000))) + data[: rng.integers(len(data) + 1)],
    "encoding": _encoded,
    "empty": lambda rng, data: pick(rng, (b"", b"\n", b"\0", b"#\n", b"{}", b"[]")),
    "twice": lambda rng, data: data + data,
    "same": lambda rng, data: data,
}
TABLES = (
    *("cells", "cells", "cells", "column", "column", "column", "numbers", "numbers", "units", "units", "columns"),
    *("columns", "rows", "rows", "text", "truncated", "bits", "encoding", "empty", "noise", "twice"),
)
TEXTS = ("text", "text", "numbers", "numbers", "numbers", "truncated", "bits", "encoding", "empty", "twice")
KINDS = {
    ".csv": TABLES,
    ".json": ("document", "document", "document", "text", "truncated", "bits", "encoding", "empty", "twice"),
    **dict.fromkeys((".toml", ".urdf", ".xml"), TEXTS),
    **dict.fromkeys((".uff", ".unv", ".lvm"), ("text", "numbers", "numbers", "truncated", "bits", "empty", "twice")),
}
BYTES = ("bits", "bits", "bits", "truncated", "noise", "empty", "twice")
DEFAULTS = (
    "starts = {}",
    "speed = {}",
    "[fit]\nfix = {}",
    "out = {}",
    "[predict]\nposture = {}",
    "limit = {}",
    "x = {}",
)


@dataclass
class Case:
    """What is run.

    Attributes:
        number: of the case.
        command: name of the command.
        kind: what is mutated, and how.
        words: arguments.
        file: what is mutated, relative to the folder; empty for options.
        data: what stands in it then.
    """

    number: int
    command: str
    kind: str
    words: tuple[str, ...]
    file: str = ""
    data: bytes = b""


def case_of(seed: int, number: int, base: Path) -> Case:
    """Return a case, which follows from seed and number."""
    rng = np.random.default_rng([seed, number])
    weights = np.array([each.weight for each in CALLS], float)
    chosen = CALLS[rng.choice(len(CALLS), p=weights / weights.sum())]
    draw = rng.random()
    if draw < 0.12 and chosen.words[0] not in ("doctor", "rerun", "new", "show", "export"):
        return Case(number, chosen.words[0], "options", (*chosen.words, *_options(rng, chosen.words[0])))
    if draw < 0.15 or not (base / chosen.files[0]).exists():
        text = pick(rng, DEFAULTS).format(pick(rng, (*NUMBERS, "'x'", "[1]", "true", "'a=b'", "[[", *WORDS)))
        return Case(number, chosen.words[0], "defaults", chosen.words, "ident.toml", text.encode("utf-8", "replace"))
    file = pick(rng, chosen.files)
    if (base / file).is_dir():
        file = str(next(iter(sorted((base / file).iterdir()))).relative_to(base))
    data, names = (base / file).read_bytes(), []
    for _ in range(rng.integers(1, 4) if rng.random() < 0.4 else 1):
        names.append(pick(rng, KINDS.get(Path(file).suffix, BYTES)))
        data = MUTATIONS[names[-1]](rng, data)
    return Case(number, chosen.words[0], f"{Path(file).suffix[1:]} {names[0]}", chosen.words, file, data)


def _options(rng: np.random.Generator, command: str) -> Iterator[str]:
    """Yield one or two flags of a command with words and numbers that may not fit."""
    from typer.main import get_command

    from ident.cli.output import app

    every = [each for each in get_command(app).commands[command].params if each.param_type_name == "option"]  # type: ignore[attr-defined]
    every = [each for each in every if not each.is_flag and each.name not in ("out", "arm", "workers")]
    for each in (pick(rng, every) for _ in range(rng.integers(1, 3))):
        value = pick(rng, (*NUMBERS, *WORDS, "0.5mm", "10 %", "joint1.k_tors=1", "joint1.k_tors=1x:2x", "a=1,b=2"))
        yield f"{max(each.opts, key=len)}={value}".replace("\0", "")


# -------- One case


@dataclass
class Outcome:
    """How a case has ended.

    Attributes:
        number, command, kind: of the case.
        status: exit status; None where there is none.
        seconds, megabytes: CPU time and memory that it took.
        faults: what must not be; empty where all is well.
        said: the first lines of standard error.
    """

    number: int
    command: str
    kind: str
    status: int | None = None
    seconds: float = 0.0
    megabytes: float = 0.0
    faults: list[str] = field(default_factory=list)
    said: str = ""


class OutOfTime(BaseException):
    """A case takes too long."""


def run(case: Case, base: Path, folder: Path) -> Outcome:
    """Run a case in this process, in a folder that is removed behind it."""
    from diagnose_small import SMALL

    from ident import cli
    from ident.studies.cure.effort import DiagnosisEffort

    DiagnosisEffort.__init__.__kwdefaults__.update(asdict(SMALL))  # type: ignore[attr-defined]  # minutes, where right
    outcome = Outcome(case.number, case.command, case.kind)
    shutil.copytree(base, folder)
    if case.file:
        (folder / case.file).unlink(missing_ok=True)
        (folder / case.file).write_bytes(case.data)
    before = {path.relative_to(folder) for path in folder.rglob("*")}
    out, err, began = StringIO(), StringIO(), time.process_time()
    Path("/proc/self/clear_refs").write_text("5")
    os.chdir(folder)
    sys.argv = ["ident", *case.words]

    def end(*_: Any) -> None:
        raise OutOfTime

    signal.signal(signal.SIGPROF, end)
    seconds = WHOLE_RUNS.get(case.command, SECONDS)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                cli.main()
                outcome.status = 0
            except SystemExit as stop:
                outcome.status = int(stop.code or 0)
    except OutOfTime:
        outcome.faults.append(f"longer than {seconds} s of CPU time")
    except BaseException as error:
        own = [each for each in traceback.extract_tb(error.__traceback__) if "/ident/" in each.filename]
        place = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else "?"
        outcome.faults.append(f"{type(error).__name__} in {place}: {error!s:.120}".replace("\n", " "))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        os.chdir(base)
    outcome.seconds = time.process_time() - began
    status = Path("/proc/self/status").read_text()
    outcome.megabytes = int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1e3  # type: ignore[index]
    outcome.said = "\n".join(err.getvalue().splitlines()[:3])
    outcome.faults += judged(outcome, out.getvalue(), err.getvalue(), folder, before)
    shutil.rmtree(folder, ignore_errors=True)
    return outcome


def judged(outcome: Outcome, out: str, err: str, folder: Path, before: set[Path]) -> Iterator[str]:
    """Yield what must not be."""
    new = {path.relative_to(folder) for path in folder.rglob("*")} - before
    if left := [path for path in new if LEFTOVER.search(path.name)]:
        yield f"left behind {left[0]}"
    if outcome.megabytes > MEMORY:
        yield f"{outcome.megabytes:.0f} MB"
    if outcome.status is None:
        return
    if outcome.status not in STATUSES:
        yield f"exit status {outcome.status}"
    lines = err.splitlines()
    if "Traceback" in err:
        yield "a traceback in the text"
    if outcome.status in (1, 2) and not lines:
        yield "no word of what is wrong"
    if outcome.status == 2:
        done = {path.parent for path in new if path.name == "stiffness.item"}  # kept: another table of runs goes on
        own = [path for path in new if path.is_relative_to("out") and not done.intersection(path.parents)]
        if written := [path for path in own if (folder / path).is_file()]:
            yield f"refused, but wrote {written[0]}"
        usage = lines[:1] and lines[0].startswith("Usage:")
        said = [line for line in lines if line.startswith("ident: ") or "more problem" in line]
        if not usage and not said:
            yield "no line that begins with ident:"
        if [line for line in said if len(line) > LONGEST or not line.isprintable()]:
            yield "a line that is too long, or cannot be printed"
        if outcome.kind not in ("options", "defaults") and [line for line in said if UNPLACED.match(line)]:
            yield "a line without a place"
    if outcome.status == 0 and (
        lost := [name for name in re.findall(r"^wrote (.+)$", out, re.M) if not (folder / name).exists()]
    ):
        yield f"not there: {lost[0]}"


# -------- Workers


def serve(base: Path, seed: int) -> None:
    """Run the cases whose numbers standard input gives, and print each outcome as a line of JSON."""
    resource.setrlimit(resource.RLIMIT_AS, (24_000_000_000, 24_000_000_000))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory(dir=base.parent) as scratch:
        for line in sys.stdin:
            number = int(line)
            case = case_of(seed, number, base)
            outcome = run(case, base, Path(scratch) / f"case{number}")
            answers.write(json.dumps(asdict(outcome)) + "\n")
            answers.flush()


class Worker:
    """A process that runs cases one after the other; replaced after a failure."""

    def __init__(self, base: Path, seed: int):
        self.base, self.seed, self.served = base, seed, 0
        self.process: subprocess.Popen[str] | None = None

    def ask(self, number: int) -> Outcome:
        """Return the outcome of a case; a process that dies or does not end is one, too."""
        if self.process is None or self.served >= RESTART:
            self.end()
            words = [sys.executable, "-P", str(Path(__file__)), "--serve", str(self.base), "--seed", str(self.seed)]
            environment = os.environ | {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1"}
            pipe = subprocess.PIPE
            null = subprocess.DEVNULL
            self.process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=null, text=True, env=environment)
            self.served = 0
        process = self.process
        assert process.stdin
        assert process.stdout
        self.served += 1
        process.stdin.write(f"{number}\n")
        process.stdin.flush()
        ready, *_ = select.select([process.stdout], [], [], STUCK)
        line = process.stdout.readline() if ready else ""
        if line:
            outcome = Outcome(**json.loads(line))
        else:
            case = case_of(self.seed, number, self.base)
            fault = "the process died" if ready else f"no answer within {STUCK} s"
            outcome = Outcome(number, case.command, case.kind, faults=[fault])
        if outcome.status is None or not line:
            self.end()
        if outcome.megabytes > MEMORY and self.served > 1:  # of programs that others have compiled, maybe
            self.end()
            return self.ask(number)
        return outcome

    def end(self) -> None:
        """End the process."""
        if self.process:
            self.process.kill()
            self.process.wait()
        self.process = None


def fuzzed(
    seed: int, numbers: range, workers: int = 2, shown: Callable[[Outcome], None] = lambda each: None, *, light: int = 0
) -> list[Outcome]:
    """Return the outcomes of cases; with `light` of the first so many among them that compile little."""
    outcomes: list[Outcome] = []
    jobs: queue.SimpleQueue[int] = queue.SimpleQueue()

    def work() -> None:
        worker = Worker(base, seed)
        with contextlib.suppress(queue.Empty):
            while True:
                outcomes.append(worker.ask(jobs.get_nowait()))
                shown(outcomes[-1])
        worker.end()

    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        base = Path(scratch) / "good"
        base.mkdir()
        build(base)
        drawn = (number for number in numbers if not light or case_of(seed, number, base).command not in HEAVY)
        for number in islice(drawn, light or None):
            jobs.put(number)
        with ThreadPoolExecutor(workers) as pool:
            for each in [pool.submit(work) for _ in range(workers)]:
                each.result()
    return sorted(outcomes, key=lambda each: each.number)


# -------- Report


def table(outcomes: list[Outcome]) -> Iterator[str]:
    """Yield how many cases of each command, and of each kind, ended how."""
    for title, key in (("command", lambda each: each.command), ("kind", lambda each: each.kind)):
        yield f"{title:20s} cases  done  refused  no answer  short  faults  longest [s]  most [MB]"
        for name in sorted({key(each) for each in outcomes}):
            own = [each for each in outcomes if key(each) == name]
            count = Counter(each.status for each in own)
            yield (
                f"{name:20s} {len(own):5d} {count[0]:5d} {count[2]:8d} {count[1]:10d} {count[3]:6d}"
                f" {sum(bool(each.faults) for each in own):7d} {max(each.seconds for each in own):12.1f}"
                f" {max(each.megabytes for each in own):10.0f}"
            )
        yield ""


def main() -> None:
    """Run cases and print the tables, and each fault with what repeats it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--case", type=int, help="run this case alone, in this process, and show all of it")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve(given.serve, given.seed)
        return
    if given.case is not None:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
            base = Path(scratch) / "good"
            base.mkdir()
            build(base)
            case = case_of(given.seed, given.case, base)
            print(case.kind, " ".join(("ident", *case.words)), f"{case.file}:\n{case.data[:3000]!r}", sep="\n")
            print(run(case, base, Path(scratch) / "case"))
        return

    def shown(each: Outcome) -> None:
        for fault in each.faults:
            print(f"--seed {given.seed} --case {each.number} ({each.command}, {each.kind}): {fault}", flush=True)
            print(f"    {each.said[:300]}" if each.said else "", flush=True)

    began = time.monotonic()
    outcomes = fuzzed(given.seed, range(given.first, given.first + given.count), given.workers, shown)
    print("\n".join(table(outcomes)))
    slow = sorted(outcomes, key=lambda each: -each.seconds)[:5]
    print("slowest: " + ", ".join(f"{each.number} ({each.command}) {each.seconds:.1f} s" for each in slow))
    faults = sum(bool(each.faults) for each in outcomes)
    print(f"{len(outcomes)} cases, {faults} with faults, {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
