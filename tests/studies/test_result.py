"""Results of one name: what ident wrote is replaced, what somebody has changed or what took long is kept."""

import json
import os
import shutil
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from commands import ARM, files

import ident
from ident.cli.command import write
from ident.errors import InputError
from ident.files import WRITTEN, replace_file
from ident.studies.following import kept_in, next_command
from ident.studies.options import Options
from ident.studies.result import Alias, Result, other_inputs
from ident.text import study_of

UNKNOWN = "not known to be as ident wrote it"
OTHER = {"path": "elsewhere/file", "sha256": "0" * 64}


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


def spectrum(run, *more):
    """Run a command of a second; return the line about what is kept."""
    code, out, err = run("spectrum", "sine.csv", *more)
    assert (code, err) == (0, "")
    return "".join(line for line in out.splitlines() if line.startswith("kept"))


def test_what_ident_wrote_is_replaced_also_after_an_edit_of_its_input(run, tmp_path):
    """An edit and the same command again is how people work."""
    sine(tmp_path / "sine.csv")
    for amplitude in (1.0, 2.0):
        sine(tmp_path / "sine.csv", amplitude)
        assert spectrum(run) == ""
        assert ident.load("out/sine.spectrum.json").table()[0]["amplitude"] == pytest.approx(1e-3 * amplitude, rel=0.1)
    shutil.copytree(tmp_path / "out", tmp_path / "first")
    sine(tmp_path / "sine.csv", 3.0)
    assert spectrum(run) == ""
    sine(tmp_path / "sine.csv", 2.0)
    assert run("rerun", "first/sine.spectrum.json", "--out=out")[0] == 0
    assert files(tmp_path / "out") == ["sine.spectrum.json", "sine.spectrum.png"]


def test_what_somebody_has_changed_gets_a_number_and_so_do_all_files_of_that_result(run, tmp_path):
    sine(tmp_path / "sine.csv")
    assert spectrum(run) == ""
    out = tmp_path / "out"
    for number in (1, 2):
        (out / "sine.spectrum.png").write_bytes(b"drawn by hand")
        before = (out / "sine.spectrum.json").read_bytes()
        assert (
            spectrum(run) == f"kept what was there as out/sine.spectrum.{number}.*: not known to be as ident wrote it"
        )
        assert (out / f"sine.spectrum.{number}.png").read_bytes() == b"drawn by hand"
        assert (out / f"sine.spectrum.{number}.json").read_bytes() == before
    assert len(files(out)) == 6
    assert spectrum(run) == ""
    (out / "sine.spectrum.json").write_text("mine")
    assert spectrum(run, "--force") == ""
    assert len(files(out)) == 6


@pytest.mark.parametrize("damage", ["{", "[1]", '{"sine.spectrum.json": {}}', "\x00"])
def test_without_knowledge_of_what_was_written_it_is_kept(run, tmp_path, damage):
    sine(tmp_path / "sine.csv")
    assert spectrum(run, "--no-figure") == ""
    (tmp_path / "out" / WRITTEN).write_text(damage)
    assert "sine.spectrum.1.*" in spectrum(run, "--no-figure")
    assert files(tmp_path / "out") == ["sine.spectrum.1.json", "sine.spectrum.json"]


def saved(folder, form, name, inputs):
    """A result as `write` sees it: what it was made of, and what it saves."""

    def save(path):
        replace_file(path, lambda file: file.write(b"new"), make_folders=True)
        return (path,)

    end = ".nc" if form.startswith("ident-sample") else ".json"
    return SimpleNamespace(form=form, name=name, suffix=end, inputs=inputs, save=save)


@pytest.mark.parametrize("form", ["ident-sample/10", "ident-diagnose/10", "ident-fleet/10"])
def test_what_took_long_is_kept_where_its_inputs_are_others(tmp_path, capsys, form):
    name = f"a.{study_of(form)}"
    result = saved(tmp_path, form, name, {"campaign": Source("a.csv", "1")})
    there = tmp_path / f"{name}{result.suffix}"
    left_behind(there, "campaign")
    before = there.read_bytes()
    write(result, tmp_path)
    kept = tmp_path / f"{name}.1{result.suffix}"
    assert (kept.read_bytes(), there.read_bytes()) == (before, b"new")
    words = f"kept what was there as {tmp_path / name}.1.*: a result of other inputs (campaign: elsewhere/file)\n"
    assert capsys.readouterr().out == f"{words}wrote {there}\n"


def test_a_failure_leaves_all_as_it_was(tmp_path, monkeypatch):
    result = saved(tmp_path, "ident-fit/10", "a.fit", {})
    (tmp_path / "a.fit.json").write_text("changed")

    def fails(source, target):
        if Path(target).name == WRITTEN:
            raise OSError
        return rename(source, target)

    rename = os.replace
    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(InputError):
        write(result, tmp_path)
    assert files(tmp_path) == ["a.fit.json"]
    assert (tmp_path / "a.fit.json").read_text() == "changed"


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
    (tmp_path / "x.fleet.json").write_text(json.dumps({"format": "ident-fleet/1", "inputs": inputs}))
    own = {name: each and Source(*each) for name, each in now.items()}
    assert (other_inputs(saved(tmp_path, "ident-fleet/10", "x.fleet", own), tmp_path) == "") is fine


def test_python_replaces(tmp_path):
    """A fit of another arm, called the same: `Result.save` is asked for, and does it."""
    (tmp_path / "arm.toml").write_text(ARM.read_text() + "# another\n")
    first, second = (ident.predict(arm) for arm in (ARM, tmp_path / "arm.toml"))
    assert first.save(tmp_path / "out") == second.save(tmp_path / "out")
    assert files(tmp_path / "out") == ["arm.predict.json"]
    assert ident.load(tmp_path / "out" / "arm.predict.json").inputs["arm"].path == str(tmp_path / "arm.toml")


def test_the_next_command_names_files_in_the_folder_that_is_written():
    design = {}, Options(), "an arm.design"
    assert next_command("ident simulate {result}.toml", *design) == "ident simulate 'out/an arm.design'.toml"
    with kept_in(Path("new")):
        shown = next_command("ident simulate {result}.toml", *design)
    assert shown == "ident simulate 'new/an arm.design'.toml --out new"
    shown = next_command("fill in {result}.csv, then: {{x}}, {arm}", {}, Options(), "arm.plan")
    assert shown == "fill in out/arm.plan.csv, then: {x}, ARM"


RESULTS = [
    each for name in ident.__all__ if name.endswith("Result") and issubclass(each := getattr(ident, name), Result)
]
ANSWERS = {"short", "doubtful", "fitted", "verdict"}
"""What every result is asked, and may answer by an alias."""


def aliases(kind):
    return {name: each for name, each in vars(kind).items() if isinstance(each, Alias)}


@pytest.mark.parametrize("kind", RESULTS)
def test_an_alias_has_a_docstring_and_takes_no_name_of_all_results(kind):
    assert {name for name in aliases(kind) if hasattr(Result, name)} <= ANSWERS
    assert all(each.__doc__ for each in aliases(kind).values())
    assert aliases(kind).keys() <= set(dir(kind))


@pytest.mark.parametrize("kind", RESULTS)
def test_a_result_has_what_its_file_says_and_no_value_has_a_name_of_all_results(kind):
    names = {each.name for each in fields(kind)}
    assert {path.rpartition(".")[2] for path in kind.summarised} <= {*names, *dir(kind)}
    assert not names & {*dir(Result)}
    assert kind.shown


def test_an_alias_is_a_property_of_the_value_it_names():
    assert sum(map(len, map(aliases, RESULTS))) > 20
    value = SimpleNamespace(time=np.arange(3.0))
    result = ident.SimulateResult.__new__(ident.SimulateResult)
    vars(result).update(simulation=value)
    assert result.time is value.time
    with pytest.raises(AttributeError, match="no attribute 'path'"):
        result.path  # noqa: B018
    assert ident.SimulateResult.time.__doc__ == "Times [s]."
