"""`ident fleet --dask`: real schedulers and workers on the loopback, killed one by one; the files stay the same."""

import json
import os
import random
import runpy
import sys
import time
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

import pytest
from arms import DATA
from clusters import Cluster, Disturbed, Run
from distributed import Client
from results import TIME

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


def files(folder):
    """The contents of all files by name, but for the time that a result was made and its folder."""
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".ident-")]
    paths = [path for path in paths if not path.parent.name.startswith(".attempts-")]  # of a client that was killed
    return {
        path.relative_to(folder): TIME.sub("", path.read_text("latin-1")).replace(str(folder), "OUT") for path in paths
    }


def test_whatever_is_killed_the_files_are_those_of_one_process(run, robots, tmp_path):
    """A client, a worker and the scheduler; 20 times each on 50 robots: tests/benchmarks/fleet_killed.py."""
    out = tmp_path / "out"
    with Cluster(tmp_path / "cluster") as cluster:
        assert Disturbed(cluster, robots, out, random.Random(7)).kill_clients(1).killed == 1
        last = Run(robots, out, "--dask", cluster.address)
        last.wait_for(lambda: any(list(run.glob("*.robot")) for run in last.attempts - last.before))
        cluster.kill_worker()
        before = last.done
        last.wait_for(lambda: last.done > before + 1)
        assert last.process.poll() is None, "a moment too late to mean anything"
        cluster.kill_scheduler()
        start = time.monotonic()
        assert last.end() == 1
        assert time.monotonic() - start < 30
    said = (tmp_path / "out.log").read_text()
    assert "the same command goes on" in said
    assert "Traceback" not in said
    done = last.done
    assert done >= 2
    for each in (out, tmp_path / "alone" / "out"):
        assert run("fleet", robots, "--starts=4", "--no-figure", "--out", each)[0] == FAILED
    assert files(out) == files(tmp_path / "alone" / "out")
    assert last.done == 13 > done


def test_an_input_that_kills_its_workers_is_given_up_and_workers_of_another_kind_are_refused(robots, tmp_path):
    """The robot's file kills whoever opens it on a worker; the others are done."""
    few = [(name, robots / f"{name}.csv", robots / "arm.toml") for name in ("broken", *(f"robot00{i}" for i in "1234"))]
    (tmp_path / "sitecustomize.py").write_text(KILLER)
    hooked = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    with Cluster(tmp_path / "cluster", hooked) as cluster:
        options = FleetOptions(starts=4, normal=True, dask=cluster.address)
        flags = cluster.environment.get("XLA_FLAGS", "")
        cluster.environment["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
        cluster.start_worker()
        with pytest.raises(InputError, match="another XLA_FLAGS or EQX_ON_ERROR than here"):
            fleet(few, options=options, folder=tmp_path / "kept")
        assert not (tmp_path / "kept").exists()
        cluster.kill_workers()
        cluster.environment["XLA_FLAGS"] = flags
        for _ in range(4):
            cluster.start_worker()
        result = fleet(few, options=options, folder=tmp_path / "kept")
        dead = [worker for worker in cluster.workers if worker.poll() is not None]
    assert set(result.failed) == {"broken", "robot002"}
    assert "killed 3 times" in result.failed["robot002"]
    assert len(result.fleet.members) == 3
    assert len(dead) == 3
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


def test_a_scheduler_that_is_none_is_refused(robots, tmp_path, monkeypatch):
    monkeypatch.setattr(fleet_tasks, "CONNECT", 1.0)
    options = FleetOptions(dask="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match=r"no scheduler at tcp://127.0.0.1:9 .*dask scheduler"):
        fleet(robots, options=options, folder=tmp_path / "kept")
    assert not (tmp_path / "kept").exists()
    with pytest.raises(InputError, match="one of both"):
        FleetOptions(dask="tcp://127.0.0.1:9", workers=2)


def test_workers_without_the_folder_or_of_another_program_are_refused(tmp_path):
    """What a worker answers where the client's folder is not, and where the client is another one."""
    client = {"settings": fleet_tasks._settings(), "circumstances": fleet_tasks._circumstances()}
    with pytest.raises(InputError, match=r"another folder .*expected one that all can read and write"):
        fleet_tasks.attempt(tmp_path / "run", tmp_path)
    run = tmp_path / "run"
    run.mkdir()
    (run / "client").write_text(json.dumps(client))
    with pytest.raises(InputError, match="another folder"):
        fleet_tasks.attempt(run, tmp_path / "inputs")
    assert fleet_tasks.attempt(run, tmp_path) == ""
    client["circumstances"] |= {"jax_enable_x64": "0", "processor": "another"}
    (run / "client").write_text(json.dumps(client))
    with pytest.raises(InputError, match=r"another (processor, jax_enable_x64|jax_enable_x64, processor) than here"):
        fleet_tasks.attempt(run, tmp_path)


def test_a_local_cluster_serves_nothing_and_looks_for_modules_in_no_folder_of_others():
    """Over HTTP, which no certificate protects; in its scratch folder, which Dask puts before all others."""
    with fleet_tasks._local_cluster(1) as cluster, Client(cluster, set_as_default=False) as client:
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
