"""Frequency response functions of modes with residuals of what lies outside the band, and their derivatives."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

EXPONENTS = (-2, -1, 0, 2, 3, 4)
"""Powers of s in the accelerance of modes outside the band: s^2 / (s - p) in s / p for those above, in p / s below."""


@dataclass(frozen=True)
class ModalModel:
    """Accelerances of m modes and of what lies beyond the band, at s = i omega + decay.

    H(s) = s^2 sum_r [P_r / (2 i b_r (s - p_r)) + c.c.] + sum_e R_e s^e

    p = a + i b is a pole, P = shape participation' its residue as a product, which for a real mode is that of
    P / (s^2 - 2 a s + a^2 + b^2). An exponential window multiplies every impulse response by exp(-decay t), so that it
    moves s: the poles are those without a window.

    Attributes:
        pole: (m,) [rad/s] complex.
        shape: (O, m) [1/kg] complex: motion of each response, scaled so that the participation is one at a reference.
        participation: (I, m) [-] complex: motion of each reference.
        residual: (E, O, I) [s^e/kg] real, by the power of s: modes below the band move as a mass (0) and, near it, less
            so (-1, -2); those above it give way as a spring (2) and, near it, the more so (3, 4).

    References:
        Ewins, "Modal Testing", 2nd ed. 2000, sections 2.4 (complex modes), 4.4 (residuals).
    """

    pole: Complex[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    participation: Complex[np.ndarray, "I m"]
    residual: Float[np.ndarray, "E O I"]

    @property
    def reference(self) -> np.ndarray:
        """(m,) the reference at which a mode's participation is one."""
        return np.argmin(np.abs(self.participation - 1), 0)

    def normalised(self) -> "ModalModel":
        """Return the same with the participation one where it is largest."""
        largest = np.argmax(np.abs(self.participation), 0)
        size = np.take_along_axis(self.participation, largest[None], 0)[0]
        return ModalModel(self.pole, self.shape * size, self.participation / size, self.residual)

    def inside(self, frequency: Float[np.ndarray, "F"]) -> Int[np.ndarray, "k"]:
        """Return the modes within a band [Hz], ascending in frequency; others are residuals, as near its ends."""
        hertz = np.abs(self.pole) / (2 * np.pi)
        order = np.argsort(hertz)
        return order[(hertz[order] >= frequency[0]) & (hertz[order] <= frequency[-1])]

    def without(self, mode: int) -> "ModalModel":
        """Return the same without a mode."""
        shape, participation = (np.delete(x, mode, -1) for x in (self.shape, self.participation))
        return ModalModel(np.delete(self.pole, mode), shape, participation, self.residual)

    def accelerance(self, s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "O I F"]:
        """Return the frequency response functions at s."""
        own, mirror = _terms(self.pole, s)
        residue = self.shape[:, None] * self.participation[None]
        modes = residue @ own + residue.conj() @ mirror
        return modes + np.einsum("eoi,ef->oif", self.residual, powers(s))

    def vector(self) -> Float[np.ndarray, "n"]:
        """Return all real numbers, by mode: pole, shape, participation less the reference; then the residuals."""
        return np.concatenate([*map(self._mode_vector, range(len(self.pole))), self.residual.ravel()])

    def _mode_vector(self, r: int) -> np.ndarray:
        parts = self.pole[r : r + 1], self.shape[:, r], np.delete(self.participation[:, r], self.reference[r])
        return np.concatenate([x for part in parts for x in (part.real, part.imag)])

    def replace(self, vector: Float[np.ndarray, "n"]) -> "ModalModel":
        """Return the model with these numbers."""
        (outputs, modes), inputs = self.shape.shape, len(self.participation)
        table = vector[: modes * self.size].reshape(modes, self.size)
        pole = table[:, 0] + 1j * table[:, 1]
        shape = (table[:, 2 : 2 + outputs] + 1j * table[:, 2 + outputs : 2 + 2 * outputs]).T
        rest = table[:, 2 + 2 * outputs :]
        others = rest[:, : inputs - 1] + 1j * rest[:, inputs - 1 :]
        participation = np.ones((inputs, modes), complex)
        for r, reference in enumerate(self.reference):
            participation[np.arange(inputs) != reference, r] = others[r]
        residual = vector[modes * self.size :].reshape(-1, outputs, inputs)
        return ModalModel(pole, shape, participation, residual)

    @property
    def size(self) -> int:
        """Real numbers of a mode."""
        return 2 + 2 * len(self.shape) + 2 * (len(self.participation) - 1)

    def slopes(self, s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "n O I F"]:
        """Return the derivative of the accelerances by each number of the vector."""
        own, mirror = _terms(self.pole, s)
        (outputs, modes), inputs = self.shape.shape, len(self.participation)
        out = np.zeros((modes * self.size + self.residual.size, outputs, inputs, len(s)), complex)
        for r, reference in enumerate(self.reference):
            block = out[r * self.size : (r + 1) * self.size]
            self._mode_slopes(block, r, int(reference), (s, own[r], mirror[r]))
        residuals = out[modes * self.size :].reshape(-1, outputs * inputs, outputs * inputs, len(s))
        each = np.arange(outputs * inputs)
        residuals[:, each, each] = powers(s)[:, None]
        return out

    def _mode_slopes(self, block: np.ndarray, r: int, reference: int, terms: tuple[np.ndarray, ...]) -> None:
        s, own, mirror = terms
        pole, shape, part = self.pole[r], self.shape[:, r], self.participation[:, r]
        outputs, others = len(shape), np.delete(np.arange(len(part)), reference)
        residue = np.outer(shape, part)[..., None]
        by_own, by_mirror = own / (s - pole), mirror / (s - pole.conj())
        block[0] = residue * by_own + residue.conj() * by_mirror
        in_b = 1j * (residue * by_own - residue.conj() * by_mirror)
        block[1] = in_b - (residue * own + residue.conj() * mirror) / pole.imag
        each = np.arange(outputs)
        forward, back = part[:, None] * own, part.conj()[:, None] * mirror
        block[2 + each, each] = forward + back
        block[2 + outputs + each, each] = 1j * (forward - back)
        forward, back = shape[:, None] * own, shape.conj()[:, None] * mirror
        for k, i in enumerate(others):
            block[2 + 2 * outputs + k, :, i] = forward + back
            block[2 + 2 * outputs + len(others) + k, :, i] = 1j * (forward - back)


def powers(s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "E F"]:
    """Return the powers of s that residuals of modes outside the band have."""
    return s ** np.array(EXPONENTS, float)[:, None]


def _terms(pole: Complex[np.ndarray, "m"], s: Complex[np.ndarray, "F"]) -> tuple[np.ndarray, np.ndarray]:
    """Return what multiplies a residue and its conjugate (m, F)."""
    pole = pole[:, None]
    factor = s**2 / (2j * pole.imag)
    return factor / (s - pole), -factor / (s - pole.conj())
