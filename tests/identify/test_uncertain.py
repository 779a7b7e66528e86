"""Numbers that are not exactly known: against arms changed by hand, and against the covariance C + G P G'."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from arms import DATA, lcd_arm
from one_program import shown

from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.check import check_campaign
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.fit import fit
from ident.inference.search import evaluate
from ident.measure import Campaign, Load, Measurement, read_campaign
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.fleet import FleetOptions

slow = pytest.mark.slow

MASS, OFFSET = "link2.mass", "joint2.offset.x"
WIDTHS = {MASS: "5%", OFFSET: "2mm", "load": "1%"}
BY_HAND = {MASS: 0.05, OFFSET: 1.0, "load": 0.01}
"""Standard deviations in theta: ln of a positive number; the others count in their own width."""
PULLED = Load(masses=((20.0, "tip"),), forces=(((30.0, 40.0, 0.0), "tip"),))


def rows(load):
    """The shipped campaign's, and deflections under a load, which come last and are not known yet."""
    still = (0.3, -0.8, 0.5)
    axes = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    loaded = [
        Measurement(kind="deflection", posture=still, value=0.0, sigma=2e-4, point="tip", direction=d, load=load)
        for d in axes
    ]
    return Campaign(measurements=(*read_campaign(DATA / "lcd_arm" / "campaign.csv").measurements, *loaded))


@cache
def campaign():
    """The same, with deflections as they are."""
    *shipped, x, y, z = rows(PULLED).measurements
    values = shown(lcd_arm(), rows(PULLED))[-3:]
    loaded = (replace(row, value=float(v)) for row, v in zip((x, y, z), values, strict=True))
    return Campaign(measurements=(*shipped, *loaded))


@cache
def posed():
    return pose(lcd_arm(), campaign(), Unknowns(uncertain=WIDTHS))


@cache
def fitted():
    return fit(posed().problem, starts=1)


@slow
def test_an_uncertain_mass_takes_its_inertia_along_and_a_load_all_loads():
    """Prediction with nuisances off their centre: that of an arm and a campaign changed by hand."""
    arm, mass = lcd_arm(), float(lcd_arm().get(MASS))
    inertia = {path: 1.1 * float(arm.get(path)) for path in (f"link2.inertia.{end}" for end in ("xx", "yy", "zz"))}
    changed = arm.replace({MASS: 1.1 * mass, OFFSET: float(arm.get(OFFSET)) + 0.002, **inertia})
    more = Load(masses=((20.6, "tip"),), forces=(((30.9, 41.2, 0.0), "tip"),))
    problem, at = posed().problem, {MASS: 1.1 * mass, OFFSET: float(arm.get(OFFSET)) + 0.002, "load": 1.03}
    start = dict(zip(problem.parameters.names, np.asarray(problem.parameters.column("start")), strict=True))
    theta = problem.parameters.theta(np.array(list((start | at).values())))
    np.testing.assert_allclose(evaluate(problem, theta).predicted, shown(changed, rows(more)), rtol=1e-9)


@slow
def test_the_fit_knows_what_generalised_least_squares_knows():
    """Covariance of the stiffnesses: inv(J' inv(C + G P G') J + priors), by dense matrices."""
    found = fitted()
    names = found.problem.parameters.names
    nuisance = np.array([name in WIDTHS for name in names])
    J, sigma = np.asarray(found.jacobian), np.asarray(found.problem.sigma)
    G, P = J[:, nuisance], np.diag([BY_HAND[name] ** 2 for name in names if name in WIDTHS])
    whole = np.diag(sigma**2) + G @ P @ G.T
    known = J[:, ~nuisance].T @ np.linalg.solve(whole, J[:, ~nuisance]) + np.eye((~nuisance).sum())
    sd = np.sqrt(np.diag(np.linalg.inv(known)))
    np.testing.assert_allclose(found.information.sd[~nuisance], sd, rtol=1e-6)
    alone = J[:, ~nuisance].T @ (J[:, ~nuisance] / sigma[:, None] ** 2) + np.eye((~nuisance).sum())
    assert (sd / np.sqrt(np.diag(np.linalg.inv(alone)))).max() > 1.05


def test_nothing_uncertain_is_the_same_problem():
    """Same structure, to the bit the same predictions."""
    bare, none = (pose(lcd_arm(), rows(PULLED), u).problem for u in (Unknowns(), Unknowns(uncertain={})))
    assert jax.tree.structure(bare) == jax.tree.structure(none)


BAD = [
    ({"link2.mas": "5%"}, {}, "link2.mass"),
    ({MASS: "5"}, {}, "as a share (5%)"),
    ({MASS: "5mm"}, {}, "kg"),
    ({MASS: "0%"}, {}, "width > 0"),
    ({MASS: "300%"}, {}, "of its value"),
    ({"load": "2N"}, {}, "a share"),
    ({MASS: "5%"}, {"free": {MASS: 0.1}}, "one of them"),
    ({MASS: "5%"}, {"discrepancy": {"frequency": 0.1}}, "one of both"),
]


@pytest.mark.parametrize(("widths", "others", "said"), BAD)
def test_bad_widths_are_refused_in_one_line(widths, others, said):
    """Each with what was expected."""
    with pytest.raises(InputError) as refused:
        pose(lcd_arm(), rows(PULLED), Unknowns(uncertain=widths, **others))
    assert len(refused.value.problems) == 1
    assert said in str(refused.value)


def test_a_scale_of_loads_needs_a_load():
    """The shipped campaign has none."""
    with pytest.raises(InputError, match="no row with a mass, force or moment"):
        pose(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), Unknowns(uncertain={"load": "1%"}))


@cache
def said_in_file(folder):
    """The shipped arm, whose file says that a mass and an offset are not exactly known."""
    text = (DATA / "lcd_arm" / "arm.toml").read_text()
    text = text.replace('value = 36.395, unit = "kg"', 'value = 36.395, uncertainty = "5%", unit = "kg"')
    path = folder / "arm.toml"
    path.write_text(text)
    return read_arm(path)


def test_what_the_file_says_acts_by_default(tmp_path):
    """As if it were asked for; what is fixed or asked for otherwise goes first, and it can be switched off."""
    arm = said_in_file(tmp_path)
    assert FitOptions().unknowns_of(arm).uncertain == {MASS: "5%"}
    assert FitOptions(uncertain={MASS: "1%"}).unknowns_of(arm).uncertain == {MASS: "1%"}
    assert FitOptions(free={MASS: 0.1}).unknowns_of(arm).uncertain == {}
    assert FitOptions(no_uncertain=True).unknowns_of(arm).uncertain == {}
    with pytest.raises(InputError, match="none in this study; take them as exact"):
        FleetOptions().unknowns_of(arm)


@slow
def test_the_check_counts_them_as_noise():
    """What each stiffness is known within: inv(J' inv(C + G P G') J), by dense matrices."""
    checked = check_campaign(lcd_arm(), campaign(), Unknowns(uncertain=WIDTHS))
    assert [item.name for item in checked.items] == list(pose(lcd_arm(), campaign()).problem.parameters.names)
    problem = checked.problem
    nuisance, sigma = problem.parameters.nuisance, np.asarray(problem.sigma)
    J = np.asarray(evaluate(problem).jacobian)
    G, P = J[:, nuisance], np.diag([BY_HAND[name] ** 2 for name in problem.parameters.names if name in WIDTHS])
    whole = np.diag(sigma**2) + G @ P @ G.T
    sd = np.sqrt(np.diag(np.linalg.inv(J[:, ~nuisance].T @ np.linalg.solve(whole, J[:, ~nuisance]))))
    np.testing.assert_allclose(checked.data_sd[0], sd, rtol=1e-6)
    assert set(checked.verdicts) == {"identifiable"}


@slow
def test_chi_squared_is_that_of_the_whole_covariance():
    """(y - f)' inv(C + G P G') (y - f) at the optimum, where the nuisances' prior costs are in it: linear in them."""
    found = fitted()
    problem, nuisance = found.problem, found.problem.parameters.nuisance
    theta = found.best.theta
    z = problem.parameters.prior_residuals(theta)[0][nuisance]
    J, sigma = np.asarray(found.jacobian), np.asarray(problem.sigma)
    G = J[:, nuisance] * [BY_HAND[name] for name in problem.parameters.names if name in WIDTHS]
    off = found.predicted - np.asarray(problem.measured) - G @ z
    assert found.chi_squared == pytest.approx(off @ np.linalg.solve(np.diag(sigma**2) + G @ G.T, off), rel=1e-6)
    assert found.degrees_of_freedom == len(problem.kinds) - 6
