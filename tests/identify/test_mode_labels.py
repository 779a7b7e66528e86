"""Labels of measured modes: shapes of an arm with noise and covariance, against the names that made them."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA
from known_modes import Truth, hammer_test

from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_labels import label_modes
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.modal.estimate import modes_of
from ident.modal.frf import Place

POSTURE = tuple(np.radians([60.0, -120.0, 60.0]))
"""Lateral torsion 1 and vertical bending 1 are 2.2 % apart."""
LINES = np.arange(1.0, 18.0, 0.05)
ALONG = {"y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@pytest.fixture(scope="module")
def arm():
    return read_arm(DATA / "lcd_arm" / "arm.toml").arm


@pytest.fixture(scope="module")
def first_guess():
    return read_arm(DATA / "lcd_arm" / "first_guess.toml").arm


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
def named(arm, first_guess):
    parameters = stiffness_parameters(first_guess, Unknowns())
    return {axes: label_modes(first_guess, POSTURE, measured(arm, axes), parameters, draws=64) for axes in ("yz", "z")}


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


def test_a_point_that_the_arm_has_not_is_refused(arm, first_guess):
    modes = measured(arm, "yz")
    lost = replace(modes, frf=replace(modes.frf, responses=(Place("elbow", ALONG["y"]),) * 2))
    with pytest.raises(InputError, match="no point elbow, expected one of tip"):
        label_modes(first_guess, POSTURE, lost, stiffness_parameters(first_guess, Unknowns()), draws=2)
