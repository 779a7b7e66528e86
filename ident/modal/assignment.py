"""Match measured shapes to computed ones: probabilities of all pairs, over draws of the model."""

import math

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from numpy.polynomial.hermite_e import hermegauss
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

INEXACT = 0.15
"""Relative error of a computed shape, from sensor places, directions, and model simplifications; assumed."""
COUPLING = 0.05
"""Relative error of squared frequencies, which mixes the shapes of close modes; assumed."""
NODES = 9
"""Number of mixing angles at which mixed shapes are computed."""
UNSEEN = 0.05
"""Probability that a test does not show a mode within its band; assumed."""
NONE = 0.02
"""Prior probability that a measured mode is none of the computed ones; assumed."""


def likelihoods(
    shape: Complex[np.ndarray, "O"],
    covariance: Float[np.ndarray, "n n"],
    computed: Float[np.ndarray, "O m D"],
    frequency: Float[np.ndarray, "m D"],
    measured: float,
    frequency_sd: float,
) -> Float[np.ndarray, "D m"]:
    """Return the log-likelihood ratio of a measured shape: each computed shape against no mode.

    The measured shape is a multiple c of the computed one, c complex and of any size, with its own covariance and a
    model error of the computed shape. A small model error mixes close modes: the computed shape is turned towards that
    of its neighbour by an angle of unknown tangent, normal with standard deviation
    kappa = COUPLING w_a w_b / |w_a^2 - w_b^2|, at most one. So nearly coincident modes are compared as the plane that
    they span, in which the closer one is more probable; distant modes are compared individually. For no mode, all
    directions of the shape are equally probable.

    Args:
        shape: of the measured mode.
        covariance: of the measured shape, real parts first.
        computed: mass-normalised shapes at the same places, of D draws of the model.
        frequency: [Hz] of the computed modes.
        measured: [Hz] of the measured mode.
        frequency_sd: model error of the frequencies beyond the draws, in ln.

    References:
        Fox, Kapoor, "Rates of change of eigenvalues and eigenvectors", AIAA J. 6, 1968 (mixing).
    """
    length = np.linalg.norm(shape)
    unit, outputs = shape / length, len(shape)
    S = covariance / length**2 + np.eye(2 * outputs) * INEXACT**2 / (2 * outputs)
    tangents, weights = hermegauss(NODES)
    partner, kappa = _neighbours(frequency)
    beside = np.take_along_axis(computed, partner[None], 1)
    turned = computed[:, None] + beside[:, None] * kappa * tangents[:, None, None]
    moved = np.linalg.norm(turned, axis=0)
    turned = np.where(moved > 0, turned, 1.0) / np.where(moved > 0, moved, 1.0)
    logs = _log_density(np.concatenate([unit.real, unit.imag]), S, turned.reshape(outputs, -1))
    seen = np.where(moved > 0, logs.reshape(moved.shape), -np.inf)  # a mode without motion there is not measured
    mixed = logsumexp(seen, 0, b=weights[:, None, None] / weights.sum())
    found = mixed - (gammaln(outputs) - (outputs - 1) * math.log(math.pi))
    return (found - (np.log(frequency / measured) / frequency_sd) ** 2 / 2).T


def _neighbours(frequency: Float[np.ndarray, "m D"]) -> tuple[Int[np.ndarray, "m D"], Float[np.ndarray, "m D"]]:
    """Return the mode with which each mixes most, and the mixing coefficient."""
    gap = np.abs(frequency[:, None] ** 2 - frequency**2)
    product = frequency[:, None] * frequency * (1 - np.eye(len(frequency)))[..., None]
    kappa = np.minimum(COUPLING * product / np.maximum(gap, COUPLING * np.maximum(product, 1e-300)), 1.0)
    partner = np.argmax(kappa, 1)
    return partner, np.take_along_axis(kappa, partner[:, None], 1)[:, 0]


def _log_density(
    y: Float[np.ndarray, "two_O"], S: Float[np.ndarray, "two_O two_O"], shapes: Float[np.ndarray, "O n"]
) -> Float[np.ndarray, "n"]:
    """Return ln of the integral over c of the normal density of y about c times each shape, with covariance S.

    y has real parts first. Its residual is orthogonal to the plane spanned by the two parts of c (Gram-Schmidt).
    """
    factor, outputs = np.linalg.cholesky(S), len(shapes)
    inverse = solve_triangular(factor, np.eye(len(S)), lower=True)
    white, real, imag = inverse @ y, inverse[:, :outputs] @ shapes, inverse[:, outputs:] @ shapes
    first = np.linalg.norm(real, axis=0)
    real /= first
    imag -= real * (real * imag).sum(0)
    second = np.linalg.norm(imag, axis=0)
    left = white[:, None] - real * (white @ real)
    left -= imag / second * (white @ (imag / second))
    determinants = 2 * np.log(np.diag(factor)).sum() + 2 * np.log(first * second)
    return -((left**2).sum(0) + determinants + (len(y) - 2) * math.log(2 * math.pi)) / 2


def pair_probabilities(
    logs: Float[np.ndarray, "D R m"], within: Bool[np.ndarray, "D m"]
) -> tuple[Float[np.ndarray, "D R m"], Float[np.ndarray, "D"]]:
    """Return the probability of each pair, and ln(likelihood) of each draw, over all ways to pair modes.

    A computed mode has at most one measured partner. A measured mode may have none, with the probability that its row
    lacks to one.

    Args:
        logs: ln(likelihood) of each pair over that of no mode, for D draws.
        within: which computed modes lie in the band, where a mode is rarely missed.
    """
    draws, rows, count = logs.shape
    height = np.maximum(logs.max(2), 0.0)
    weight = np.exp(logs - height[..., None]) * ((1 - NONE) / count)
    none = np.exp(-height) * NONE
    masks = np.arange(2**count)
    free = [masks[(masks >> m) & 1 == 0] for m in range(count)]
    ahead = [np.zeros((draws, 2**count))]
    ahead[0][:, 0] = 1.0
    for r in range(rows):
        following = ahead[-1] * none[:, r, None]
        for m in range(count):
            following[:, free[m] | 1 << m] += weight[:, r, m, None] * ahead[-1][:, free[m]]
        ahead.append(following)
    unseen = (masks[:, None] >> np.arange(count)) & 1 == 0
    behind = UNSEEN ** (within.astype(float) @ unseen.T)
    pairs = np.zeros((draws, rows, count))
    for r in reversed(range(rows)):
        before = none[:, r, None] * behind
        for m in range(count):
            on = weight[:, r, m, None] * behind[:, free[m] | 1 << m]
            pairs[:, r, m] = (ahead[r][:, free[m]] * on).sum(1)
            before[:, free[m]] += on
        behind = before
    total = behind[:, 0]
    return pairs / total[:, None, None], np.log(total) + height.sum(1)
