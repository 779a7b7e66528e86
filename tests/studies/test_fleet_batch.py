"""`ident fleet --batch`: robots fitted together come out as each by itself, and what is odd is fitted by itself."""

import runpy
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA

from ident.description.file import read_arm
from ident.identify import fleet_batch
from ident.identify.fit import fit_campaign
from ident.identify.fleet import SourceFile, robot_of
from ident.identify.fleet_batch import Given, robots_together
from ident.identify.unknowns import Unknowns
from ident.inference.information import farthest
from ident.measure import Campaign, read_campaign, write_campaign
from ident.studies.fleet import FleetOptions, fleet

pytestmark = pytest.mark.slow
generate = runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"]
ALONE = FleetOptions(starts=2, normal=True)
TOGETHER = replace(ALONE, batch=16)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Six robots, one whose data contradict the model, one measured otherwise, and one file that is no campaign."""
    folder = tmp_path_factory.mktemp("batch")
    generate(folder, 6, 1, seed=1)
    campaign = read_campaign(folder / "robot001.csv")
    write(campaign, folder / "wrong.csv", lambda i, m: replace(m, value=m.value * (1.1 if i == 2 else 1.0)))
    fewer = Campaign(measurements=campaign.measurements[:-1])
    write(fewer, folder / "fewer.csv", lambda i, m: m)
    (folder / "broken.csv").write_text("kind,value\n")
    return folder


def write(campaign, path, changed):
    rows = tuple(changed(i, m) for i, m in enumerate(campaign))
    write_campaign(Campaign(measurements=rows), path, header_comments=(), relative_sigma=True)


@pytest.fixture(scope="module")
def alone(robots):
    return fleet(robots, options=ALONE)


def test_together_they_come_out_as_alone(robots, alone, tmp_path):
    together = fleet(robots, options=TOGETHER, folder=tmp_path / "kept")
    assert len(list((tmp_path / "kept").iterdir())) == 1
    assert set(together.failed) == {"broken"}
    assert together.failed == alone.failed
    assert [robot.name for robot in together.fleet.doubted] == ["wrong"]
    for one, other in zip(alone.fleet.robots, together.fleet.robots, strict=True):
        assert (one.name, one.doubts, one.names, one.measurements) == (
            other.name, other.doubts, other.names, other.measurements
        )  # fmt: skip
        np.testing.assert_allclose(other.theta, one.theta, atol=1e-6)
        np.testing.assert_allclose(other.sd, one.sd, rtol=1e-6)
        np.testing.assert_allclose(other.prior_sd, one.prior_sd)
        np.testing.assert_allclose(other.likelihood.precision, one.likelihood.precision, rtol=1e-5, atol=1e-3)
        np.testing.assert_allclose(other.likelihood.shift, one.likelihood.shift, rtol=1e-5, atol=1e-3)
    assert list(together.standing_out) == list(alone.standing_out)
    again = fleet(robots, options=TOGETHER, folder=tmp_path / "kept")
    assert again.report(details=True) == together.report(details=True)


@pytest.fixture(scope="module")
def given(robots):
    arm = read_arm(robots / "arm.toml").arm
    paths = sorted(robots.glob("*[0-9r]*.csv"))
    named = [path for path in paths if path.stem != "broken"]
    return [Given(p.stem, read_campaign(p), arm, SourceFile(p.name), SourceFile("arm.toml")) for p in named]


def test_only_what_nothing_speaks_against_is_fitted_together(given):
    found = robots_together(given, Unknowns(), 16)
    assert set(found) == {f"robot00{i}" for i in range(1, 7)}
    assert robots_together(given[:1], Unknowns(), 16) == {}, "one is for itself"
    far = given[0].campaign.measurements
    far = Campaign(measurements=(replace(far[0], value=9 * far[0].value), *far[1:]))
    assert "far" not in robots_together([*given, given[0]._replace(name="far", campaign=far)], Unknowns(), 16)


def test_a_wrong_row_that_the_fit_follows_is_noticed_together_as_alone(given):
    """The row of the largest leverage, off by 8 sigma in the direction in which it is off: by sigma it would pass."""
    rows, tests = given[0].campaign.measurements, fit_campaign(given[0].arm, given[0].campaign, starts=1).row_tests
    i = int(tests.left.argmin())
    moved = replace(rows[i], value=rows[i].value - 8 * np.sign(tests.z[i]) * rows[i].sigma)
    wrong = Campaign(measurements=(*rows[:i], moved, *rows[i + 1 :]))
    fit = fit_campaign(given[0].arm, wrong, starts=1)
    assert fit.outliers[i]
    assert np.abs(fit.residuals).max() < farthest(len(rows))
    assert "wrong row" not in robots_together(
        [*given, given[0]._replace(name="wrong row", campaign=wrong)], Unknowns(), 16
    )


def test_other_unknowns_are_integrated_out_and_modes_have_labels():
    """A free mass beside the stiffnesses, labels put to modes between the steps; against the fit of one by itself."""
    labelled = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    arm, unknowns = read_arm(DATA / "lcd_arm" / "arm.toml").arm, Unknowns(prior_sd=2.0, free={"link2.mass": 0.1})
    rng = np.random.default_rng(5)

    def one(i):
        rows = tuple(replace(m, value=m.value + m.sigma * rng.standard_normal()) for m in labelled)
        return Given(f"r{i}", Campaign(measurements=rows), arm, SourceFile(), SourceFile())

    robots = [one(i) for i in range(4)]
    found = robots_together(robots, unknowns, 16)
    assert len(found) >= 2
    each = next(each for each in robots if each.name in found)
    own = robot_of(fit_campaign(arm, each.campaign, unknowns, starts=2), each.name, SourceFile(), SourceFile())
    assert "link2.mass" not in own.names
    np.testing.assert_allclose(found[each.name].theta, own.theta, atol=1e-5)
    np.testing.assert_allclose(found[each.name].likelihood.precision, own.likelihood.precision, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(found[each.name].sd, own.sd, rtol=1e-5)
    # the likelihood times the interim prior is the fit's own posterior
    precision = own.likelihood.precision + np.diag(own.prior_sd**-2.0)
    at = own.likelihood.shift + own.prior_mean / own.prior_sd**2
    np.testing.assert_allclose(np.linalg.solve(precision, at), own.theta, atol=1e-4 * own.sd.min())
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(precision))), own.sd, rtol=1e-6)


def test_a_batch_that_can_not_be_done_is_done_one_by_one(robots, alone, tmp_path, monkeypatch):
    def wrong(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(fleet_batch, "robots_together", wrong)
    result = fleet(robots, options=TOGETHER, folder=tmp_path / "kept")
    assert set(result.failed) == {"broken"}
    assert len(list((tmp_path / "kept").glob("*.robot"))) == 9
    assert result.table() == alone.table()
