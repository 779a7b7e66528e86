"""All modes at once by maximum likelihood, with their joint covariance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Bool, Complex, Float

from ident.modal.frf import Frf
from ident.modal.modal_model import ModalModel
from ident.modal.noise import Noise, channels_of

STEPS = 60
"""Steps of a search at most."""
SMALL = 1e-4
"""Last change of chi-squared at which a search ends; one is a standard deviation."""

CHORDS = 4
"""Steps to an estimate nearby."""
SETTLED = 0.01
"""Last change of chi-squared after which such steps have come to an end."""
FALLBACK = 8
"""Steps of a search where they do not."""


@dataclass(frozen=True)
class Likelihood:
    """Maximum-likelihood estimate of all modes of a test.

    Attributes:
        model: the modes with the residuals.
        covariance: (n, n) of the model's vector: the inverse of the full information matrix; zero for numbers that are
            not estimated (the imaginary parts of real modes).
        chi_squared: [-] of the whitened residuals.
        freedom: number of residuals less that of parameters.
        converged: whether the search ended by its own criterion.

    References:
        Guillaume, Verboven, Vanlanduit, ISMA 1998. El-Kafafy, De Troyer, Peeters, Guillaume, MSSP 40, 2013 (from
        poly-reference least squares to the modal model).
    """

    model: ModalModel
    covariance: Float[np.ndarray, "n n"]
    chi_squared: float
    freedom: int
    converged: bool


def maximise(
    frf: Frf, noise: Noise, start: ModalModel, *, real: bool = False, steps: int = STEPS, below: float = math.inf
) -> Likelihood:
    """Search the modes that make the averaged functions most probable, by Levenberg and Marquardt's method.

    Args:
        frf: of the test.
        noise: of the functions.
        start: modes to begin with.
        real: whether shapes are real.
        steps: at most.
        below: chi-squared that has to be reached within these steps: where the larger of the last two gains, in all
            steps that are left, would not do it, the search is given up.
    """
    s, mean = 2j * np.pi * frf.frequency + frf.decay, channels_of(frf.mean)
    free = free_numbers(start, real)
    model = start.replace(np.where(free, start.vector(), 0.0)) if real else start
    cost, damping, converged, before = _cost(mean, noise, model, s), 1e-3, False, math.inf
    for left in reversed(range(steps)):
        gradient, information = _normal_equations(mean, noise, model, s, free)
        scale = np.sqrt(np.diag(information))
        scaled = information / (scale[:, None] * scale)
        while damping < 1e8:
            step = scipy.linalg.solve(scaled + damping * np.eye(len(scale)), gradient / scale, assume_a="pos") / scale
            new = model.replace(_moved(model.vector(), free, step))
            new_cost = _cost(mean, noise, new, s) if _is_sound(new) else np.inf
            if new_cost < cost:
                break
            damping *= 10
        else:
            break
        model, gained, cost = new, cost - new_cost, new_cost
        damping = max(damping / 30, 1e-12)
        if gained < SMALL:
            converged = True
            break
        if cost - left * max(gained, before) > below:
            break
        before = gained
    return Likelihood(model, _covariance(information, free), cost, 2 * mean.size - int(free.sum()), converged)


def nearby(frf: Frf, noise: Noise, fit: Likelihood, others: Sequence[Frf], *, real: bool) -> Float[np.ndarray, "h n"]:
    """Return the vectors of estimates from functions that differ little from those of a fit.

    By steps with the slopes and the information of the fit; by a search where these lead away, as where a mode beyond
    the band is hardly known.
    """
    s, free, vector = 2j * np.pi * frf.frequency + frf.decay, free_numbers(fit.model, real), fit.model.vector()
    gain = fit.covariance[:, free] @ noise.whiten(channels_of(fit.model.slopes(s)[free]))
    vectors = []
    for other in others:
        own, mean = vector, channels_of(other.mean)
        costs = []
        for _ in range(CHORDS):
            residual = noise.whiten(mean - channels_of(fit.model.replace(own).accelerance(s)))
            costs.append(float(residual @ residual))
            own = own + gain @ residual
        settled = _is_sound(fit.model.replace(own)) and abs(costs[-1] - costs[-2]) < SETTLED and costs[-1] < costs[0]
        vectors.append(own if settled else maximise(other, noise, fit.model, real=real, steps=FALLBACK).model.vector())
    return np.array(vectors)


def free_numbers(model: ModalModel, real: bool) -> Bool[np.ndarray, "n"]:
    """Return which numbers of the model's vector are estimated."""
    outputs, others = len(model.shape), len(model.participation) - 1
    own = np.ones(model.size, bool)
    if real:
        own[2 + outputs : 2 + 2 * outputs] = False
        own[2 + 2 * outputs + others :] = False
    return np.concatenate([np.tile(own, len(model.pole)), np.ones(model.residual.size, bool)])


def _moved(vector: np.ndarray, free: np.ndarray, step: np.ndarray) -> np.ndarray:
    moved = vector.copy()
    moved[free] += step
    return moved


def _is_sound(model: ModalModel) -> bool:
    return bool((model.pole.imag > 0).all() and np.isfinite(model.vector()).all())


def _cost(mean: Complex[np.ndarray, "K F"], noise: Noise, model: ModalModel, s: np.ndarray) -> float:
    return float((noise.whiten(mean - channels_of(model.accelerance(s))) ** 2).sum())


def _normal_equations(
    mean: Complex[np.ndarray, "K F"], noise: Noise, model: ModalModel, s: np.ndarray, free: Bool[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "f"], Float[np.ndarray, "f f"]]:
    residual = noise.whiten(mean - channels_of(model.accelerance(s)))
    slopes = model.slopes(s)
    slopes = noise.whiten(channels_of(slopes if free.all() else slopes[free]))
    return slopes @ residual, slopes @ slopes.T


def _covariance(information: Float[np.ndarray, "f f"], free: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "n n"]:
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.pinv(information / (scale[:, None] * scale), hermitian=True) / (scale[:, None] * scale)
    full = np.zeros((len(free), len(free)))
    full[np.ix_(free, free)] = inverse
    return full
