"""Covariance-driven stochastic subspace identification: poles and shapes of correlation functions, by order."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import eigh, solve_triangular


@dataclass(frozen=True)
class Realisation:
    """Poles and shapes of one order.

    Attributes:
        order: states.
        pole: (m,) [rad/s] complex, those of positive frequency.
        shape: (O, m) complex, in the channels' own units.
    """

    order: int
    pole: Complex[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]

    @property
    def unit_shape(self) -> Complex[np.ndarray, "O m"]:
        """(O, m) shapes of unit length."""
        return self.shape / np.linalg.norm(self.shape, axis=0)

    def pick(self, kept: np.ndarray) -> "Realisation":
        """Return some of the poles."""
        return Realisation(self.order, self.pole[kept], self.shape[:, kept])


def realisations(
    correlation: Float[np.ndarray, "O R K"], step: float, orders: Sequence[int]
) -> tuple[Realisation, ...]:
    """Return the poles of correlation functions of responses to white noise.

    R(k) = C A^(k - 1) G for lags k >= 1, so that the block Hankel matrix of R(1), R(2), ... is the product of
    observability and controllability; A follows from the shift of the observability by one block row. Lag 0, which
    has the noise of the sensors and the direct part of accelerations, is not used.

    Args:
        correlation: at lags 0 to K - 1; K even.
        step: [s] between lags.
        orders: numbers of states.

    Returns:
        One realisation for each order. Orders above the numerical rank of the Hankel matrix have as many states as
        its rank, since what lies below is rounding: a quiet response has fewer states than a noisy one.

    References:
        Peeters, De Roeck, "Reference-based stochastic subspace identification for output-only modal analysis", MSSP 13,
        1999.
    """
    outputs, _, lags = correlation.shape
    hankel = _hankel(correlation, lags // 2)
    square = hankel @ hankel.T
    size = len(square)
    power, left = eigh(square, subset_by_index=(size - max(orders), size - 1))
    rank = int(np.sum(power > size * np.finfo(float).eps * power[-1]))
    observability = left[:, : -rank - 1 : -1] * power[: -rank - 1 : -1] ** 0.25
    first, triangle = np.linalg.qr(observability[:-outputs])
    shifted = first.T @ observability[outputs:]
    return tuple(
        _realisation(solve_triangular(triangle[:n, :n], shifted[:n, :n]), observability[:outputs, :n], step)
        for n in np.minimum(orders, rank).tolist()
    )


def _hankel(correlation: np.ndarray, rows: int) -> Float[np.ndarray, "iO iR"]:
    outputs, inputs, _ = correlation.shape
    lag = 1 + np.arange(rows)[:, None] + np.arange(rows)
    return np.transpose(correlation[..., lag], (2, 0, 3, 1)).reshape(rows * outputs, rows * inputs)


def _realisation(transition: np.ndarray, output: np.ndarray, step: float) -> Realisation:
    root, vector = (each.astype(complex) for each in np.linalg.eig(transition))
    kept = root.imag > 0
    return Realisation(len(transition), np.log(root[kept]) / step, (output @ vector)[:, kept])
