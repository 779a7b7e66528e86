"""When the end has settled: closed forms, other solvers, and simulations that are long enough to look it up."""

import jax
import numpy as np
import pytest
from arms import DATA, lcd_arm
from conformance import agrees
from runs import vibration_at
from scipy.linalg import eig
from scipy.optimize import brentq

import ident
from ident.arm.chain import at_posture
from ident.arm.modes import damped_eigenvalues, linearize
from ident.studies.cure.motion import MotionOptions
from ident.studies.cure.motion_study import Wanted, _drawn, _verified, scheduling_of
from ident.studies.motion_options import basis_of
from ident.studies.scenario import DAMPING
from ident.vibrate.motion import stroke
from ident.vibrate.settling import (
    Decay,
    amplitudes,
    decay_of,
    free_decay,
    largest_decay,
    poles_at,
    poles_of,
    settling_time,
)
from ident.vibrate.simulate import Superposition, simulate

TIME = np.arange(501) / 250
POLES = np.array([-0.666 + 25.9j, -0.091 + 30.2j, -8.0 + 140.0j, -30.0, np.nan])
"""As of the paper's arm at the arrival, an overdamped one, and the place of a conjugate."""


def made(size, rest):
    """A decay with amplitudes (3, 4) and what rests (3,), at `TIME`."""
    return np.stack([(a * np.exp(POLES[:4] * TIME[:, None])).sum(1).real + c for a, c in zip(size, rest, strict=True)])


def drawn(seed):
    rng = np.random.default_rng(seed)
    size = 1e-4 * (rng.normal(size=(3, 4)) + 1j * rng.normal(size=(3, 4)))
    size[:, 3] = size[:, 3].real
    return size, 1e-6 * rng.normal(size=3)


@pytest.mark.parametrize("seed", range(3))
def test_amplitudes_of_a_made_decay_come_back(seed):
    size, rest = drawn(seed)
    found, stays = amplitudes(TIME, made(size, rest), POLES)
    np.testing.assert_allclose(found[:, :3], size[:, :3], rtol=1e-9)
    np.testing.assert_allclose(found[:, 3].real, size[:, 3].real, rtol=1e-9)
    assert (found[:, 4] == 0).all()
    np.testing.assert_allclose(stays, rest, rtol=1e-9)


def test_one_mode_settles_when_its_closed_form_says():
    decay = Decay(np.array([[0.0895]]), np.full((3, 1, 1), 2e-4), np.array([[0.0], [1e-6], [6e-5]]))
    expected = [np.log(2e-4 / 5e-5) / 0.0895, np.log(2e-4 / 4.9e-5) / 0.0895]
    found, what = decay.settled(5e-5)[:, 0], "time until a decaying mode stays below a value"
    agrees(found[:2], expected[:2], "vibration", what, "ln(a / value) / rate", rtol=1e-12, unit="s")
    assert found[2] == np.inf
    np.testing.assert_array_equal(decay.settled(3e-4), 0.0)
    endless = decay._replace(rate=np.zeros((1, 1)))
    np.testing.assert_array_equal(endless.settled(5e-5), np.inf)


@pytest.mark.parametrize("seed", range(3))
def test_several_modes_settle_where_their_envelope_meets_the_value(seed):
    size, rest = drawn(seed)
    vibration = made(size, rest)
    decay = free_decay(TIME, 0.0, vibration[..., None], POLES[:, None])
    for way in range(3):

        def above(t, way=way):
            return (abs(size[way]) * np.exp(POLES[:4].real * t)).sum() + abs(rest[way]) - 2e-5

        what, root = "time until the envelope of several modes meets a value", brentq(above, 0.0, 200.0, xtol=1e-13)
        agrees(decay.settled(2e-5)[way, 0], root, "vibration", what, "SciPy's brentq", rtol=1e-8, unit="s")
    values = np.geomspace(2e-5, 1e-4, 200)
    times = np.array([decay.settled(value)[0, 0] for value in values])
    late = times > 0.2  # before, the fast modes still count
    assert np.abs(np.diff(times))[late[1:]].max() < 0.2, "no jump from one maximum to the next: a beat lasts 1.5 s"
    assert (np.abs(vibration) <= decay.envelope(0.0) * (1 + 1e-9)).all()


def in_order(poles):
    return sorted(poles[~np.isnan(poles)], key=lambda s: (round(s.imag, 6), s.real))


def test_poles_are_those_of_another_eigensolver():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4, 2))
    M = np.einsum("ikb,jkb->ijb", root, root) + 4 * np.eye(4)[..., None]
    K, D = 1e3 * M[::-1, ::-1] + 1e3 * np.eye(4)[..., None], 0.1 * M[:, ::-1] + 0.5 * M
    D[..., 1] *= 1e3  # overdamped
    for b in range(2):
        zero, one = np.zeros((4, 4)), np.eye(4)
        left = np.block([[zero, one], [-K[..., b], -D[..., b]]])
        expected = eig(left, np.block([[one, zero], [zero, M[..., b]]]), right=False)
        found = poles_of(M, D, K)[:, b]
        ours, theirs = (np.array(in_order(each)) for each in (found, expected[expected.imag >= 0]))
        for name, part in (("decay rates", np.real), ("damped frequencies", np.imag)):
            what = f"{name} of poles after the arrival"
            agrees(
                part(ours),
                part(theirs),
                "vibration",
                what,
                "SciPy's generalised eig",
                rtol=1e-8,
                atol=1e-9,
                unit="rad/s",
            )


def test_no_phases_settle_later_than_the_bound():
    rng, parts = np.random.default_rng(1), [drawn(seed) for seed in range(5)]
    each = np.stack([made(*part) for part in parts])
    whole = Superposition(TIME, ("a", "b"), np.zeros(2, bool), each[0], each[1:3], each[3:])
    bound = largest_decay(whole, 0.0, POLES)
    phases = rng.uniform(0, 2 * np.pi, (2, 200))
    settled = free_decay(TIME, 0.0, vibration_at(whole, phases), np.repeat(POLES[:, None], 200, 1)).settled(3e-5)
    assert (settled <= bound.settled(3e-5) * (1 + 1e-9)).all()
    assert (settled.max(1) > 0.7 * bound.settled(3e-5)[:, 0]).all()


@pytest.mark.slow
def test_poles_of_the_arm_are_those_of_its_damped_modes():
    """Of the room `arm`, which has the matrices from energies, in the base's axes."""
    arm, motion = lcd_arm(), stroke(lcd_arm().stroke, percent=10.0)
    posture = np.asarray(motion(motion.breaks[-1:])[0])[:, 0]
    expected = np.asarray(jax.jit(lambda arm: damped_eigenvalues(linearize(at_posture(arm, posture))))(arm))
    np.testing.assert_allclose(in_order(poles_at(arm, motion)[:, 0]), in_order(expected), rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["fast", "exact"])
def test_two_seconds_tell_what_a_long_simulation_shows(method):
    """Between two maxima of the vertical bending, which decays by 0.3 % of critical."""
    arm = lcd_arm()
    short, long = (stroke(arm.stroke, percent=10.0, dwell=dwell) for dwell in (2.0, 20.0))
    told = simulate(arm, short, method=method, rate=250.0)
    shown = simulate(arm, long, method=method, rate=250.0)
    time, size = np.asarray(shown.time), np.abs(np.asarray(shown.vibration))
    assert (size[:, time >= long.arrival].max(1) <= decay_of(told).envelope(0.0)[:, 0] * 1.001).all()
    for value in (5e-5, 3e-5):
        last = time[size[2] > value][-1]
        assert last <= settling_time(told, value)[2] < last + 0.12, "half a period of 4.8 Hz"
        np.testing.assert_allclose(settling_time(told, value)[:2], long.arrival)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_most_of_a_hundred_arms_settle_in_the_promised_time():
    """Stiffness 5 %, damping as assumed, any phases; the promise by 200 draws, the truth by 400, the slowest exact."""
    file = ident.read_arm(DATA / "lcd_arm" / "arm.toml")
    basis = basis_of(file, MotionOptions(settled=0.05)).with_unknown_damping(50)
    scheduling = scheduling_of(basis, basis.arm.stroke, segments=4, dwell=2.0)
    motion, wanted = basis.motion, Wanted(np.inf, 5e-5)

    def arms(count, seed):
        rng = np.random.default_rng(seed)
        paths = [path for path in basis.arm.paths() if path.endswith(("k_bend", "k_tors"))]
        stiff = {path: float(basis.arm.get(path)) * np.exp(0.05 * rng.normal(size=count)) for path in paths}
        return basis.unknown.draws(count, seed) | stiff

    whole = scheduling.vibration(motion)
    promise = _verified(basis, scheduling, motion, whole, arms(200, 1), wanted).ready
    fresh = arms(100, 2)
    _, times = _drawn(basis, scheduling, wanted, motion, fresh)
    assert (times <= promise).sum() >= 90  # 95 of 100 promised: fewer than 90 by chance in 1 % of seeds
    spread = np.log(fresh["joint1.tau_bend"] / float(basis.arm.get("joint1.tau_bend"))).std()
    assert spread == pytest.approx(DAMPING, rel=0.2)
    _, truth = _drawn(basis, scheduling, wanted, motion, arms(400, 3))
    assert promise <= 1.3 * np.quantile(truth, 0.95)
    for k in np.argsort(times)[-5:]:
        arm = basis.arm.replace({path: float(values[k]) for path, values in fresh.items()})
        exact = simulate(arm, motion.dwell(2.0), loads=basis.loads, method="exact", rate=250.0)
        assert settling_time(exact, 5e-5).max() == pytest.approx(times[k], rel=0.02)
