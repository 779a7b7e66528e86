"""`ident sample` through the command line."""

import json
import re
import shutil
import sys

import pytest
from arms import DATA
from commands import files
from reports import assert_one_screen

from ident.cli import running
from ident.files import claimed
from ident.studies.stiffness.sample import SampleResult

pytestmark = pytest.mark.slow

DATA = DATA / "lcd_arm"
FEW = ("--starts=1", "--discrepancy=deflection:0.1", "--fix=joint1.k_bend", "--walkers=14")
"""What all short chains have, here and in `tests/studies/test_sample.py`, so that they need the same programs."""


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Where a chain that is too short is kept for the tests of this file."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture
def too_short(run, kept, tmp_path):
    """What a chain that is too short prints; it is run once, and its files lie in the folder of each test."""
    if not (kept / "out").exists():
        code, out, err = run("sample", DATA / "table1.csv", *FEW, "--steps=500", "--no-figure")
        assert code == 3, err
        (kept / "printed").write_text(out)
        shutil.copytree(tmp_path / "out", kept / "out")
    shutil.copytree(kept / "out", tmp_path / "out", dirs_exist_ok=True)
    return (kept / "printed").read_text()


@pytest.fixture
def interrupted(monkeypatch):
    """Interrupt a chain behind its second block."""

    def progress(description, total=None):
        def stop(numbers):
            for number in numbers:
                if description == "blocks of steps" and number == 2:
                    raise KeyboardInterrupt
                yield number

        return stop

    monkeypatch.setattr(running, "progress", progress)


def test_sample_goes_on_where_it_was_and_writes_draws_and_figures(run, too_short, tmp_path, monkeypatch):
    import arviz

    assert re.search(r"RESULT: TOO SHORT|the chains are too short as well", too_short, re.IGNORECASE)
    assert_one_screen(too_short, files=3)
    assert "the same command with more --steps goes on from there" in too_short
    first = arviz.from_netcdf(tmp_path / "out/table1.sample.nc")
    longer = ("sample", DATA / "table1.csv", *FEW, "--steps=600", "--ess=100")
    code, out, _ = run(*longer)
    assert code == 3
    assert "discrepancy.deflection" in out
    names = [f"out/table1.sample.{name}" for name in ("corner.png", "nc", "posterior.png", "trace.png")]
    assert set(names) < set(files(tmp_path))
    data = arviz.from_netcdf(tmp_path / "out/table1.sample.nc")
    assert json.loads(data.attrs["format"]) == SampleResult.form
    assert len(json.loads(data.attrs["inputs"])["campaign"]["sha256"]) == 64
    assert data.observed_data["data"].values.tolist() == pytest.approx([4.38, 4.38, 0.022])
    assert set(data.sample_stats["ensemble"].values) == {0, 1, 2, 3}
    draws = data.posterior["joint2.k_tors"]
    assert draws.sizes["draw"] > first.posterior.sizes["draw"]
    monkeypatch.setattr(SampleResult, "enough", True)
    assert run(*longer, "--no-figure")[0] == 0
    assert files(tmp_path) == names, "a chain that is long enough leaves no checkpoints"


@pytest.mark.usefixtures("too_short", "interrupted")
def test_sample_refuses_the_checkpoints_of_another_run_and_says_how_an_interrupted_one_goes_on(run, tmp_path):
    short = (*FEW, "--steps=500", "--no-figure")
    before = {path: (tmp_path / path).read_bytes() for path in files(tmp_path)}
    code, out, err = run("sample", DATA / "table1.csv", *short, "--seed=1")
    assert (code, out) == (2, "")
    assert "a run with another seed" in err
    assert "(--restart)" in err
    assert "(--out)" in err
    assert len(err.splitlines()) == 1
    assert {path: (tmp_path / path).read_bytes() for path in files(tmp_path)} == before
    code, out, err = run("sample", DATA / "table1.csv", *short, "--seed=1", "--restart")
    assert (code, out) == (130, "")
    assert err == "stopped; kept out/table1.sample.part: the same command goes on from there\n"
    assert len(list((tmp_path / "out/table1.sample.part").glob("draws*"))) == 2, "begun anew"


def test_weights_without_dynesty_are_refused_before_anything_is_computed(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "dynesty", None)
    code, out, err = run("sample", DATA / "campaign.csv", "--weights")
    assert (code, out, files(tmp_path)) == (2, "", [])
    assert err == (
        "ident: --weights: got optima to weigh without the package dynesty, expected it installed; "
        "pip install dynesty\n"
    )


@pytest.mark.parametrize("command", ["sample", "diagnose"])
def test_a_second_run_at_the_same_time_is_refused_by_its_folder(run, tmp_path, command):
    folder = tmp_path / f"out/campaign.{command}.part"
    with claimed(folder):
        code, out, err = run(command, DATA / "campaign.csv", "--restart")
        assert (code, out) == (2, "")
        assert err.startswith(f"ident: out/campaign.{command}.part: got a folder in which another run is at work")
        assert err.endswith("wait until it has ended, or choose another folder (--out)\n")
        assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--prior=joint1.k_tors=cataloge:1:2"], "log-uniform:LOW:HIGH"),
        (["--prior=joint1.k_tor=log-uniform:1e5:2e5"], "did you mean joint1.k_tors"),
        (["--prior=joint1.k_tors"], "a name, = and what it is given"),
        (["--discrepancy=deflection:0.1", "--discrepancy=deflection:0.2"], "deflection twice"),
        (["--noise=frequenzy"], "did you mean frequency"),
        (["--discrepancy=deflection:-1"], "a width from 1e-06"),
        (["--no-prior"], "nor a prior that bound"),
        (["--walkers=6"], "at least 12 for 6 unknowns"),
    ],
)
def test_bad_options_of_sample_are_named(run, tmp_path, options, words):
    code, out, err = run("sample", DATA / "table1.csv", "--starts=1", *options)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == []
