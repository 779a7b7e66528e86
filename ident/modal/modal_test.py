"""What a hammer test is, as a value, and how its records are processed."""

from dataclasses import dataclass

import numpy as np

from ident.measure.load import Load
from ident.modal.checks import Check
from ident.modal.frf import Frf, Place


@dataclass(frozen=True)
class Processing:
    """How records become frequency responses.

    Attributes:
        estimator: `h1`, `h2` or `hv`.
        window_end: [-] share to which the exponential window fades a record; 1 for none.
        rest: [s] between two hits of one record, at least.
        band: [Hz] lowest and highest line that is kept; None for what the hammer excites.
    """

    estimator: str = "h1"
    window_end: float = 0.001
    rest: float = 1.0
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rejected:
    """A hit that does not count.

    Attributes:
        file: where it is.
        number: of the hit in its file, from 1.
        reason: why.
    """

    file: str
    number: int
    reason: str


@dataclass(frozen=True)
class ModalTest:
    """What was measured at one posture under one load.

    Attributes:
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: what held the motors.
        files: from which.
        frf: frequency responses with those of each hit.
        coherence: (O, I, F) [-]; ones for a single hit.
        duration: [s] of a record; 0 for finished frequency responses.
        rejected: hits that do not count.
        checks: of driving points and reciprocity.
        remarks: what else a reader should know.
    """

    posture: tuple[float, ...]
    load: Load
    drives: str
    files: tuple[str, ...]
    frf: Frf
    coherence: np.ndarray
    duration: float
    rejected: tuple[Rejected, ...]
    checks: tuple[Check, ...]
    remarks: tuple[str, ...]

    @property
    def responses(self) -> tuple[Place, ...]:
        """(O,) where and along what was measured."""
        return self.frf.responses

    @property
    def hits(self) -> int:
        """Hits that count."""
        return len(self.frf.hits) * len(self.frf.references)

    @property
    def good(self) -> bool:
        """Whether driving points and reciprocal responses do not contradict each other."""
        return all(check.good for check in self.checks)
