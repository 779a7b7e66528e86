"""`ident.design` from Python: what it changes, what it returns, and the files that bring it back."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from commands import log, posterior
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain

from ident.description.file import parse_arm, read_arm
from ident.errors import InputError
from ident.studies.cure.design import DesignOptions, _checked_text, design
from ident.studies.cure.design_study import unchanged
from ident.studies.values import drawn_groups, drawn_values
from ident.vibrate.design import verify, with_minimum_change

pytestmark = pytest.mark.slow

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")
SHORT = {"dwell": 0.2, "rate": 100.0, "phases": "file"}
K1, K2 = "joint1.k_tors", "joint2.k_tors"
CHANGE = {K1: ("0.5x", "2x"), K2: (2e5, 4e5, 2.0)}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A joint path of half a second: the motion of the tests of the command, whose programs these share."""
    path = tmp_path_factory.mktemp("path") / "teach.csv"
    log(path)
    return path


def telling(progress):
    """A progress that notes of what it is."""

    def shown(description, total=None):
        return lambda numbers: (progress.append(description) or number for number in numbers)

    return shown


@pytest.fixture(scope="module")
def progress():
    """What the design has said of its progress."""
    return []


@pytest.fixture(scope="module")
def result(path, progress):
    options = DesignOptions(change=CHANGE, set={"link2.mass": 36.0}, starts=1, no_curve=True, **SHORT)
    return design(FILE, options, path=path, progress=telling(progress))


@pytest.fixture(scope="module")
def alone(path):
    return design(FILE, DesignOptions(sensitivities=True, **SHORT), path=path)


def test_the_best_is_within_the_bounds_and_vibrates_less(result):
    present = float(lcd_arm().get(K1))
    assert list(result.values) == [K1, K2]
    assert 0.5 * present <= result.values[K1] * (1 + 1e-9)
    assert 2e5 * (1 - 1e-9) <= result.values[K2] <= 4e5 * (1 + 1e-9)
    assert result.best.max() < result.present.max()
    assert [float(result.changed_arm.get(path)) for path in (K1, "link2.mass")] == [result.values[K1], 36.0]
    study = result.study
    assert (study.limit, study.starts, study.draws) == (None, 1, 0)
    assert study.evaluator.variables[1].weight == 2.0
    rows = result.table()
    assert [(row["number"], row["best"]) for row in rows] == list(result.values.items())
    assert np.isnan([row["minimum_change"] for row in rows]).all()


def limited(result, limit):
    """A result with a limit [m], without a search for the least amplitude again."""
    study = result.study
    least = with_minimum_change(replace(study.design, limit=limit), limit)
    checks = verify(least.evaluator, least.best, limit)
    return replace(result, study=replace(study, design=least, verification=checks))


@pytest.fixture(scope="module")
def found(result):
    return limited(result, float(result.present.max() + result.best.max()) / 2)


def test_with_a_limit_the_least_change_that_keeps_it_is_proposed_and_verified(result, found):
    limit = found.study.limit
    design = found.study.design
    assert design.best is design.minimum_change
    assert design.best.change_norm < result.study.design.best.change_norm
    assert limit * 0.99 < found.best.max() <= limit
    np.testing.assert_allclose(found.study.verification.after.amplitude, found.best, atol=3e-3 * limit)
    assert not found.short
    report = found.sections()
    assert (report.verdict.word, report.verdict.kind) == ("MET", "good")
    assert "it is the least change that keeps it" in report.verdict.reason
    changes, effect = report.answer
    assert [row[0] for row in changes.rows] == [K1, K2]
    assert [row[0] for row in effect.rows][:3] == ["peak in x [mm]", "peak in y [mm]", "peak in z [mm]"]
    assert_one_screen(found.report(), files=5)
    assert_one_screen(found.report(width=80), files=5)
    assert not too_wide(found.report(details=True))
    loud = replace(design, present=replace(design.present, amplitude=design.best.amplitude / 1.5))
    said = with_design(found, loud).sections()
    way = "xyz"[int(found.best.argmax())]
    assert (said.verdict.word, said.verdict.kind) == ("MET", "caution")
    assert f"it is the least change that keeps it, but {way} rises by 50 %, from " in said.verdict.reason
    aimless = with_design(found, replace(loud, limit=None)).sections()
    assert any("peak in z rises by 50 %" in finding.text for finding in aimless.findings)


def test_a_design_that_misses_its_limit_says_so(result, found):
    missed = with_design(found, replace(found.study.design, limit=float(found.best.max()) / 2))
    assert (missed.short, missed.sections().verdict.word) == (True, "NOT MET")
    assert result.sections().verdict is None, "no limit, nothing to judge"


def with_design(result, design):
    return replace(result, study=replace(result.study, design=design))


def test_a_limit_that_is_kept_needs_no_change(result):
    found = limited(result, 1.0)
    assert unchanged(found.study.design.best)
    assert not found.short
    report = found.sections()
    assert (report.verdict.word, report.answer) == ("MET", ())
    assert "no change is needed" in report.verdict.reason


def test_its_arm_file_has_the_changed_numbers(result, tmp_path):
    path, arm = result.save(tmp_path)
    assert (path.name, arm.name) == ("arm.teach.design.json", "arm.teach.design.toml")
    written = read_arm(arm)
    assert {path: float(written.arm.get(path)) for path in result.values} == pytest.approx(result.values)
    assert (written.origins[K1], written.origins["link2.mass"]) == ("designed", "assumed")
    assert tomllib.loads(result.text)["name"] == lcd_arm().name
    assert f"# by ident design from {FILE.path}, sha256 {FILE.sha256}" == arm.read_text().splitlines()[0]


@pytest.mark.parametrize("name", ["result", "alone"])
def test_it_comes_back_as_it_was(name, request, tmp_path):
    result = request.getfixturevalue(name)
    assert_comes_back(result, tmp_path)
    assert_plain(result.table())
    figures = [path.name for path in result.save_figures(tmp_path)]
    words = ["" if word == result.main_figure else f".{word}" for word in result.figures()]
    assert figures == [f"{result.name}{word}.png" for word in words]


def test_sensitivities_alone_are_listed_with_the_strongest_first(alone):
    direct = alone.study.sensitivities
    assert alone.name == "arm.teach.sensitivities"
    assert (alone.best, dict(alone.values), alone.text) == (None, {}, "")
    first, *_ = alone.table()
    strongest = direct.order[0]
    assert first["number"] == direct.paths[strongest]
    np.testing.assert_allclose([first[way] for way in "xyz"], direct.elasticity[strongest], rtol=1e-6)
    in_its_way = np.abs(direct.elasticity[:, np.argmax(direct.amplitude)])
    assert in_its_way[strongest] == in_its_way.max()
    assert_one_screen(alone.report(), files=2)
    assert not too_wide(alone.report(details=True))
    assert alone.sections().verdict is None


def test_progress_is_told_of_starts_and_sensitivities(result, progress):
    assert result.study.sensitivities.paths
    assert set(progress) == {"starts", "sensitivities"}


def test_an_arm_of_python_has_no_file_to_write(path, result, alone, tmp_path):
    arm = parse_arm((DATA / "lcd_arm" / "arm.toml").read_text())
    own = design(arm, alone.options, path=path)
    assert _checked_text(own.study.basis, result.study.evaluator.variables) == ""
    other = replace(result, study=replace(result.study, basis=own.study.basis), text="")
    (written,) = other.save(tmp_path)
    assert written.name == f"{arm.name}.teach.design.json"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"change": {K1: (1.0,)}}, rf"`change` {K1}=1: got '1', expected LOW:HIGH or LOW:HIGH:WEIGHT"),
        ({"sensitivities": True, "max_change": 1.0}, "max_change: got it beside `sensitivities`"),
        ({"max_change": 0.0}, "max_change: got 0"),
        ({"min_frequency": -1.0}, "min_frequency: got -1"),
        ({"fresh": -1}, "fresh: got -1, expected a number from 0"),
    ],
)
def test_options_are_checked_when_they_are_made(options, words):
    with pytest.raises(InputError, match=words) as refusal:
        DesignOptions(**options)
    assert len(refusal.value.problems) == 1


def test_a_number_that_the_file_does_not_have_is_refused_before_the_search():
    with pytest.raises(InputError, match=r"link1\.inertia\.xx: got a number that is not written in the arm file"):
        design(FILE, DesignOptions(change={"link1.inertia.xx": ("0.5x", "2x")}, **SHORT))


def test_two_groups_of_draws_have_none_in_common(tmp_path):
    path, arm = tmp_path / "draws.nc", lcd_arm()
    values = posterior(path, draws=50)[K1].ravel()
    few, others = drawn_groups(path, arm, 16, 30, seed=1)
    np.testing.assert_array_equal(few.values[K1], drawn_values(path, arm, 16).values[K1])
    one, two = few.values[K1], others.values[K1]
    assert (len(one), len(two), len(np.intersect1d(one, two))) == (16, 30, 0)
    assert np.isin(np.concatenate([one, two]), values).all()
    again = drawn_groups(path, arm, 16, 30, seed=1)[1].values[K1]
    np.testing.assert_array_equal(two, again)
    _, rest = drawn_groups(path, arm, 16, 1000)
    assert len(rest.values[K1]) == 84, "what is left"
    assert drawn_groups(path, arm, 100, 1000)[1] is None
