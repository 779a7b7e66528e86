"""The paper's arm in motion: Pinocchio and the benchmarks' MuJoCo, each integrated on its own."""

from functools import cache

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from moving_engines import PinocchioMoving
from mujoco_arm import (
    BushedTransient,
    HingedBushings,
    MotionTable,
    MujocoTransient,
    Response,
    cycloid,
    reference,
)

pytestmark = pytest.mark.slow

DURATION, SPACING = 0.1, 0.005
TIMES = np.linspace(0, DURATION, round(DURATION / SPACING) + 1)


def motion() -> MotionTable:
    """Quick enough for the pulleys to reach 700 rad/s."""
    return cycloid((1, -2, 1), *np.deg2rad([80, 70]), DURATION)


@cache
def exact(engine: type = PinocchioMoving) -> tuple[Response, np.ndarray, float]:
    response, states = reference(lcd_arm(), motion(), TIMES, engine_of=engine)
    moved = response.displacement - response.displacement[:, :1]
    return response, states, float(np.abs(moved).max())


def test_mujoco_converges_to_the_motion_of_its_hinges() -> None:
    """To the fourth order in the step."""
    hinges, _, peak = exact(HingedBushings)
    transient, errors = MujocoTransient(lcd_arm(), motion(), DURATION), []
    for step in (1e-3, 5e-4, 2.5e-4):
        found = transient.run(step, every=round(SPACING / step))
        np.testing.assert_allclose(found.time, TIMES, atol=1e-12)
        errors.append(np.abs(found.displacement - hinges.displacement).max() / peak)
    what, source = "MuJoCo's own run against its hinges", "order 4: halved steps divide by 16"
    agrees(errors[0] / errors[1], 16, "vibration", what, source, rtol=0.3)
    assert errors[2] < 1e-6


def test_hinges_are_nearly_a_bushing_and_mujoco_with_the_bushings_own_springs_moves_like_it() -> None:
    """Hinges differ by the square of small angles, the bushings' own springs by the third order: here some hundredths
    of that. The benchmark's MuJoCo is no oracle beyond it."""
    (bushings, _, peak), hinges = exact(), exact(HingedBushings)[0]
    found = BushedTransient(lcd_arm(), motion(), DURATION).run(2.5e-4, every=20)
    off, apart = (np.abs(each.displacement - bushings.displacement).max() / peak for each in (found, hinges))
    assert 1e-6 < apart < 1e-2
    assert off < 0.05 * apart
