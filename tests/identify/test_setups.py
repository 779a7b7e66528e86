"""Frames of setups: what a tracker reads of an arm whose frame is not known, against frames made by SciPy."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from arms import lcd_arm
from equinox import filter_jit
from one_program import predicted
from scipy.spatial.transform import Rotation

from ident.arm.chain import at_posture
from ident.arm.mechanics import point_positions, static_equilibrium
from ident.errors import InputError
from ident.identify.binding import loads_of
from ident.identify.fit import CampaignFit
from ident.identify.plan import PlanSettings, plan_campaign
from ident.identify.problem import pose
from ident.inference.fit import fit
from ident.inference.search import evaluate
from ident.measure import Campaign, Load, Measurement, parse_campaign, read_campaign, write_campaign
from ident.measure.frames import Setup, Setups

TURN, ORIGIN = np.array([0.4, -2.0, 1.1]), np.array([2.3, -1.7, 0.6])
"""Rotation vector [rad] and place [m] of a tracker."""
AXES = np.eye(3)
POSTURES = [(0.0, 0.0, 0.0), (0.5, -1.0, 0.6), (1.0, -2.0, 1.1), (-0.6, 0.4, 1.2)]
LOADS = [Load(masses=((20.0, "tip"),)), Load(forces=(((0.0, 300.0, 0.0), "tip"),))]


def at_rest(posture, load) -> np.ndarray:
    """Return where the tip is in the base frame, by kinematics at the static equilibrium."""
    arm = lcd_arm()
    places = _places(arm, np.asarray(posture), loads_of(arm, load))
    return np.asarray(places)[:, [p.name for p in arm.points].index("tip")]


@filter_jit
def _places(arm, posture, loads):
    chain = at_posture(arm, posture, loads)
    return point_positions(chain, static_equilibrium(chain).phi)


@cache
def tracked(kind: str, noise: float = 0.0, setup: str = "tracker") -> Campaign:
    """Return what a tracker reads of the paper's arm, along its own axes."""
    R, rng = Rotation.from_rotvec(TURN).as_matrix(), np.random.default_rng(0)
    rows = []
    for posture in POSTURES:
        for load in LOADS:
            vector = at_rest(posture, load)
            vector = vector - (ORIGIN if kind == "position" else at_rest(posture, Load()))
            for axis, value in zip(AXES, R.T @ vector + noise * rng.standard_normal(3), strict=True):
                rows.append(
                    Measurement(
                        kind=kind,
                        posture=posture,
                        value=value,
                        sigma=noise or 3e-5,
                        point="tip",
                        direction=tuple(axis),
                        load=load,
                        setup=setup,
                    )
                )
    return Campaign(measurements=tuple(rows))


@cache
def both(noise: float = 0.0) -> Campaign:
    """Positions by one tracker, and by another one differences, which do not tell where it is."""
    rows = (*tracked("position", noise), *tracked("deflection_difference", noise, "other"))
    return Campaign(measurements=rows)


def parameters_of(problem):
    return dict(zip(problem.parameters.names, np.asarray(problem.parameters.column("start")), strict=True))


def test_frames_are_found_and_exact_data_are_predicted():
    """Started by triads; at the truth, what SciPy's frame gives, to rounding."""
    problem = pose(lcd_arm(), both()).problem
    start = parameters_of(problem)
    counts = {name: sum(path.startswith(f"setup:{name}.") for path in start) for name in ("tracker", "other")}
    assert counts == {"tracker": 6, "other": 3}
    for axes in np.moveaxis(np.asarray(problem.model.frames.axes), 2, 0):
        np.testing.assert_allclose(axes, Rotation.from_rotvec(TURN).as_matrix(), atol=1e-9)
    np.testing.assert_allclose([start[f"setup:tracker.{a}"] for a in "xyz"], ORIGIN, atol=1e-9)
    theta = problem.parameters.theta(problem.parameters.column("start"))
    np.testing.assert_allclose(predicted(problem, theta), problem.measured, rtol=1e-9, atol=1e-12)


def differences(problem, theta, step=1e-4):
    """The derivatives of predictions by differences."""
    ends = [[predicted(problem, theta + way * step * e) for e in np.eye(len(theta))] for way in (1, -1)]
    return (np.array(ends[0]) - ends[1]).T / (2 * step)


@pytest.mark.slow
def test_the_derivatives_are_those_of_finite_differences():
    """By the frame's place and turns and by the stiffnesses, of positions and differences alike."""
    problem = pose(lcd_arm(), both()).problem
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    theta = theta + 0.1 * np.random.default_rng(1).standard_normal(len(theta))
    np.testing.assert_allclose(evaluate(problem, theta).jacobian, differences(problem, theta), rtol=1e-5, atol=1e-9)


@pytest.fixture(scope="module")
def fitted():
    """A fit, without what else is said of one."""
    plain = fit(pose(lcd_arm(), both(3e-5)).problem, starts=1)
    return CampaignFit(**{f.name: getattr(plain, f.name) for f in fields(plain)}, arm=lcd_arm(), campaign=both(3e-5))


@pytest.mark.slow
def test_a_free_frame_costs_what_projecting_it_out_costs(fitted):
    """Covariance of the stiffnesses: the Schur complement of the frames' part, by dense matrices."""
    parameters = fitted.problem.parameters
    J = np.asarray(fitted.jacobian) / np.asarray(fitted.problem.sigma)[:, None]
    own, F = J[:, ~parameters.nuisance], J[:, parameters.nuisance]
    left = own - F @ np.linalg.lstsq(F, own, rcond=None)[0]
    known = left.T @ left + np.eye(own.shape[1])
    sd = np.sqrt(np.diag(np.linalg.inv(known)))
    np.testing.assert_allclose(fitted.information.sd[~parameters.nuisance], sd, rtol=1e-6)
    assert fitted.degrees_of_freedom == len(J) - 6 - 9
    assert fitted.information.rank == 6
    assert not fitted.doubts


@pytest.mark.slow
def test_a_plan_goes_on_from_what_is_read_in_a_frame_that_was_found(fitted):
    plan = plan_campaign(lcd_arm(), fitted, settings=PlanSettings(step=np.pi / 2, draws=2, count=1))
    names = fitted.problem.parameters.names
    assert plan.known.names == tuple(name for name in names if not name.startswith("setup:"))
    own = [names.index(name) for name in plan.known.names]
    np.testing.assert_allclose(plan.sd[0], fitted.information.sd[own], rtol=1e-6)
    assert (plan.sd[-1] < plan.sd[0]).all()


@pytest.mark.slow
def test_a_known_frame_is_no_unknown_and_one_with_a_prior_is_one_of_six():
    """And the data find the truth within that prior: by one Gauss-Newton step, as readings are linear in the place."""
    rows = (*tracked("position", setup="known"), *tracked("position", setup="near"))
    known = Setup("known", tuple(ORIGIN), tuple(TURN), 0.0, 0.0)
    near = Setup("near", tuple(ORIGIN + 1e-3), tuple(TURN), 2e-3, 1e-3)
    problem = pose(lcd_arm(), Campaign(measurements=rows, setups=Setups((known, near)))).problem
    names = problem.parameters.names
    assert [name for name in names if name.startswith("setup:known")] == []
    assert sum(name.startswith("setup:near") for name in names) == 6
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    start = predicted(problem, theta)
    exact, off = np.split(start - np.asarray(problem.measured), 2)
    np.testing.assert_allclose(exact, 0.0, atol=1e-12)
    assert np.abs(off).max() > 5e-4
    residuals, slope = problem.weigh(start, differences(problem, theta), theta)
    end = theta - np.linalg.lstsq(np.asarray(slope), np.asarray(residuals), rcond=None)[0]
    found = dict(zip(names, np.asarray(problem.parameters.values(end)), strict=True))
    np.testing.assert_allclose([found[f"setup:near.{a}"] for a in "xyz"], ORIGIN, atol=1e-4)


@pytest.mark.slow
def test_rows_that_do_not_tell_how_a_frame_is_turned_are_refused():
    """One vector leaves the turn about itself; the remedy is to say it."""
    rows = tuple(replace(m, posture=POSTURES[0]) for m in tracked("deflection_difference").measurements[:3])
    with pytest.raises(InputError, match="not known how it is turned"):
        pose(lcd_arm(), Campaign(measurements=rows))


def test_setups_are_written_and_read_back(tmp_path):
    """With what is known of one frame, and nothing of the other."""
    rows = (*tracked("position").measurements[:6], *(replace(m, setup="other") for m in tracked("position")))
    setups = Setups((Setup("tracker", (1.5, 2.0, -0.25), (0.1, 0.2, 0.3), 0.001, 0.002), Setup("other")))
    campaign = Campaign(measurements=rows, setups=setups)
    write_campaign(campaign, tmp_path / "c.csv")
    read = read_campaign(tmp_path / "c.csv")
    assert read.setups == setups
    assert [m.setup for m in read] == [m.setup for m in campaign]
    np.testing.assert_allclose([m.value for m in read], [m.value for m in campaign], rtol=1e-14)


HEAD = "setup,x,y,z,unit,sigma,rx,ry,rz,turn_unit,turn_sigma\n"
BAD = [
    (HEAD.replace(",turn_sigma", "") + "tracker,1,2,3,m,0,0,0,0,deg\n", "expected a column turn_sigma"),
    (HEAD.replace("turn_sigma", "turn_sigma,rw") + "tracker,1,2,3,m,0,0,0,0,deg,0,1\n", "the unknown column 'rw'"),
    (HEAD + "trakker,1,2,3,m,0,0,0,0,deg,0\n", "write tracker"),
    (HEAD + "tracker,1,2,,m,0,0,0,0,deg,0\n", "give all three"),
    (HEAD + "tracker,1,2,3,kg,0,0,0,0,deg,0\n", "a length unit"),
    (HEAD + "tracker,1,2,3,m,-1,0,0,0,deg,0\n", "0 for known, or free"),
    (HEAD + "tracker,1,2,3,m,0,0,0,0,deg,0\ntracker,1,2,3,m,0,0,0,0,deg,0\n", "each setup once"),
    (HEAD + "tracker,,,,m,0,0,0,0,deg,0\n", "a number, as sigma is not free"),
    (HEAD + "tracker,1,2,3\n", "4 fields"),
    (HEAD.replace(",x,", ",x [mm],") + "tracker,1,2,3,m,0,0,0,0,deg,0\n", "the unknown column 'x [mm]'"),
]


@pytest.mark.parametrize(("text", "said"), BAD)
def test_bad_setups_are_refused_with_their_row(text, said):
    """One line each."""
    table = "kind,q1 [deg],point,direction,setup,value,unit,sigma\nposition,0,tip,x,tracker,1,m,0.001\n"
    with pytest.raises(InputError) as refused:
        parse_campaign(table.encode(), "c.csv", None, text.encode())
    assert len(refused.value.problems) == 1
    assert said in str(refused.value)
    assert str(refused.value).startswith("c.setups.csv")
