"""The modal model against other ways to it: the dynamic stiffness of a chain of masses, finite differences."""

import numpy as np
import pytest
import scipy.linalg
from conformance import agrees

from ident.modal.poles import EXPONENTS, ModalModel

S = 1j * np.linspace(20.0, 120.0, 50) + 0.5


def random_model(rng, inputs=2):
    def pair(*size):
        return rng.normal(size=size) + 1j * rng.normal(size=size)

    residual = rng.normal(size=(len(EXPONENTS), 3, inputs)) * 50.0 ** -np.array(EXPONENTS, float)[:, None, None]
    return ModalModel(np.array([-1 + 50j, -2 + 90j]), pair(3, 2), pair(inputs, 2), residual).normalised()


def test_poles_of_a_chain_with_dampers_make_its_accelerance():
    """s^2 (M s^2 + C s + K)^-1 of three masses, damped at one end: complex modes."""
    M, K = np.diag([1.0, 2.0, 1.5]), 4e3 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    C = np.diag([8.0, 0, 0]) + 2e-4 * K
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    pole, right = scipy.linalg.eig(A)
    pole, right = pole[pole.imag > 0], right[:3, pole.imag > 0]
    modal = np.array([v @ (2 * p * M + C) @ v for p, v in zip(pole, right.T, strict=True)])
    shape = right * 2j * pole.imag / modal
    model = ModalModel(pole, shape, right, np.zeros((len(EXPONENTS), 3, 3))).normalised()
    direct = np.moveaxis([s**2 * np.linalg.inv(M * s**2 + C * s + K) for s in S], 0, -1)
    what, source = "accelerance of complex modes", "s^2 (M s^2 + C s + K)^-1, NumPy"
    agrees(model.accelerance(S), direct, "modal", what, source, rtol=1e-9)


@pytest.mark.parametrize("inputs", [1, 2])
def test_slopes_are_those_of_differences(inputs):
    model = random_model(np.random.default_rng(1), inputs)
    vector, slopes = model.vector(), model.slopes(S)
    for k, step in enumerate(np.eye(len(vector)) * 1e-5):
        ahead, back = (model.replace(vector + sign * step).accelerance(S) for sign in (1, -1))
        expected, what = (ahead - back) / 2e-5, "slopes of the modal model"
        allowed = float(1e-6 * np.abs(slopes[k]).max())
        agrees(slopes[k], expected, "modal", what, "central differences", atol=allowed)


def test_a_vector_makes_the_same_model():
    model = random_model(np.random.default_rng(2))
    assert model.replace(model.vector()).accelerance(S) == pytest.approx(model.accelerance(S))
    assert np.take_along_axis(model.participation, model.reference[None], 0) == pytest.approx(np.ones((1, 2)))
