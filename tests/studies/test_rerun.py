"""`ident.rerun`: what a file records comes out again, or the reason why not."""

import shutil
from dataclasses import replace

import pytest
from arms import DATA, lcd_arm
from reports import assert_one_screen

import ident
from ident import InputError, read_campaign, rerun
from ident.description.file import ArmFile
from ident.report.report import text_of
from ident.studies.repetition import differences
from ident.studies.rerun import Rerun
from ident.studies.rerun_report import SHOWN_OF_RERUN
from ident.studies.saved import files_of
from ident.studies.stiffness.fit import FitOptions, fit

pytestmark = pytest.mark.slow

OPTIONS = {"starts": 1, "fix": ("joint1.k_bend",), "discrepancy": {"deflection": 0.1}}
QUICK = FitOptions(**OPTIONS, no_explain=True)


@pytest.fixture(scope="module")
def fitted():
    return fit(DATA / "lcd_arm" / "arm.toml", DATA / "lcd_arm" / "table1.csv", QUICK)


def test_a_fit_comes_out_the_same_and_says_so(fitted, tmp_path):
    (path,) = fitted.save(tmp_path)
    again = rerun(path)
    assert again.same
    assert again.now.options == fitted.options
    assert again.now.report() == fitted.report()
    said = again.sections()
    assert (said.verdict.word, said.verdict.reason) == ("SAME", "6 rows of numbers agree with the file to 1e-9.")
    assert str(again).rstrip().endswith(said.verdict.reason)
    assert again.report(details=True).startswith(fitted.report(details=True))


def test_a_number_that_differs_is_named(fitted):
    other = fit(lcd_arm(), read_campaign(DATA / "lcd_arm" / "table1.csv"), replace(QUICK, prior_sd=0.9))
    unlike = list(differences(fitted.table(), other.table()))
    assert {each.column for each in unlike} >= {"value", "low_95", "high_95"}
    each = unlike[0]
    assert each.before == fitted.table()[each.row][each.column]
    assert each.now == other.table()[each.row][each.column]
    said = Rerun(fitted, other, tuple(unlike)).sections()
    assert said.verdict.word == "DIFFERENT"
    assert len(said.answer[0].rows) == min(len(unlike), SHOWN_OF_RERUN)
    assert_one_screen(text_of(said))


def test_inputs_are_found_by_their_hash_beside_the_file(tmp_path):
    campaign = tmp_path / "old" / "table1.csv"
    campaign.parent.mkdir()
    shutil.copy(DATA / "lcd_arm" / "table1.csv", campaign)
    inputs = {"campaign": read_campaign(campaign)}
    assert files_of(inputs, tmp_path).paths["campaign"] == campaign
    moved = shutil.move(campaign, tmp_path)
    assert files_of(inputs, tmp_path).paths["campaign"] == tmp_path / "table1.csv"
    with open(moved, "a") as file:
        file.write("# changed\n")
    with pytest.raises(InputError, match=r"table1.csv: got a file that has changed since, expected the file"):
        files_of(inputs, tmp_path)
    (tmp_path / "table1.csv").unlink()
    with pytest.raises(InputError, match=r"old/table1.csv: got no such file, .* put it there, or beside the result"):
        files_of(inputs, tmp_path)


def test_what_came_from_no_file_can_not_be_found(fitted, tmp_path):
    result = replace(fitted, arm=ArmFile(lcd_arm(), "", "", {}))
    with pytest.raises(InputError, match=r"arm: got a value that came from no file"):
        rerun(result.save(tmp_path)[0])


def test_no_result_is_refused(tmp_path):
    with pytest.raises(InputError, match="expected a result file of ident"):
        rerun(DATA / "lcd_arm" / "arm.toml")
    assert ident.rerun is rerun
