"""`ident fleet --workers`: whatever is killed, the files stay the same, and nobody is left behind."""

import os
import random
import runpy
import sys

import psutil
import pytest
from arms import DATA
from killing import Disturbed, Run, files

from ident import InputError
from ident.studies.stiffness import fleet_tasks
from ident.studies.stiffness.fleet import FleetOptions, fleet

pytestmark = pytest.mark.slow
generate = runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"]
FAILED = 3
"""Exit status where a robot failed."""


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Six robots, and one file that is no campaign."""
    folder = tmp_path_factory.mktemp("cluster") / "robots"
    generate(folder, 6, 1, seed=1)
    (folder / "broken.csv").write_text("kind,value\n")
    return folder


def test_whatever_is_killed_the_files_are_those_of_one_process(run, robots, tmp_path):
    """The process, then a worker; 20 times each on 50 robots: tests/benchmarks/fleet_killed.py."""
    out = tmp_path / "out"
    assert Disturbed(robots, out, random.Random(7)).kill_clients(1).killed == 1
    last = Run(robots, out, "--workers=2")
    last.wait_for(lambda: len(last.workers) == 2)
    before = last.done
    last.wait_for(lambda: last.done > before)
    assert last.kill_worker(), "a moment too late to mean anything"
    assert last.end() == FAILED
    said = (tmp_path / "out.log").read_text()
    assert "Traceback" not in said
    assert run("fleet", robots, "--starts=4", "--no-figure", "--out", tmp_path / "alone" / "out")[0] == FAILED
    assert files(out) == files(tmp_path / "alone" / "out")
    assert last.done == 13


def test_an_input_that_kills_its_workers_is_given_up(robots, tmp_path, monkeypatch):
    """The robot's file kills whoever opens it on a worker; the others are done."""
    few = [(name, robots / f"{name}.csv", robots / "arm.toml") for name in ("broken", *(f"robot00{i}" for i in "1234"))]
    (tmp_path / "sitecustomize.py").write_text(KILLER)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))
    result = fleet(few, options=FleetOptions(starts=4, normal=True, workers=2), folder=tmp_path / "kept")
    assert set(result.failed) == {"broken", "robot002"}, result.failed
    assert "killed 3 times" in result.failed["robot002"]
    assert len(result.fleet.members) == 3
    assert not list((tmp_path / "kept").glob(".attempts-*"))


KILLER = """
import os, sys
def watch(event, args):
    if event == "open" and str(args[0]).endswith("robot002.csv"):
        import traceback
        if any(frame.name in ("fitted", "drawn") for frame in traceback.extract_stack()):
            os.kill(os.getpid(), 9)
sys.addaudithook(watch)
"""


def test_processes_that_cannot_write_are_refused(tmp_path):
    (tmp_path / "kept").write_text("")
    campaign, arm = DATA / "lcd_arm" / "campaign.csv", DATA / "lcd_arm" / "arm.toml"
    task = fleet_tasks.Task("a", campaign, arm, FleetOptions(), tmp_path / "kept")
    with pytest.raises(InputError, match=r"kept: got Not a directory, expected a folder to write in, and"):
        list(fleet_tasks.done([task], 2))


def test_a_worker_ends_with_its_command_and_looks_for_no_module_in_the_folder_of_others(robots, tmp_path, monkeypatch):
    """A planted module does not run; without its command a worker has nobody who would ever end it."""
    for name in ("pickle", "socket"):
        (tmp_path / f"{name}.py").write_text("import os\nopen('planted', 'w').close()\nraise SystemExit('planted')")
    monkeypatch.chdir(tmp_path)
    run = Run(robots, tmp_path / "out", "--workers=2")
    run.wait_for(lambda: run.done > 0)
    workers = run.workers
    run.process.kill()
    run.process.wait()
    assert len(workers) == 2
    _, alive = psutil.wait_procs(workers, timeout=20)
    assert not alive
    assert "planted" not in (tmp_path / "out.log").read_text()
    assert not (tmp_path / "planted").exists()
