"""What is made of a response: measures, tension of belts, where they are slack; and what cannot be simulated.

The states are made up: each is told of a moment by itself. Simulations are in the files beside this one.
"""

from functools import cache

import equinox as eqx
import numpy as np
import pytest
from arms import lcd_arm
from moving_engines import PinocchioMoving
from numpy.polynomial import Polynomial
from runs import along, swing

from ident.arm.multibody import multibody
from ident.errors import InputError, ModelError
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response, belt_tension, peak, refuse_slack, rms, slack
from ident.vibrate.simulate import simulate

RATIOS = np.array([161.0, -160.0, 161.0])
"""Of the drives, as in the arm file."""
TIMES = np.linspace(0.0, 5.0, 8)


def made(y: np.ndarray, yd: np.ndarray, *, elastic: bool = False) -> Response:
    """A response of the paper's arm in such states."""
    model, none = multibody(lcd_arm(), rank=1, elastic_belts=elastic), np.zeros((3, len(TIMES)))
    return Response(model, swing(), TIMES, y, yd, none, none, none, none, "fast")


@cache
def shaken() -> Response:
    """On rigid belts."""
    rng = np.random.default_rng(0)
    return made(1e-3 * rng.normal(size=(9, len(TIMES))), 0.1 * rng.normal(size=(9, len(TIMES))))


@cache
def stretched() -> Response:
    """On elastic belts, by some tens of newtons, shafts turned about their own axes alone."""
    y = np.random.default_rng(1).normal(size=(11, len(TIMES))) * np.repeat([1e-3, 1e-5], [9, 2])[:, None]
    y[[0, 1, 3, 4, 6, 7]] = 0.0
    return made(y, 0 * y, elastic=True)


def loose(response: Response) -> Response:
    return eqx.tree_at(lambda r: r.model.belts.pretension, response, 0 * response.model.belts.pretension)


def test_measures_of_made_signals() -> None:
    t = np.arange(501) / 100
    traces = np.stack([2e-3 * np.exp(-t), -3e-3 * np.cos(2 * np.pi * t), np.full_like(t, 1e-4)])
    traces[2, 300] = -5e-3
    motion = Motion("made", swing().breaks, swing().coefficients, 1.0)
    response = Response(
        shaken().model, motion, t, *np.zeros((2, 9, 501)), 0 * traces, traces, *np.zeros((2, *traces.shape)), "fast"
    )
    np.testing.assert_allclose(peak(response.vibration), [2e-3, 3e-3, 5e-3], rtol=1e-12)
    np.testing.assert_allclose(rms(response.vibration[:, :500])[1], 3e-3 / np.sqrt(2), rtol=1e-12)
    np.testing.assert_array_equal(response.after(3.0), traces[:, 300:])
    np.testing.assert_array_equal(response.after(3.0)[:, 0], traces[:, 300])


@pytest.mark.slow
def test_tension_of_rigid_belts() -> None:
    """Each span carries half of torque / ratio / radius; the first belt also what the second one asks of its pulley."""
    response, engine = shaken(), PinocchioMoving(lcd_arm())
    found = np.asarray(belt_tension(response))
    for k in (0, 3, 7):
        command = np.stack([np.asarray(part) for part in response.motion(response.time[k])])
        y, yd = (np.array(part[:, k]) for part in (response.y, response.yd))
        torque = engine.torques(command, y, yd, engine.accelerations(command, y, yd)) / RATIOS
        second = torque[2] / 0.06
        first = (torque[1] + second * 0.03) / 0.03
        right = 500 + np.array([[first, second], [-first, -second]]) / 2
        np.testing.assert_allclose(found[:, :, k], right, atol=1e-9 * np.abs(right).max())
        assert np.abs(right - 500).max() > 1e-3


@pytest.mark.slow
def test_tension_of_elastic_belts() -> None:
    """k times the stretch, r1 theta1 - r2 theta2."""
    response = stretched()
    found, xi, phi = np.asarray(belt_tension(response)), np.asarray(response.y)[9:], np.asarray(response.phi)
    first = 0.0 - 0.03 * (RATIOS[1] * xi[0] + phi[2, 1])
    second = 0.03 * (RATIOS[1] - 1) * xi[0] - 0.06 * (RATIOS[2] * xi[1] + phi[2, 2])
    for b, s in enumerate((first, second)):
        pull = (found[0, b] - found[1, b]) / 2
        np.testing.assert_allclose(pull, 4e5 * s, atol=1e-3 * np.abs(4e5 * s).max())
    assert found.min() > 0


@pytest.mark.slow
def test_slack_is_told() -> None:
    """Belts that are hardly tensioned go slack, and the report names span and times."""
    tension, time = np.asarray(belt_tension(loose(stretched()))), np.asarray(stretched().time)
    told = list(slack(time, tension))
    assert not list(slack(time, belt_tension(stretched())))
    assert {span for _, span, _, _ in told} == {"upper", "lower"}
    below = np.zeros(tension.shape, bool)
    for belt, span, start, end in told:
        below[("upper", "lower").index(span), belt] |= (time >= start) & (time <= end)
    np.testing.assert_array_equal(below, tension <= 0)


@pytest.mark.slow
def test_slack_of_elastic_belts_is_refused_of_the_fast_method() -> None:
    """With the span and the time that `slack` tells; that of rigid ones is not."""
    names = ["belt1", "belt2"]
    refuse_slack(stretched(), names)
    refuse_slack(loose(shaken()), names)
    assert list(slack(TIMES, belt_tension(loose(shaken()))))
    with pytest.raises(InputError, match=r"^elastic_belts: got the (upper|lower) span of belt[12] slack at [\d.e-]+ s"):
        refuse_slack(loose(stretched()), names)


def test_what_cannot_be() -> None:
    """Each is one clear line."""
    arm = lcd_arm()
    few, many = (
        along(Polynomial([0, 0, 0.1]), 5.0, direction=d, start=(0,) * len(d)) for d in ((1, -2), (1, -2, 1, 1))
    )
    with pytest.raises(ModelError, match=r"^the posture has 2 angles; LCD transfer arm has 3 joints"):
        simulate(arm, few)
    with pytest.raises(ModelError, match=r"^the posture has 4 angles; LCD transfer arm has 3 joints"):
        simulate(arm, many)
    with pytest.raises(InputError, match=r"^method: got 'quick', expected fast or exact; choose one$"):
        simulate(arm, swing(), method="quick")
    for rate in (0.1, 1e7):
        with pytest.raises(InputError, match=r"^rate: got .* samples a second, expected 1 to 1e6; choose .*$"):
            simulate(arm, swing(), rate=rate)
    with pytest.raises(InputError, match=r"^rate: got 1 samples a second, one in all, .* two samples or more;"):
        simulate(arm, along(Polynomial([0, 0, 0.1]), 0.9), rate=1.0)
    with pytest.raises(InputError, match=r"^method: got exact for several sets, expected one set; .* one by one$"):
        simulate(arm.replace({"link1.mass": np.array([40.0, 41.0])}), swing(), method="exact")


def test_a_jump_of_speed_is_refused() -> None:
    """Where a motion starts, and within it; no blow of it would be felt."""
    moving = along(Polynomial([0, 0.1]), 5.0)
    with pytest.raises(
        InputError, match=r"^run: got a jump of joint2's speed by 11\.46 deg/s at 0 s, expected a motion"
    ):
        simulate(lcd_arm(), moving)
    halves = along(Polynomial([0, 0, 0.1]), 1.0).dwell(1.0)
    with pytest.raises(InputError, match=r"a jump of joint2's speed by 22\.92 deg/s at 1 s"):
        simulate(lcd_arm(), halves)
