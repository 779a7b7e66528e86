"""52 random arms in motion against MuJoCo and Pinocchio; pins under transmission errors, gradients."""

from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from driven_arms import State, driven_arm, random_loads, random_state
from engines import title
from moving_engines import MovingArm, MujocoMoving, PinocchioMoving

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.mechanics import potential_gradient, unflatten
from ident.arm.multibody import (
    Command,
    Multibody,
    Turning,
    drive_torques,
    end_point,
    multibody,
    pins,
    possible_orders,
    residual,
)

ARMS_EACH = 26
JOINTS = [2, pytest.param(3, marks=pytest.mark.slow)]  # with errors of further orders, and with a joint not driven
ENGINES = (PinocchioMoving, MujocoMoving)
MOVING = {
    "inertia": "inverse dynamics of a moving arm",
    "springs": "springs and dampers of a moving arm",
    "torques": "drive torques of a moving arm",
    "mass": "mass matrix of a moving arm",
    "end point": "end point of a moving arm",
}
EIGHTH_ORDER = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def slack(of: Multibody) -> Multibody:
    """Without springs and dampers, which would hide errors of what is smaller."""
    return eqx.tree_at(lambda m: (m.stiffness, m.damping), of, replace_fn=jnp.zeros_like)


def ours(arm: Arm, loads: Loads, state: State) -> dict[str, Any]:
    of = multibody(arm, loads)
    command = Command(*state.command)
    at = (command, state.y, state.yd, state.ydd)
    return {
        "inertia": residual(slack(of), *at),
        "springs": residual(of, *at) - residual(slack(of), *at),
        "torques": drive_torques(of, *at)[np.asarray(of.driven, int)],
        "mass": jax.jacfwd(lambda ydd: residual(of, *at[:3], ydd))(state.ydd),
        "end point": end_point(of, pin_angles(of, command), unflatten(state.y)),
    }


def pin_angles(of: Multibody, command: Command) -> jax.Array:
    q = jnp.zeros(of.joints).at[np.asarray(of.driven, int)].set(command.q)
    return q + sum(A * jnp.sin(order * of.drives.ratio * q + chi) for order, A, chi in waves_of(of))


def waves_of(of: Multibody) -> Any:
    """Order, amplitudes and phases of all transmission errors."""
    return zip(of.drives.orders, of.drives.error, of.drives.error_phase, strict=True)


def theirs(engine: MovingArm, state: State) -> dict[str, np.ndarray]:
    at = (state.command, state.y, state.yd, state.ydd)
    whole = engine.residual(*at)
    springs = engine.K @ state.y + engine.C @ state.yd
    return {
        "inertia": whole - springs,
        "springs": springs,
        "torques": engine.torques(*at)[engine.pinned],
        "mass": engine.mass_matrix(*at[:2]),
        "end point": engine.points(engine.configuration(*at[:2]))[:, -1],
    }


def stacked(values: list[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *values)


def fields(state: State) -> tuple[np.ndarray, ...]:
    return state.command, state.y, state.yd, state.ydd


@cache
def cases(joints: int) -> list[tuple[Arm, Loads, State, dict[str, np.ndarray]]]:
    """Arms, loads, states, and what ident says of them, all in one program; half have errors of three orders."""
    rng = np.random.default_rng(joints)
    undriven = (joints // 2,) if joints % 3 == 0 else ()
    orders = (1, 4) if joints == 2 else ()
    arms = [driven_arm(rng, joints, undriven=undriven, orders=orders) for _ in range(ARMS_EACH)]
    loads = [random_loads(rng, arm) for arm in arms]
    states = [random_state(rng, len(arm.driven), 3 * joints) for arm in arms]

    def one(arm: Arm, load: Loads, state: tuple[Any, ...]) -> dict[str, Any]:
        return ours(arm, load, State(*state))

    parts = stacked(arms), stacked(loads), stacked([fields(state) for state in states])
    results = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(*parts))
    each = [{key: value[n] for key, value in results.items()} for n in range(ARMS_EACH)]
    return list(zip(arms, loads, states, each, strict=True))


@cache
def judged(engine: type, joints: int) -> list[tuple[dict[str, np.ndarray], dict[str, np.ndarray]]]:
    return [(mine, theirs(engine(arm, loads), state)) for arm, loads, state, mine in cases(joints)]


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("quantity", ["inertia", "springs", "torques", "mass", "end point"])
def test_moving_arm(engine: type, joints: int, quantity: str) -> None:
    # measured: 4e-15 for M and points, 4e-13 for inertia and torques, whose angles reach 1000 rad
    for mine, other in judged(engine, joints):
        agrees(mine[quantity], other[quantity], "mechanics", MOVING[quantity], title(engine), largest=1e-11)


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return np.abs(a - b).max() / np.abs(b).max()


@pytest.mark.parametrize("joints", JOINTS)
def test_mass_matrix_is_symmetric_and_positive(joints: int) -> None:
    for _, _, _, mine in cases(joints):
        M = mine["mass"]
        assert relative(M.T, M) < 1e-13
        assert np.linalg.eigvalsh((M + M.T) / 2)[0] > 0


@pytest.mark.parametrize(
    "part",
    [
        *(f".{name}" for name in ("eccentric_mass", "rotor_inertia", "height", "eccentricity")),
        *(".error", ".error_phase", ".phase", ".ratio", "_order1.amplitude", "_order1.phase", "_order4.amplitude"),
    ],
)
def test_every_part_of_a_drive_is_seen(part: str) -> None:
    """With one number of one drive of the engine's arm halved, results differ by much more than they do otherwise."""
    arm, loads, state, mine = cases(2)[0]
    changed = arm.replace({f"drive_j1{part}": arm.get(f"drive_j1{part}") / 2})
    other = theirs(PinocchioMoving(changed, loads), state)
    assert max(relative(mine[key], other[key]) for key in ("inertia", "torques")) > 1e-6


def slope(values: Any, h: float) -> Any:
    """The derivative at 0, to the eighth order."""
    return sum(w * (values(n * h) - values(-n * h)) for n, w in EIGHTH_ORDER.items()) / h


def test_kinematic_error_against_differences() -> None:
    """Angles, rates and accelerations of pins whose drives turn a few times, along a path of constant acceleration."""
    rng = np.random.default_rng(103)
    arm = driven_arm(rng, 3)
    slow = {f"{drive.name}.ratio": rng.uniform(2, 5) * rng.choice([-1, 1]) for drive in arm.drives}
    of = multibody(arm.replace(slow | {f"{drive.name}.error": 0.02 for drive in arm.drives}))
    start = random_state(rng, 3, 9).command

    def pin(t: float) -> np.ndarray:
        q = start[0] + start[1] * t + start[2] * t * t / 2
        return q + sum(A * np.sin(order * np.asarray(of.drives.ratio) * q + chi) for order, A, chi in waves_of(of))

    none = jnp.zeros(of.joints)
    turn = pins(of, Command(*(jnp.asarray(part) for part in start)), Turning(none, none, none)).pin
    np.testing.assert_allclose(turn.angle, pin(0.0), rtol=1e-14)
    what, source = "pins under transmission errors", "differences of order 8 of A sin(n N q + chi)"
    agrees(turn.rate, slope(pin, 1e-3), "mechanics", f"{what}, rate", source, rtol=1e-10, unit="rad/s")
    second = slope(lambda t: slope(lambda s: pin(t + s), 2e-3), 2e-3)
    agrees(turn.acceleration, second, "mechanics", f"{what}, acceleration", source, rtol=1e-8, unit="rad/s^2")


def test_held_arm_is_the_arm_of_the_statics() -> None:
    """At rest the residual is the potential's gradient, turned into the shafts' axes, if no mass is off its axis."""
    arm, loads, state, _ = cases(2)[0]
    balanced = arm.replace({each.amplitude: 0.0 for each in possible_orders(arm)})

    @jax.jit
    def both(arm: Arm, loads: Loads, q: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array]:
        mine = residual(multibody(arm, loads), Command(q, 0 * q, 0 * q), y, 0 * y, 0 * y)
        chain = at_posture(arm, q, loads)
        turn = jax.scipy.linalg.block_diag(*(chain.frame[:, :, n] for n in range(2)))
        return mine, turn.T @ potential_gradient(chain, unflatten(turn @ y))

    mine, gradient = both(balanced, loads, state.command[0], state.y)
    what, source = "equations of motion at rest", "gradient of the potential of the statics"
    agrees(mine, gradient, "mechanics", what, source, largest=1e-13)


@pytest.mark.slow
def test_gradients_by_every_number() -> None:
    """jit and grad of the residual are finite and, along one direction, the slope; elastic belts, phi = 0."""
    arm = lcd_arm()
    paths = arm.paths()
    values = jnp.stack([arm.get(path) for path in paths])
    rng = np.random.default_rng(5)
    size = multibody(arm, elastic_belts=True).size
    weights, (yd, ydd) = jnp.asarray(rng.normal(size=size)), jnp.asarray(rng.normal(size=(2, size)))
    command = Command(*(jnp.asarray(part) for part in rng.normal(size=(3, 3))))

    @jax.jit
    @jax.value_and_grad
    def loss(values: jax.Array) -> jax.Array:
        of = multibody(arm.replace(dict(zip(paths, values, strict=True))), elastic_belts=True)
        return weights @ residual(of, command, jnp.zeros(size), yd, ydd)

    value, gradient = loss(values)
    assert np.isfinite(value)
    assert np.isfinite(np.asarray(gradient)).all()
    direction = values * rng.normal(size=len(values))
    measured = slope(lambda h: float(loss(values + h * direction)[0]), 1e-3)
    allowed = float(1e-8 * np.abs(np.asarray(gradient * direction)).max())
    what, source = "slope of the equations by all numbers of an arm", "differences of order 8"
    agrees(gradient @ direction, measured, "mechanics", what, source, atol=allowed)
