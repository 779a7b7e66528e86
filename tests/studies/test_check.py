"""`ident.check` from Python."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from results import assert_comes_back, assert_plain

import ident
from ident.studies.stiffness.check import CheckOptions, check


@pytest.fixture(scope="module")
def result():
    arm, campaign = (DATA / "lcd_arm" / name for name in ("arm.toml", "table1.csv"))
    return check(ident.read_arm(arm), ident.read_campaign(campaign), CheckOptions(no_explain=True))


def test_it_gives_a_verdict_for_each_parameter(result):
    assert result.name == "table1.check"
    assert set(result.verdicts.values()) == {"open"}
    assert list(result.verdicts) == list(result.check.problem.parameters.names)
    assert result.contradictory
    assert result.others == (), "directions are open: none is looked for"


def test_it_comes_back_as_it_was(result, tmp_path):
    assert_comes_back(result, tmp_path)


def test_its_table_has_a_row_for_each_parameter(result):
    rows = result.table()
    assert_plain(rows)
    assert {row["parameter"]: row["verdict"] for row in rows} == result.verdicts
    assert all(row["data_sd"] == np.inf for row in rows)


def test_a_model_without_answer_has_a_table_too(tmp_path):
    soft = lcd_arm().replace({f"joint{j}.k_bend": 10.0 for j in (1, 2, 3)})
    unknown = check(soft, ident.read_campaign(DATA / "lcd_arm" / "table1.csv"))
    assert set(unknown.verdicts.values()) == {"unknown"}
    assert all(np.isnan(row["data_sd"]) for row in unknown.table())
    assert_comes_back(unknown, tmp_path)


def test_a_remedy_names_the_option_as_python_does(result):
    rows = result.check.campaign.measurements
    campaign = ident.Campaign(measurements=(*rows, replace(rows[2], value=10 * rows[2].value)))
    with pytest.raises(ident.InputError, match=r"\(`trust_values` 7\)"):
        check(result.arm, campaign)


def test_an_unknown_parameter_is_refused(result):
    with pytest.raises(ident.InputError, match=r"did you mean joint1\.k_bend"):
        check(result.arm, result.check.campaign, CheckOptions(fix=("joint1.kbend",)))


def test_a_wrong_number_of_the_arm_is_named_with_the_line_of_its_file(tmp_path):
    before = (DATA / "lcd_arm" / "arm.toml").read_text(encoding="utf-8").splitlines(keepends=True)
    place = next(i for i, line in enumerate(before) if line.startswith("offset = { value = [1.0"))
    arm = tmp_path / "arm.toml"
    wrong = before[place].replace("[1.0", "[1000", 1)
    arm.write_text("".join([*before[:place], wrong, *before[place + 1 :]]), encoding="utf-8")
    with pytest.raises(ident.InputError) as refused:
        check(arm, DATA / "lcd_arm" / "table1.csv")
    assert str(refused.value.problems[0]).startswith(f"{arm}:{place + 1}, joint2.offset: got 1000 m, expected at most")
    assert ident.show(arm).sections().findings[0].text.startswith(f"line {place + 1}, joint2.offset: 1000 m")
