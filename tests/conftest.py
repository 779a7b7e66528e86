"""Double precision, run-time checks of shapes and types, and a compilation cache for every test."""

import ctypes
import gc
import math
import os
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from weakref import WeakSet

import pytest
from browser import browser, browser_page  # noqa: F401
from hypothesis import settings
from jaxtyping import install_import_hook
from shelf import Shelf
from typecheck import COMPUTING, ROOMS, sparingly

CACHE = os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.path.join(tempfile.gettempdir(), "ident-tests-jax-cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("IDENT_PROGRAMS", "on")  # shapes and types are checked where a program is traced first
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each worker has a core; their threads would wait for each other
os.environ.setdefault("EQX_ON_ERROR", "nan")  # as the command line sets it: one set of programs for all
# as `ident.programs` for its programs, and less still: of the thousands of single operations here none runs for long
QUICKLY = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
QUICKLY += " --xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
os.environ.setdefault("XLA_FLAGS", QUICKLY)

sparingly()
install_import_hook([f"ident.{room}" for room in (*ROOMS, *COMPUTING)], "typecheck.checked")

import jax  # noqa: E402

from ident.programs import Programs  # noqa: E402

PROGRAMS, make = WeakSet(), Programs.__init__  # of each function: they hold what was compiled, too


def noted(self, *given):
    """Make the programs of a function, and note them."""
    make(self, *given)
    PROGRAMS.add(self)


Programs.__init__ = noted

from reports import too_wide, without_number  # noqa: E402

from ident import cli  # noqa: E402
from ident.studies.result import Result  # noqa: E402

jax.config.update("jax_enable_x64", True)
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
gc.freeze()  # traced programs are millions of objects: looking through them again and again took 8 % of the time
gc.set_threshold(200_000, 50, 1000)


HERE = Path(__file__).parent
MAPS, MEMORY = Path("/proc/self/maps"), Path("/proc/self/statm")
MOST_MAPS = 15_000
MOST_PAGES, MOST_PAGES_WITHIN = 900_000_000 // 4096, 1_350_000_000 // 4096
"""Of memory after a module, and after a test within one, whose neighbours would share what was compiled; assumed. Most
workers stay below 1.5 GB so; a diagnosis comes to 2."""
C_LIBRARY = ctypes.CDLL(None) if MAPS.exists() else None
if hasattr(C_LIBRARY, "mallopt"):  # of the GNU C library
    C_LIBRARY.mallopt(ctypes.c_int(-8), ctypes.c_int(2))  # M_ARENA_MAX: else each thread that compiles keeps its own


def _keep_few_programs(most_pages):
    """Forget compiled programs when a worker fills memory; what they took goes back to the system."""
    if MEMORY.exists() and int(MEMORY.read_text().split()[1]) > most_pages:
        for programs in PROGRAMS:
            programs.loaded.clear()
        jax.clear_caches()
        gc.collect()
        if trim := getattr(C_LIBRARY, "malloc_trim", None):
            trim(0)


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Begin each module with memory to spare, and with few programs.

    Each has memory maps of its own, and Linux admits 65530 in all.
    """
    yield
    _keep_few_programs(0 if MAPS.exists() and MAPS.read_text().count("\n") > MOST_MAPS else MOST_PAGES)


@pytest.fixture(autouse=True)
def few_programs_within():
    """The same within a module that compiles very many."""
    yield
    _keep_few_programs(MOST_PAGES_WITHIN)


@pytest.fixture(scope="module")
def one_size():
    """Motions of one size, and so a program for each arm, not one for each of a dozen motions of other lengths.

    What fills them up is tested in `tests/vibrate/test_time_intervals.py`, and by all that does not ask for this.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ident.vibrate.linear.PIECES", 8192)
        patch.setattr("ident.vibrate.linear.FEWEST", 96)
        yield


def pytest_collection_modifyitems(items):
    """Begin with the notebooks, the longest file, and end with short ones: no process waits long for the other."""
    items.sort(key=lambda item: (item.path.name != "test_notebooks.py", item.path.parent == HERE))


def pytest_sessionfinish():
    """Spare pytest's searches for garbage at the end all that was traced: seconds in each worker."""
    gc.freeze()


def _without_number_in_tables(out):
    """Return the lines of tables that a command has written, which say nan or inf where a number is meant."""
    written = [Path(line.removeprefix("wrote ")) for line in out.splitlines() if line.startswith("wrote ")]
    tables = [path.read_text(encoding="utf-8") for path in written if path.suffix == ".csv"]
    return [line for text in tables for line in without_number(text.replace(",", " "))]


def _called(monkeypatch, read, arguments):
    """Run ident in this process; return exit code, and output and error text as they are read."""
    monkeypatch.setattr(sys, "argv", ["ident", *map(str, arguments)])
    monkeypatch.setattr("ident.cli.running.PACE", math.inf)  # no line of progress, however slow the machine is
    try:
        cli.main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    out, err = read()
    if not {"--help", "--json"} & set(arguments):
        assert not too_wide(out), "a report fits a terminal"
        assert not [*without_number(out), *_without_number_in_tables(out)], "numbers are numbers"
    return code, out, err


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run ident in this process, in an empty folder; return exit code, output and error text."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: _called(monkeypatch, capsys.readouterr, arguments)


@pytest.fixture
def made(monkeypatch):
    """The results that commands have written in this process, by name."""
    results, save = {}, Result.save

    def kept(self, path):
        results[self.name] = self
        return save(self, path)

    monkeypatch.setattr(Result, "save", kept)
    return results


@pytest.fixture(scope="session")
def run_here():
    """Run ident in this process, in the present folder: for what several tests share."""

    def call(*arguments):
        out, err = StringIO(), StringIO()
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            return _called(patch, lambda: (out.getvalue(), err.getvalue()), arguments)

    return call


@pytest.fixture(scope="session")
def shelf(tmp_path_factory):
    """What commands have done that several tests need: one for all processes of a run."""
    base = tmp_path_factory.getbasetemp()
    return Shelf((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shelf")
