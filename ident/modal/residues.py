"""Shapes of given poles, by linear least squares, with residuals of what lies outside the band."""

import numpy as np
from jaxtyping import Complex, Float

from ident.modal.frf import Frf
from ident.modal.modal_model import ModalModel, powers
from ident.modal.noise import Noise
from ident.modal.polynomial import Poles


def model_of(frf: Frf, noise: Noise, poles: Poles) -> ModalModel:
    """Fit shapes and residuals to the averaged functions, for known poles and participations.

    Of poles with the motion of the responses known (`poles.transposed`), the participations are fitted instead.

    References:
        Guillaume, Verboven, Vanlanduit, "Frequency-domain maximum likelihood identification of modal parameters with
        confidence intervals", ISMA 1998 (LSFD).
    """
    mean, sd = frf.mean, noise.sd.reshape(frf.mean.shape)
    if poles.transposed:
        mean, sd = mean.swapaxes(0, 1), sd.swapaxes(0, 1)
    s = 2j * np.pi * frf.frequency + frf.decay
    fitted, residual = _least_squares(mean, 1 / np.sqrt((sd**2).mean((0, 1))), s, poles)
    if poles.transposed:
        return ModalModel(poles.pole, poles.participation, fitted, residual.swapaxes(1, 2)).normalised()
    return ModalModel(poles.pole, fitted, poles.participation, residual).normalised()


def _least_squares(
    mean: Complex[np.ndarray, "A B F"], weight: Float[np.ndarray, "F"], s: Complex[np.ndarray, "F"], poles: Poles
) -> tuple[np.ndarray, np.ndarray]:
    """Return what each row of the functions moves by in each mode, and residuals; the columns' motion is known."""
    rows, columns, lines = mean.shape
    factor = s**2 / (2j * poles.pole.imag[:, None])
    own, mirror = factor / (s - poles.pole[:, None]), -factor / (s - poles.pole.conj()[:, None])
    forward = poles.participation[:, :, None] * own
    back = poles.participation.conj()[:, :, None] * mirror
    power = powers(s)
    size = np.abs(power).max(1)
    each = [np.eye(columns)[:, :, None] * x for x in power / size[:, None]]
    terms = [forward + back, 1j * (forward - back), *each]
    matrix = np.concatenate([weight * x for x in terms], 1)
    A = np.moveaxis(matrix, 1, 2).reshape(columns * lines, -1)
    b = (mean * weight).reshape(rows, -1).T
    x = np.linalg.lstsq(np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=None)[0]
    count = len(poles.pole)
    motion = (x[:count] + 1j * x[count : 2 * count]).T
    residual = x[2 * count :].reshape(len(size), columns, rows) / size[:, None, None]
    return motion, residual.swapaxes(1, 2)
