"""The arm at work as a line: where its end and its bushings are."""

import numpy as np
import pytest
from arms import lcd_arm

from ident.errors import InputError
from ident.vibrate.motion import stroke
from ident.vibrate.response import outline
from ident.vibrate.simulate import simulate

pytestmark = pytest.mark.slow

MOMENTS = np.linspace(0.2, 0.9, 8)


@pytest.fixture(scope="module")
def moved():
    arm = lcd_arm().replace({"drive2.error": 1e-4})
    response = simulate(arm, stroke(arm.stroke).dwell(0.1), rate=1000.0)
    return arm, response, outline(arm, response, MOMENTS, factor=20.0)


def test_the_end_is_the_responses_end_point(moved):
    _, response, shown = moved
    at = np.searchsorted(np.asarray(response.time), MOMENTS - 1e-9)
    rest = np.asarray(response.path + response.quasi_static)[:, at]
    vibration = np.asarray(response.vibration)[:, at]
    assert shown.time == pytest.approx(MOMENTS)
    np.testing.assert_allclose(shown.rest[:, -1], rest, atol=1e-7)
    np.testing.assert_allclose(shown.drawn[:, -1], rest + 20.0 * vibration, atol=1e-6)


def test_the_rest_is_as_long_as_the_arm(moved):
    _, _, shown = moved
    lengths = np.linalg.norm(np.diff(shown.rest, axis=1), axis=0)
    offsets = [np.linalg.norm(joint.offset) for joint in lcd_arm().joints[1:]]
    assert shown.rest[:, 0] == pytest.approx(np.zeros((3, len(MOMENTS))), abs=1e-12)
    for j, offset in enumerate(offsets):
        assert lengths[j] == pytest.approx(np.full(len(MOMENTS), offset))


@pytest.mark.parametrize(("times", "factor"), [([0.1, 5.0], 1.0), ([], 1.0), ([0.5], 0.0)])
def test_what_cannot_be_drawn_is_refused(moved, times, factor):
    arm, response, _ = moved
    with pytest.raises(InputError):
        outline(arm, response, times, factor=factor)
