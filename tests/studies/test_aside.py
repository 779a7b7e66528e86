"""Results of the same name: the same again is replaced, another one is kept."""

import shutil

import pytest
from commands import ARM

import ident
from ident.cli.command import write
from ident.studies.aside import set_aside

CAMPAIGN = ARM.with_name("campaign.csv")


def check_of(campaign=CAMPAIGN):
    return ident.check(ARM, campaign)


def test_the_same_again_takes_its_place(tmp_path):
    result = check_of()
    result.save(tmp_path)
    assert set_aside(check_of(), tmp_path) == ""
    assert len(list(tmp_path.iterdir())) == 1


def test_an_edited_campaign_takes_its_place(tmp_path):
    mine = tmp_path / "campaign.csv"
    shutil.copy(CAMPAIGN, mine)
    (tmp_path / "out").mkdir()
    check_of(mine).save(tmp_path / "out")
    mine.write_text(mine.read_text() + "# read again\n")
    assert set_aside(check_of(mine), tmp_path / "out") == ""


def test_a_campaign_of_the_same_name_is_kept(tmp_path):
    other = tmp_path / "campaign.csv"
    other.write_text(CAMPAIGN.read_text() + "# of another day\n")
    out = tmp_path / "out"
    first = check_of()
    (kept,) = first.save(out)
    held = kept.read_text()
    (out / "campaign.check.notes.txt").write_text("mine")
    assert (
        set_aside(check_of(other), out)
        == "kept the campaign.check that was there, of other campaign, as campaign.check.1"
    )
    check_of(other).save(out)
    assert (out / "campaign.check.1.json").read_text() == held
    assert (out / "campaign.check.1.notes.txt").read_text() == "mine"
    assert "as campaign.check.2" in set_aside(first, out)
    assert (out / "campaign.check.1.json").read_text() == held


def test_other_options_are_named(tmp_path):
    ident.predict(ARM, ident.PredictOptions(load="glass")).save(tmp_path)
    assert "of other options" in set_aside(ident.predict(ARM), tmp_path)


def test_what_is_no_result_is_not_looked_at(tmp_path):
    (tmp_path / "campaign.check.json").write_text("{")
    assert set_aside(check_of(), tmp_path) == ""


@pytest.mark.slow
def test_the_command_says_what_it_keeps(run):
    def fit(starts):
        code, out, err = run("fit", str(CAMPAIGN), "--arm", str(ARM), "--starts", str(starts), "--no-figure")
        assert code == 0, err
        assert "wrote out/campaign.fit.json" in out
        return "kept the campaign.fit that was there, of other options, as campaign.fit.1" in err

    assert [fit(1), fit(1), fit(2)] == [False, False, True]
    assert ident.load("out/campaign.fit.1.json").options.starts == 1
    assert ident.load("out/campaign.fit.json").options.starts == 2


def test_results_of_two_robots_stay_side_by_side(tmp_path):
    """Both of one name in one folder, written by the command: the first is kept, and all files are there."""
    for robot in ("a", "b"):
        (tmp_path / robot).mkdir()
        (tmp_path / robot / "arm.toml").write_text(ARM.read_text() + f"# robot {robot}\n")
        write(ident.predict(tmp_path / robot / "arm.toml"), tmp_path / "out")
    assert len(list((tmp_path / "out").iterdir())) == 2
