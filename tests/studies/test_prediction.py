"""Predictions by draws: each as if computed alone, modes recognised by their shapes."""

import numpy as np
import pytest
from arms import lcd_arm

from ident.errors import ModelError
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load
from ident.studies.look.prediction import predict_draws

pytestmark = pytest.mark.slow

POSTURE = (0.5, -1.0, 0.5)
PATHS = ("joint1.k_bend", "joint1.k_tors", "joint2.k_tors")


def scattered(count, width, seed=0):
    rng = np.random.default_rng(seed)
    return {path: float(lcd_arm().get(path)) * np.exp(width * rng.normal(size=count)) for path in PATHS}


def among(path, values):
    """Draws of one of the numbers, while the others stay."""
    own = {each: np.full(len(values), float(lcd_arm().get(each))) for each in PATHS}
    return own | {path: np.array(values)}


def test_each_draw_is_predicted_as_if_it_were_alone():
    """The first and the last of more than are solved at a time."""
    count, load = 70, Load.parse("glass")
    draws = scattered(count, 0.02)
    prediction = predict_draws(modal_analysis(lcd_arm(), POSTURE, load, 4), draws)
    assert prediction.frequency.shape == prediction.damping_ratio.shape == (4, count)
    for k in (0, count - 1):
        alone = modal_analysis(lcd_arm().replace({path: own[k] for path, own in draws.items()}), POSTURE, load, 4)
        np.testing.assert_allclose(prediction.frequency[:, k], alone.modes.frequency, rtol=1e-9)
        np.testing.assert_allclose(prediction.damping_ratio[:, k], alone.damping_ratio, rtol=1e-9)
        np.testing.assert_allclose(prediction.deflection["tip"][:, k], alone.deflection["tip"], rtol=1e-8, atol=1e-12)
    ordered = np.sort(prediction.frequency[0])
    np.testing.assert_array_equal(prediction.frequency_band[:, 0], np.quantile(ordered, (0.05, 0.95)))


def test_modes_that_change_places_are_followed_by_their_shapes():
    own = modal_analysis(lcd_arm(), (0.0, 0.0, 0.0), modes=2)
    assert [label.direction for label in own.labels] == ["lateral", "vertical"]
    stiff = float(lcd_arm().get("joint1.k_tors"))
    prediction = predict_draws(own, among("joint1.k_tors", [stiff, 4.0 * stiff]))
    lateral, vertical = prediction.frequency
    assert vertical[0] == pytest.approx(vertical[1], rel=1e-6), "torsion does nothing to vertical bending"
    assert lateral[0] < vertical[0]
    assert lateral[1] > vertical[1]


def test_draws_that_collapse_are_left_out_and_counted():
    own, stiff = modal_analysis(lcd_arm(), POSTURE, modes=2), float(lcd_arm().get("joint1.k_bend"))
    prediction = predict_draws(own, among("joint1.k_bend", [stiff, 100.0, stiff]))
    assert prediction.collapsed == 1
    assert prediction.frequency.shape == (2, 2)
    np.testing.assert_allclose(prediction.frequency[:, 0], own.modes.frequency, rtol=1e-9)
    with pytest.raises(ModelError, match="with any draw"):
        predict_draws(own, among("joint1.k_bend", [100.0]))
