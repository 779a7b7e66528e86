"""How many modes a test shows: those that the data ask for and no more, with why others were left out."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from ident.modal.frf import Frf
from ident.modal.likelihood import Likelihood, maximise
from ident.modal.modal_model import ModalModel
from ident.modal.modal_parameters import Rejected
from ident.modal.noise import Noise, channels_of
from ident.modal.polynomial import Poles
from ident.modal.residues import model_of
from ident.modal.stabilisation import MOST_DAMPED, Diagram

FIRST_STEPS = 8
"""Steps of the search that compares one number of modes with another."""
ABOUT = 5
"""Lines about a pole that tell how the references move."""
SHARPEST = 0.005
"""Relative standard deviation of a frequency that is good enough, however sharp its resonance."""
BEYOND = 0.15
"""How far outside the band a mode is sought first, as a share of its end."""
MOST_ADDED = 8
"""Modes that are added to those of the diagram at most."""


def starting_model(frf: Frf, noise: Noise, diagram: Diagram) -> ModalModel:
    """Return the chosen poles of a diagram with their shapes."""
    residues = diagram.shape[:, diagram.chosen].T.reshape(-1, len(frf.responses), len(frf.references))
    participation = np.linalg.svd(residues)[2][:, 0].T if len(residues) else np.zeros((len(frf.references), 0))
    return model_of(frf, noise, Poles(0, diagram.pole[diagram.chosen], participation.astype(complex)))


def select(
    frf: Frf, noise: Noise, start: ModalModel, candidates: np.ndarray | None, *, real: bool = False
) -> tuple[Likelihood, tuple[Rejected, ...]]:
    """Add modes to a start while the data ask for more, and leave out those that they don't.

    A mode stays where it lowers chi-squared by more than its numbers cost (Schwarz's criterion), is damped, and has a
    frequency that is known to within its resonance. What is added is a pole that was found in few orders, a mode split
    in two, or one just outside the band, where its tail is more than residuals can be.

    Args:
        frf: of the test.
        noise: of the functions.
        start: modes of the stabilisation diagram.
        candidates: poles [rad/s] that were found, but not in enough orders; None where a person chose the modes, so
            that only such outside the band are added.
        real: whether shapes are real.

    References:
        Schwarz, "Estimating the dimension of a model", Ann. Stat. 6, 1978.
    """
    fit, rejected = _begun(frf, noise, start, real)
    for _ in range(MOST_ADDED):
        more = _with_one_more(frf, noise, fit, _beyond(frf), real)
        if more is None and candidates is not None:
            more = _with_one_more(frf, noise, fit, _where_it_lacks(frf, noise, fit, candidates), real)
        larger, lost = (fit, []) if more is None else _pruned(frf, noise, more, real)
        if _schwarz(frf, larger) >= _schwarz(frf, fit):
            break
        fit, rejected = larger, [*rejected, *lost]
    return fit, tuple(rejected)


def _begun(frf: Frf, noise: Noise, start: ModalModel, real: bool) -> tuple[Likelihood, list[Rejected]]:
    """Return the fit of a start without what is no mode; where that loses one, with a mode outside the band if better.

    Where such a mode's tail is more than residuals can be, the search makes it of a mode that the start has within the
    band, which is lost then: the mode outside has to be there from the beginning.
    """
    found = _pruned(frf, noise, maximise(frf, noise, start, real=real), real)
    if not found[1]:
        return found
    starts = [_start_with(frf, noise, start, pole) for pole in _beyond(frf)]
    others = [_pruned(frf, noise, maximise(frf, noise, each, real=real), real) for each in starts]
    return min([found, *others], key=lambda each: _schwarz(frf, each[0]))


def _with_one_more(
    frf: Frf, noise: Noise, fit: Likelihood, poles: Iterable[np.ndarray], real: bool
) -> Likelihood | None:
    """Return the fit with the one of some poles that lowers chi-squared most; None where none lowers it enough."""
    starts = [_start_with(frf, noise, fit.model, pole) for pole in poles]
    below = fit.chi_squared - _price(frf, fit.model)
    fits = [maximise(frf, noise, start, real=real, steps=FIRST_STEPS, below=below) for start in starts]
    best = min(fits, key=lambda each: each.chi_squared, default=fit)
    if best.chi_squared > below:
        return None
    return maximise(frf, noise, best.model, real=real)


def _schwarz(frf: Frf, fit: Likelihood) -> float:
    return fit.chi_squared + len(fit.model.pole) * _price(frf, fit.model)


def _price(frf: Frf, model: ModalModel) -> float:
    """Return by how much a mode has to lower chi-squared."""
    return model.size * math.log(2 * frf.mean.size)


def _pruned(frf: Frf, noise: Noise, fit: Likelihood, real: bool) -> tuple[Likelihood, list[Rejected]]:
    """Leave out modes that are none, one at a time, the most doubtful first."""
    rejected: list[Rejected] = []
    while True:
        for r, why in _doubtful(frf, fit):
            without = maximise(frf, noise, fit.model.without(r), real=real)
            gain, price = without.chi_squared - fit.chi_squared, _price(frf, fit.model)
            if why or gain < price:
                why = why or f"chi-squared falls by {gain:.0f} only, where {price:.0f} is asked for"
                pole = fit.model.pole[r]
                rejected.append(Rejected(float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole)), why))
                fit = without
                break
        else:
            return fit, rejected


def _doubtful(frf: Frf, fit: Likelihood) -> list[tuple[int, str]]:
    """Return modes that may be none, the weakest first, with why where it is certain."""
    model, inside = fit.model, fit.model.inside(frf.frequency)
    ratio = -model.pole.real / np.abs(model.pole)
    rows = np.arange(len(model.pole)) * model.size + 1
    sd = np.sqrt(np.diag(fit.covariance))[rows] / np.abs(model.pole)
    why = {r: "its frequency is not known to within its resonance" for r in inside if sd[r] > max(ratio[r], SHARPEST)}
    why |= {r: f"damping ratio not between 0 and {MOST_DAMPED:g}" for r in inside if not 0 < ratio[r] < MOST_DAMPED}
    strength = [_strength(fit, r) for r in range(len(model.pole))]
    weak = [r for r in np.argsort(strength) if r in why or strength[r] < _price(frf, model)]
    return [(int(r), why.get(r, "")) for r in sorted(weak, key=lambda r: r not in why)]


def _strength(fit: Likelihood, r: int) -> float:
    """Return by about how much chi-squared falls by a mode: its shape as chi-squared (Wald)."""
    outputs = len(fit.model.shape)
    at = r * fit.model.size + np.arange(2, 2 + 2 * outputs)
    vector = fit.model.vector()[at]
    return float(vector @ np.linalg.pinv(fit.covariance[np.ix_(at, at)], hermitian=True) @ vector)


def _beyond(frf: Frf) -> list[np.ndarray]:
    """Return a pole below the band and one above."""
    ends = 2 * np.pi * frf.frequency[[0, -1]] * np.array([1 - BEYOND, 1 + BEYOND])
    return [np.array([end * (1j - 0.02)]) for end in ends]


def _where_it_lacks(frf: Frf, noise: Noise, fit: Likelihood, candidates: np.ndarray) -> Iterator[np.ndarray]:
    """Yield poles that may be missing: candidates, and modes in two, where the surroundings don't fit."""
    left = channels_of(frf.mean - fit.model.accelerance(2j * np.pi * frf.frequency + frf.decay))
    by_line = (np.abs(noise.by_line(left)) ** 2).mean(0)
    omega = 2 * np.pi * frf.frequency
    lacking, level = [], float(np.median(by_line))
    for pole in [*fit.model.pole, *candidates]:
        near = np.abs(omega - pole.imag) < max(3 * abs(pole.real), 4 * (omega[1] - omega[0]))
        expected = math.sqrt(2 / max(1, 2 * near.sum() * len(left)))
        lacking.append((by_line[near].mean() / level - 1) / expected if near.any() else 0.0)
    order = np.argsort(lacking)[::-1]
    for i in [i for i in order if lacking[i] > 3][:3]:
        if i < len(fit.model.pole):
            pole = fit.model.pole[i]
            yield np.array([pole - 0.7j * pole.real, pole + 0.7j * pole.real])
        else:
            yield candidates[i - len(fit.model.pole)][None]


def _start_with(frf: Frf, noise: Noise, model: ModalModel, poles: np.ndarray) -> ModalModel:
    """Return a start with one pole more: a new one, or two in place of the one that lies between them."""
    pole, participation = model.pole, model.participation
    if len(poles) == 2:
        split = np.argmin(np.abs(pole - poles.mean()))
        beside = participation[:, [split, split]]
        pole, participation = np.delete(pole, split), np.delete(participation, split, 1)
    else:
        beside = _participation(frf, noise, model, poles[0])
    return model_of(frf, noise, Poles(0, np.append(pole, poles), np.concatenate([participation, beside], 1)))


def _participation(frf: Frf, noise: Noise, model: ModalModel, pole: complex) -> np.ndarray:
    """Return how the references move by the residuals about a pole."""
    left = frf.mean - model.accelerance(2j * np.pi * frf.frequency + frf.decay)
    apart = np.abs(2 * np.pi * frf.frequency - pole.imag)
    near = apart <= max(2 * abs(pole.real), np.sort(apart)[ABOUT])
    rows = np.moveaxis(left[..., near], 1, 2).reshape(-1, left.shape[1])
    return np.linalg.svd(rows, full_matrices=False)[2][0][:, None]
