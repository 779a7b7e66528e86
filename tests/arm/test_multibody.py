"""104 random arms in motion against MuJoCo and Pinocchio; energy, power, gradients."""

from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from driven_arms import State, driven_arm, random_loads, random_state
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
JOINTS = [pytest.param(n, marks=[] if n == 2 else pytest.mark.slow) for n in (1, 2, 3, 7)]
ENGINES = (PinocchioMoving, MujocoMoving)
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
    orders = (1, 4) if joints in (2, 7) else ()
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
    errors = [relative(mine[quantity], other[quantity]) for mine, other in judged(engine, joints)]
    # measured: 4e-15 for M and points, 4e-13 for inertia and torques, whose angles reach 1000 rad
    assert max(errors) < 1e-11


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


@cache
def table(joints: int = 4) -> tuple[PinocchioMoving, Multibody, State]:
    """An arm with drives of few turns, for differences in time."""
    rng = np.random.default_rng(100 + joints)
    arm = driven_arm(rng, joints)
    slow = {f"{drive.name}.ratio": rng.uniform(2, 5) * rng.choice([-1, 1]) for drive in arm.drives}
    strong = {f"{drive.name}.error": 0.02 for drive in arm.drives}
    arm, loads = arm.replace(slow | strong), random_loads(rng, arm)
    return PinocchioMoving(arm, loads), multibody(arm, loads), random_state(rng, joints, 3 * joints)


def at_time(start: State, t: float, held: bool) -> State:
    """A path of constant accelerations, q of every pin held or not."""
    q, qd, qdd = start.command * np.array([[1.0], [not held], [not held]])
    command = np.stack([q + qd * t + qdd * t * t / 2, qd + qdd * t, qdd])
    y, yd, ydd = start.y, start.yd, start.ydd
    return State(command, y + yd * t + ydd * t * t / 2, yd + ydd * t, ydd)


def slope(values: Any, h: float) -> Any:
    """The derivative at 0, to the eighth order."""
    return sum(w * (values(n * h) - values(-n * h)) for n, w in EIGHTH_ORDER.items()) / h


def power(of: Multibody, start: State) -> tuple[float, float]:
    """What the residual does on the path's rates, and the drives on the pins' at t = 0."""

    @eqx.filter_jit
    def powers(of: Multibody, command: jax.Array, *at: jax.Array) -> tuple[jax.Array, jax.Array]:
        parts = Command(*command)
        return residual(of, parts, *at) @ at[1], drive_torques(of, parts, *at) @ parts.qd

    on_path, on_pins = powers(of, *(jnp.asarray(part) for part in fields(start)))
    return float(on_path), float(on_pins)


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("joints", [1, 2, 4, 6])
def test_power_balance(joints: int, held: bool) -> None:
    """Along any path, d/dt (T + V) + dissipation = residual' dy/dt + torques' dq/dt; the energies are Pinocchio's."""
    engine, of, start = table(joints)

    def energy(t: float) -> float:
        state = at_time(start, t, held)
        return engine.energy(state.command, state.y, state.yd)

    now = at_time(start, 0.0, held)
    on_path, on_pins = power(of, now)
    dissipated = now.yd @ engine.C @ now.yd
    change = slope(energy, 2e-3)
    size = abs(change) + abs(on_path) + abs(on_pins) + abs(dissipated)
    assert held or abs(on_pins) > 1e-4 * size
    assert not held or on_pins == 0
    # measured: 5e-11, of the difference
    assert abs(change + dissipated - on_path - on_pins) < 1e-9 * size


@pytest.mark.slow
@pytest.mark.parametrize("joints", [1, 2, 4])
def test_free_vibration_of_the_held_arm_dissipates(joints: int) -> None:
    """With the residual at zero, d/dt (T + V) = -yd' C yd: by jvp along the flow of the equations of motion."""
    engine, of, start = table(joints)
    now = at_time(start, 0.0, held=True)
    command = Command(*(jnp.asarray(part) for part in now.command))

    def kinetic(y: jax.Array, yd: jax.Array) -> jax.Array:
        M = jax.jacfwd(lambda a: residual(of, command, y, 0 * yd, a))(0 * y)
        return yd @ M @ yd / 2

    def potential(y: jax.Array) -> jax.Array:
        return residual(of, command, y, 0 * y, 0 * y)

    @jax.jit
    def changes(y: jax.Array, yd: jax.Array) -> tuple[jax.Array, jax.Array]:
        mass, rest = jax.jacfwd(lambda a: residual(of, command, y, yd, a))(y), residual(of, command, y, yd, 0 * y)
        ydd = -jnp.linalg.solve(mass, rest)
        return jax.jvp(kinetic, (y, yd), (yd, ydd))[1], potential(y) @ yd

    of_kinetic, of_potential = map(float, changes(jnp.asarray(now.y), jnp.asarray(now.yd)))
    dissipated = now.yd @ engine.C @ now.yd
    size = dissipated + abs(of_potential)
    assert abs(of_kinetic + of_potential + dissipated) < 1e-12 * size


@pytest.mark.slow
@pytest.mark.parametrize("joints", [1, 3])
def test_kinematic_error_against_differences(joints: int) -> None:
    """Rates of the pin, seen as the work of the drives, and the pin's angle itself, seen in the points."""
    _, of, start = table(joints)

    def pin(t: float) -> np.ndarray:
        q = at_time(start, t, held=False).command[0]
        return q + sum(A * np.sin(order * np.asarray(of.drives.ratio) * q + chi) for order, A, chi in waves_of(of))

    none = jnp.zeros(of.joints)
    command = Command(*(jnp.asarray(part) for part in start.command))
    turn = pins(of, command, Turning(none, none, none)).pin
    np.testing.assert_allclose(turn.angle, pin(0.0), rtol=1e-14)
    np.testing.assert_allclose(turn.rate, slope(pin, 1e-3), rtol=1e-10)
    np.testing.assert_allclose(turn.acceleration, slope(lambda t: slope(lambda s: pin(t + s), 2e-3), 2e-3), rtol=1e-8)


@pytest.mark.parametrize("joints", JOINTS)
def test_held_arm_is_the_arm_of_the_statics(joints: int) -> None:
    """At rest the residual is the potential's gradient, turned into the shafts' axes, if no mass is off its axis."""
    arm, loads, state, _ = cases(joints)[0]
    balanced = arm.replace({each.amplitude: 0.0 for each in possible_orders(arm)})

    @jax.jit
    def both(arm: Arm, loads: Loads, q: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array]:
        mine = residual(multibody(arm, loads), Command(q, 0 * q, 0 * q), y, 0 * y, 0 * y)
        chain = at_posture(arm, q, loads)
        turn = jax.scipy.linalg.block_diag(*(chain.frame[:, :, n] for n in range(joints)))
        return mine, turn.T @ potential_gradient(chain, unflatten(turn @ y))

    mine, gradient = both(balanced, loads, state.command[0], state.y)
    assert relative(np.asarray(mine), np.asarray(gradient)) < 1e-13


@pytest.mark.slow
def test_gradients_by_every_number() -> None:
    """jit and grad of the residual are finite and, along one direction, the slope; rigid and elastic belts, phi = 0."""
    arm = lcd_arm()
    paths = arm.paths()
    values = jnp.stack([arm.get(path) for path in paths])
    rng = np.random.default_rng(5)
    for elastic in (False, True):
        size = multibody(arm, elastic_belts=elastic).size
        weights, (yd, ydd) = jnp.asarray(rng.normal(size=size)), jnp.asarray(rng.normal(size=(2, size)))
        command = Command(*(jnp.asarray(part) for part in rng.normal(size=(3, 3))))

        @jax.jit
        @jax.value_and_grad
        def loss(
            values: jax.Array,
            elastic: bool = elastic,
            weights: jax.Array = weights,
            at: tuple[Any, ...] = (command, jnp.zeros(size), yd, ydd),
        ) -> jax.Array:
            of = multibody(arm.replace(dict(zip(paths, values, strict=True))), elastic_belts=elastic)
            return weights @ residual(of, *at)

        value, gradient = loss(values)
        assert np.isfinite(value)
        assert np.isfinite(np.asarray(gradient)).all()
        direction = values * rng.normal(size=len(values))
        measured = slope(lambda h, loss=loss, d=direction: float(loss(values + h * d)[0]), 1e-3)
        assert abs(gradient @ direction - measured) < 1e-8 * np.abs(np.asarray(gradient * direction)).max()
