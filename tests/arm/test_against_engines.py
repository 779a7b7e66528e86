"""52 random arms against MuJoCo and Pinocchio: mass matrix, gravity, static equilibrium, natural frequencies."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import posture_of, random_arm
from conformance import agrees
from engines import Engine, MujocoArm, PinocchioArm, settled, stiffness, title
from jaxtyping import Array
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium, mass_matrix, point_rotations, potential_derivatives, unflatten
from ident.arm.modes import natural_frequencies
from ident.arm.rotations import rotation_vector
from ident.identify.conditions import Readings
from ident.identify.predict import read

ARMS_EACH = 26
JOINTS = [2, pytest.param(3, marks=pytest.mark.slow)]  # all joints driven, and one not
ENGINES = (MujocoArm, PinocchioArm)
NAMES = {"mass_matrix": "mass matrix", "gravity_gradient": "slope of gravity", "gravity_hessian": "Hessian of gravity"}
READINGS = ("deflection", "rotation", "place", "twist of a joint")


def ours(arm: Arm, posture: Array, x: Array) -> dict[str, Array]:
    """All that is compared; gravity without the springs, which would hide an error of it."""
    chain, phi = at_posture(arm, posture), unflatten(x)
    slack = eqx.tree_at(lambda c: (c.bend, c.tors), chain, replace_fn=jnp.zeros_like)
    gradient, hessian = potential_derivatives(slack, phi)
    return {
        "mass_matrix": mass_matrix(chain, phi),
        "gravity_gradient": gradient,
        "gravity_hessian": hessian,
        "deflection": deflection(chain, equilibrium(chain))[:, -1],
        "rotation": rotation_vector(point_rotations(chain, equilibrium(chain))[:, :, -1]),
        "frequency": natural_frequencies(chain, 3 * len(arm.joints)),
        "slopes": jax.jacfwd(lambda off: readings(arm, posture, off))(jnp.zeros(2 * len(arm.joints))),
    }


def readings(arm: Arm, posture: Array, off: Array) -> Array:
    """What instruments read of an arm at rest whose stiffnesses are off by so much in ln: along x, y, z how its end is
    moved, how it is turned and where it is, and each joint's twist.
    """
    stiffer = arm.replace({path: arm.get(path) * jnp.exp(x) for path, x in zip(stiffness_paths(arm), off, strict=True)})
    end, count = len(arm.points) - 1, len(arm.joints)
    kind = np.concatenate([np.repeat(range(3), 3), np.full(count, 3)])
    axes = jnp.concatenate([np.tile(np.eye(3), (1, 3)), jnp.stack([joint.axis for joint in arm.joints], 1)], 1)
    each = Readings(
        states=np.zeros(len(kind), int),
        references=np.full(len(kind), -1),
        points=np.concatenate([np.full(9, end), np.arange(count)]),
        direction=axes,
        turning=kind == 1,
        placing=kind == 2,
        twisting=kind == 3,
    )
    chain = at_posture(stiffer, posture[:, None])
    return read(chain, equilibrium(chain), each)


@cache
def cases(joints: int) -> list[tuple[Arm, np.ndarray, np.ndarray, dict[str, np.ndarray]]]:
    """Arms, postures, phi of about 0.3 rad, and what ident says of them, all in one program."""
    rng = np.random.default_rng(joints)
    undriven = (joints // 2,) if joints % 3 == 0 else ()
    arms = [random_arm(rng, joints, undriven=undriven) for _ in range(ARMS_EACH)]
    postures = jnp.stack([posture_of(arm, rng) for arm in arms])
    x = jnp.asarray(rng.normal(size=(ARMS_EACH, 3 * joints)) * 0.3)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *arms)
    results = jax.tree.map(np.asarray, jax.jit(jax.vmap(ours))(stacked, postures, x))
    each = ({key: value[i] for key, value in results.items()} for i in range(ARMS_EACH))
    return list(zip(arms, np.asarray(postures), np.asarray(x), each, strict=True))


@cache
def engines(engine: type, joints: int) -> list[Engine]:
    return [engine(arm, posture) for arm, posture, _, _ in cases(joints)]


@cache
def settle(engine: type, joints: int, index: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """An engine's static equilibrium, by MINPACK, and the stiffness that it was found with."""
    arm, other = cases(joints)[index][0], engines(engine, joints)[index]
    K = stiffness(arm, other)
    return other, K, settled(other, K)


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("quantity", NAMES)
def test_mechanics_at_any_phi(engine: type, joints: int, quantity: str) -> None:
    what = f"{NAMES[quantity]} at any elastic rotation"
    # measured: 2e-15 for M and gradient, 7e-14 for MuJoCo's Hessian by differences, 2e-15 for Pinocchio's
    for (_, _, x, mine), other in zip(cases(joints), engines(engine, joints), strict=True):
        expected = getattr(other, quantity)(x)
        agrees(mine[quantity], expected, "mechanics", what, title(engine), largest=1e-12)


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
def test_static_deflection(engine: type, joints: int) -> None:
    # measured: 2e-11, of the root-finder; most arms 1e-13
    for index, (_, _, _, mine) in enumerate(cases(joints)):
        other, _, x = settle(engine, joints, index)
        expected, source = other.point(x) - other.point(0 * x), f"{title(engine)}, settled by MINPACK"
        agrees(mine["deflection"], expected, "statics", "deflection of the end point", source, largest=1e-10, unit="m")


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
def test_static_rotation(engine: type, joints: int) -> None:
    for index, (_, _, _, mine) in enumerate(cases(joints)):
        other, _, x = settle(engine, joints, index)
        turn = Rotation.from_matrix(other.end_axes(x) @ other.end_axes(0 * x).T).as_rotvec()
        source = f"{title(engine)}, settled by MINPACK"
        agrees(mine["rotation"], turn, "statics", "rotation of the last link", source, largest=1e-10, unit="rad")


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
def test_slopes_of_readings(engine: type, joints: int) -> None:
    """By the implicit function theorem, dx/d ln k = -H^-1 (dK/d ln k) x; what is read along it by differences."""
    for index, (arm, _, _, mine) in enumerate(cases(joints)):
        other, K, x = settle(engine, joints, index)
        pins = [F @ np.asarray(joint.axis) for joint, F in zip(arm.joints, other.frames(), strict=True)]
        doubled = [stiffness(arm.replace({p: 2 * float(arm.get(p))}), other) - K for p in stiffness_paths(arm)]
        moves = np.linalg.solve(other.gravity_hessian(x) + K, -np.stack([dK @ x for dK in doubled], 1)).T
        expected = np.stack([differences(partial(seen, other, pins), x, move) for move in moves], 1)
        kinds = dict(zip(READINGS, np.split(np.arange(len(expected)), [3, 6, 9]), strict=True))
        for kind, own in kinds.items():
            what, source = f"{kind}: slopes by ln stiffness", f"{title(engine)}, implicit function theorem"
            agrees(mine["slopes"][own], expected[own], "statics", what, source, largest=1e-8)


def seen(other: Engine, pins: list[np.ndarray], x: np.ndarray) -> np.ndarray:
    """What `readings` reads, by an engine."""
    still = np.zeros_like(x)
    turn = Rotation.from_matrix(other.end_axes(x) @ other.end_axes(still).T).as_rotvec()
    twists = [phi @ pin for phi, pin in zip(x.reshape(-1, 3), pins, strict=True)]
    return np.concatenate([other.point(x) - other.point(still), turn, other.point(x), twists])


def differences(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Central differences of the sixth order along a move."""
    h = 0.03 / np.abs(move).max()
    once = [(f(x + n * h * move) - f(x - n * h * move)) / (2 * n * h) for n in (1, 2, 3)]
    return 1.5 * once[0] - 0.6 * once[1] + 0.1 * once[2]


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("engine", ENGINES)
def test_natural_frequencies(engine: type, joints: int) -> None:
    """The reference solves M v = mu H v, mu = 1/lambda, which is exact to rounding for the lowest frequencies.

    Solved as H v = lambda M v, LAPACK's error is rounding times the highest eigenvalue: useless for the lowest.
    Either way round the far end of the spectrum is less exact, hence every mode is held to 1e-8 only.
    """
    # measured: 2e-15 for the lowest three, 2e-13 for all
    for index, (_, _, _, mine) in enumerate(cases(joints)):
        other, K, x = settle(engine, joints, index)
        H = other.gravity_hessian(x) + K
        mu = eigh(other.mass_matrix(x), (H + H.T) / 2, eigvals_only=True)[::-1]
        expected, source = 1 / (2 * np.pi * np.sqrt(mu)), f"{title(engine)}, modes by LAPACK"
        for which, count, rtol in (("the lowest three", 3, 1e-11), ("all", len(expected), 1e-8)):
            what = f"natural frequencies, {which}"
            agrees(mine["frequency"][:count], expected[:count], "modal", what, source, rtol=rtol, unit="Hz")
