"""Shapes in the complex plane: in phase, out of phase, and their ellipses against draws."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import agrees
from known_modes import arm_like, hammer_test

from ident.modal.modes import modes_of
from ident.modal.parameters import phase_planes


@pytest.fixture(scope="module")
def modes():
    rng = np.random.default_rng(4)
    return modes_of(hammer_test(arm_like(rng, outputs=4), rng), band=(15.0, 25.0), near=(19.0,))


def test_a_shape_in_phase_lies_on_the_real_axis(modes):
    real = np.array([0.5, -2.0, 1.0, 0.1]) * np.exp(0.7j)
    plane = phase_planes(replace(modes, shape=real[:, None]))[0]
    assert plane.shape == pytest.approx(np.array([-0.25, 1.0, -0.5, -0.05]))
    assert plane.collinearity == pytest.approx(1.0)


def test_a_wave_has_no_phase_of_its_own(modes):
    wave = np.exp(0.5j * np.pi * np.arange(4))
    assert phase_planes(replace(modes, shape=wave[:, None]))[0].collinearity == pytest.approx(0.0, abs=1e-12)


def test_ellipses_are_those_of_draws(modes):
    plane = phase_planes(modes)[0]
    mean = np.concatenate([modes.shape[:, 0].real, modes.shape[:, 0].imag])
    draws = np.random.default_rng(0).multivariate_normal(mean, modes.of_shape([0]), 40_000)
    shapes = draws[:, :4] + 1j * draws[:, 4:]
    factor = plane.shape[0] / modes.shape[0, 0]
    for o in range(4):
        own = shapes[:, o] * factor
        drawn = np.cov(np.array([own.real, own.imag]))
        what, source = "ellipse of a complex shape", "covariance of 40000 draws"
        agrees(plane.covariance[o], drawn, "modal", what, source, largest=0.03)
