"""Rigid directions: against MuJoCo in the coordinates that are left, and as the limit of ever stiffer springs."""

from dataclasses import replace
from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm
from conformance import agrees
from engines import MujocoArm
from scipy.linalg import block_diag, eigh
from scipy.optimize import root

from ident.arm.arm import stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, static_equilibrium
from ident.arm.modes import damped_eigenvalues, linearize, modes_about, natural_frequencies
from ident.arm.multibody import Command, multibody, residual
from ident.arm.parts import CubicSpring, Joint, Servo
from ident.errors import InputError
from ident.programs import jit
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate

TORSION_ALONE = (("j0", "k_bend"), ("j1", "k_bend"))
CASES = (TORSION_ALONE, (("j0", "k_tors"), ("j1", "k_bend")), (("j1", "k_bend"), ("j1", "k_tors")))
BY_CASE = pytest.mark.parametrize("given", [pytest.param(TORSION_ALONE, marks=pytest.mark.slow), *CASES[1:]])
"""A joint's bending is rigid in all of them."""


def rigid(arm, given):
    """The arm with these stiffnesses rigid."""

    def joint(old):
        own = {field.name: getattr(old, field.name) for field in old.__dataclass_fields__.values()}
        return Joint(**own | {field: None for name, field in given if name == old.name})

    return eqx.tree_at(lambda a: a.joints, arm, tuple(map(joint, arm.joints)))


def an_arm():
    rng = np.random.default_rng(54)
    arm = random_arm(rng, 2)
    return arm, np.asarray(posture_of(arm, rng))


@jax.jit
def shown(arm, posture):
    chain = at_posture(arm, posture)
    at = static_equilibrium(chain)
    modes = modes_about(chain, at)
    return modes, damped_eigenvalues(linearize(chain, at)), deflection(chain, at.phi)[:, -1]


def by_mujoco(arm, posture):
    """Frequencies [Hz] and deflection of the tip, from MuJoCo's mass matrix and gravity in the free coordinates."""
    engine = MujocoArm(arm, posture)
    ways, springs = [], []
    for joint, F in zip(arm.joints, engine.frames(), strict=True):
        a = F @ np.asarray(joint.axis)
        across = np.linalg.svd(a[None])[2][1:]
        own = [] if joint.k_bend is None else list(across)
        springs += [] if joint.k_bend is None else [float(joint.k_bend)] * 2
        own += [] if joint.k_tors is None else [a]
        springs += [] if joint.k_tors is None else [float(joint.k_tors)]
        ways.append(np.array(own).reshape(-1, 3).T)
    S, K, off = block_diag(*ways), np.diag(springs), 1e-9  # away from zero, where the engine's charts end

    def gradient(u):
        return S.T @ engine.gravity_gradient(S @ u + off) + K @ u

    u = root(gradient, np.zeros(S.shape[1]), tol=1e-13).x
    x = S @ u + off
    H, M = S.T @ engine.gravity_hessian(x) @ S + K, S.T @ engine.mass_matrix(x) @ S
    return np.sqrt(eigh(H, M, eigvals_only=True)) / (2 * np.pi), engine.point(x) - engine.point(0 * x + off)


@BY_CASE
def test_frequencies_and_deflection_are_those_of_mujoco_without_the_rigid_coordinates(given):
    arm, posture = an_arm()
    arm = rigid(arm, given)
    modes, s, moved = shown(arm, jnp.asarray(posture))
    frequency, tip = by_mujoco(arm, posture)
    assert len(modes.frequency) == arm.degrees_of_freedom == len(frequency)
    source = "MuJoCo without the rigid coordinates"
    what = "natural frequencies with rigid directions"
    agrees(modes.frequency, frequency, "modal", what, source, rtol=1e-7, unit="Hz")
    agrees(moved, tip, "statics", "deflection with rigid directions", source, rtol=1e-5, atol=1e-9, unit="m")
    assert (np.abs(s[len(frequency) :]) > np.abs(s[: len(frequency)]).max()).all()


@cache
def limit():
    """What a rigid arm shows with its slopes by ln of stiffnesses and posture, and one that is stiff instead."""
    arm, posture = an_arm()
    given = CASES[1]
    stiff = arm.replace({f"{joint}.{field}": 1e12 for joint, field in given})
    paths = stiffness_paths(rigid(arm, given))

    def of(arm):
        def seen(x):
            changed = arm.replace({path: arm.get(path) * jnp.exp(own) for path, own in zip(paths, x, strict=False)})
            modes, s, moved = shown(changed, posture + x[len(paths) :])
            return (jnp.concatenate([modes.frequency[:3], s[:3].real, moved]),) * 2

        slopes, values = jax.jit(jax.jacfwd(seen, has_aux=True))(jnp.zeros(len(paths) + len(posture)))
        return np.asarray(values), np.asarray(slopes)

    return of(rigid(arm, given)), of(stiff)


def test_it_is_the_limit_of_stiff_springs_and_so_are_its_slopes():
    for exact, near in zip(*limit(), strict=True):
        what, source = "rigid directions, values and slopes", "limit of stiff springs"
        agrees(exact, near, "modal", what, source, rtol=9.99e-6, atol=float(1e-6 * np.abs(exact).max()))


@BY_CASE
def test_motion_has_the_equations_of_the_elastic_coordinates(given):
    """The residual of any springs, projected: what is rigid has none, and no part of the matrices."""
    arm, posture = an_arm()
    rng = np.random.default_rng(1)
    held = multibody(rigid(arm, given))
    free = np.eye(6) - block_diag(*np.moveaxis(np.asarray(held.rigid), 2, 0))
    command = Command(*(jnp.asarray(x) for x in (posture, rng.normal(size=2), rng.normal(size=2))))
    y, yd, ydd = (jnp.asarray(free @ x) for x in 0.1 * rng.normal(size=(3, 6)))
    both = [np.asarray(jit(residual)(each, command, y, yd, ydd)) for each in (held, multibody(arm))]
    expected, least = free @ both[1], float(1e-9 * np.abs(both[1]).max())
    what, source = "equations of motion with rigid directions", "projection of the elastic ones"
    agrees(both[0], expected, "mechanics", what, source, rtol=1e-7, atol=least)


def test_a_spring_that_bends_where_nothing_gives_is_refused():
    arm = rigid(an_arm()[0], CASES[1])
    with pytest.raises(InputError, match="bent, joint: got j0 rigid in torsion, expected a stiffness there"):
        replace(arm, springs=(CubicSpring("bent", "j0", "torsion", 1.0),))


GIVEN = (("joint2", "k_bend"), ("joint3", "k_tors"))
POSTURE = jnp.array([0.3, -0.7, 0.4])


@pytest.mark.slow  # compiles a motion; equations with belts that stretch
def test_an_arm_in_motion_is_the_limit_of_a_stiff_one():
    motion = stroke(lcd_arm().stroke, percent=20.0)
    arms = rigid(lcd_arm(), GIVEN), lcd_arm().replace({".".join(path): 1e11 for path in GIVEN})
    exact, near = (np.asarray(simulate(arm, motion).vibration) for arm in arms)
    assert np.abs(exact).max() > 1e-5
    np.testing.assert_allclose(near, exact, atol=1e-3 * np.abs(exact).max())

    held, plain = (multibody(arm, elastic_belts=True) for arm in (arms[0], lcd_arm()))
    free = np.eye(held.size)
    free[:9, :9] -= block_diag(*np.moveaxis(np.asarray(held.rigid), 2, 0))
    rng = np.random.default_rng(2)
    command = Command(*(jnp.asarray(x) for x in rng.normal(size=(3, 3))))
    y, yd, ydd = (jnp.asarray(free @ x) for x in 1e-3 * rng.normal(size=(3, held.size)))
    found, whole = (np.asarray(residual(each, command, y, yd, ydd)) for each in (held, plain))
    np.testing.assert_allclose(found, free @ whole, atol=1e-9 * np.abs(whole).max())


@partial(jax.jit, static_argnums=1)
def of_servos(arm, on):
    chain = at_posture(arm, POSTURE, servo=jnp.asarray(float(on)))
    at, count = static_equilibrium(chain), 6 + on

    def total(k):
        return natural_frequencies(
            at_posture(arm.replace({"joint1.k_tors": k}), POSTURE, servo=jnp.asarray(float(on))), 5
        ).sum()

    slope = jax.grad(total)(jnp.asarray(arm.get("joint1.k_tors")))
    return modes_about(chain, at, count).frequency, damped_eigenvalues(linearize(chain, at))[:count], slope


@pytest.mark.slow  # servos: quick tests have no program for them
@pytest.mark.parametrize("on", [0, 1])
def test_with_motors_on_servos_it_is_the_limit_of_a_stiff_one(on):
    arm = replace(lcd_arm(), servos=(Servo("s", "joint2", k_servo=5.0, tau=1e-3),))
    arms = rigid(arm, GIVEN), arm.replace({".".join(path): 1e11 for path in GIVEN})
    for exact, near in zip(*(of_servos(each, on) for each in arms), strict=True):
        np.testing.assert_allclose(near, exact, rtol=1e-5)
