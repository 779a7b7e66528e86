"""Frequency response functions of a modal test, with the single hits that they are averaged from."""

from dataclasses import dataclass

import numpy as np

from ident.errors import InputError, Problem


@dataclass(frozen=True)
class Place:
    """Where and along what a force acts or a response is measured.

    point: name of a point of the arm
    direction: (3,) [-] unit vector in the base frame, at the posture of the test
    """

    point: str
    direction: tuple[float, float, float]


@dataclass(frozen=True)
class Frf:
    """Accelerance, acceleration by force, of one posture of an arm.

    frequency: (F,) [Hz] lines, evenly spaced, ascending
    hits: (H, O, I, F) [1/kg] complex; response of each of H hits (of a shaker test: of each block) at O responses, by I
        references
    responses: (O,) where and along what acceleration is measured
    references: (I,) where and along what the force acts
    decay: [1/s] what an exponential window has added to the decay rate of every pole; to be taken off again
    """

    frequency: np.ndarray
    hits: np.ndarray
    responses: tuple[Place, ...]
    references: tuple[Place, ...]
    decay: float = 0.0

    def __post_init__(self) -> None:
        expected = (len(self.responses), len(self.references), len(self.frequency))
        if self.hits.ndim != 4 or self.hits.shape[1:] != expected:
            wanted = f"shape (hits, {', '.join(map(str, expected))})"
            raise InputError(
                Problem("", f"hits of shape {self.hits.shape}", wanted, "see `responses`, `references`", "hits")
            )

    @property
    def mean(self) -> np.ndarray:
        """(O, I, F) [1/kg] the estimate: the average over hits (H1 where every hit has the same force spectrum)."""
        return self.hits.mean(axis=0)
