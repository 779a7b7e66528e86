"""Labels of measured modes: shapes of an arm with noise and covariance, against the names that made them."""

from dataclasses import replace

import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from known_modes import Truth, hammer_test

from ident.arm.parts import Point
from ident.errors import InputError
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_names import Measured, label_modes, nearer, prior_draws, shares
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.modal.finished import FinishedModes
from ident.modal.frf import Place
from ident.modal.modes import modes_of

POSTURE = tuple(np.radians([60.0, -120.0, 60.0]))
"""Lateral torsion 1 and vertical bending 1 are 2.2 % apart."""
LINES = np.arange(1.0, 18.0, 0.05)
OFF = np.array([-0.27, -0.36, -0.32, -0.27, 0.28, 0.18])
"""ln(stiffness) of an arm over its file's: at 60 degrees its third lateral torsion lies beyond the lateral bending."""
ALONG = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
DRAWS = 63
"""With the arm as it is 64, as many as `ident.predict` takes together: one program serves both."""


@pytest.fixture(scope="module")
def arm():
    return lcd_arm()


@pytest.fixture(scope="module")
def first_guess(arm):
    """The numbers of the first guess in the structure of the arm, for which there are programs."""
    return arm.replace(first_guess_arm().numbers())


def measured(arm, directions, noise=0.01):
    """Modes of a hammer test on the tip along (1, 1, 1), accelerations along axes."""
    known = modal_analysis(arm, POSTURE, modes=8)
    motion = known.modes.motion[:, -1]
    shape = np.array([ALONG[axis] for axis in directions]) @ motion
    damping = np.maximum(known.damping_ratio, 0.004)
    truth = Truth(known.modes.frequency, damping, shape, np.full((1, 3), 3**-0.5) @ motion)
    frf = hammer_test(truth, np.random.default_rng(3), noise=noise, lines=LINES)
    return modes_of(replace(frf, responses=tuple(Place("tip", ALONG[axis]) for axis in directions)))


@pytest.fixture(scope="module")
def hammered(arm):
    return {axes: measured(arm, axes) for axes in ("yz", "z")}


@pytest.fixture(scope="module")
def named(hammered, first_guess):
    parameters = stiffness_parameters(first_guess, Unknowns())
    each = {axes: [Measured(POSTURE, modes)] for axes, modes in hammered.items()}
    return {axes: label_modes(first_guess, tests, parameters, draws=DRAWS)[0] for axes, tests in each.items()}


def test_two_modes_two_percent_apart_are_labelled_from_two_directions(named):
    given = [str(label) for label in named["yz"].given]
    assert given[:2] == ["lateral torsion 1", "vertical bending 1"]


def test_from_one_direction_they_are_not(named):
    labels = named["z"]
    assert labels.given[:2] == (None, None)
    assert "move alike where it was measured" in labels.why[0]


def test_probabilities_are_such(named):
    for labels in named.values():
        assert (labels.probability >= 0).all()
        assert (labels.probability.sum(1) <= 1 + 1e-9).all()
        assert (labels.probability.sum(0) <= 1 + 1e-9).all()


def test_a_point_that_the_arm_has_not_is_refused(hammered, first_guess):
    modes = hammered["yz"]
    lost = replace(modes, responses=(Place("elbow", ALONG["y"]),) * 2)
    with pytest.raises(InputError, match="no point elbow, expected one of tip"):
        label_modes(first_guess, [Measured(POSTURE, lost)], stiffness_parameters(first_guess, Unknowns()), draws=2)


def test_an_arm_that_stands_in_no_draw_is_refused(hammered, first_guess):
    soft = first_guess.replace({f"joint{j}.k_bend": 1.0 for j in (1, 2, 3)})
    tests, parameters = [Measured(POSTURE, hammered["yz"])], stiffness_parameters(soft, Unknowns())
    with pytest.raises(InputError, match="no draw of the prior that stands in all postures"):
        label_modes(soft, tests, parameters, draws=DRAWS)


def exact(arm, posture):
    """The five lowest modes of an arm as another program may have found them, exact to a percent of the shape."""
    known = modal_analysis(arm, posture, modes=5)
    names = [point.name for point in arm.points]
    places = tuple(Place(point, ALONG[axis]) for point in ("tip", "elbow") for axis in "yz")
    shape = np.array([np.array(p.direction) @ known.modes.motion[:, names.index(p.point)] for p in places])
    frequency, ratio = np.asarray(known.modes.frequency), np.asarray(known.damping_ratio)
    largest = np.repeat(np.abs(shape).max(0), 2 * len(shape))
    sd = np.concatenate([1e-3 * frequency, 0.1 * ratio, 0.01 * largest])
    modes = frequency, ratio, shape.astype(complex), np.diag(sd**2), places, (frequency[0], frequency[-1])
    return FinishedModes(*modes, "undamped"), known.labels


@pytest.mark.slow
def test_it_is_one_arm_in_all_postures_and_draws_come_near_it(arm):
    """By draws of the prior alone the last mode at 60 degrees was called lateral torsion 3, with a probability of 1."""
    arm = replace(arm, points=(Point("elbow", arm.joints[2].name, (0.0, 0.0, 0.0)), *arm.points))
    parameters = stiffness_parameters(arm, Unknowns())
    theta = np.asarray(parameters.theta(parameters.column("start"))) + OFF
    true = arm.replace(parameters.by_path(np.asarray(parameters.values(theta))))
    each = [exact(true, posture) for posture in ((0.0, 0.0, 0.0), POSTURE)]
    tests = [Measured(q, modes) for q, (modes, _) in zip(((0.0, 0.0, 0.0), POSTURE), each, strict=True)]
    labels = label_modes(arm, tests, parameters)
    for own, (_, meant) in zip(labels, each, strict=True):
        assert own.given == meant


def test_draws_near_those_that_count_have_the_posterior_of_a_normal_likelihood(arm):
    """Importance sampling in rounds against the closed form: N(0, 1) prior, N(theta; 1, 0.3^2) likelihood of each."""
    parameters, rng = stiffness_parameters(arm, Unknowns()), np.random.default_rng(7)
    centre = np.asarray(parameters.theta(parameters.column("centre")))[:, None]
    theta, weight = prior_draws(parameters, 1000, rng), np.zeros(1000)
    for _ in range(3):
        share = shares(weight - (((theta - centre - 1) / 0.3) ** 2).sum(0) / 2)
        theta, weight = nearer(parameters, theta, share, rng)
    share = shares(weight - (((theta - centre - 1) / 0.3) ** 2).sum(0) / 2)
    mean = (theta - centre) @ share
    sd = np.sqrt(((theta - centre - mean[:, None]) ** 2) @ share)
    precision = 1 + 1 / 0.3**2
    assert mean == pytest.approx(np.full(6, (precision - 1) / precision), abs=0.05)
    assert sd == pytest.approx(np.full(6, precision**-0.5), rel=0.15)


def test_too_few_draws_do_not_decide_alone():
    logs = np.array([0.0, -20.0, -30.0, *np.full(13, -40.0)])
    share = shares(logs)
    assert 1 / (share**2).sum() == pytest.approx(2.0, rel=1e-3)
    assert (np.diff(share) <= 0).all()
    equal = shares(np.log(np.full(8, 0.125)))
    assert equal == pytest.approx(np.full(8, 0.125))
