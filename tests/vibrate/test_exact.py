"""The exact equations in time, and the fast method beside them: energy, decay, order, engines, stiff arms, failure."""

from functools import partial
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from arms import lcd_arm
from conformance import agrees
from engines import title
from moving_engines import PinocchioMoving
from oracles import QuickMujoco, command_at, follow, table_of
from runs import about, apart, held, named, paper, scaled, short, still, swing, undamped

from ident.arm.arm import Arm
from ident.arm.modes import damped_eigenvalues
from ident.arm.multibody import multibody
from ident.errors import ConvergenceError
from ident.vibrate import exact
from ident.vibrate.fast import Solution, step_for
from ident.vibrate.linear import quasi_static_deflection
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.response import peak
from ident.vibrate.simulate import fast_method, simulate

pytestmark = pytest.mark.slow

POSTURE = (20.0, -50.0, 40.0)
SAMPLES = 250
FASTEST = slice(7500, 7700)
"""0.4 s from 15 s on, when pulleys turn fastest at 10 %: two and a half of their turns, two periods of mode 1."""
QUICKEST = slice(720, 820)
"""0.2 s when they do at 100 %."""


def at_rest(arm: Arm, motion: Motion) -> np.ndarray:
    return np.array(quasi_static_deflection(arm, multibody(arm, rank=1), motion(jnp.zeros(1))[0])[:, 0])


def run(arm: Arm, motion: Motion, y: np.ndarray, yd: np.ndarray, **options: float) -> Solution:
    """To the end of the motion, from any state."""
    method = partial(fast_method, arm, motion, None, False, SAMPLES / float(motion.breaks[-1]))
    return exact.integrate(arm, motion, method, step_for(arm, motion), (y, yd), **options)


@pytest.mark.parametrize(
    ("percent", "span", "engine", "step"), [(10, FASTEST, QuickMujoco, None), (100, QUICKEST, PinocchioMoving, 2e-3)]
)
def test_against_another_engine(percent: float, span: slice, engine: type, step: float | None) -> None:
    """From ident's state where the pulleys turn fastest; the whole run is in benchmarks/whole_run.py.

    Rates between steps err by more than the rest, and the engine starts with them: at 100 % steps are short.
    """
    response, fast = paper(percent, "exact", step=step), paper(percent, "fast")
    y, yd = (np.asarray(part)[:, span] for part in (response.y, response.yd))
    times = np.asarray(response.time)[span]
    start = np.concatenate([y[:, 0], yd[:, 0]])
    theirs, states = follow(engine(lcd_arm()), table_of(response.motion), start, times, 1e-7)
    peak = np.abs(np.asarray(response.vibration)).max(1)
    exactly, fast = (np.asarray(r.displacement)[:, span] / peak[:, None] for r in (response, fast))
    theirs, source = theirs / peak[:, None], f"{title(engine)}, its own integration"
    # measured: 9e-8 at 10 %; 2.7e-7 at 100 %, 1.1e-6 from the rates of its own steps
    what = f"the paper's arm at {percent:g} %, over its peak"
    agrees(exactly, theirs, "vibration", f"{what}, exact method", source, atol=1e-6)
    assert apart(states[:9], y).max() < 1e-5
    by_its_own_steps = paper(percent, "exact").vibration  # measured: 3e-8 at 100 %
    assert apart(by_its_own_steps, response.vibration).max() < 1e-6
    assert (np.abs(fast - theirs).max(1) * peak < 1e-3 * peak.max()).all()
    if percent <= 10:
        agrees(fast, theirs, "vibration", f"{what}, fast method", source, atol=1e-3)


@pytest.mark.parametrize(
    ("percent", "elastic", "error", "worst"),
    # measured, the worst direction: 9.7e-4, 9.5e-4, 1.0e-3, 1.3e-3
    [
        (10, False, 0.0, 1e-3),
        (100, False, 0.0, 1.2e-3),
        (100, True, 0.0, 1.2e-3),
        (100, False, 30.0, 3e-3),
    ],
)
def test_agrees_with_exact(percent: float, elastic: bool, error: float, worst: float) -> None:
    """Within 0.1 % of the largest peak; in each direction, of its own peak, within `worst`."""
    fast, exact = (paper(percent, method, elastic, error) for method in ("fast", "exact"))
    off = apart(fast.vibration, exact.vibration)
    highest = np.asarray(peak(exact.vibration))
    assert (off * highest < 1e-3 * highest.max()).all()
    assert (off < worst).all()


def test_energy_is_kept() -> None:
    """Held, undamped, nothing turning: kinetic and potential energy, by Pinocchio, of a vibration of some mm."""
    arm = undamped(still(lcd_arm()))
    posture = held(POSTURE, 0.5)
    rest, engine = at_rest(arm, posture), PinocchioMoving(arm)
    command = command_at(table_of(posture), 0.0)
    push = 1e-3 * np.random.default_rng(1).normal(size=(2, len(rest))) * np.array([[1.0], [100.0]])
    found = run(arm, posture, rest + push[0], push[1])
    states = zip(np.array(found.y).T, np.array(found.yd).T, strict=True)
    energy = np.array([engine.energy(command, y, yd) for y, yd in states]) - engine.energy(command, rest, 0 * rest)
    kinetic = energy[0] - engine.energy(command, rest + push[0], 0 * rest) + engine.energy(command, rest, 0 * rest)
    assert 0.01 * energy[0] < kinetic < 0.99 * energy[0]
    # measured: 1.8e-8
    what, source = "energy of a free, undamped vibration", "Pinocchio's energy at the start"
    agrees(energy, energy[0], "vibration", what, source, rtol=2e-7, unit="J")


@pytest.mark.parametrize("mode", [0, 4])
def test_free_vibration_decays_as_its_mode_does(mode: int) -> None:
    """Logarithmic decrement over five periods of one damped mode, started in its complex shape.

    Its own share in what follows is measured, phi' (C x + M dx/dt) + s phi' M x, to which no other mode adds.
    """
    arm = still(lcd_arm())
    lin, rest = about(arm, held(POSTURE)), at_rest(arm, held(POSTURE))
    s, shape = nearest(lin, complex(damped_eigenvalues(lin)[mode]))
    local = in_shafts(shape)
    local *= 1e-5 / np.abs(local).max()
    found = run(arm, held(POSTURE, 10 * np.pi / s.imag), rest + local.real, (s * local).real, atol=1e-13)
    M, C, _ = (np.asarray(part) for part in (lin.M, lin.C, lin.H))
    turned = in_shafts(np.eye(9))
    x, v = turned.T @ (np.asarray(found.y) - rest[:, None]), turned.T @ np.asarray(found.yd)
    share = np.abs(shape @ (C @ x + M @ v + s * (M @ x)))[:: SAMPLES // 5]
    decrement = np.log(share[:-1] / share[1:])
    ratio = decrement / np.sqrt(4 * np.pi**2 + decrement**2)
    what, source = "logarithmic decrement of a mode in time", "SciPy's damped eigenvalue"
    agrees(ratio, -s.real / abs(s), "vibration", what, source, rtol=2e-3)


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


def started(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    rest = at_rest(lcd_arm(), motion)
    return rest, np.zeros_like(rest)


def test_order() -> None:
    """Halving the steps divides what the next halving changes by 2^6; all modes vibrate, up to 300 Hz."""
    motion, rng = swing(0.5), np.random.default_rng(3)
    rest, _ = started(motion)
    start = rest, 0.03 * rng.normal(size=len(rest))
    steps = 1.6e-3 / 2.0 ** np.arange(3)
    ways = [exact.solved(lcd_arm(), fast_method(lcd_arm(), motion, None, False, 2500.0, h), start).y for h in steps]
    first, second = (np.abs(one - other).max() for one, other in pairwise(ways))
    # measured: 6.00
    order = np.log2(first / second)
    agrees(order, 6, "vibration", "order of the exact method, three joints", "order of the formula", atol=0.2)


def test_error_keeps_the_tolerance() -> None:
    """What halving the last steps has changed is larger than what is left."""
    motion = swing(0.5)
    true = run(lcd_arm(), motion, *started(motion), rtol=1e-9, atol=0).y
    size = np.abs(true - true[:, :1]).max()
    for rtol in (1e-2, 1e-6):
        assert np.abs(run(lcd_arm(), motion, *started(motion), rtol=rtol, atol=0).y - true).max() < 0.1 * rtol * size


def stiff() -> Arm:
    """A light hand on a very stiff last joint."""
    arm = lcd_arm()
    light = {f"{part}.mass": 0.01 for part in ("bracket", "fingers")}
    firm = {f"joint3.{k}": 1e3 * arm.get(f"joint3.{k}") for k in ("k_bend", "k_tors")}
    return arm.replace(light | firm)


def test_stiff_arm() -> None:
    """An explicit method would need 20,000 steps a second and more."""
    motion = swing(0.5)
    fast = short(stiff(), motion)
    found = run(stiff(), motion, np.asarray(fast.y[:, 0]), np.zeros(9))
    every = slice(None, None, (fast.y.shape[1] - 1) // SAMPLES)
    vibration = np.asarray(fast.y - fast.y[:, :1])[:, every]
    assert np.abs(found.y - np.asarray(fast.y)[:, every]).max() < 1e-3 * np.abs(vibration).max()


def test_an_arm_that_vibrates_by_degrees() -> None:
    """Its mass matrix changes with it: the derivatives at rest alone would lead nowhere, however fine the steps.

    Against the explicit method of order eight that was used before (Dormand and Prince, relative tolerance 1e-7).
    """
    arm, motion = lcd_arm(), stroke(lcd_arm().stroke, percent=100.0, profile="trapezoid", dwell=0.5)
    soft = scaled(scaled(arm, "k_bend", 0.01), "k_tors", 0.01)
    found = simulate(soft, named(motion), method="exact")
    what, source = "an arm that vibrates by degrees", "Dormand and Prince, order 8, before"
    agrees(np.abs(found.y).max(), 0.2881, "vibration", what, source, atol=1e-4, unit="rad")


def test_steps_longer_than_the_intervals_are_halved_too() -> None:
    right, found = (simulate(lcd_arm(), swing(0.5), method="exact", step=step) for step in (None, 5.0))
    assert np.abs(right.y - found.y).max() < 1e-8


def test_tolerance_that_cannot_be_met() -> None:
    """One line that says how far it went."""
    with pytest.raises(ConvergenceError, match=r"^the simulation of run cannot meet its tolerance with steps of .*$"):
        run(lcd_arm(), swing(0.5), *started(swing(0.5)), rtol=0, atol=1e-17, halvings=1)
