"""Runs of the paper's arm: gradients, sets, measures, tension of belts, and what cannot be simulated."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from moving_engines import PinocchioMoving
from numpy.polynomial import Polynomial
from runs import along, named, paper, short, swing

from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.errors import InputError, ModelError
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.response import Response, belt_tension, peak, refuse_slack, rms, settling_time, slack
from ident.vibrate.simulate import simulate

pytestmark = pytest.mark.slow

PATHS = ("joint1.k_tors", "joint3.k_bend", "joint2.tau_tors", "bracket.com.x", "fingers.com.x", "drive2.eccentricity")
STEP = 1e-5
"""Of the central differences, as a part of each value."""
RATIOS = np.array([161.0, -160.0, 161.0])
"""Of the drives, as in the arm file."""

SWING = swing()
"""Made outside of jit, where panels are found."""


def measures(arm) -> jax.Array:
    vibration = short(arm, SWING).vibration
    return jnp.concatenate([peak(vibration), rms(vibration)])


def values() -> np.ndarray:
    return np.array([float(lcd_arm().get(path)) for path in PATHS])


@cache
def around() -> np.ndarray:
    """Measures (6, 2, 2, 3): at each path's value less and more one and two steps; by sets of shape (2, 3)."""
    found = np.zeros((6, len(PATHS), 4))
    for k, shift in enumerate((-2, -1, 1, 2)):
        table = np.tile(values(), (len(PATHS), 1))
        table[np.diag_indices(len(PATHS))] *= 1 + shift * STEP
        sets = table.reshape(2, 3, -1)
        arm = lcd_arm().replace({path: sets[..., n] for n, path in enumerate(PATHS)})
        found[:, :, k] = np.asarray(measures(arm)).reshape(6, -1)
    return found


def test_gradients() -> None:
    """Of peak and RMS in each direction by jit and jacfwd of the whole run, against differences of fourth order."""

    @jax.jit
    def slopes(numbers: jax.Array) -> jax.Array:
        return jax.jacfwd(lambda x: measures(lcd_arm().replace(dict(zip(PATHS, x, strict=True)))))(numbers)

    mine = np.asarray(slopes(jnp.asarray(values()))) * values()
    low2, low, high, high2 = np.moveaxis(around(), 2, 0)
    measured = (8 * (high - low) - (high2 - low2)) / (12 * STEP)
    size = np.abs(measured).max(1, keepdims=True)
    assert np.abs(mine - measured).max(initial=0, where=size > 0) < 1e-5 * size.max()
    assert (np.abs(mine - measured) < 1e-5 * size).all()


def test_sets_are_single_arms() -> None:
    for k, path in ((0, PATHS[0]), (5, PATHS[5])):
        alone = measures(lcd_arm().replace({path: values()[k] * (1 + STEP)}))
        np.testing.assert_allclose(around()[:, k, 2], alone, rtol=1e-12, atol=2e-15)  # rounding of lengths of 4 m


def test_quasi_static_deflection_is_that_of_the_chain() -> None:
    response = short(lcd_arm(), swing())
    some = slice(0, None, 250)
    chain = at_posture(lcd_arm(), response.posture[:, some])
    right = deflection(chain, jax.jit(equilibrium)(chain))[:, -1]
    # measured by the polynomials between six nodes of an interval
    assert np.abs(np.asarray(response.quasi_static[:, some] - right)).max() < 1e-6 * np.abs(np.asarray(right)).max()


def made(traces: np.ndarray, arrival: float) -> Response:
    """A response that vibrates so, at 100 samples a second."""
    response = short(lcd_arm(), swing())
    T = traces.shape[1]
    motion = Motion("made", response.motion.breaks, response.motion.coefficients, arrival)
    whole = {"time": jnp.arange(T) / 100, "displacement": jnp.asarray(traces), "quasi_static": jnp.zeros((3, T))}
    for name, value in whole.items():
        response = eqx.tree_at(lambda r, name=name: getattr(r, name), response, value)
    return eqx.tree_at(lambda r: r.motion, response, motion)


def test_measures_of_made_signals() -> None:
    t = np.arange(501) / 100
    traces = np.stack([2e-3 * np.exp(-t), -3e-3 * np.cos(2 * np.pi * t), np.full_like(t, 1e-4)])
    traces[2, 300] = -5e-3
    response = made(traces, 1.0)
    np.testing.assert_allclose(peak(response.vibration), [2e-3, 3e-3, 5e-3], rtol=1e-12)
    np.testing.assert_allclose(rms(response.vibration[:, :500])[1], 3e-3 / np.sqrt(2), rtol=1e-12)
    # 2e-3 exp(-t) falls below 1e-3 after ln 2 = 0.69 s; the cosine never; the outlier at 3.00 s is the last
    np.testing.assert_allclose(settling_time(response, 1e-3 / 2), [0.39, np.inf, 2.01], atol=1e-9)
    np.testing.assert_allclose(settling_time(response, 1.0), 0.0)
    np.testing.assert_array_equal(response.after(3.0), traces[:, 300:])
    np.testing.assert_array_equal(response.after(3.0)[:, 0], traces[:, 300])


def test_tension_of_rigid_belts() -> None:
    """Each span carries half of torque / ratio / radius; the first belt also what the second one asks of its pulley."""
    response, engine = short(lcd_arm(), swing(), method="exact"), PinocchioMoving(lcd_arm())
    found = np.asarray(belt_tension(response))
    for k in (0, 77, 500):
        command = np.stack([np.asarray(part) for part in response.motion(response.time[k])])
        y, yd = (np.array(part[:, k]) for part in (response.y, response.yd))
        torque = engine.torques(command, y, yd, engine.accelerations(command, y, yd)) / RATIOS
        second = torque[2] / 0.06
        first = (torque[1] + second * 0.03) / 0.03
        right = 500 + np.array([[first, second], [-first, -second]]) / 2
        np.testing.assert_allclose(found[:, :, k], right, atol=1e-9 * np.abs(right).max())
        assert np.abs(right - 500).max() > 1e-3


def test_tension_of_elastic_belts() -> None:
    """k times the stretch, r1 theta1 - r2 theta2; at thrice full speed the tilt of the shafts adds little."""
    motion = named(stroke(lcd_arm().stroke, percent=300, dwell=0.2))
    response = simulate(lcd_arm(), motion, elastic_belts=True)
    found, xi, phi = np.asarray(belt_tension(response)), np.asarray(response.y)[9:], np.asarray(response.phi)
    first = 0.0 - 0.03 * (RATIOS[1] * xi[0] + phi[2, 1])
    second = 0.03 * (RATIOS[1] - 1) * xi[0] - 0.06 * (RATIOS[2] * xi[1] + phi[2, 2])
    for b, s in enumerate((first, second)):
        pull = (found[0, b] - found[1, b]) / 2
        right = 4e5 * s
        assert np.abs(pull - right).max() < 0.1 * np.abs(right).max()
    assert found.min() > 0


def test_slack_is_told() -> None:
    """Belts that are hardly tensioned go slack, and the report names span and times."""
    response = short(first_guess_arm(), swing())
    loose = eqx.tree_at(lambda r: r.model.belts.pretension, response, 0 * response.model.belts.pretension)
    tension = belt_tension(loose)
    told = list(slack(response.time, tension))
    assert not list(slack(response.time, belt_tension(response)))
    assert {span for _, span, _, _ in told} == {"upper", "lower"}
    below = np.zeros(tension.shape, bool)
    time = np.asarray(response.time)
    for belt, span, start, end in told:
        below[("upper", "lower").index(span), belt] |= (time >= start) & (time <= end)
    np.testing.assert_array_equal(below, np.asarray(tension) <= 0)


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


def test_slack_of_elastic_belts_is_refused_of_the_fast_method() -> None:
    """With the span and the time that `slack` tells; that of rigid ones is not."""
    response, names = paper(100, "fast", True), ["belt1", "belt2"]
    refuse_slack(response, names)
    loose = eqx.tree_at(lambda r: r.model.belts.pretension, response, 0 * response.model.belts.pretension)
    with pytest.raises(InputError, match=r"^elastic_belts: got the (upper|lower) span of belt[12] slack at [\d.e-]+ s"):
        refuse_slack(loose, names)
