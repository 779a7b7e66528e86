"""Poles of frequency response functions: the poly-reference least-squares complex frequency-domain estimator."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex

from ident.modal.frf import Frf
from ident.modal.noise import Noise

SPAN = 0.8
"""Share of the unit circle that the band covers: of all of it, its ends would be neighbours."""


@dataclass(frozen=True)
class Poles:
    """Poles of one order.

    Attributes:
        order: of the polynomial.
        pole: (n,) [rad/s] complex.
        participation: (I, n) [-] complex; (O, n) motion of the responses where `transposed`.
        transposed: whether responses took the place of references.
    """

    order: int
    pole: Complex[np.ndarray, "n"]
    participation: Complex[np.ndarray, "I n"]
    transposed: bool = False

    def pick(self, which: np.ndarray) -> "Poles":
        """Return some of them."""
        return Poles(self.order, self.pole[which], self.participation[:, which], self.transposed)


class PolynomialFit:
    """H = B A^-1 with matrix polynomials in z = exp(s T), by weighted linear least squares, over orders.

    The coefficients of B are eliminated for each response; the normal equations of the highest order hold those of all
    lower ones. Transposed, responses take the place of references: the motion of many of them tells close modes apart,
    also from a single reference. The lowest coefficient of A is the unit matrix, so that poles of no mode tend to be
    unstable.

    References:
        Peeters, Van der Auweraer, Guillaume, Leuridan, "The PolyMAX frequency-domain method", Shock and Vibration 11,
        2004. Cauberghe, Guillaume, Verboven, Parloo, Vanlanduit, "The secret behind clear stabilization diagrams",
        SEM 2005.
    """

    def __init__(self, frf: Frf, noise: Noise, highest: int, transposed: bool = False):
        mean, sd = frf.mean, noise.sd.reshape(frf.mean.shape)
        if transposed:
            mean, sd = mean.swapaxes(0, 1), sd.swapaxes(0, 1)
        self.inputs, self.decay, self.transposed = mean.shape[1], frf.decay, transposed
        self.middle = np.pi * (frf.frequency[0] + frf.frequency[-1])
        self.interval = SPAN / (frf.frequency[-1] - frf.frequency[0])
        z = np.exp(1j * (2 * np.pi * frf.frequency - self.middle) * self.interval)
        weight = 1 / np.sqrt((sd**2).mean(1))
        self.blocks = [self._normal(z, w, h, highest) for w, h in zip(weight, mean, strict=True)]

    def _normal(self, z: np.ndarray, weight: np.ndarray, h: np.ndarray, highest: int) -> tuple[np.ndarray, ...]:
        """Return X'X, X'Y, Y'Y of one response, Y by power and reference."""
        X = weight * z ** np.arange(highest + 1)[:, None]
        Y = -(X[:, None] * h).reshape(-1, len(z))
        return X.conj() @ X.T, X.conj() @ Y.T, Y.conj() @ Y.T

    def poles(self, order: int) -> Poles:
        """Return the poles of an order, in the half plane of positive frequencies or not, stable or not."""
        size, inputs = order + 1, self.inputs
        total: Complex[np.ndarray, "n n"] = np.zeros((size * inputs, size * inputs), complex)
        for R, S, T in self.blocks:
            S, T = S[:size, : size * inputs], T[: size * inputs, : size * inputs]
            total += T - S.conj().T @ np.linalg.lstsq(R[:size, :size], S, rcond=None)[0]
        free, fixed = total[inputs:, inputs:], total[inputs:, :inputs]
        above = np.linalg.lstsq(free, -fixed, rcond=None)[0].reshape(order, inputs, inputs)
        z, left = _reciprocal_roots(above)
        pole = np.log(z) / self.interval + 1j * self.middle + self.decay
        return Poles(order, pole, left, self.transposed)


def _reciprocal_roots(above: Complex[np.ndarray, "order I I"]) -> tuple[np.ndarray, np.ndarray]:
    """Return roots z of det(1 + sum_k A_k z^k) and left null vectors, by the companion matrix in 1/z."""
    order, inputs, _ = above.shape
    companion = np.eye(order * inputs, k=-inputs, dtype=complex)
    companion[:inputs] = -np.concatenate(list(above.transpose(0, 2, 1)), 1)
    values, vectors = np.linalg.eig(companion)
    return 1 / values, vectors[-inputs:]
