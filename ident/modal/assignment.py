"""Which measured shape is which computed one: probabilities of all pairs, over draws of what computed them."""

import math

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.special import gammaln, logsumexp

INEXACT = 0.15
"""How far a computed shape is off, as a share of its length: places, directions, what the model leaves out."""
COUPLING = 0.05
"""How far squared frequencies are off, as a share: it mixes the shapes of modes that are near each other."""
FREQUENCY_SD = 0.3
"""How far computed frequencies are off beyond their draws, in ln."""
UNSEEN = 0.1
"""Probability that a test does not show a mode within its band."""
NONE = 0.02
"""Probability that a measured mode is none of the computed ones, before its shape is seen."""


def likelihoods(
    shape: Complex[np.ndarray, "O"],
    covariance: Float[np.ndarray, "n n"],
    computed: Float[np.ndarray, "O m"],
    frequency: Float[np.ndarray, "m"],
    measured: float,
) -> Float[np.ndarray, "m"]:
    """Return ln(likelihood of a measured shape) for each computed one, over that of a shape of no mode.

    The measured shape is a multiple c of the computed one, c complex and of any size, with its own covariance, an
    inexactness of the computed one, and as much of the others as a small error of the model mixes in:
    kappa = COUPLING w_a w_b / |w_a^2 - w_b^2|, at most one. So modes that nearly coincide, which any small error turns
    within the plane that they span, are compared as that plane; modes far apart as they are. A shape of no mode has
    any direction alike.

    Args:
        shape: of the measured mode.
        covariance: its own, real parts first.
        computed: shapes at the same places.
        frequency: [Hz] of the computed modes.
        measured: [Hz] of the measured one; the frequencies agree to within `FREQUENCY_SD` only.

    References:
        Fox, Kapoor, "Rates of change of eigenvalues and eigenvectors", AIAA J. 6, 1968 (mixing).
    """
    length = np.linalg.norm(shape)
    unit, outputs = shape / length, len(shape)
    y = np.concatenate([unit.real, unit.imag])
    # shapes of length one; places where a mode hardly moves leave it unlike anything
    size = np.linalg.norm(computed, axis=0)
    squared = frequency**2
    gap = np.abs(squared[:, None] - squared) + np.eye(len(frequency))
    kappa = np.minimum(COUPLING * frequency[:, None] * frequency / gap, 1.0) * (1 - np.eye(len(frequency)))
    mixed = np.einsum("oa,ma,pa->mop", computed, kappa**2, computed) / size[:, None, None] ** 2
    alone = covariance / length**2 + np.eye(2 * outputs) * INEXACT**2 / (2 * outputs)
    S = alone + _doubled(mixed / 2)
    A = _doubled_columns(computed / size)
    return (
        _log_density(y, S, A)
        - (gammaln(outputs) - (outputs - 1) * math.log(math.pi))
        + _by_frequency(frequency, measured)
    )


def _by_frequency(frequency: Float[np.ndarray, "m"], measured: float) -> Float[np.ndarray, "m"]:
    return -((np.log(frequency / measured) / FREQUENCY_SD) ** 2) / 2


def _doubled(blocks: Float[np.ndarray, "m O O"]) -> Float[np.ndarray, "m n n"]:
    """Return covariances of real and imaginary parts that are alike."""
    count, outputs, _ = blocks.shape
    out = np.zeros((count, 2 * outputs, 2 * outputs))
    out[:, :outputs, :outputs] = out[:, outputs:, outputs:] = blocks
    return out


def _doubled_columns(shapes: Float[np.ndarray, "O m"]) -> Float[np.ndarray, "m n 2"]:
    """Return what the real and the imaginary part of a factor do."""
    outputs, count = shapes.shape
    out = np.zeros((count, 2 * outputs, 2))
    out[:, :outputs, 0] = out[:, outputs:, 1] = shapes.T
    return out


def _log_density(
    y: Float[np.ndarray, "n"], S: Float[np.ndarray, "m n n"], A: Float[np.ndarray, "m n 2"]
) -> Float[np.ndarray, "m"]:
    """Return ln of the integral over c of the normal density of y about A c with covariance S."""
    inverse = np.linalg.inv(S)
    weighted = inverse @ A
    information = np.swapaxes(A, 1, 2) @ weighted
    c = np.linalg.solve(information, (np.swapaxes(weighted, 1, 2) @ y)[..., None])
    apart = y - (A @ c)[..., 0]
    squared = np.einsum("mi,mij,mj->m", apart, inverse, apart)
    free = len(y) - 2
    determinants = np.linalg.slogdet(S)[1] + np.linalg.slogdet(information)[1]
    return -(squared + determinants + free * math.log(2 * math.pi)) / 2


def pair_probabilities(
    logs: Float[np.ndarray, "D R m"], within: Bool[np.ndarray, "D m"]
) -> tuple[Float[np.ndarray, "D R m"], Float[np.ndarray, "D"]]:
    """Return the probability of each pair, and of each draw, over all ways to pair measured modes with computed ones.

    No computed mode is two measured ones, and a measured one may be none: what is missing of a row's sum to one.

    Args:
        logs: ln(likelihood) of each pair over that of no mode, for D draws.
        within: which computed modes lie in the band: there one rarely goes unseen.
    """
    draws, rows, count = logs.shape
    height = np.maximum(logs.max(2), 0.0)
    weight = np.exp(logs - height[..., None]) * ((1 - NONE) / count)
    none = np.exp(-height) * NONE
    masks = np.arange(2**count)
    ahead = [np.zeros((draws, 2**count))]
    ahead[0][:, 0] = 1.0
    for r in range(rows):
        ahead.append(_next(ahead[-1], weight[:, r], none[:, r], masks))
    unseen = (masks[:, None] >> np.arange(count)) & 1 == 0
    behind = UNSEEN ** (within.astype(float) @ unseen.T)
    pairs = np.zeros((draws, rows, count))
    for r in reversed(range(rows)):
        before = none[:, r, None] * behind
        for m in range(count):
            free = masks[(masks >> m) & 1 == 0]
            on = weight[:, r, m, None] * behind[:, free | 1 << m]
            pairs[:, r, m] = (ahead[r][:, free] * on).sum(1)
            before[:, free] += on
        behind = before
    total = behind[:, 0]
    log_draw = np.log(total) + height.sum(1)
    return pairs / total[:, None, None], np.exp(log_draw - logsumexp(log_draw))


def _next(
    before: Float[np.ndarray, "D S"], weight: Float[np.ndarray, "D m"], none: Float[np.ndarray, "D"], masks: np.ndarray
) -> Float[np.ndarray, "D S"]:
    out = before * none[:, None]
    for m in range(weight.shape[1]):
        free = masks[(masks >> m) & 1 == 0]
        out[:, free | 1 << m] += weight[:, m, None] * before[:, free]
    return out
