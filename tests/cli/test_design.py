"""`ident design`: a real run with all on a short path, the files that it leaves, and bad input."""

import json
import tomllib

import numpy as np
import pytest
from arms import lcd_arm
from commands import ARM, files, log, posterior
from reports import assert_one_screen

import ident
from ident.description.file import read_arm

pytestmark = pytest.mark.slow

K = ("joint1.k_tors", "joint2.k_tors", "joint3.k_tors")
SHORT = ("--path=teach.csv", "--dwell=0.2", "--rate=100")
NAME = "arm.teach"


@pytest.mark.timeout(900)  # some ten programs are compiled, slowly on a machine that others share
def test_a_design_with_all_that_there_is(run, tmp_path, made):
    log(tmp_path / "teach.csv")
    posterior(tmp_path / "draws.nc")
    limit = 20.0
    options = (f"--change={K[0]}", f"--change={K[1]}={K[2]}=0.5x:1.5x:2", "--set=link2.mass=36")
    drawn = ("--posterior=draws.nc", "--draws=4", "--fresh=4", "--starts=1", f"--limit={limit}", "--max-change=1.2")
    code, out, err = run("design", ARM, *SHORT, *options, *drawn, "--out=new")
    assert (code, err) == (0, "")
    base = f"new/{NAME}.design"
    ends = ("json", "png", "sensitivities.png", "toml", "vibration.png")
    assert [name for name in files(tmp_path) if name.startswith("new")] == [f"{base}.{end}" for end in ends]

    result = json.loads((tmp_path / f"{base}.json").read_text())
    assert set(result["inputs"]) == {"arm", "fit", "posterior", "path"}
    assert result["inputs"]["posterior"]["path"] == "draws.nc"
    assert result["options"]["change"] == {K[0]: [], f"{K[1]}={K[2]}": ["0.5x", "1.5x", 2]}
    assert result["options"]["set"] == {"link2.mass": 36}
    study = made[f"{NAME}.design"].study
    assert study.basis.changed == {"link2.mass": 36.0}
    design, best = study.design, study.design.best
    assert design.limit == pytest.approx(limit / 1e3)
    _, second = design.evaluator.variables
    assert second.paths == (K[1], K[2])
    assert (second.weight, second.shifted) == (2, False)
    present = second.present(study.basis.arm)
    assert (second.low, second.high) == pytest.approx((0.5 * present, 1.5 * present))
    assert best.values[K[2]] == pytest.approx(best.values[K[1]] / present * float(lcd_arm().get(K[2])))
    assert [row["best"] for row in result["table"]] == list(best.values.values())
    assert best.change_norm <= 1.2 * (1 + 1e-6)
    assert design.optima[0].largest < design.limit < design.present.largest
    assert [place.change_norm for place in design.curve] == sorted(place.change_norm for place in design.curve)
    fresh = study.verification.after.exceedance
    assert fresh.draws == 4
    assert fresh.interval[0] <= fresh.share <= fresh.interval[1]
    for check in (study.verification.before, study.verification.after):
        assert np.abs(check.difference).max() < 0.05
    assert np.shape(study.sensitivities.band) == (2, len(study.sensitivities.paths), 3)

    text = (tmp_path / f"{base}.toml").read_text()
    written = read_arm(tmp_path / f"{base}.toml")
    for path, value in best.values.items():
        assert float(written.arm.get(path)) == pytest.approx(value)
        assert written.origins[path] == "designed"
    assert (written.origins["link2.mass"], float(written.arm.get("link2.mass"))) == ("assumed", 36)
    assert tomllib.loads(text)["name"] == lcd_arm().name

    report = ident.load(tmp_path / f"{base}.json").sections()
    assert report.verdict.word == ("MET" if study.verification.after.amplitude.max() <= design.limit else "NOT MET")
    assert f"RESULT: {report.verdict.word}." in out
    assert_one_screen(out, extra=1)  # the next command repeats all that was given
    titles = [section.title for section in report.details]
    assert "Verification by the exact equations of motion" in titles
    (_, chances) = report.details[titles.index("Verification by the exact equations of motion")].parts
    assert [row[-1] for row in chances.rows] == [4, 4]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([f"--change={K[0]}=2x:0.5x"], f"--change {K[0]}=2x:0.5x: got 719635 to 179909, expected a lower and a higher"),
        ([f"--change={K[0]}=1.5x:2x"], "bounds about the present"),
        ([f"--change={K[0]}=0:2x"], "bounds above 0"),
        ([f"--change={K[0]}=0.5x"], "expected LOW:HIGH or LOW:HIGH:WEIGHT"),
        ([f"--change={K[0]}=a:b"], "a finite number"),
        ([f"--change={K[0]}=0.5x:2x:0"], "a weight above 0"),
        ([f"--change={K[0]}=0.5x:2x:-1"], "a weight above 0"),
        (["--change=joint1.k_tor"], "did you mean joint1.k_tors"),
        (["--change=speed"], "got the speed, expected a number of the arm; sweep it instead"),
        ([f"--change={K[0]}", f"--change={K[1]}={K[0]}"], f"{K[0]} twice"),
        ([f"--change={K[0]}=fingers.com.x"], "numbers of one kind"),
        (["--change=link1.inertia.xx=0.5x:2x"], "not written in the arm file"),
        (["--limit=0"], "--limit: got 0"),
        (["--max-change=0"], "--max-change: got 0"),
        (["--min-frequency=-1"], "--min-frequency: got -1"),
        (["--measure=peek"], "--measure: got 'peek', expected one of peak, rms, residual"),
        (["--measure=residual", "--dwell=0"], "--measure: got a motion that ends"),
        (["--sensitivities", "--limit=1"], "--limit: got it beside --sensitivities"),
        (["--posterior=none.nc"], "none.nc: got no such file"),
    ],
)
def test_bad_questions_are_one_line_and_nothing_is_written(run, tmp_path, options, words):
    log(tmp_path / "teach.csv")
    code, out, err = run("design", ARM, *SHORT, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.startswith("ident: ")
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == ["teach.csv"]


def test_a_bound_by_its_old_name_is_refused_with_the_new_one(run, tmp_path):
    code, out, err = run("design", ARM, "--max-amount=1")
    assert (code, out) == (2, "")
    assert "No such option: --max-amount" in err
    assert "--max-change" in err
