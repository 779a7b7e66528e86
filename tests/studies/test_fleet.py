"""`ident.fleet` from Python and from the command line: robots in, population out, whatever becomes of one of them."""

import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import DATA
from reports import assert_one_screen
from results import TIME, assert_comes_back, assert_plain

from ident import InputError
from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.fleet import SourceFile, robot_of
from ident.identify.fleet import fleet as infer
from ident.identify.unknowns import Unknowns
from ident.inference.priors import Prior
from ident.measure import read_campaign
from ident.report.page import render
from ident.studies.handout import page_of
from ident.studies.stiffness.fleet import FleetOptions, fleet, robots_in

pytestmark = pytest.mark.slow
generate = runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"]
DRAWN = FleetOptions(starts=2)
QUICK = replace(DRAWN, normal=True)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Eight robots, one of them faulty, and one file that is no campaign."""
    folder = tmp_path_factory.mktemp("robots")
    worn = generate(folder, 8, 1, seed=1)
    (folder / "broken.csv").write_text("kind,value\n")
    return folder, worn


def test_files_beside_a_campaign_are_no_robots(tmp_path):
    (tmp_path / "arm.toml").write_text("")
    for name in ("a", "b"):
        for end in (".csv", ".covariance.csv", ".setups.csv"):
            (tmp_path / f"{name}{end}").write_text("")
    own = tmp_path / "c"
    own.mkdir()
    for name in ("measured.csv", "measured.covariance.csv", "arm.toml"):
        (own / name).write_text("")
    found = {name: (campaign.name, arm.parent) for name, campaign, arm in robots_in(tmp_path, None)}
    assert found == {"a": ("a.csv", tmp_path), "b": ("b.csv", tmp_path), "c": ("measured.csv", own)}


@pytest.fixture(scope="module")
def drawn(robots, tmp_path_factory):
    """A folder in which each robot's fit and draws are kept, and the fleet that was made of them."""
    folder = tmp_path_factory.mktemp("drawn") / "kept"
    return folder, fleet(robots[0], options=DRAWN, folder=folder)


@pytest.fixture(scope="module")
def result(drawn):
    return drawn[1]


@pytest.fixture(scope="module")
def fitted(robots, tmp_path_factory):
    """A folder in which each robot's fit is kept, and the fleet that was made of them without draws."""
    folder = tmp_path_factory.mktemp("fitted") / "kept"
    return folder, fleet(robots[0], options=QUICK, folder=folder)


@pytest.fixture
def kept(fitted, tmp_path):
    """A copy of that folder."""
    return Path(shutil.copytree(fitted[0], tmp_path / "kept"))


def forget(robots, kept, name):
    """Throw away what is kept of a robot."""
    (one,) = (file for file in kept.iterdir() if str(robots[0] / f"{name}.csv").encode() in file.read_bytes())
    one.unlink()


def test_what_it_says(result, robots):
    (worn,) = robots[1]
    report = result.sections()
    assert report.subject.endswith("8 in the population, 1 failed")
    assert report.verdict.word == "1 OF 8 STANDS OUT"
    assert_one_screen(result.report(), files=5, extra=1)
    assert list(result.standing_out) == [worn]
    change = 100 * result.standing_out[worn][robots[1][worn]]
    assert list(result.standing_out[worn]) == [robots[1][worn]]
    assert f"{worn} (joint2 in torsion {change:+.1f} %)" in report.verdict.reason
    assert list(result.failed) == ["broken"]
    assert "broken.csv" in result.failed["broken"]
    assert result.short
    assert result.doubtful
    rows = result.table()
    assert len(rows) == 8 * 6
    assert_plain(rows)
    (off,) = (row for row in rows if row["stands_out"])
    assert (off["robot"], off["parameter"]) == (worn, robots[1][worn])
    assert off == min(rows, key=lambda row: row["chance_if_healthy"])
    assert off["against_fleet_log"] < np.log(0.75)


def test_its_draws_can_be_trusted_and_agree_with_normal_data_where_these_are_good(result, fitted):
    ours, rough = result.fleet.population, fitted[1].fleet.population
    assert len(ours.trusted) == 8
    assert ours.log_likelihood_variance < 0.01
    effective = min(each.effective for each in ours.trusted)
    assert f"Effective draws of each robot: {effective:.0f} or more" in result.report(details=True)
    assert "Effective draws" not in fitted[1].report(details=True)
    assert rough.normal == tuple(range(8))
    assert (np.abs(rough.robot_mean - ours.robot_mean) < 0.5 * ours.robot_sd).all()
    np.testing.assert_allclose(rough.robot_sd, ours.robot_sd, rtol=0.25)


def test_its_page_has_all_robots_and_no_folder_of_theirs(result, robots):
    (worn,) = robots[1]
    text = render(page_of(result))
    assert "1 OF 8 STANDS OUT" in text
    assert re.search(rf"{worn} \(joint2 in torsion -\d+\.\d %\)", text)
    assert all(robot.name in text for robot in result.fleet.robots)
    assert "Robots against the fleet&#39;s median</h2>" in text
    assert "kind,value" not in text
    assert str(robots[0]) not in text
    assert "<script" not in text


def test_names_that_are_no_addresses_are_written_so(result):
    odd = replace(result.fleet.robots[-1], name="a #1?/<b>")
    text = render(page_of(replace(result, fleet=infer([odd]))))
    assert "<b>" not in text
    assert "a #1?/&lt;b&gt;" in text


def test_its_file_brings_it_back(result, tmp_path):
    assert_comes_back(result, tmp_path)


def test_its_priors_for_the_next_robot_are_about_the_fleet_s_median(result):
    assert set(result.priors) == set(result.fleet.names)
    low = [Prior.parse(result.priors[name]).low for name in result.fleet.names]
    np.testing.assert_allclose(low, np.exp(result.fleet.population.mean.mean(0)), rtol=1e-5)


def test_what_data_say_is_free_of_the_prior(robots):
    """The likelihood times the interim prior is the fit's own posterior."""
    arm, campaign = read_arm(robots[0] / "arm.toml").arm, read_campaign(robots[0] / "robot001.csv")
    fit = fit_campaign(arm, campaign, Unknowns(prior_sd=0.3), starts=1)
    robot = robot_of(fit, "one", SourceFile(), SourceFile())
    precision = robot.likelihood.precision + np.diag(robot.prior_sd**-2.0)
    at = robot.likelihood.shift + robot.prior_mean / robot.prior_sd**2
    np.testing.assert_allclose(np.linalg.solve(precision, at), robot.theta, atol=1e-4 * robot.sd.min())
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(precision))), robot.sd, rtol=1e-6)


def test_another_design_is_none_of_the_fleet(fitted):
    names = tuple(name.replace("joint3", "wrist") for name in fitted[1].fleet.names)
    robots = [replace(robot, names=names) if robot.name == "robot005" else robot for robot in fitted[1].fleet.robots]
    found = infer(robots)
    assert {robot.name for robot in found.failed} == {"broken", "robot005"}
    (other,) = (robot for robot in found.failed if robot.name == "robot005")
    assert "wrist.k_tors" in other.error
    assert len(found.members) == 7


def test_what_is_done_is_not_done_again(robots, drawn, fitted, tmp_path):
    """What is damaged is made again, by another process, and comes out the same."""
    kept = Path(shutil.copytree(drawn[0], tmp_path / "kept"))
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in kept.iterdir()}
    assert len(before) == 9 + 8
    damaged = min(path for path in before if path.suffix == ".draws")
    damaged.write_bytes(before[damaged][1][:-20])
    again = fleet(robots[0], options=replace(DRAWN, workers=2), folder=kept)
    after = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in kept.iterdir()}
    assert {path for path in before if before[path][0] != after[path][0]} == {damaged}
    assert {path: text for path, (_, text) in before.items()} == {path: text for path, (_, text) in after.items()}
    assert again.report(details=True) == drawn[1].report(details=True)
    others = {path.name for path in fitted[0].iterdir()}
    assert len(others) == 9
    assert others.isdisjoint(path.name for path in before), "other options, other files"


def test_an_error_that_nobody_expected_costs_one_robot(robots, kept, monkeypatch):
    """It is reported, the others go on, and the next run tries again."""
    from ident.studies.stiffness import fit as module

    right = module.fit

    def wrong(arm, campaign, options):
        if campaign.name == "robot003.csv":
            raise ZeroDivisionError("of a library")
        return right(arm, campaign, options)

    monkeypatch.setattr(module, "fit", wrong)
    for name in ("robot003", "robot004"):
        forget(robots, kept, name)
    result = fleet(robots[0], options=QUICK, folder=kept)
    assert set(result.failed) == {"broken", "robot003"}
    assert "(ZeroDivisionError: of a library)" in result.failed["robot003"]
    assert "robot003" in result.sections().verdict.reason
    assert result.short
    assert len(list(kept.iterdir())) == 8
    monkeypatch.setattr(module, "fit", right)
    assert set(fleet(robots[0], options=QUICK, folder=kept).failed) == {"broken"}


def test_stopped_or_killed_at_any_moment_it_comes_to_the_same_files(run, robots, tmp_path):
    """With processes of its own none of these stays: each has its output open, and that comes to its end."""
    few = tmp_path / "few"
    few.mkdir()
    for name in ("arm.toml", "broken.csv", *(f"robot00{i}.csv" for i in range(1, 8))):
        shutil.copy(robots[0] / name, few)
    words = ["fleet", str(few), "--starts=2", "--normal", "--no-figure", "--out"]

    def disturbed(out, end):
        line = [sys.executable, "-m", "ident", *words, str(out), "--workers=2"]
        process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
        kept = out / f"{few.name}.fleet.robots"
        before = len(list(kept.glob("*.robot")))
        while process.poll() is None:
            if len(list(kept.glob("*.robot"))) > before:
                end(process)
                break
            time.sleep(0.005)
        printed, _ = process.communicate(timeout=300)
        return process.returncode, printed.decode()

    killed = tmp_path / "killed"
    assert disturbed(killed, subprocess.Popen.kill)[0] == -signal.SIGKILL
    code, printed = disturbed(killed, lambda process: os.killpg(process.pid, signal.SIGINT))
    assert code == 130, printed
    assert "the same command goes on from there" in printed
    assert "Traceback" not in printed
    for out in (killed, tmp_path / "alone"):
        assert run(*words, out)[0] == 3
    assert files(killed) == files(tmp_path / "alone")


def files(folder):
    """The contents of all files by name, but for the time that a result was made and its folder."""
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".ident-")]
    paths = [path for path in paths if ".attempts-" not in str(path)]  # of a client that was killed
    return {
        path.relative_to(folder): TIME.sub("", path.read_text("latin-1")).replace(str(folder), "OUT") for path in paths
    }


def test_the_command(run, robots, kept, tmp_path):
    shutil.copytree(kept, tmp_path / "out" / f"{robots[0].name}.fleet.robots")
    code, out, _ = run("fleet", robots[0], "--starts=2", "--normal", "--out", tmp_path / "out")
    assert code == 3, "a robot failed"
    assert_one_screen(out, extra=1)
    name = robots[0].name
    written = {path.name for path in (tmp_path / "out").iterdir()} - {".ident-written"}
    assert written == {f"{name}.fleet{end}" for end in (".json", ".prior", ".png", ".robots")}
    flags = (tmp_path / "out" / f"{name}.fleet.prior").read_text().split()
    code, out, err = run("fit", robots[0] / "robot002.csv", "--starts=2", "--no-figure", *flags)
    assert code == 0, err


@pytest.mark.parametrize("workers", [1, 2])
def test_two_robots_of_one_name_are_refused_before_any_is_read(workers):
    file = ("one", Path("one.csv"), Path("arm.toml"))
    with pytest.raises(InputError, match=r"^one: got two robots of this name"):
        fleet([file, file], options=FleetOptions(workers=workers))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: None, "got no robots"),
        (lambda folder: (folder / "a.csv").write_text(""), "arm.toml: got no such file"),
        (lambda folder: folder.rmdir(), "got no such folder"),
    ],
)
def test_a_folder_without_robots_is_refused(tmp_path, make, words):
    folder = tmp_path / "robots"
    folder.mkdir()
    make(folder)
    with pytest.raises(InputError, match=words):
        fleet(folder)


def test_a_worker_that_is_killed_costs_no_more_than_its_robot(robots, kept, tmp_path, monkeypatch):
    """A robot at which the process ends each time is reported as failed after three; the others are done."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    (tmp_path / "kills").mkdir()
    (tmp_path / "sitecustomize.py").write_text(KILLER.format(name="robot002.csv", kills=tmp_path / "kills"))
    for name in ("robot002", "robot003"):
        forget(robots, kept, name)
    result = fleet(robots[0], options=replace(QUICK, workers=2), folder=kept)
    assert set(result.failed) == {"broken", "robot002"}
    assert "killed 3 times" in result.failed["robot002"]
    assert len(list((tmp_path / "kills").iterdir())) == 3
    assert len(result.fleet.members) == 7


KILLER = """
import os, sys
def watch(event, args):
    if event == "open" and str(args[0]).endswith("{name}") and "--multiprocessing-fork" in sys.orig_argv:
        import traceback
        if any(frame.name in ("fitted", "drawn") for frame in traceback.extract_stack()):
            os.mkdir(f"{kills}/{{os.getpid()}}")
            os.kill(os.getpid(), 9)
sys.addaudithook(watch)
"""


def test_a_folder_that_can_not_be_written_is_said_alike_by_processes(robots, tmp_path):
    """What is wrong comes whole from another process."""
    (tmp_path / "file").touch()
    broken = [("broken", robots[0] / "broken.csv", robots[0] / "arm.toml")]
    for workers in (1, 2):
        with pytest.raises(InputError) as caught:
            fleet(broken, options=replace(QUICK, workers=workers), folder=tmp_path / "file" / "kept")
        (problem,) = caught.value.problems
        assert problem.where.startswith(str(tmp_path / "file" / "kept"))
        assert str(caught.value) == str(problem)
