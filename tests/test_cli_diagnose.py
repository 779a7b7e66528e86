"""`ident diagnose` as a user meets it, at full speed, where a motion is short; with few draws."""

import json

import numpy as np
import pytest
from arms import DATA
from commands import files

from ident.cli import diagnose as command
from ident.diagnose import kept, remedies, task
from ident.vibrate import search

CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"
ASKED = ("diagnose", CAMPAIGN, "--speed", "100", "--dwell", "0.2", "--limit", "8")


@pytest.fixture
def small(monkeypatch):
    """Few of everything: what is tested is the way through."""
    few = {
        (command, "ESS"): 100.0,
        (command, "DRAWS"): 30,
        (command, "FEW"): 4,
        (task, "SEEN"): 10,
        (remedies, "SPEEDS"): np.array([0.5, 1.25]),
        (remedies, "FEW"): 4,
        (remedies, "TRIED"): 5,
        (search, "SCREENED"): 4,
        (search, "ITERATIONS"): 4,
    }
    for (module, name), value in few.items():
        monkeypatch.setattr(module, name, value)


@pytest.mark.timeout(900)
def test_from_a_campaign_to_advice(small, run, monkeypatch, tmp_path, browser_page):
    """Stopped before its last stage, it goes on there; the page opens in a browser."""

    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(remedies, "prove", stopped)
        code, out, err = run(*ASKED)
    assert code == 130
    assert "goes on from there" in err
    assert not (tmp_path / "out" / "campaign.diagnose.html").exists()
    assert out.count("->") == 5

    def again(*_, **__):
        raise AssertionError("a finished stage is repeated")

    with monkeypatch.context() as patch:
        patch.setattr("ident.identify.campaign_sample.sample_campaign", again)
        patch.setattr("ident.diagnose.shake.shake", again)
        patch.setattr(remedies, "remedies", again)
        code, out, err = run(*ASKED)
    assert code == 0, err
    assert out.count("(as found before)") == 5
    assert "6. Does it hold?" in out

    assert files(tmp_path / "out") == ["campaign.diagnose.html", "campaign.diagnose.json", "campaign.diagnose.nc"]
    document = json.loads((tmp_path / "out" / "campaign.diagnose.json").read_text("utf-8"))
    stages = document["stages"]
    assert list(stages) == ["stiffness", "resonance", "vibration", "sensitivities", "remedies", "proof"]
    assert stages["stiffness"]["rank"] == 6
    assert not stages["vibration"]["accepted"]
    assert {found["kind"] for found in stages["remedies"]["remedies"]} == {"torsion", "mass centre", "both", "speed"}
    assert stages["proof"]["keeps"]["draws"] == 20
    for width in (360, 1280):
        with browser_page(tmp_path / "out" / "campaign.diagnose.html", width, 800) as opened:
            assert opened.alone
            assert not opened.complaints
            assert opened.overhang <= 0
            assert not opened.broken_images


def test_a_run_of_other_inputs_is_not_gone_on_with(run, tmp_path):
    kept.Kept(tmp_path / "out" / "campaign.diagnose.part", {"campaign": "another"})
    code, _, err = run(*ASKED)
    assert code == 2
    assert "another campaign" in err
    assert len(err.splitlines()) == 1


def test_stages_are_kept_whole(tmp_path):
    stages = kept.Kept(tmp_path, {"campaign": "one"})
    assert stages.read("vibration") is None
    stages.write("vibration", {"facts": {"name": "Gelenk \u00fc"}})
    assert kept.Kept(tmp_path, {"campaign": "one"}).read("vibration") == {"facts": {"name": "Gelenk \u00fc"}}
    (tmp_path / "stage-vibration.json").write_text('{"facts": {"na')
    assert stages.read("vibration") is None
    kept.Kept.discard(tmp_path)
    assert not tmp_path.exists()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("--limit", "0"), "--limit: got 0"),
        (("--limit", "nan"), "--limit"),
        (("--speed", "-5"), "--speed"),
        (("--profile", "s-curv"), "did you mean"),
        (("--fix", "joint1.k_bnd"), "joint1.k_bend"),
        (("--load", "glas"), "glass"),
    ],
)
def test_bad_input(run, tmp_path, wrong, said):
    code, _, err = run("diagnose", CAMPAIGN, *wrong)
    assert code == 2
    assert said in err
    assert len(err.splitlines()) == 1
    assert not files(tmp_path)
