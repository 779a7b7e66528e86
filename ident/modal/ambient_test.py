"""What an ambient test is, as a value: responses to forces that nobody measured."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.measure.load import Load
from ident.measure.speeds import Speed
from ident.modal.correlations import Correlations
from ident.modal.frf import Place
from ident.modal.harmonics import Harmonic


@dataclass(frozen=True)
class SpectralDensity:
    """Singular values of the spectral density matrix of the responses, each in its own standard deviations.

    Attributes:
        frequency: (F,) [Hz]
        singular: (S, F) [1/Hz] descending.
    """

    frequency: Float[np.ndarray, "F"]
    singular: Float[np.ndarray, "S F"]


@dataclass(frozen=True)
class AmbientTest:
    """What was recorded at one posture under one load, without a force.

    Attributes:
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: what held the motors.
        files: from which.
        responses: (O,) where and along what was measured.
        references: rows of the responses with which all are correlated.
        scale: (O,) [SI] by which responses are divided: their standard deviations.
        order: (O,) how often each is differentiated to give an acceleration.
        band: [Hz] in which modes are sought.
        correlations: of the scaled responses, without harmonics.
        density: of the scaled responses, harmonics included.
        speeds: what turned.
        harmonics: lines that were taken out.
        remarks: what else a reader should know.
    """

    posture: tuple[float, ...]
    load: Load
    drives: str
    files: tuple[str, ...]
    responses: tuple[Place, ...]
    references: tuple[int, ...]
    scale: Float[np.ndarray, "O"]
    order: tuple[int, ...]
    band: tuple[float, float]
    correlations: Correlations
    density: SpectralDensity
    speeds: tuple[Speed, ...]
    harmonics: tuple[Harmonic, ...]
    remarks: tuple[str, ...]
