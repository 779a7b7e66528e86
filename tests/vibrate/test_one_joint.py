"""An arm of one joint in motion: the fast method, the exact one and the sum over phases say the same; gradients, sets.

What makes a peak of its vibration, too, by the same programs: the smallest arm that shows it.

Small enough for the quick tests; the paper's arm, other engines and the rates of errors are in the slow ones.
"""

from functools import cache
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import peaks
import pytest
from conformance import agrees
from numpy.polynomial import Polynomial
from runs import along, vibration_at

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.arm.multibody import possible_orders
from ident.arm.parts import Body, Drive, Joint, Point
from ident.vibrate import exact
from ident.vibrate.response import gear_error, peak, rms
from ident.vibrate.simulate import fast_method, simulate, superposition
from ident.vibrate.source_problem import Channel, Prior, SourceProblem
from ident.vibrate.unit_response import Response, Run, unit_response

LINK = Body("link", 20.0, (0.5, 0.1, -0.1), np.diag([0.2, 1.0, 1.1]))
SHAFT = Body("shaft", 4.0, (0.0, 0.0, 0.05), np.diag([0.03, 0.03, 0.05]))
DRIVE = Drive("drive", "one", ratio=30.0, rotor_inertia=0.01, eccentric_mass=1.0, eccentricity=0.01, error=1e-4)
JOINT = Joint("one", k_bend=3e4, k_tors=1e4, tau_bend=1e-3, tau_tors=2e-3, shaft=(SHAFT,), link=(LINK,))
ARM = Arm("one joint", (JOINT,), (Point("tip", "one", (1.0, 0.0, 0.0)),), drives=(DRIVE,))
PHASES = "drive.phase", "drive.error_phase"
SWING = along(Polynomial([0, 0, 1.2, -0.8]), 1.0, (1,), (0.3,))
"""Half a turn a second at most: the imbalance passes the first frequencies."""

PATHS = ("one.k_tors", "one.k_bend", "one.tau_tors", "link.mass", "link.com.x", "drive.eccentricity")
LOSSES = "one.loss_bend", "one.loss_tors"
CHANGE = 1e-5
"""Of the central differences, as a part of each value."""


@cache
def shaken(method: str):
    return simulate(ARM.replace(dict(zip(PHASES, (0.4, 2.0), strict=True))), SWING, method=method, step=2e-3)


def test_the_fast_method_agrees_with_the_exact_equations():
    assert np.abs(shaken("exact").vibration).max() > 1e-3
    fast, exactly = (shaken(method).vibration for method in ("fast", "exact"))
    agrees(fast, exactly, "vibration", "fast method, one joint", "exact equations", largest=5e-4, unit="m")


@pytest.mark.parametrize("method", ["fast", "exact"])
def test_what_the_gear_errs_at_rest_is_no_vibration_but_a_sensor_has_it_in_its_trace(method):
    """The tip is 1 m from the axis: it moves by 1 m times the error, which is 0.1 mm at most."""
    response = shaken(method)
    (angle,), _ = response.pulley
    moved = np.linalg.norm(response.gear_error, axis=0)
    expected = 1e-4 * np.abs(np.sin(2 * np.asarray(angle) + 2.0))
    what, source = "what a gear error moves the tip by", "A sin(2 N q + chi) times 1 m"
    agrees(moved, expected, "vibration", what, source, rtol=1e-7, atol=1e-7, unit="m")
    at_rest = np.linalg.norm(response.vibration, axis=0)[0], np.linalg.norm(response.measured, axis=0)[0]
    assert at_rest == pytest.approx((0.0, moved[0]), abs=5e-6)  # the imbalance's weight is all that is left
    largest, sizes = np.asarray(gear_error(ARM, response.posture)), np.abs(response.gear_error)
    assert (sizes <= largest + 5e-7).all()  # the arm sags
    assert sizes.max() == pytest.approx(largest.max(), rel=0.01)


def test_the_exact_method_is_of_sixth_order():
    """Halving the steps divides what the next halving changes by 2^6; steps fine enough would hide wrong stages."""
    ways = [exact.solved(ARM, fast_method(ARM, SWING, None, False, 500.0, 4e-3 / 2**k)).y for k in range(3)]
    first, second = (np.abs(one - other).max() for one, other in pairwise(ways))
    order = np.log2(first / second)
    agrees(order, 6, "vibration", "order of the exact method, one joint", "order of the formula", atol=0.2)


def test_the_sum_over_phases_is_the_simulation_with_them(monkeypatch):
    """Its sets are divided between cores."""
    monkeypatch.setattr("ident.vibrate.fast.cores", lambda: 2)
    whole = superposition(ARM, SWING, PHASES, step=2e-3)
    what, source = "sum over phases, one joint", "the simulation with them"
    summed = vibration_at(whole, np.array([0.4, 2.0]))
    agrees(summed, shaken("fast").vibration, "vibration", what, source, largest=1e-4, unit="m")
    peaks = whole.peaks(np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 400)))
    assert (peaks <= whole.worst[:, None]).all()
    assert (peaks.max(1) > 0.99 * whole.worst).all()
    np.testing.assert_allclose(whole.division.sum(0), whole.worst, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [500.0, 1.0])
def test_sections_are_one_solution(rate, monkeypatch):
    """Of intervals that the exact method solves some at a time, with samples or without."""
    solve = fast_method(ARM, SWING, None, False, rate, 2e-3)
    whole = exact.solved(ARM, solve)
    monkeypatch.setattr(exact, "FEWEST", 2)
    parted = exact.solved(ARM, solve)
    for one, other in zip(whole[:5], parted[:5], strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_the_quasi_static_deflection_is_that_of_the_chain():
    response, some = shaken("fast"), slice(0, None, 50)

    @jax.jit
    def deflected(posture: jax.Array) -> jax.Array:
        chain = at_posture(ARM, posture)
        return deflection(chain, equilibrium(chain))[:, -1]

    right = np.asarray(deflected(response.posture[:, some]))
    what, source = "quasi-static deflection along a motion", "equilibrium of each posture"
    agrees(response.quasi_static[:, some], right, "vibration", what, source, largest=1e-6, unit="m")


def measures(arm: Arm) -> jax.Array:
    vibration = simulate(arm, SWING, step=2e-3).vibration
    return jnp.concatenate([peak(vibration), rms(vibration)])


def values() -> np.ndarray:
    return np.array([float(ARM.get(path)) for path in PATHS])


@cache
def around() -> np.ndarray:
    """Measures (6, 6, 4): at each path's value less and more one and two changes; by sets of shape (2, 3)."""
    found = np.zeros((6, len(PATHS), 4))
    for k, shift in enumerate((-2, -1, 1, 2)):
        table = np.tile(values(), (len(PATHS), 1))
        table[np.diag_indices(len(PATHS))] *= 1 + shift * CHANGE
        sets = table.reshape(2, 3, -1)
        arm = ARM.replace({path: sets[..., n] for n, path in enumerate(PATHS)})
        found[:, :, k] = np.asarray(measures(arm)).reshape(6, -1)
    return found


@pytest.mark.slow
def test_gradients():
    """Of peak and RMS in each direction by jit and jacfwd of the whole run, against differences of fourth order.

    The one program of the whole run gives what the several of a plain one do.
    """

    def twice(numbers: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = measures(ARM.replace(dict(zip(PATHS, numbers, strict=True))))
        return found, found

    slopes, one = jax.jit(jax.jacfwd(twice, has_aux=True))(jnp.asarray(values()))
    np.testing.assert_allclose(one, measures(ARM), rtol=1e-10)  # fused otherwise
    mine = np.asarray(slopes) * values()
    low2, low, high, high2 = np.moveaxis(around(), 2, 0)
    measured = (8 * (high - low) - (high2 - low2)) / (12 * CHANGE)
    size = np.abs(measured).max(1, keepdims=True)
    assert (size > 0).all()
    what, source = "slopes of peak and RMS by an arm's numbers", "differences of order 4"
    agrees(mine / size, measured / size, "vibration", what, source, atol=1e-5)


@pytest.mark.slow
def test_gradients_by_a_loss_factor_and_by_a_stiffness_that_has_one():
    none = {path.replace(".loss_", ".tau_"): 0.0 for path in LOSSES}
    arm, paths = ARM.replace(none | dict.fromkeys(LOSSES, 0.03)), ("one.k_tors", "one.loss_tors", "one.loss_bend")

    def logs(x: jax.Array) -> tuple[jax.Array, jax.Array]:
        values = {path: arm.get(path) * jnp.exp(own) for path, own in zip(paths, x, strict=True)}
        found = jnp.log(measures(arm.replace(values)))
        return found, found

    slopes = jax.jit(jax.jacfwd(logs, has_aux=True))
    mine = np.asarray(slopes(jnp.zeros(3))[0])
    low2, low, high, high2 = (
        np.stack([slopes(jnp.asarray(shift * step))[1] for step in np.eye(3)], 1)
        for shift in (-4e-4, -2e-4, 2e-4, 4e-4)
    )
    np.testing.assert_allclose(mine, (8 * (high - low) - (high2 - low2)) / 24e-4, atol=1e-5)
    assert (np.abs(mine).max(0) > 1e-3).all()


def test_sets_are_single_arms():
    for k, path in ((0, PATHS[0]), (5, PATHS[5])):
        alone = measures(ARM.replace({path: values()[k] * (1 + CHANGE)}))
        np.testing.assert_allclose(around()[:, k, 2], alone, rtol=1e-12, atol=1e-15)  # rounding of lengths of 1 m


STIFF = {"one.k_bend": 4.5e5, "one.k_tors": 1.5e5, "drive.ratio": 160.0}
SLOW = along(2.2 * Polynomial([0, 0, 3 / 64, -2 / 512]), 8.0, (1,), (0.3,))
"""The stiff arm's drive comes to 10.5 Hz: its imbalance and its error both pass 9.5 Hz, and neither a mode."""
LINE = 9.4


@cache
def of_units() -> Response:
    arm = ARM.replace(STIFF)
    return unit_response(arm, Run("run", SLOW, None, peaks.SENSORS), possible_orders(arm))


def with_peak(kind: str) -> SourceProblem:
    """Traces of which one cause makes most of the band about the peak, imbalance and transmission error a little."""
    rng, time, arm = np.random.default_rng(0), np.arange(0.2, 7.8, 1 / peaks.RATE), ARM.replace(STIFF)
    seen = [of_units().along(k, time) for k in range(len(peaks.SENSORS))]
    parts = {"imbalance": [own[:, 1] for own in seen], "error": [own[:, 3] for own in seen]}
    if kind == "line":
        parts["line"] = [np.cos(2 * np.pi * LINE * time + rng.uniform(-np.pi, np.pi)) for _ in seen]
    values = np.array([own[:, 0] for own in seen])
    for name, own in parts.items():
        values += np.array(own) / peaks.in_band(own) * (1.0 if name == kind else peaks.BESIDE) * 1e-4
    values += peaks.NOISE * np.abs(values).max(1, keepdims=True) * rng.standard_normal(values.shape)
    channels = tuple(Channel("yz"[k], 0, k, time, own) for k, own in enumerate(values))
    sources = tuple(possible_orders(arm))
    return SourceProblem(arm, (of_units().run,), (0,), channels, sources, Prior.of(arm, {}), 0.05)


def test_a_fixed_frequency_is_told():
    found = peaks.causes(with_peak("line"), teeth=None)
    assert found.told
    assert "not given" in found.untested["mesh"]
    assert found.causes[0].kind == "line"
    assert found.causes[0].frequency == pytest.approx(LINE, abs=0.01)
    assert found.causes[0].predicted > 0.9
    assert found.causes[0].share == pytest.approx(found.causes[0].explained, abs=0.05), "hardly anything else is there"


@pytest.mark.parametrize("kind", ["imbalance", "error"])
def test_what_turns_with_the_drive_is_told(kind):
    found = peaks.causes(with_peak(kind), teeth=None)
    assert (found.causes[0].kind, found.told) == (kind, True)
    assert found.causes[0].source == possible_orders(ARM)[kind == "error"]
