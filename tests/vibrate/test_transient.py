"""The paper's arm in motion: ident's residual, Pinocchio and MuJoCo, each integrated on its own."""

from functools import cache

import numpy as np
import pytest
from arms import lcd_arm
from moving_engines import PinocchioMoving
from mujoco_arm import (
    BushedTransient,
    HingedBushings,
    MotionTable,
    MujocoTransient,
    Response,
    by_ident,
    cycloid,
    displacement,
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


def test_residual_integrated_against_pinocchio() -> None:
    response, states, peak = exact()
    mine = by_ident(lcd_arm(), motion(), TIMES, states[:, 0])
    tip = displacement(PinocchioMoving(lcd_arm()), motion(), TIMES, mine[: len(mine) // 2])
    # measured: 1e-14
    assert np.abs(tip - response.displacement).max() < 1e-10 * peak


def test_mujoco_converges_to_the_motion_of_its_hinges() -> None:
    """To the fourth order in the step."""
    hinges, _, peak = exact(HingedBushings)
    transient, errors = MujocoTransient(lcd_arm(), motion(), DURATION), []
    for step in (1e-3, 5e-4, 2.5e-4):
        found = transient.run(step, every=round(SPACING / step))
        np.testing.assert_allclose(found.time, TIMES, atol=1e-12)
        errors.append(np.abs(found.displacement - hinges.displacement).max() / peak)
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.3)
    assert errors[2] < 1e-6


def test_hinges_are_nearly_a_bushing() -> None:
    """They differ by the square of small angles: the benchmark's MuJoCo is no oracle beyond that."""
    bushings, hinges = exact()[0], exact(HingedBushings)[0]
    apart = np.abs(bushings.displacement - hinges.displacement).max() / exact()[2]
    assert 1e-6 < apart < 1e-2


def test_mujoco_with_the_bushings_own_springs_moves_like_them() -> None:
    """To the third order of the angles, here up to some hundredths."""
    found, (bushings, _, peak) = BushedTransient(lcd_arm(), motion(), DURATION).run(2.5e-4, every=20), exact()
    off = np.abs(found.displacement - bushings.displacement).max() / peak
    apart = np.abs(exact(HingedBushings)[0].displacement - bushings.displacement).max() / peak
    assert off < 0.05 * apart
