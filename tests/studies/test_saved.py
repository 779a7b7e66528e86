"""Result files of every version: each is read, shows one screen, and its numbers are taken over."""

import importlib
from pathlib import Path

import pytest
from arms import lcd_arm
from reports import assert_one_screen, too_wide

import ident
from ident.present.files.document import FIRST, NEWEST
from ident.studies import STUDIES
from ident.studies.values import drawn_values, fitted_values

FOLDER = Path(__file__).parents[1] / "data" / "results"
FILES = sorted(path for path in FOLDER.glob("*/*") if path.suffix in (".json", ".nc"))
WITH_FIT = [path for path in FILES if path.name.endswith((".fit.json", ".sample.nc", ".diagnose.json"))]
by_file = pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.name}")


def test_every_study_writes_the_newest_version():
    for study in STUDIES:
        kind = getattr(importlib.import_module(f"ident.studies.{study}"), f"{study.capitalize()}Result")
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
