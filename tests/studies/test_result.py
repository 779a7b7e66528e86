"""Results of one name: the same inputs again replace them, other inputs are refused before anything is computed."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from arms import DATA
from commands import ARM, files, log, posterior

import ident
from ident.errors import InputError
from ident.studies.result import Result, check_place, kept_in, written_to

CAMPAIGN, TABLE = ARM.with_name("campaign.csv"), ARM.with_name("table1.csv")
OTHER = {"path": "elsewhere/file", "sha256": "0" * 64}
SHORT = ("--path=teach.csv", "--rate=100")


def sine(path, amplitude=1.0):
    time = np.arange(200) / 100
    np.savetxt(
        path,
        np.column_stack([time, amplitude * np.sin(30 * time)]),
        header="time [s],x [mm]",
        comments="",
        delimiter=",",
    )


def left_behind(path, *names):
    """Write what a result of other inputs says of itself."""
    path.parent.mkdir(exist_ok=True)
    inputs = dict.fromkeys(names, OTHER)
    if path.suffix == ".nc":
        xarray.Dataset(attrs={"format": "ident-x/1", "inputs": json.dumps(inputs)}).to_netcdf(path, engine="h5netcdf")
    else:
        path.write_text(json.dumps({"format": "ident-x/1", "inputs": inputs}))


COMMANDS = {
    "campaign.fit.json": ("campaign", "fit", CAMPAIGN),
    "campaign.profile.json": ("arm", "profile", CAMPAIGN),
    "campaign.sample.nc": ("campaign", "sample", CAMPAIGN),
    "campaign.validate.json": ("campaign", "validate", CAMPAIGN),
    "campaign.plan.json": ("campaign", "plan", CAMPAIGN),
    "arm.plan.json": ("arm", "plan", f"--arm={ARM}"),
    "campaign.diagnose.json": ("campaign", "diagnose", CAMPAIGN),
    "robots.fleet.json": ("campaign of one", "fleet", "robots", f"--arm={ARM}"),
    "draws-later.compare.json": ("second", "compare", "draws.nc", "later.nc"),
    "hammer.modal.json": ("channels", "modal", DATA / "lcd_arm" / "hammer"),
    "arm.extend-10.resonance.json": ("fit", "resonance", ARM),
    "arm.teach.simulate.json": ("path", "simulate", ARM, *SHORT),
    "arm.extend-10.joint1.k_tors-by-speed.sweep.json": (
        "arm",
        "sweep",
        ARM,
        "--vary=joint1.k_tors",
        "--vary=speed",
        "--grid",
    ),
    "arm.extend-10.joint1.k_tors+speed.sweep.json": ("arm", "sweep", ARM, "--vary=joint1.k_tors", "--vary=speed"),
    "arm.extend-10.design.json": ("arm", "design", ARM),
    "arm.extend-10.sensitivities.json": ("arm", "design", ARM, "--sensitivities"),
    "sine.spectrum.json": ("trace", "spectrum", "sine.csv"),
}
"""By the file that is in the way: the input in which it differs, and the command."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_result_of_other_inputs_is_refused_before_anything_is_computed(run, tmp_path, name):
    differing, *words = COMMANDS[name]
    sine(tmp_path / "sine.csv")
    log(tmp_path / "teach.csv")
    posterior(tmp_path / "draws.nc")
    posterior(tmp_path / "later.nc")
    (tmp_path / "robots").mkdir()
    shutil.copy(CAMPAIGN, tmp_path / "robots" / "one.csv")
    left_behind(tmp_path / "out" / name, differing)
    before = files(tmp_path)
    code, out, err = run(*words)
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert err.startswith(
        f"ident: out/{name}: got a result of other inputs ({differing}: elsewhere/file), expected no re"
    )
    assert err.endswith("choose another folder (--out), or replace it (--force)\n")
    assert files(tmp_path) == before


def test_the_same_inputs_replace_a_result_and_others_only_if_forced(run, tmp_path):
    def spectrum(*more):
        code, _, err = run("spectrum", "sine.csv", "--no-figure", "--quiet", *more)
        assert code == 0 or "got a result of other inputs (trace: sine.csv, since changed)" in err
        return code

    def options():
        return ident.load("out/sine.spectrum.json").options

    sine(tmp_path / "sine.csv")
    assert spectrum() == 0
    shutil.copytree(tmp_path / "out", tmp_path / "first")
    assert spectrum("--upto=10") == 0
    assert options().upto == 10
    sine(tmp_path / "sine.csv", 2.0)
    assert spectrum("--upto=30") == 2
    assert options().upto == 10
    assert spectrum("--upto=30", "--out=other") == 0
    assert spectrum("--upto=30", "--force") == 0
    assert options().upto == 30
    assert files(tmp_path / "out") == ["sine.spectrum.json"]
    sine(tmp_path / "sine.csv")
    code, _, err = run("rerun", "first/sine.spectrum.json", "--out=out")
    assert (code, err.count("\n")) == (2, 1)
    assert err.endswith("choose another folder (--out), or replace it (--force)\n")
    assert run("rerun", "first/sine.spectrum.json", "--out=out", "--force")[0] == 0
    assert options().upto == 20


class Source:
    def __init__(self, path, sha256):
        self.path, self.sha256 = path, sha256


@pytest.mark.parametrize(
    ("there", "now", "fine"),
    [
        ({"arm": ("a.toml", "1")}, {"arm": ("moved/a.toml", "1")}, True),
        ({"arm": ("a.toml", "1")}, {"arm": ("a.toml", "2")}, False),
        ({"arm": ("a.toml", "1"), "fit": None}, {"arm": ("a.toml", "1"), "fit": ("out/a.fit.json", "3")}, False),
        ({"arm": ("a.toml", "1"), "fit": ("out/a.fit.json", "3")}, {"arm": ("a.toml", "1"), "fit": None}, False),
        ({"arm": ("a.toml", "1"), "path": None}, {"arm": ("a.toml", "1"), "path": None}, True),
        ({"fit": ("out/a.fit.json", "3")}, {"fit": ("out/a.fit.json", "4")}, True),
        ({"fit": ("out/a.fit.json", "3")}, {"fit": ("b/a.fit.json", "4")}, False),
        ({"arm of one": ("a", "1")}, {"arm of one": ("a", "1"), "arm of two": ("b", "2")}, True),
        ({"arm of one": ("a", "1")}, {"arm of two": ("a", "1")}, False),
    ],
    ids=[
        "moved",
        "edited",
        "with a fit",
        "without a fit",
        "no path",
        "fitted again",
        "other fit",
        "grown",
        "other robots",
    ],
)
def test_which_inputs_are_the_same(tmp_path, there, now, fine):
    """By contents; what ident has written carries its date, and is the same at its place, too."""
    inputs = {name: each and dict(zip(("path", "sha256"), each, strict=True)) for name, each in there.items()}
    (tmp_path / "x.fit.json").write_text(json.dumps({"format": "ident-fit/1", "inputs": inputs}))
    own = {name: each and Source(*each) for name, each in now.items()}
    with written_to(tmp_path):
        if fine:
            check_place("x.fit", own)
        else:
            with pytest.raises(InputError, match="got a result of other inputs"):
                check_place("x.fit", own)
        check_place("x.fit", {"arm": Source("z", "z")})  # a study within: it writes nothing
    check_place("x.fit", {"arm": Source("z", "z")})  # called from Python, which writes where and when it likes


@pytest.mark.parametrize("end", [".json", ".nc"])
@pytest.mark.parametrize("text", ["{", "[]", '{"format": "x"}', '{"format": "x", "inputs": 3}', ""])
def test_what_is_no_result_is_replaced(tmp_path, text, end):
    (tmp_path / f"x.fit{end}").write_text(text)
    with written_to(tmp_path):
        check_place("x.fit", {"arm": Source("z", "z")})


def test_a_covariance_and_bushings_that_lie_beside_an_input_count(tmp_path):
    campaign = Source("a.csv", "1")
    campaign.covariance = Source("a.covariance.csv", "2")
    inputs = {"campaign": {"path": "a.csv", "sha256": "1"}, "campaign's covariance": OTHER}
    (tmp_path / "x.fit.json").write_text(json.dumps({"format": "ident-fit/1", "inputs": inputs}))
    with written_to(tmp_path), pytest.raises(InputError, match=r"campaign's covariance: elsewhere/file"):
        check_place("x.fit", {"campaign": campaign})


def test_python_replaces(tmp_path):
    """A fit of another arm, called the same: `Result.save` is asked for, and does it."""
    (tmp_path / "arm.toml").write_text(ARM.read_text() + "# another\n")
    first, second = (ident.predict(arm) for arm in (ARM, tmp_path / "arm.toml"))
    assert first.save(tmp_path / "out") == second.save(tmp_path / "out")
    assert files(tmp_path / "out") == ["arm.predict.json"]
    assert ident.load(tmp_path / "out" / "arm.predict.json").inputs["arm"].path == str(tmp_path / "arm.toml")


def test_the_next_command_names_files_in_the_folder_that_is_written():
    result, words = SimpleNamespace(inputs={}, name="an arm.design", options=None), "ident simulate {result}.toml"
    assert Result._command(result, words) == "ident simulate 'out/an arm.design.toml'"
    with kept_in(Path("new")):
        assert Result._command(result, words) == "ident simulate 'new/an arm.design.toml'"
    both = SimpleNamespace(inputs={}, name="arm.plan", options=None)
    assert (
        Result._command(both, "fill in {result}.csv, then: {{x}}, {arm}") == "fill in out/arm.plan.csv, then: {x}, ARM"
    )
