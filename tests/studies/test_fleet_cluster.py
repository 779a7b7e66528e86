"""`ident fleet --workers`: whatever is killed, the files stay the same; and its processes serve nobody else."""

import os
import random
import runpy
import sys
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

import pytest
from arms import DATA
from distributed import Client
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
    """What a worker answers where its folder is a file."""
    (tmp_path / "kept").write_text("")
    campaign, arm = DATA / "lcd_arm" / "campaign.csv", DATA / "lcd_arm" / "arm.toml"
    task = fleet_tasks.Task("a", campaign, arm, FleetOptions(), tmp_path / "kept")
    with pytest.raises(
        InputError, match=r"workers: got .*kept, which cannot be used .*make room there, or name another"
    ):
        fleet_tasks.attempt(tmp_path / "kept" / ".attempts-1", {}, task)


def test_a_local_cluster_serves_nothing_and_looks_for_modules_in_no_folder_of_others():
    """Over HTTP, which no certificate protects; in its scratch folder, which Dask puts before all others."""
    with fleet_tasks.local_cluster(1) as cluster, Client(cluster, set_as_default=False) as client:
        (worker,) = client.scheduler_info()["workers"].values()
        assert cluster.scheduler_address.startswith("tls://127.0.0.1:")
        for page in ("info/main.html", "info/main/workers.html", "json/identity.json", "health", "metrics"):
            with pytest.raises(HTTPError, match="404"):
                urlopen(f"http://127.0.0.1:{worker['services']['dashboard']}/{page}", timeout=10)
        with pytest.raises(URLError, match="refused"):
            urlopen(f"http://127.0.0.1:{client.scheduler_info()['services']['dashboard']}/info/main.html", timeout=10)
        (found,) = client.run(lambda: (sys.flags.safe_path, Path(sys.path[0]).parents[1].stat().st_mode)).values()
        assert found[0]
        assert not found[1] & 0o077, "nobody else may write there"
