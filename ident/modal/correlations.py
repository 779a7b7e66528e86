"""How responses are correlated over time, block by block: all that is needed of an ambient record."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.fft import irfft, next_fast_len, rfft


@dataclass(frozen=True)
class Correlations:
    """Correlation functions of responses with references, a part of each block of the record.

    R(k) = sum over t of y(t + k) y_ref(t)', t within the block; its sum over blocks is that of the record.

    Attributes:
        step: [s] between lags.
        blocks: (B, O, R, K) [channel units squared] at lags 0 to K - 1.
        samples: (B,) samples in each block.
    """

    step: float
    blocks: Float[np.ndarray, "B O R K"]
    samples: Float[np.ndarray, "B"]

    @property
    def mean(self) -> Float[np.ndarray, "O R K"]:
        """Correlation functions of the record."""
        return self.blocks.sum(0) / self.samples.sum()

    @property
    def duration(self) -> float:
        """[s] of the record."""
        return float(self.samples.sum()) * self.step

    def without(self, block: int) -> Float[np.ndarray, "O R K"]:
        """Return the correlation functions of all but one block."""
        return np.delete(self.blocks, block, 0).sum(0) / np.delete(self.samples, block).sum()

    def joined(self, count: int) -> "Correlations":
        """Return the same with neighbouring blocks joined, `count` of them in all."""
        starts = np.unique(np.linspace(0, len(self.blocks), count + 1).astype(int))[:-1]
        return replace(self, blocks=np.add.reduceat(self.blocks, starts), samples=np.add.reduceat(self.samples, starts))


def correlations_of(
    records: Sequence[Float[np.ndarray, "O T"]], references: Sequence[int], step: float, lags: int, length: int
) -> Correlations:
    """Return the correlation functions of records, in blocks of at least some length.

    Args:
        records: of the same channels, without their mean.
        references: (R,) rows of the responses that the others are correlated with.
        step: [s] between samples.
        lags: K.
        length: samples of a block, at least.

    References:
        Bendat and Piersol, "Random Data", 4th ed. 2010, section 11.4.2 (by Fourier transforms).
    """
    blocks, samples = [], []
    for record in records:
        usable = record.shape[1] - lags + 1
        edges = np.linspace(0, usable, max(usable // length, 1) + 1).astype(int)
        for start, end in pairwise(edges.tolist()):
            blocks.append(_block(record, references, start, end, lags))
            samples.append(float(end - start))
    return Correlations(step, np.array(blocks), np.array(samples))


def _block(record: np.ndarray, references: Sequence[int], start: int, end: int, lags: int) -> np.ndarray:
    count = next_fast_len(end - start + lags - 1, real=True)
    ahead = rfft(record[:, start : end + lags - 1], count)
    here = rfft(record[list(references), start:end], count)
    out: np.ndarray = irfft(ahead[:, None] * here.conj()[None], count)[..., :lags]
    return out
