"""Frequencies, damping ratios and shapes of the modes of a test, however they were measured."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ident.modal.frf import Place
from ident.modal.stabilisation import Diagram


@dataclass(frozen=True)
class Rejected:
    """A pole that was taken for no mode.

    Attributes:
        frequency: [Hz] undamped.
        damping: [-] damping ratio.
        why: in words.
    """

    frequency: float
    damping: float
    why: str


@dataclass(frozen=True)
class ModalParameters(ABC):
    """Modes of a test, ascending in frequency, with their joint covariance.

    Attributes:
        frequency: (m,) [Hz] undamped, |pole| / 2 pi.
        damping: (m,) [-] damping ratio.
        shape: (O, m) complex motion of each response.
        covariance: (n, n) of frequencies, damping ratios, real and imaginary parts of the shapes mode by mode;
            n = 2 m + 2 O m.
        diagram: poles over orders.
        rejected: poles that were taken for no mode, with why.
    """

    frequency: Float[np.ndarray, "m"]
    damping: Float[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    covariance: Float[np.ndarray, "n n"]
    diagram: Diagram
    rejected: tuple[Rejected, ...]

    @property
    @abstractmethod
    def responses(self) -> tuple[Place, ...]:
        """(O,) where and along what was measured."""

    @property
    @abstractmethod
    def band(self) -> tuple[float, float]:
        """[Hz] between which modes were sought."""

    @property
    @abstractmethod
    def doubtful(self) -> bool:
        """Whether the covariance is not to be relied on."""

    @property
    def sigma(self) -> Float[np.ndarray, "2 m"]:
        """(2, m) [Hz, -] standard deviations of frequencies and damping ratios."""
        return np.sqrt(np.diag(self.covariance))[: 2 * len(self.frequency)].reshape(2, -1)

    @property
    def correlation(self) -> Float[np.ndarray, "k k"]:
        """(2 m, 2 m) [-] of frequencies, then damping ratios."""
        count = 2 * len(self.frequency)
        sd = self.sigma.ravel()
        return self.covariance[:count, :count] / (sd[:, None] * sd)

    def of_shape(self, modes: Sequence[int]) -> Float[np.ndarray, "k k"]:
        """Return the joint covariance of the shapes of some modes: real parts, then imaginary ones, mode by mode."""
        count, outputs = 2 * len(self.frequency), 2 * len(self.shape)
        at = np.concatenate([count + mode * outputs + np.arange(outputs) for mode in modes])
        return self.covariance[np.ix_(at, at)]
