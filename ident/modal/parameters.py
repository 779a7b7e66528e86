"""Frequencies, damping ratios and shapes of the modes of a test, and the complexity of the shapes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ident.modal.frf import ModeSet
from ident.modal.poles import Diagram

# -------- Modal parameters
# Frequencies, damping ratios and shapes of the modes of any kind of test.


@dataclass(frozen=True)
class Rejected:
    """A pole that is not a mode.

    Attributes:
        frequency: [Hz] undamped.
        damping: [-] damping ratio.
        why: in words.
    """

    frequency: float
    damping: float
    why: str


@dataclass(frozen=True)
class ModalParameters(ModeSet):
    """Identified modes; their frequencies are undamped, |pole| / 2 pi.

    Attributes:
        diagram: poles over orders.
        rejected: poles that are not modes, with the reason.
    """

    diagram: Diagram
    rejected: tuple[Rejected, ...]


# -------- Complexity
# Deviation of a mode shape from motion in phase, with its uncertainty.


@dataclass(frozen=True)
class PhasePlane:
    """The shape of a mode in the complex plane, turned to the real axis and scaled to one at its largest.

    Attributes:
        shape: (O,) [-] complex.
        covariance: (O, 2, 2) [-] of real and imaginary part of each response's motion, at this turn and scale.
        collinearity: [-] modal phase collinearity: one for motion in phase, zero for evenly spread phases.
    """

    shape: Complex[np.ndarray, "O"]
    covariance: Float[np.ndarray, "O 2 2"]
    collinearity: float


def phase_planes(modes: ModalParameters) -> tuple[PhasePlane, ...]:
    """Return the shape of each mode in the complex plane.

    References:
        Pappa, Elliott, Schenk, "A consistent-mode indicator for the eigensystem realization algorithm", AIAA 1992
        (modal phase collinearity).
    """
    return tuple(_plane(modes, mode) for mode in range(len(modes.frequency)))


def _plane(modes: ModalParameters, mode: int) -> PhasePlane:
    shape, covariance = modes.shape[:, mode], modes.of_shape([mode])
    parts = np.array([shape.real, shape.imag])
    spread, axes = np.linalg.eigh(parts @ parts.T)
    along = axes[0, 1] + 1j * axes[1, 1]
    turned = shape * along.conjugate()
    largest = turned[np.argmax(np.abs(turned))]
    factor = along.conjugate() * np.sign(largest.real) / abs(largest)
    turn = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    each = np.arange(len(shape))[:, None, None] + len(shape) * np.arange(2)
    blocks = covariance[np.swapaxes(each, 1, 2), each]
    collinearity = float(((spread[1] - spread[0]) / (spread[1] + spread[0])) ** 2)
    return PhasePlane(shape * factor, turn @ blocks @ turn.T, collinearity)
