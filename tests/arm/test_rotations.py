"""Rotations: against SciPy, against differences, and smooth at zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conformance import agrees
from scipy.spatial.transform import Rotation

from ident.arm.rotations import (
    axial,
    curvature,
    inertia_from_second_moment,
    left_jacobian,
    matmul,
    matvec,
    outer,
    rotation,
    rotation_vector,
    skew,
    transpose,
    turn_about,
)

ANGLES = (0.0, 1e-9, 1e-4, 0.1, 0.22, 0.23, 1.0, 2.0, 3.0)
EPS = 2.2e-16


def rotation_vectors() -> np.ndarray:
    """(3, n): every angle about several axes."""
    axes = np.random.default_rng(0).normal(size=(6, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.concatenate([angle * axes for angle in ANGLES]).T


def test_rotation_agrees_with_scipy() -> None:
    phi = rotation_vectors()
    expected = np.moveaxis(Rotation.from_rotvec(phi.T).as_matrix(), 0, -1)
    found = rotation(jnp.asarray(phi))
    agrees(found, expected, "mechanics", "rotation matrix of a rotation vector", "SciPy's Rotation", atol=20 * EPS)


@pytest.mark.parametrize("angle", [-7.0, -1.0, 0.0, 3.1, 12.0])
def test_turn_about_a_unit_axis_of_any_angle(angle: float) -> None:
    axis = np.array([2.0, -3.0, 6.0]) / 7
    expected = Rotation.from_rotvec(angle * axis).as_matrix()
    found = turn_about(jnp.asarray(axis), jnp.asarray(angle))
    agrees(found, expected, "mechanics", "rotation about a unit axis", "SciPy's Rotation", atol=20 * EPS)


def test_left_jacobian_gives_the_angular_velocity() -> None:
    """(dR/dt) R' = [J dphi/dt], the left side by central differences of SciPy's rotation; their error is 1e-10."""
    rng, h, jacobian = np.random.default_rng(1), 1e-5, jax.jit(left_jacobian)
    for phi in rotation_vectors().T:
        rate = rng.normal(size=3)
        ahead, behind = (Rotation.from_rotvec(phi + s * h * rate).as_matrix() for s in (1, -1))
        spun = (ahead - behind) / (2 * h) @ Rotation.from_rotvec(phi).as_matrix().T
        omega = jnp.asarray(np.asarray(jacobian(phi)) @ rate)
        what, source = "angular velocity by the left Jacobian", "differences of SciPy's Rotation"
        agrees(skew(omega), spun, "mechanics", what, source, atol=1e-9, unit="rad/s")


def test_right_jacobian_is_the_transpose() -> None:
    phi = jnp.asarray(rotation_vectors())
    J = left_jacobian(phi)
    assert jnp.abs(matmul(transpose(rotation(phi)), J) - transpose(J)).max() < 20 * EPS


def test_curvature_is_the_symmetric_slope_of_the_jacobian() -> None:
    rng = np.random.default_rng(2)
    both = jax.jit(lambda p, m: (curvature(p, m), jax.jacfwd(lambda q: left_jacobian(q).T @ m)(p)))
    for phi in rotation_vectors().T:
        found, slope = map(np.asarray, both(phi, rng.normal(size=3)))
        expected, what = (slope + slope.T) / 2, "curvature of a rotation"
        agrees(found, expected, "mechanics", what, "derivative of the Jacobian", atol=20 * EPS)


def test_derivatives_at_zero_are_those_of_the_series() -> None:
    """exp[phi] = 1 + [phi] + [phi]^2/2 + ..., J = 1 + [phi]/2 + [phi]^2/6 + ...: first and second derivatives."""
    zero = jnp.zeros(3)
    generators = np.stack([np.asarray(skew(jnp.asarray(e))) for e in np.eye(3)], -1)
    products = np.einsum("ika,kjb->ijab", generators, generators)
    squares = products + np.swapaxes(products, 2, 3)
    for function, first, second in ((rotation, 1.0, 1 / 2), (left_jacobian, 1 / 2, 1 / 6)):
        for derivative, expected in (
            (jax.jacfwd(function), first * generators),
            (jax.jacrev(function), first * generators),
            (jax.hessian(function), second * squares),
        ):
            found, what = jax.jit(derivative)(zero), "derivatives of rotations at zero"
            agrees(found, expected, "mechanics", what, "power series of exp", atol=EPS)


@pytest.mark.parametrize("function", [rotation, left_jacobian])
@pytest.mark.parametrize("angle", [1e-6, 0.2235, 0.2237, 1.5, 2.9])
def test_second_derivatives_are_smooth(function: object, angle: float) -> None:
    """Against differences of the first derivative (cut-off 1e-10); 0.2236 = sqrt(0.05) once switched formulas."""
    phi = angle * jnp.array([2.0, -3.0, 6.0]) / 7
    first = jax.jit(jax.jacrev(function))
    second, h = jax.jit(jax.jacfwd(jax.jacrev(function)))(phi), 1e-5
    for a, e in enumerate(np.eye(3)):
        ahead, behind = (first(phi + s * h * e) for s in (1, -1))
        expected, what = (ahead - behind) / (2 * h), "second derivatives of rotations"
        agrees(second[..., a], expected, "mechanics", what, "central differences of the first", atol=1e-9)


def test_dyad_rules() -> None:
    """axial gives a x b; spin the map w -> b x (w x a)."""
    a, b, w = jnp.asarray(np.random.default_rng(3).normal(size=(3, 3)))
    assert jnp.abs(axial(outer(a, b)) - jnp.cross(a, b)).max() < 10 * EPS
    assert jnp.abs(matvec(inertia_from_second_moment(outer(a, b)), w) - jnp.cross(b, jnp.cross(w, a))).max() < 20 * EPS


def test_batch_is_last() -> None:
    phi = jnp.asarray(np.random.default_rng(4).normal(size=(3, 4, 5)) * 0.5)
    assert rotation(phi).shape == (3, 3, 4, 5)
    assert jnp.abs(rotation(phi)[..., 2, 3] - rotation(phi[:, 2, 3])).max() < EPS


@pytest.mark.parametrize("angle", [*ANGLES, 1.9e-3, 2.1e-3])
def test_a_rotation_vector_is_found_again_and_so_is_its_slope(angle):
    phi = jnp.asarray(angle * np.array([0.48, -0.6, 0.64]))
    found, slope = jax.jit(
        lambda p: (rotation_vector(rotation(p)), jax.jacfwd(lambda q: rotation_vector(rotation(q)))(p))
    )(phi)
    scipys = Rotation.from_matrix(np.asarray(rotation(phi))).as_rotvec()
    np.testing.assert_allclose(found, phi, rtol=1e-13, atol=1e-15)
    what = "rotation vector of a rotation matrix"
    agrees(found, scipys, "mechanics", what, "SciPy's Rotation", rtol=1e-13, atol=1e-15, unit="rad")
    np.testing.assert_allclose(slope, np.eye(3), atol=1e-12)
