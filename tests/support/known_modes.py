"""Hammer tests with known truth: frequency response functions of given modes, with what scatters from hit to hit."""

from dataclasses import dataclass

import numpy as np

from ident.modal.frf import Frf, Place


@dataclass(frozen=True)
class Truth:
    """Modes of a structure: frequency (m,) [Hz], damping ratio (m,), shape (O, m), motion at the references (I, m)."""

    frequency: np.ndarray
    damping: np.ndarray
    shape: np.ndarray
    references: np.ndarray

    def accelerance(self, frequency, decay=0.0):
        """Sum over modes of s^2 phi_o phi_i / (s^2 + 2 zeta w s + w^2)."""
        s = (2j * np.pi * frequency + decay)[:, None]
        w = 2 * np.pi * self.frequency
        each = s**2 / (s**2 + 2 * self.damping * w * s + w**2)
        return np.einsum("om,im,fm->oif", self.shape, self.references, each)


def arm_like(rng, outputs=6, inputs=1, close=None):
    """Five modes as an arm has them, one below the band's end, one beyond it; `close` [-] apart are the first two."""
    frequency = np.array([8.0, 11.5, 19.0, 31.0, 44.0, 95.0])
    if close is not None:
        frequency[1] = frequency[0] * (1 + close)
    damping = np.array([0.012, 0.015, 0.01, 0.02, 0.015, 0.02])
    shape = rng.normal(size=(outputs, 6))
    return Truth(frequency, damping, shape, rng.uniform(0.4, 1.5, (inputs, 6)) * rng.choice([-1, 1], (inputs, 6)))


def directions(count, point="tip"):
    """As many places, along the axes in turn."""
    axes = np.eye(3)
    return tuple(Place(f"{point}{n // 3 or ''}", tuple(axes[n % 3].tolist())) for n in range(count))


def hammer_test(truth, rng, *, hits=5, noise=0.01, lines=None, decay=0.0, complex_noise=None):
    """Frf of a test with noise of the responses, white, as a share of the root mean square of each function.

    An exponential window of this decay is laid over response and noise alike, so that it correlates neighbouring lines.
    """
    frequency = np.arange(3.0, 55.0, 0.125) if lines is None else lines
    clean = truth.accelerance(frequency, decay)
    size = noise * np.sqrt((np.abs(clean) ** 2).mean(-1, keepdims=True))
    scatter = rng.normal(size=(hits, *clean.shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    if decay:
        scatter = windowed(scatter, decay, frequency, rng, clean.shape, hits)
    return Frf(frequency, clean + size * scatter, directions(clean.shape[0]), directions(clean.shape[1], "hit"), decay)


def windowed(scatter, decay, frequency, rng, shape, hits):
    """White noise in time under exp(-decay t), as spectra at the lines, of unit variance."""
    step = frequency[1] - frequency[0]
    count = int(2 ** np.ceil(np.log2(2.5 * frequency[-1] / step)))
    time = np.arange(count) / (count * step)
    window = np.exp(-decay * time)
    signal = rng.normal(size=(hits, *shape[:2], count)) * window / np.sqrt((window**2).sum())
    first = round(frequency[0] / step)
    return np.fft.fft(signal)[..., first : first + len(frequency)]
