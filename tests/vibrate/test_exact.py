"""The exact equations in time: energy, decay, order, another engine's motion, stiff arms, failure."""

from collections.abc import Iterable, Iterator
from functools import cache
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from arms import lcd_arm
from moving_engines import PinocchioMoving
from numpy.polynomial import Polynomial
from oracles import QuickMujoco, command_at, follow, table_of
from runs import about, along, apart, held, paper, short, still, swing, undamped

from ident.arm.arm import Arm
from ident.arm.modes import damped_eigenvalues
from ident.arm.multibody import multibody
from ident.errors import ConvergenceError
from ident.vibrate import exact
from ident.vibrate.linear import quasi_static_deflection
from ident.vibrate.motion import Motion

pytestmark = pytest.mark.slow

POSTURE = (20.0, -50.0, 40.0)
SAMPLES = exact.SAMPLES
FASTEST = slice(7500, 7900)
"""0.8 s from 15 s on, when pulleys turn fastest at 10 %: five of their turns, four periods of the first mode."""
QUICKEST = slice(720, 820)
"""0.2 s when they do at 100 %."""


def at_rest(arm: Arm, motion: Motion) -> np.ndarray:
    return np.array(quasi_static_deflection(arm, multibody(arm, rank=1), motion(jnp.zeros(1))[0])[:, 0])


def run(arm: Arm, motion: Motion, y: np.ndarray, yd: np.ndarray, end: float, **options: float) -> exact.Exact:
    times = np.linspace(0, end, SAMPLES + 1)
    return exact.integrate(multibody(arm, rank=1), motion, (jnp.asarray(y), jnp.asarray(yd)), times, **options)


@pytest.mark.parametrize(("percent", "span", "engine"), [(10, FASTEST, QuickMujoco), (100, QUICKEST, PinocchioMoving)])
def test_against_another_engine(percent: float, span: slice, engine: type) -> None:
    """From ident's state where the pulleys turn fastest; the whole run is in benchmarks/whole_run.py."""
    response, fast = paper(percent, "exact"), paper(percent, "fast")
    y, yd = (np.asarray(part)[:, span] for part in (response.y, response.yd))
    times = np.asarray(response.time)[span]
    start = np.concatenate([y[:, 0], yd[:, 0]])
    theirs, states = follow(engine(lcd_arm()), table_of(response.motion), start, times, 1e-7)
    peak = np.abs(np.asarray(response.vibration)).max(1)
    off = [np.abs(np.asarray(r.displacement)[:, span] - theirs).max(1) / peak for r in (response, fast)]
    # measured: 2e-8 in the whole run at 10 %
    assert (off[0] < 1e-6).all()
    assert apart(states[:9], y).max() < 1e-5
    assert (off[1] * peak < 1e-3 * peak.max()).all()
    assert percent > 10 or (off[1] < 1e-3).all()


def test_energy_is_kept() -> None:
    """Held, undamped, nothing turning: kinetic and potential energy, by Pinocchio, of a vibration of some mm."""
    arm = undamped(still(lcd_arm()))
    rest, engine = at_rest(arm, held(POSTURE)), PinocchioMoving(arm)
    command = command_at(table_of(held(POSTURE)), 0.0)
    push = 1e-3 * np.random.default_rng(1).normal(size=(2, len(rest))) * np.array([[1.0], [100.0]])
    found = run(arm, held(POSTURE), rest + push[0], push[1], 0.5, rtol=1e-9, atol=1e-12)
    states = zip(np.array(found.y).T, np.array(found.yd).T, strict=True)
    energy = np.array([engine.energy(command, y, yd) for y, yd in states]) - engine.energy(command, rest, 0 * rest)
    kinetic = energy[0] - engine.energy(command, rest + push[0], 0 * rest) + engine.energy(command, rest, 0 * rest)
    assert 0.01 * energy[0] < kinetic < 0.99 * energy[0]
    # measured: 1.1e-7
    assert np.abs(energy / energy[0] - 1).max() < 1e-6


@pytest.mark.parametrize("mode", [0, 1, 4])
def test_free_vibration_decays_as_its_mode_does(mode: int) -> None:
    """Logarithmic decrement over five periods of one damped mode, started in its complex shape.

    Its own share in what follows is measured, phi' (C x + M dx/dt) + s phi' M x, to which no other mode adds.
    """
    arm = still(lcd_arm())
    lin, rest = about(arm, held(POSTURE)), at_rest(arm, held(POSTURE))
    s, shape = nearest(lin, complex(damped_eigenvalues(lin)[mode]))
    local = in_shafts(shape)
    local *= 1e-5 / np.abs(local).max()
    found = run(arm, held(POSTURE), rest + local.real, (s * local).real, 10 * np.pi / s.imag, rtol=1e-9, atol=1e-13)
    M, C, _ = (np.asarray(part) for part in (lin.M, lin.C, lin.H))
    turned = in_shafts(np.eye(9))
    x, v = turned.T @ (np.asarray(found.y) - rest[:, None]), turned.T @ np.asarray(found.yd)
    share = np.abs(shape @ (C @ x + M @ v + s * (M @ x)))[:: SAMPLES // 5]
    decrement = np.log(share[:-1] / share[1:])
    ratio = decrement / np.sqrt(4 * np.pi**2 + decrement**2)
    np.testing.assert_allclose(ratio, -s.real / abs(s), rtol=2e-3)


def nearest(lin, eigenvalue: complex) -> tuple[complex, np.ndarray]:
    """The eigenvalue and its vector (9) of the state-space matrix, by SciPy."""
    M, C, H = (np.asarray(x) for x in (lin.M, lin.C, lin.H))
    zero, one = np.zeros_like(M), np.eye(len(M))
    values, vectors = scipy.linalg.eig(np.block([[zero, one], [-np.linalg.solve(M, H), -np.linalg.solve(M, C)]]))
    at = np.argmin(np.abs(values - eigenvalue))
    assert abs(values[at] - eigenvalue) < 1e-6 * abs(eigenvalue)
    return complex(values[at]), vectors[: len(M), at]


def in_shafts(x: np.ndarray) -> np.ndarray:
    """Flat coordinates along the shafts' axes, which are turned by the pins before them, about z."""
    turned = np.deg2rad(np.cumsum((0, *POSTURE[:2])))
    parts = [np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in turned]
    return scipy.linalg.block_diag(*parts) @ x


@cache
def nearly_true() -> exact.Exact:
    return run(lcd_arm(), swing(), *started(), 0.5, rtol=1e-13, atol=1e-16)


def started() -> tuple[np.ndarray, np.ndarray]:
    rest = at_rest(lcd_arm(), swing())
    return rest, np.zeros_like(rest)


def test_error_falls_with_the_tolerance() -> None:
    """As the tolerance of a step does, at least where stability does not hold the step down."""
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        found = run(lcd_arm(), swing(), *started(), 0.5, rtol=rtol, atol=1e-3 * rtol)
        errors.append(float(np.abs(found.y - nearly_true().y).max()))
    assert errors[0] < 1e-6
    # measured: 5e-8, 7e-10, 2e-12, 5e-14
    assert all(later < first / 10 for first, later in pairwise(errors))


def in_pieces(h: float) -> Motion:
    """A turn at constant speed, cut every h seconds."""
    whole = along(Polynomial([0.3, 0.5]), 8 * h)
    return Motion("run", np.append(whole.breaks[:-1], 5.0), whole.coefficients, 0.0)


def test_order_of_a_fixed_step() -> None:
    """Breaks at each step and a loose tolerance make the steps what we like; rates are large, so terms not linear."""
    rng, end = np.random.default_rng(3), 2e-3
    rest = at_rest(lcd_arm(), in_pieces(end))
    rates = 30 * rng.normal(size=len(rest))
    # at a tenth of these tolerances rounding errors of ten times the steps add up to more than is gained
    true = run(lcd_arm(), in_pieces(end), rest, rates, end, rtol=1e-11, atol=1e-14)
    counts, errors = (4, 5, 6, 7), []
    for count in counts:
        found = run(lcd_arm(), in_pieces(end / count), rest, rates, end, rtol=1e2, atol=1e2)
        assert found.steps == count
        errors.append(float(np.abs(found.y - true.y)[:, -1].max()))
    # measured: 9.4, more than the method's eight; the reason was not looked for
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 7.7


def stiff() -> Arm:
    """A light hand on a very stiff last joint."""
    arm = lcd_arm()
    light = {f"{part}.mass": 0.01 for part in ("bracket", "fingers")}
    firm = {f"joint3.{k}": 1e3 * arm.get(f"joint3.{k}") for k in ("k_bend", "k_tors")}
    return arm.replace(light | firm)


def test_stiff_arm_takes_the_implicit_method() -> None:
    motion = swing(0.5)
    fast = short(stiff(), motion)
    found = run(stiff(), motion, np.asarray(fast.y[:, 0]), np.zeros(9), 0.5)
    assert found.method == "Kvaerno5"
    every = slice(None, None, (fast.y.shape[1] - 1) // SAMPLES)
    vibration = np.asarray(fast.y - fast.y[:, :1])[:, every]
    largest = np.abs(vibration).max()
    assert np.abs(np.asarray(found.y) - np.asarray(fast.y)[:, every]).max() < 1e-3 * largest
    assert run(lcd_arm(), swing(), *started(), 0.5).method == "Dopri8"


def test_tolerance_that_cannot_be_met() -> None:
    """One line that names the times."""
    with pytest.raises(
        ConvergenceError, match=r"^the simulation cannot meet its tolerance from 0 to 0\.5 s; loosen .*$"
    ):
        run(lcd_arm(), swing(), *started(), 0.5, max_steps=10)


@pytest.mark.parametrize("sections", [0, 1, 2])
def test_an_interrupted_solution_says_so(sections: int) -> None:
    def stopping(numbers: Iterable[int]) -> Iterator[int]:
        yield from list(numbers)[:sections]
        raise KeyboardInterrupt

    times = np.linspace(0, 0.5, 2 * SAMPLES + 1)
    y, yd = map(jnp.asarray, started())
    solution = exact.integrate(multibody(lcd_arm(), rank=1), swing(), (y, yd), times, progress=stopping)
    assert solution.y.shape == solution.yd.shape == (9, sections * SAMPLES + 1)
    assert solution.interrupted == (None if sections == 2 else pytest.approx(0.25 * sections))
