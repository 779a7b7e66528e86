"""`ident diagnose` as a user meets it, at full speed, where a motion is short; with little effort."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from commands import files
from diagnose_small import CAMPAIGN
from reports import assert_one_screen

from ident.studies.cure.remedies import AND, EFFORTS

pytestmark = pytest.mark.slow

SUPPORT = Path(__file__).parents[1] / "support"
MOTION = ("--speed", "100", "--dwell", "0.2", "--limit", "1.3", "--page")


@pytest.fixture
def small(tmp_path):
    """Start the command `small` in an empty folder."""
    line = [sys.executable, str(SUPPORT / "diagnose_small.py"), "small", str(CAMPAIGN), *MOTION]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SUPPORT), *sys.path])}
    return lambda: subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=environment
    )


@pytest.mark.timeout(900)
def test_from_a_campaign_to_advice_with_a_kill_on_the_way(small, tmp_path, request):
    """Killed (kill -9), it goes on behind the last stage that was finished; the page opens in a browser."""
    killed = small()
    next(line for line in killed.stderr if line.startswith("5/7 "))
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    killed.stdout.close()
    killed.stderr.close()
    assert not (tmp_path / "out" / "campaign.diagnose.html").exists()

    last = small()
    out, err = last.communicate()
    assert last.returncode == 0
    assert err.count("(from an earlier run)") == 5
    assert "7/7 verification: " in err

    assert files(tmp_path / "out") == [f"campaign.diagnose.{end}" for end in ("html", "json", "nc", "png")]
    document = json.loads((tmp_path / "out" / "campaign.diagnose.json").read_text("utf-8"))
    assert document["summary"]["verdict"] in ("warn", "reject")
    assert document["verdict"] == "NOT OK"
    assert document["summary"]["advice"] in err
    assert_one_screen(out)
    kinds = {kind for remedy in document["table"] for kind in remedy["kind"].split(AND)}
    none = {
        "balance",
        "transmission error",
        "schedule",
    }  # no runs; none assumed; the lowest speed that is tried is half
    assert kinds == {*EFFORTS} - none
    assert document["next"].startswith("ident simulate ")
    assert "of 20 fresh draws" in err
    browser_page = request.getfixturevalue("browser_page")  # where there is no browser, all before has been tested
    for width in (360, 1280):
        with browser_page(tmp_path / "out" / "campaign.diagnose.html", width, 800) as opened:
            assert opened.alone
            assert not opened.complaints
            assert opened.overhang <= 0
            assert not opened.broken_images
            boxes = opened.page.locator("figure .scroll").evaluate_all(
                "all => all.map(b => b.scrollWidth > b.clientWidth)"
            )
            assert set(boxes) == {width < 600}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("--limit", "0"), "--limit: got 0"),
        (("--limit", "nan"), "--limit"),
        (("--speed", "-5"), "--speed"),
        (("--profile", "s-curv"), "did you mean"),
        (("--smoothing", "1"), "--smoothing: got it without --path"),
        (("--fix", "joint1.k_bnd"), "joint1.k_bend"),
        (("--set", "joint1.k_bend=-1"), "--set"),
        (("--load", "glas"), "glass"),
    ],
)
def test_bad_input(run, tmp_path, wrong, said):
    code, _, err = run("diagnose", CAMPAIGN, *wrong)
    assert code == 2
    assert said in err
    assert len(err.splitlines()) == 1
    assert not files(tmp_path)
