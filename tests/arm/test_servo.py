"""What a servo that gives, or a motor that turns freely, does to the modes: the figures of docs/assumptions.md.

One motor turns wave generator 1 and, by belts, all others: its angle is a coordinate `a` along the stroke, with pins
q + direction a, rotors that turn with them, and a servo of stiffness k (N1 direction1)^2 seen from a.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from conformance import agrees
from jaxtyping import Array
from scipy.linalg import eigh

from ident.arm.arm import Arm
from ident.arm.multibody import Command, Multibody, balanced, drive_torques, multibody, residual
from ident.arm.parts import Body, Drive, Joint

pytestmark = pytest.mark.slow

Matrices = tuple[np.ndarray, np.ndarray]


def matrices(arm: Arm, direction: np.ndarray, posture: np.ndarray) -> Matrices:
    """Mass and stiffness by the bushings and, last, by the motor without a servo, about the equilibrium."""
    model = balanced(multibody(arm))
    n = model.size
    x = np.zeros(n + 1)
    for _ in range(6):
        force, stiffness, _ = linear(model, direction, posture, x)
        x[:n] -= np.linalg.solve(stiffness[:n, :n], force[:n])
    _, stiffness, mass = linear(model, direction, posture, x)
    return np.asarray(mass), np.asarray(stiffness)


@eqx.filter_jit
def linear(model: Multibody, direction: Array, posture: Array, x: Array) -> tuple[Array, Array, Array]:
    """Forces on all coordinates at rest, and their derivatives by these and by their accelerations."""
    n, still, none = model.size, jnp.zeros(len(direction)), jnp.zeros(model.size)

    def forces(x: Array, acceleration: Array) -> Array:
        command = Command(posture + direction * x[n], still, direction * acceleration[n])
        state = model, command, x[:n], none, acceleration[:n]
        return jnp.append(residual(*state), direction @ drive_torques(*state))

    return forces(x, 0 * x), *jax.jacfwd(forces, (0, 1))(x, 0 * x)


def hertz(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    squared = eigh((stiffness + stiffness.T) / 2, (mass + mass.T) / 2, eigvals_only=True)
    return np.sqrt(np.abs(squared)) / (2 * np.pi)


def held(system: Matrices) -> np.ndarray:
    mass, stiffness = system
    return hertz(mass[:-1, :-1], stiffness[:-1, :-1])


def with_servo(system: Matrices, stiffness: float) -> np.ndarray:
    """Frequencies with a servo of this stiffness, seen from the motor's coordinate."""
    mass, spring = system
    return hertz(mass, spring + np.diag([*np.zeros(len(mass) - 1), stiffness]))


def two_masses(link: float, rotor: float, spring: float, servo: float) -> np.ndarray:
    """Frequencies of a link on a spring to a rotor, and the rotor on a spring to the ground, in closed form."""
    b, c = (spring + servo) / rotor + spring / link, spring * servo / (rotor * link)
    root = np.sqrt(b * b - 4 * c)
    return np.sqrt(np.array([(b - root) / 2, (b + root) / 2])) / (2 * np.pi)


LINK, ROTOR, TORSION = 9.0, 0.001, 3.2e5


@pytest.mark.parametrize("servo", [2.0, 22.0, 500.0])
def test_one_joint_is_a_chain_of_two_masses(servo: float) -> None:
    """But for 1/N: the shaft, which is the rotor, turns with the bushing."""
    ratio = 12000.0  # so large that what turns with the shaft does not count
    rotor, bodies = ROTOR * (120 / ratio) ** 2, []
    for name, inertia in (("shaft", rotor), ("link", LINK)):
        bodies.append(Body(name, 1.0, np.zeros(3), inertia * np.eye(3)))
    joint = Joint("j", offset=np.zeros(3), k_bend=1e12, k_tors=TORSION, shaft=(bodies[0],), link=(bodies[1],))
    arm = Arm("one", (joint,), drives=(Drive("d", "j", ratio=ratio, rotor_inertia=rotor),))
    system, seen = matrices(arm, np.ones(1), np.zeros(1)), servo * 120**2
    expected = two_masses(LINK, ROTOR * 120**2, TORSION, seen)
    found, what = with_servo(system, seen)[:2], "a joint, its rotor and a servo"
    agrees(found, expected, "modal", what, "chain of two masses, closed form", rtol=2e-4, unit="Hz")
    # far below the rotor's own mode servo and joint are two springs in series, and without servo the motor drifts
    if servo == 500.0:
        series = 1 / (1 / TORSION + 1 / seen)
        np.testing.assert_allclose(expected[0], np.sqrt(series / LINK) / (2 * np.pi), rtol=2e-3)
    assert with_servo(system, 0.0)[0] < 1e-3


def planar(arm: Arm, direction: np.ndarray, alpha: float) -> Matrices:
    """The same of an arm with vertical pins that gives about them alone, body by body in the plane."""
    count, angle = len(arm.joints), 0.0
    mass, turns, speed = np.zeros((count + 1, count + 1)), np.zeros(count + 1), np.zeros((2, count + 1))

    def rotated(r: np.ndarray, by: float) -> np.ndarray:
        return np.array([np.cos(by) * r[0] - np.sin(by) * r[1], np.sin(by) * r[0] + np.cos(by) * r[1]])

    def across(r: np.ndarray) -> np.ndarray:
        return np.array([-r[1], r[0]])

    for j, (joint, drive) in enumerate(zip(arm.joints, arm.drives, strict=True)):
        speed = speed + np.outer(across(rotated(np.asarray(joint.offset)[:2], angle)), turns)
        shaft = turns + np.eye(count + 1)[j]
        link = shaft + direction[j] * np.eye(count + 1)[-1]
        for bodies, turn, by in ((joint.shaft, shaft, angle), (joint.link, link, angle + direction[j] * alpha)):
            for body in bodies:
                v = speed + np.outer(across(rotated(np.asarray(body.com)[:2], by)), turn)
                mass += float(body.mass) * v.T @ v + float(body.inertia[2, 2]) * np.outer(turn, turn)
        rotor = shaft + float(drive.ratio) * direction[j] * np.eye(count + 1)[-1]
        mass += float(drive.rotor_inertia) * (np.outer(rotor, rotor) - np.outer(shaft, shaft))
        turns, angle = link, angle + direction[j] * alpha
    return mass, np.diag([*(float(joint.k_tors) for joint in arm.joints), 0.0])


@pytest.mark.parametrize("alpha", [0.0, 1.1])
@pytest.mark.parametrize("servo", [0.0, 3e5])
def test_three_joints_are_as_a_plane_arm_computed_body_by_body(alpha: float, servo: float) -> None:
    arm = lcd_arm().replace({f"joint{j}.k_bend": 1e12 for j in (1, 2, 3)})
    direction = np.asarray(arm.stroke.direction)
    system = matrices(arm, direction, alpha * direction)
    expected = with_servo(planar(arm, direction, alpha), servo)
    found, what = with_servo(system, servo)[1:4], "three joints that one motor turns"
    agrees(found, expected[1:], "modal", what, "plane arm, body by body", rtol=1e-5, unit="Hz")
    np.testing.assert_allclose(with_servo(system, servo)[0], expected[0], rtol=1e-5, atol=2e-3)
    assert (expected[0] < 1e-3) == (servo == 0)


def test_the_rotor_alone_has_its_mode_at_24_hz_but_one_motor_that_turns_three_joints_at_8() -> None:
    """Issue 15 said near 25 Hz at 22 N m/rad: so it is for the rotor of one joint that nothing else holds."""
    arm = first_guess_arm()
    direction, ratio = np.asarray(arm.stroke.direction), float(arm.drives[0].ratio)
    rotor = float(arm.drives[1].rotor_inertia)
    at_motor = [float(joint.k_tors) / ratio**2 for joint in arm.joints]
    np.testing.assert_allclose(at_motor, [25.0, 22.5, 18.1], atol=0.05)
    assert rotor * ratio**2 == pytest.approx(14.4)
    assert np.sqrt(22 / rotor) / (2 * np.pi) == pytest.approx(23.6, abs=0.05)
    assert np.sqrt((22 + at_motor[1]) / rotor) / (2 * np.pi) == pytest.approx(33.6, abs=0.1)
    system = matrices(arm, direction, np.zeros(3))
    found = with_servo(system, 22 * ratio**2)
    np.testing.assert_allclose(found[:5], [4.09, 4.80, 8.11, 13.63, 16.70], atol=0.01)
    np.testing.assert_allclose(found[[0, 1, 3, 4]] / held(system)[:4] - 1, [-0.0063, 0, 0, 0.0653], atol=5e-4)


SHARES = {22: (-0.00277, 0.04201), 100: (-0.00050, -0.05585), 1000: (-0.00005, -0.00237)}
"""By how much a servo of this stiffness [N m/rad] at the motor moves lateral torsion 1 and 2, unfolded."""


@pytest.mark.parametrize("servo", SHARES)
def test_what_a_servo_does_to_the_shipped_arm(servo: float) -> None:
    arm = lcd_arm()
    direction, ratio = np.asarray(arm.stroke.direction), float(arm.drives[0].ratio)
    system = matrices(arm, direction, np.zeros(3))
    found, still = with_servo(system, servo * ratio**2), held(system)
    torsions = [found[np.argmin(np.abs(found - hertz))] / hertz - 1 for hertz in still[[0, 3]]]
    np.testing.assert_allclose(torsions, SHARES[servo], atol=1e-5)
    if servo == 100:
        np.testing.assert_allclose(found[3:5], [15.29, 20.12], atol=0.01)
    free = with_servo(system, 0.0)
    assert free[0] < 0.05
    np.testing.assert_allclose(free[[1, 4]] / still[[0, 3]] - 1, [0.00976, 0.03035], atol=5e-5)
