"""Every benchmark starts as its README says: by itself, outside pytest."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "benchmarks"
NAMES = sorted(set(re.findall(r"`(\w+\.py)\b", (FOLDER / "README.md").read_text(encoding="utf-8"))))
START = """
import runpy, sys, traceback
from contextlib import redirect_stdout
from io import StringIO
places = sys.path[1:]
for name in sys.argv[2:]:
    own = [key for key, each in sys.modules.items() if "/tests/" in (getattr(each, "__file__", None) or "")]
    for key in own:  # what an earlier one has found is no help
        del sys.modules[key]
    sys.path[:], sys.argv = [sys.path[0], *places], [name, "--help"]
    sys.path[0], said, status = sys.argv[0].rpartition("/")[0], StringIO(), None
    try:
        with redirect_stdout(said):
            runpy.run_path(name, run_name="__main__")
    except SystemExit as end:
        status = end.code
    except BaseException:
        traceback.print_exc()
    print(name.rpartition("/")[2], status == 0 and "usage:" in said.getvalue(), flush=True)
"""
"""Starts all in one process, which loads the libraries once; each finds the modules of the tests by itself."""


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_each_command_starts():
    """No other test starts a benchmark without the paths that pytest adds."""
    command = [sys.executable, "-c", START, "benchmarks", *(str(FOLDER / name) for name in NAMES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.split() == [word for name in NAMES for word in (name, "True")], done.stderr[-2000:]


def test_those_that_are_named_are_there():
    assert len(NAMES) > 40
    assert all((FOLDER / name).is_file() for name in NAMES)
