"""Motors that servos hold: against MuJoCo with rotors on hinges of their own, and against differences."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm
from conformance import agrees
from engines import EIGHTH_ORDER, MujocoArm, local, rates, stiffness
from scipy.linalg import eigh
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import linearize, natural_frequencies
from ident.arm.parts import Belt, Body, Drive, Joint, Servo
from ident.errors import InputError

pytestmark = pytest.mark.slow


def with_rotor(joint: Joint, rng: np.random.Generator) -> Joint:
    """The joint with a body of revolution about its axis on the shaft, which its drive turns."""
    a = np.asarray(joint.axis)
    inertia = 0.02 * np.eye(3) + 0.01 * np.outer(a, a)
    rotor = Body(f"rotor {joint.name}", 2.0, rng.uniform(0, 0.1) * a, inertia)
    return replace(joint, shaft=(*joint.shaft, rotor))


def driven_arm(rng: np.random.Generator, joints: int, *, belts: bool) -> Arm:
    """A random arm with rotors and servos: one for each of its drives, or one for all, which belts tie."""
    arm = random_arm(rng, joints, undriven=() if belts else (1,))
    if belts:
        axis = rng.normal(size=3)
        across = np.cross(axis, rng.normal(size=(joints, 3)))
        offsets = 0.5 * across / np.linalg.norm(across, axis=1)[:, None]
        axis = axis / np.linalg.norm(axis)
        arm = replace(
            arm,
            joints=tuple(
                replace(each, axis=jnp.asarray(axis), offset=jnp.asarray(offset + 0.1 * axis))
                for each, offset in zip(arm.joints, offsets, strict=True)
            ),
        )
    arm = replace(arm, joints=tuple(with_rotor(each, rng) if each.driven else each for each in arm.joints))
    drives = tuple(
        Drive(f"d{j.name}", j.name, ratio=rng.choice([-1, 1]) * rng.uniform(5, 60), rotor_inertia=0.03)
        for j in arm.driven
    )
    names = [j.name for j in arm.driven]
    ties = tuple(
        Belt(f"b{n}", one, other, driver_radius=rng.uniform(0.01, 0.1), driven_radius=rng.uniform(0.01, 0.1))
        for n, (one, other) in enumerate(pairwise(names))
    )
    where = names[joints // 2 : joints // 2 + 1] if belts else names[:-1]
    seen = [next(float(d.ratio) for d in drives if d.joint == name) for name in where]
    servos = tuple(
        Servo(f"s{name}", name, k_servo=rng.uniform(2e4, 2e5) / ratio**2, tau=rng.uniform(0, 1e-3))
        for name, ratio in zip(where, seen, strict=True)
    )
    return replace(arm, drives=drives, belts=ties if belts else (), servos=servos)


class MotorizedMujoco(MujocoArm):
    """Coordinates (phi, a): pins and rotors turn with the motors, as gears and belts tie them."""

    def __init__(self, arm: Arm, posture: np.ndarray):
        super().__init__(arm, posture)
        self.size = 3 * len(arm.joints)
        self.gears = gears(arm)  # (driven, A)
        ratio = {drive.joint: float(drive.ratio) for drive in arm.drives}
        pins = [self.model.joint(f"{joint.name} pin") for joint in arm.driven]
        self.q_pin = [int(pin.qposadr[0]) for pin in pins]
        self.at_pins = np.array([self.held[q] for q in self.q_pin])
        self.v_pin = [int(pin.dofadr[0]) for pin in pins]
        self.v_rotor = [int(self.model.joint(f"{joint.name} rotor").dofadr[0]) for joint in arm.driven]
        self.turns = np.array([ratio[joint.name] for joint in arm.driven])[:, None] * self.gears

    def _place(self, x: np.ndarray) -> None:
        phi, a = x[: self.size], x[self.size :]
        self.data.qpos[:] = self.held
        self.data.qpos[self.q_pin] = self.at_pins + self.gears @ a
        turns = Rotation.from_rotvec(local(self._frames, phi)).as_quat(scalar_first=True)
        for index, turn in zip(self.q_ball, turns, strict=True):
            self.data.qpos[index : index + 4] = turn
        mujoco.mj_forward(self.model, self.data)

    def ways(self, x: np.ndarray) -> np.ndarray:
        P = np.zeros((self.model.nv, len(x)))
        P[self.v_ball, : self.size] = rates(self._frames, x[: self.size])
        P[self.v_pin, self.size :] = self.gears
        P[self.v_rotor, self.size :] = self.turns
        return P

    def mass_matrix(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return self.ways(x).T @ M @ self.ways(x)

    def gravity_gradient(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        return self.ways(x).T @ self.data.qfrc_bias


def gears(arm: Arm) -> np.ndarray:
    """By how much each pin turns with each motor: belts pass the same length at both of their pulleys."""
    names, ratio = [joint.name for joint in arm.driven], {drive.joint: float(drive.ratio) for drive in arm.drives}
    if not arm.belts:
        return np.array([[float(name == servo.joint) for servo in arm.servos] for name in names])
    turns = [1.0]
    for belt in arm.belts:
        passed = float(belt.driver_radius) * (ratio[belt.driver] - 1) * turns[-1]
        turns.append(passed / (float(belt.driven_radius) * ratio[belt.driven]))
    return np.array(turns)[:, None] / turns[names.index(arm.servos[0].joint)]


def reference(arm: Arm, posture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness of (phi, a) at equilibrium, by MuJoCo, the bushings' springs and the servos'."""
    engine, still = MotorizedMujoco(arm, posture), MujocoArm(arm, posture)
    K, n = stiffness(arm, engine), 3 * len(arm.joints)
    found = root(lambda x: still.gravity_gradient(x) + K @ x, np.full(n, 1e-3), options={"xtol": 1e-14})
    x = np.append(found.x, np.zeros(len(arm.servos)))
    ratio = {drive.joint: float(drive.ratio) for drive in arm.drives}
    servos = [float(servo.k_servo) * ratio[servo.joint] ** 2 for servo in arm.servos]
    H = np.zeros((len(x), len(x)))
    for i, e in enumerate(np.eye(len(x))):
        steps = ((w, 0.02 * k) for k, w in EIGHTH_ORDER.items())
        H[:, i] = (
            sum(w * (engine.gravity_gradient(x + h * e) - engine.gravity_gradient(x - h * e)) for w, h in steps) / 0.02
        )
    H[:n, :n] += K
    H[range(n, len(x)), range(n, len(x))] += servos
    return engine.mass_matrix(x), H


@jax.jit
def on_and_off(arm: Arm, posture: jax.Array) -> tuple[Any, jax.Array]:
    """The equations with servos on and with brakes on, and the frequencies of both."""
    chain = at_posture(arm, posture[:, None] * jnp.ones(2), None, jnp.array([1.0, 0.0]))
    return linearize(chain), natural_frequencies(chain, 3 * len(arm.joints) + len(arm.servos))


@pytest.mark.parametrize(("joints", "belts"), [(4, False), (3, True)])
def test_random_arms_are_as_in_mujoco(joints: int, belts: bool) -> None:
    """Matrices and frequencies with servos on; with brakes on those of the engine's arm with its motors held."""
    rng = np.random.default_rng(10 * joints + belts)
    for _ in range(3):
        arm = driven_arm(rng, joints, belts=belts)
        posture = posture_of(arm, rng)
        M, H = reference(arm, np.asarray(posture))
        both, frequency = jax.tree.map(np.asarray, on_and_off(arm, posture))
        tie, source = "with belts" if belts else "without belts", "MuJoCo, rotors on hinges of their own"
        agrees(both.M[..., 0], M, "mechanics", f"mass matrix with motors, {tie}", source, rtol=1e-7, largest=1e-10)
        K, least = (H + H.T) / 2, float(1e-9 * np.abs(H).max())
        agrees(both.H[..., 0], K, "mechanics", f"stiffness matrix with servos, {tie}", source, rtol=1e-7, atol=least)
        n = 3 * joints
        for k, size in enumerate((len(M), n)):
            mu = eigh(M[:size, :size], (H + H.T)[:size, :size] / 2, eigvals_only=True)[::-1]
            expected, state = 1 / (2 * np.pi * np.sqrt(mu)), "brakes" if k else "servos"
            what = f"natural frequencies, {state} on, {tie}"
            agrees(frequency[:size, k], expected, "modal", what, source, rtol=1e-8, unit="Hz")
        assert (frequency[n:, 1] > frequency[n - 1, 1]).all()
        seen = [
            float(next(d.ratio for d in arm.drives if d.joint == s.joint)) ** 2 * float(s.k_servo) for s in arm.servos
        ]
        dampers = [float(servo.tau) * k for servo, k in zip(arm.servos, seen, strict=True)]
        np.testing.assert_allclose(np.diagonal(both.C[..., 0])[n:], dampers)
        np.testing.assert_allclose(both.C[n:, :, 1], 0)


SERVO = "servo1.k_servo"


def with_servo(arm: Arm, k: float = 22.0) -> Arm:
    return replace(arm, servos=(Servo("servo1", "joint1", k_servo=k),))


def test_frequencies_are_differentiable_in_all_that_they_depend_on() -> None:
    arm = with_servo(lcd_arm(), 60.0)
    paths = (SERVO, "drive1.ratio", "drive2.rotor_inertia", "belt1.driven_radius", "joint2.k_tors", "link2.mass")
    posture = jnp.asarray(0.4 * np.asarray(arm.stroke.direction))[:, None] * jnp.ones(2)
    present = {path: arm.get(path) for path in paths}

    def hertz(logs: jax.Array) -> jax.Array:
        changed = arm.replace({path: present[path] * jnp.exp(x) for path, x in zip(paths, logs, strict=True)})
        return natural_frequencies(at_posture(changed, posture, None, jnp.array([1.0, 0.0])), 6)

    both = jax.jit(lambda logs: (hertz(logs), jax.jacfwd(hertz)(logs)))
    slopes = np.asarray(both(jnp.zeros(len(paths)))[1])
    for i in range(len(paths)):
        step = 1e-4 * np.eye(len(paths))[i]
        expected = (np.asarray(both(step)[0]) - np.asarray(both(-step)[0])) / 2e-4
        what = "slopes of frequencies by ratio, rotor, radius, servo"
        agrees(slopes[..., i], expected, "modal", what, "central differences", rtol=1e-5, atol=1e-6)
    assert np.abs(slopes[:, 0, :4]).max(0).min() > 1e-3  # each of them matters where a servo holds
    np.testing.assert_allclose(slopes[:, 1, [0, 3]], 0, atol=1e-12)  # and not where a brake does


@pytest.mark.parametrize(
    ("servos", "words"),
    [
        ((Servo("s", "joint9", k_servo=1.0),), "joint9"),
        ((Servo("s", "joint1"),), "a value > 0"),
        ((Servo("s", "joint1", k_servo=1.0), Servo("t", "joint3", k_servo=1.0)), "a second servo of what s holds"),
    ],
)
def test_servos_that_no_arm_can_have(servos: tuple[Servo, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        replace(lcd_arm(), servos=servos)
