"""Result files of every version: each is read, shows one screen, and its numbers are taken over."""

import json
from pathlib import Path

import pytest
from arms import lcd_arm
from reports import assert_one_screen, too_wide

import ident
from ident.errors import InputError
from ident.studies import STUDIES, module_of
from ident.studies.values import drawn_values, fitted_values
from ident.text import FIRST, NEWEST

FOLDER = Path(__file__).parents[1] / "data" / "results"
SOURCE = FOLDER / "10" / "runs.source.json"
TRIED = {"run": "a", "drive": "drive2", "stated": [1.0, 2.0], "factor": [1.0, 0.0]}
FILES = sorted(path for path in FOLDER.glob("*/*") if path.suffix in (".json", ".nc"))
WITH_FIT = [path for path in FILES if path.name.endswith((".fit.json", ".sample.nc", ".diagnose.json"))]
by_file = pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.name}")


def test_every_study_writes_the_newest_version():
    for study in STUDIES:
        kind = getattr(module_of(study), f"{study.capitalize()}Result")
        assert kind.form == f"ident-{study}/{NEWEST}"
    assert {int(path.name) for path in FOLDER.iterdir() if path.is_dir()} == set(range(FIRST, NEWEST + 1))


def test_every_study_has_one_in_every_version():
    for version in FOLDER.iterdir():
        if version.is_dir():
            assert {ident.load(path).study for path in version.iterdir()} == set(STUDIES)


@by_file
def test_it_is_read_and_shows_one_screen(path):
    saved = ident.load(path)
    assert_one_screen(saved.report(), files=3, extra=len(saved.table()) if saved.study == "modal" else 0)
    assert not too_wide(saved.report(details=True))
    assert saved.table()
    assert saved.document()["format"] == saved.form
    assert saved.inputs
    assert {*saved.summary, "verdict", "table"} <= {*dir(saved)}


@pytest.mark.parametrize("path", WITH_FIT, ids=lambda path: path.name)
def test_its_fit_is_that_of_its_numbers(path, monkeypatch):
    monkeypatch.chdir(FOLDER)  # so that arm and campaign are those that the file holds
    saved = ident.load(path)
    fitted = saved.fitted
    assert saved.notes == ()
    if saved.study == "fit":
        assert fitted.parameters == saved.parameters
        assert list(map(float, fitted.predicted)) == pytest.approx(
            [row["predicted"] for row in saved.record["measurements"]]
        )


def test_values_and_draws_are_taken_over():
    for path in WITH_FIT:
        if path.suffix == ".nc":
            assert len(drawn_values(path, lcd_arm(), 10).medians) == 6
        elif path.name == "campaign.fit.json":
            assert fitted_values(path, lcd_arm()).medians == ident.load(path).parameters


@pytest.mark.parametrize(
    "damage",
    [
        lambda summary, draws: draws["drive2.phase"].pop(),
        lambda summary, draws: draws["drive2.phase"].__setitem__(2, None),
        lambda summary, draws: draws["drive2.phase"].__setitem__(2, [1.0, 2.0]),
        lambda summary, draws: draws["drive2.phase"].__setitem__(2, "much"),
        lambda summary, draws: draws.update({"drive2.phase": 0.5}),
        lambda summary, draws: draws.update({"drive2.phase": [[0.5] * 5]}),
    ],
    ids=["short", "null", "list", "text", "number", "nested"],
)
def test_a_damaged_draw_is_refused_in_one_line_by_all_that_read_it(damage, tmp_path):
    document = json.loads(SOURCE.read_text())
    damage(document["summary"], document["summary"]["draws"])
    assert_refused(document, tmp_path, lambda file: drawn_values(file, lcd_arm(), 10))
    assert_refused(document, tmp_path, ident.balance)


@pytest.mark.parametrize(
    "damage",
    [
        lambda summary: summary["parameters"].update({"drive2.phase": None}),
        lambda summary: summary["phases"].update({"drive2": 3}),
        lambda summary: summary["phases"].update({"drive2": [[None], [None]]}),
        lambda summary: summary.update(trials=[{"run": "a", "drive": "drive2", "stated": [1, 2], "factor": [1, 0]}]),
        lambda summary: summary.update(trials=[TRIED | {"draws": [[1.0, None], [0.0, 0.0]]}]),
        lambda summary: summary.update(trials=[TRIED | {"draws": [1.0, 1.0]}]),
    ],
    ids=["parameter", "number", "phases", "no draws", "null", "flat"],
)
def test_a_damaged_number_of_a_source_is_refused_by_balance(damage, tmp_path):
    document = json.loads(SOURCE.read_text())
    damage(document["summary"])
    assert_refused(document, tmp_path, lambda file: ident.balance(file, speed=24.0))


def assert_refused(document, folder, read):
    (folder / "runs.source.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as error:
        read(folder / "runs.source.json")
    assert len(error.value.problems) == 1
    assert error.value.problems[0].where.endswith("runs.source.json")
