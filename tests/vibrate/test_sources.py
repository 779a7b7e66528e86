"""What sensors see of a moving arm as a sum over sources, against the simulation of the arm with these sources.

The quick tests find the sources of simulated traces: `tests/studies/test_source.py`.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from ident.arm.multibody import at_rest, bushing_rotations, deviations, pins, possible_orders
from ident.arm.parts import Point
from ident.errors import InputError
from ident.vibrate.motion import command, stroke
from ident.vibrate.simulate import simulate
from ident.vibrate.source_problem import Channel, slow_columns, taken_out, whitening_filter
from ident.vibrate.unit_response import Run, Sensor, changed_responses, excited_by, unit_response

TIME = np.arange(3.5, 6.5, 0.01)
SENSORS = (
    Sensor("tip", (0.0, 1.0, 0.0)),
    Sensor("tip", (0.0, 0.6, 0.8), derivative=1),
    Sensor("elbow", (1.0, 0.0, 0.0), body=True, derivative=2),
)
PARTS = np.array([[8.0, 1.0], [0.4, -0.3], [6.0, -5.0], [0.0, 1.0], [-1.0, 2.0], [0.7, 0.7]])


@pytest.fixture(scope="module")
def arm():
    arm = lcd_arm()
    return eqx.tree_at(lambda a: a.points, arm, (Point("elbow", "joint2", (0.9, 0.1, 0.0)), *arm.points))


@pytest.fixture(scope="module")
def run(arm):
    return Run("run", stroke(arm.stroke, percent=30.0), None, SENSORS)


@pytest.fixture(scope="module")
def response(arm, run):
    return unit_response(arm, run, possible_orders(arm))


@pytest.mark.slow
def test_their_sum_is_what_a_simulation_gives(arm, run, response):
    sources = possible_orders(arm)
    whole = simulate(arm.replace(excited_by(sources, PARTS)), run.motion, rate=250.0)
    moved = make_interp_spline(whole.time, np.asarray(whole.measured).T, k=5)
    weights = np.append(1.0, PARTS.ravel())
    for number, expected in ((0, moved(TIME)[:, 1]), (1, moved(TIME, nu=1) @ [0.0, 0.6, 0.8])):
        seen = response.along(number, TIME) @ weights
        assert np.abs(seen - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.slow
def test_an_accelerometer_on_a_link_turns_with_it_and_feels_the_motion_itself(arm, run):
    """The rigid arm's acceleration at a link's point: centripetal and tangential, in the link's own axes."""
    q, qd, qdd = (np.asarray(part) for part in run.motion(TIME))
    first, both = q[0], q[0] + q[1]
    first_rate, both_rate = qd[0], qd[0] + qd[1]
    first_turn, both_turn = qdd[0], qdd[0] + qdd[1]

    def acceleration(angle, rate, turn, x, y):
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        r, turned = x * along + y * across, x * across - y * along
        return turn * turned - rate**2 * r

    total = acceleration(first, first_rate, first_turn, 1.0, 0.0)
    total = total + acceleration(both, both_rate, both_turn, 0.9, 0.1)
    expected = total[0] * np.cos(both) + total[1] * np.sin(both)
    weightless = eqx.tree_at(lambda a: a.gravity, arm, jnp.zeros(3))
    rigid = unit_response(weightless, run, possible_orders(arm)).along(2, TIME)[:, 0]
    assert np.abs(rigid - expected).max() < 0.05 * np.abs(expected).max()  # the arm's elasticity adds the rest


@pytest.mark.slow
def test_an_accelerometer_feels_gravity_in_axes_that_turn_and_tilt(arm, run):
    """Of an oblique arm, by finite rotations of its links: what is left is a tenth of what the arm's tilt adds."""
    arm = eqx.tree_at(lambda a: a.gravity, arm, jnp.array([6.0, -3.0, -7.0]))
    sources, weights = possible_orders(arm), np.append(1.0, PARTS.ravel())
    whole = simulate(arm.replace(excited_by(sources, PARTS)), run.motion, rate=250.0)
    model, time, y = whole.model, np.asarray(whole.time), jnp.asarray(whole.y)
    angles = np.array(pins(model, command(model, run.motion, time), at_rest(deviations(model, y))).pin.angle)
    phi, turned, place = np.array(bushing_rotations(model, y)), Rotation.identity(len(time)), np.zeros((len(time), 3))
    for j in range(2):
        place += turned.apply(np.asarray(model.offset)[:, j].ravel())
        turned = turned * Rotation.from_rotvec(phi[:, j].T) * Rotation.from_rotvec(angles[j][:, None] * [0.0, 0.0, 1.0])
    place += turned.apply([0.9, 0.1, 0.0])
    felt = make_interp_spline(time, place, k=5)(time, nu=2) - np.asarray(arm.gravity)
    expected = (felt * turned.apply([1.0, 0.0, 0.0])).sum(1)
    response = unit_response(arm, run, sources)
    off = expected - response.along(2, time) @ weights
    tilt = expected - (felt * response.directions[2].T).sum(1)
    assert np.ptp(off[500:-500]) < 0.1 * np.ptp(tilt[500:-500])
    rate = np.gradient(response.along(2, TIME)[:, 0], TIME)[1:-1]
    assert np.abs(response.rate(2, TIME)[1:-1, 0] - rate).max() < 0.02 * np.abs(rate).max()


@pytest.mark.slow
def test_changed_numbers_are_those_of_the_changed_arm(arm, run):
    """But for what is of second order in the eccentricity, the inertia of the eccentric mass."""
    sources, name = possible_orders(arm), "joint1.k_tors"
    numbers = [{}, {name: 1.05 * float(arm.get(name))}]
    members = changed_responses(arm, run, sources, PARTS, numbers).along(0, TIME)
    for number, own in zip(numbers, members.T, strict=True):
        alone = unit_response(arm.replace(number), run, sources).along(0, TIME) @ np.append(1.0, PARTS.ravel())
        np.testing.assert_allclose(own, alone, atol=5e-4 * np.abs(alone).max(), rtol=0)


def test_a_point_that_the_arm_does_not_have_is_refused(arm, run):
    other = Run("run", run.motion, None, (Sensor("hand", (0.0, 0.0, 1.0)),))
    with pytest.raises(InputError, match="hand"):
        unit_response(arm, other, possible_orders(arm))


def test_noise_beside_what_was_taken_out_is_not_too_small() -> None:
    """White noise without its slow part, and without what a fit of 40 waves at 2 to 4 Hz takes, has its own density at
    0.5 to 5 Hz in its model; by the lag sums of what is left alone it would miss a fifth."""
    size, lags, sd = 6000, 20, 1.5
    time = np.arange(size) / 200
    slow = slow_columns(Channel("", 0, 0, time, np.zeros(size)))
    waves = np.linalg.qr(
        np.column_stack([f(np.outer(time, 2 * np.pi * np.linspace(2, 4, 20))) for f in (np.sin, np.cos)])
    )[0]
    waves -= slow @ (slow.T @ waves)
    covariance = sd**2 * np.linalg.inv(waves.T @ waves)
    turn = np.exp(-2j * np.pi * np.outer(np.linspace(0.5, 5, 10), np.arange(lags + 1)) / 200)
    rng, density = np.random.default_rng(2), []
    for _ in range(40):
        noise = sd * rng.standard_normal(size)
        left = noise - slow @ (slow.T @ noise)
        left -= waves @ np.linalg.lstsq(waves, left)[0]
        missing = taken_out(left, slow, waves, covariance, lags)
        density.append([np.mean(np.abs(turn @ whitening_filter(left, lags, m)) ** -2) for m in (missing, 0.0)])
    whole, alone = np.mean(density, 0) / sd**2
    assert abs(whole - 1) < 0.02
    assert alone < 0.85
