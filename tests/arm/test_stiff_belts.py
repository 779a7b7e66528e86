"""What stiff belts tend to, in closed form: it is not what rigid ones are."""

import equinox as eqx
import jax
import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from conformance import agrees
from jaxtyping import Array
from scipy.linalg import eigh

from ident.arm.arm import Arm
from ident.arm.multibody import Command, Multibody, multibody, residual
from ident.arm.parts import Belt, Body, Drive, Joint

pytestmark = pytest.mark.slow

SHAFT, LINK, ROTOR, TORSION, RADIUS = 0.4, 9.0, 0.003, 3e4, 0.03


@eqx.filter_jit
def linear(model: Multibody, still: Array, y: Array) -> tuple[Array, Array, Array]:
    """What is out of balance where all is at rest, and its derivatives by coordinates and by accelerations."""
    command, none = Command(still, still, still), 0 * y

    def force(y: Array, a: Array) -> Array:
        return residual(model, command, y, none, a)

    return force(y, none), *jax.jacfwd(force, (0, 1))(y, none)


def matrices(arm: Arm, *, elastic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness about the equilibrium of the unfolded arm."""
    model, still = multibody(arm, elastic_belts=elastic), np.zeros(len(arm.driven))
    y = np.zeros(model.size)
    for _ in range(6):
        force, stiffness, _ = linear(model, still, y)
        y = y - np.linalg.solve(stiffness, force)
    _, stiffness, mass = linear(model, still, y)
    return np.asarray(mass), np.asarray(stiffness)


def frequencies(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    return np.sqrt(eigh((stiffness + stiffness.T) / 2, (mass + mass.T) / 2, eigvals_only=True)) / (2 * np.pi)


def one_joint(ratio: float, span: float) -> Arm:
    """A joint whose pulley a belt ties to a pulley that stands still, on a joint that hardly gives."""
    bodies = [Body(name, 1.0, np.zeros(3), inertia * np.eye(3)) for name, inertia in (("s", SHAFT), ("l", LINK))]
    ground = Joint("one", offset=np.zeros(3), k_bend=1e13, k_tors=1e13, link=(Body("b", 1.0, np.zeros(3), np.eye(3)),))
    joint = Joint(
        "two", offset=np.array([0.8, 0, 0]), k_bend=1e7, k_tors=TORSION, shaft=(bodies[0],), link=(bodies[1],)
    )
    drives = (Drive("d1", "one", ratio=ratio), Drive("d2", "two", ratio=ratio, rotor_inertia=ROTOR))
    radii = {"driver_radius": RADIUS, "driven_radius": RADIUS}
    belt = Belt("belt", "one", "two", **radii, pretension=1.0, stiffness=span)
    return Arm("pair", (ground, joint), drives=drives, belts=(belt,))


@pytest.mark.parametrize("ratio", [120.0, -80.0, 5.0])
def test_one_joint(ratio: float) -> None:
    """Shaft turns by phi, link by phi (1 - 1/N), rotor (a part of the shaft) not at all; rigid: all of them by phi."""
    stiff = frequencies(*matrices(one_joint(ratio, 1e13), elastic=True))[0]
    hertz = np.sqrt(TORSION) / (2 * np.pi)
    expected = hertz / np.sqrt(SHAFT - ROTOR + LINK * (1 - 1 / ratio) ** 2)
    what, source = "one joint on a stiff belt", "the link turns by 1 - 1/N"
    agrees(stiff, expected, "modal", what, source, rtol=1e-6, unit="Hz")
    assert abs(stiff / (hertz / np.sqrt(SHAFT + LINK)) - 1) > 0.5 / abs(ratio)


@pytest.mark.parametrize("ratio", [120.0, -80.0])
def test_torsion_that_a_hammer_test_has_measured(ratio: float) -> None:
    """1/k = (1 - 1/N)^2 / k_tors + 1 / (2 k (N r2)^2) at the link, as `docs/assumptions.md` says."""
    span = 4e5
    _, K = matrices(one_joint(ratio, span), elastic=True)
    load = np.r_[np.zeros(5), 1, 1]  # a unit torque on link two about its axis: by virtual work on phi and xi
    compliance = load @ np.linalg.solve(K, load)
    expected = (1 - 1 / ratio) ** 2 / TORSION + 1 / (2 * span * (ratio * RADIUS) ** 2)
    what, source = "torsional compliance with a belt", "(1 - 1/N)^2 / k + 1 / (2 k_b (N r)^2)"
    agrees(compliance, expected, "statics", what, source, rtol=1e-6, unit="rad/(N m)")


@pytest.mark.parametrize(
    ("arm", "shifts"),
    [(lcd_arm(), [-0.00091, 0, 0, 0.00361, 0, 0]), (first_guess_arm(), [0.00298, 0, 0, 0.00751, 0.00015, 0])],
    ids=["lcd arm", "first guess"],
)
def test_two_belts_in_a_row(arm, shifts) -> None:
    """The paper's arm, belts at the height of the bushings, where they do not hold the shafts from tilting.

    r2 N xi = r1 (N1 - 1) xi1 - r2 phi from belt to belt; gravity on the pins of the bent arm is left out, 4e-6.
    A link turns by 1 - 1/N of its bushing's turn, so by more where the ratio is negative, as that of drive 2.
    """
    arm = arm.replace({f"belt{b}.height": 0.0 for b in (1, 2)})
    rigid = matrices(arm, elastic=False)
    loose = matrices(arm.replace({f"belt{b}.pretension": 1e7 for b in (1, 2)}), elastic=True)
    stiff = arm.replace(
        {f"belt{b}.{what}": x for b in (1, 2) for what, x in (("stiffness", 4e10), ("pretension", 1e6))}
    )
    ratio2, ratio3 = (float(drive.ratio) for drive in arm.drives[1:])
    radii = float(arm.belts[1].driver_radius) / float(arm.belts[1].driven_radius)
    tied = np.vstack([np.eye(9), np.zeros((2, 9))])
    tied[9, 5] = -1 / ratio2
    tied[10] = radii * (ratio2 - 1) / ratio3 * tied[9]
    tied[10, 8] = -1 / ratio3
    limit = frequencies(tied.T @ loose[0] @ tied, rigid[1])[:6]
    found, what = frequencies(*matrices(stiff, elastic=True))[:6], "two stiff belts in a row"
    agrees(found, limit, "modal", what, "r2 N xi = r1 (N1 - 1) xi1 - r2 phi", rtol=1e-5, unit="Hz")
    np.testing.assert_allclose(limit / frequencies(*rigid)[:6] - 1, shifts, atol=1e-5)


def test_belts_above_the_bushings_hold_shafts_from_tilting() -> None:
    """By 2 k h^2 about the axis across the belt: 2880 N m/rad of joint 2's 315 699, 9.1e-3."""
    arm = lcd_arm()
    height = {f"belt{b}.height": 0.0 for b in (1, 2)}
    with_height, without = (matrices(a, elastic=True)[1] for a in (arm, arm.replace(height)))
    found, expected = (with_height - without)[4, 4], 2 * 4e5 * 0.06**2
    what = "stiffness of a belt above the bushing"
    agrees(found, expected, "mechanics", what, "2 k h^2", rtol=0.02, unit="N m/rad")
