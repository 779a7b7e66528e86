"""Modes of a test by maximum likelihood, with their joint covariance: selection, estimate, jackknife."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float
from scipy.stats import chi2, t
from threadpoolctl import threadpool_limits

from ident.errors import require
from ident.modal.frf import Frf
from ident.modal.parameters import ModalParameters, Rejected
from ident.modal.poles import (
    MOST_DAMPED,
    WEIGHED,
    Diagram,
    ModalModel,
    Noise,
    Poles,
    channels_of,
    diagram_of,
    model_of,
    noise_of,
)

# -------- Likelihood
# All modes at once by maximum likelihood, with their joint covariance.

STEPS = 60
"""Most steps of a search."""
SMALL = 1e-4
"""Change of chi-squared that ends a search; one is a standard deviation."""

CHORDS = 4
"""Steps with fixed slopes to a neighbouring estimate."""
SETTLED = 0.01
"""Change of chi-squared below which such steps have converged."""
FALLBACK = 8
"""Steps of a full search where they do not converge."""


@dataclass(frozen=True)
class Likelihood:
    """Maximum-likelihood estimate of all modes of a test.

    Attributes:
        model: the modes with the residuals.
        covariance: (n, n) of the model's vector: the inverse of the full information matrix.
        chi_squared: [-] of the whitened residuals.
        freedom: number of residuals minus that of parameters.
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


def maximise(frf: Frf, noise: Noise, start: ModalModel, *, steps: int = STEPS, below: float = math.inf) -> Likelihood:
    """Search the modes of maximum likelihood for the averaged functions, by Levenberg and Marquardt's method.

    Args:
        frf: of the test.
        noise: of the functions.
        start: starting modes.
        steps: at most.
        below: target for chi-squared within these steps. The search stops if the larger of the last two gains, repeated
            over all remaining steps, would miss it.
    """
    s, mean = 2j * np.pi * frf.frequency + frf.decay, channels_of(frf.mean)
    model, cost, damping, converged, before = start, _cost(mean, noise, start, s), 1e-3, False, math.inf
    for left in reversed(range(steps)):
        residual = noise.whiten(mean - channels_of(model.accelerance(s)))
        slopes = noise.whiten(channels_of(model.slopes(s)))
        gradient, information = slopes @ residual, slopes @ slopes.T
        scale = np.sqrt(np.diag(information))
        scaled = information / (scale[:, None] * scale)
        while damping < 1e8:
            step = scipy.linalg.solve(scaled + damping * np.eye(len(scale)), gradient / scale, assume_a="pos") / scale
            new = model.replace(model.vector() + step)
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
    covariance = np.linalg.pinv(information / (scale[:, None] * scale), hermitian=True) / (scale[:, None] * scale)
    return Likelihood(model, covariance, cost, 2 * mean.size - len(scale), converged)


def nearby(frf: Frf, noise: Noise, fit: Likelihood, others: Sequence[Frf]) -> Float[np.ndarray, "h n"]:
    """Return the vectors of estimates from functions that differ little from those of a fit.

    Takes steps with the slopes and the information of the fit. Where these diverge, for example with a poorly
    determined mode outside the band, it searches.
    """
    s, vector = 2j * np.pi * frf.frequency + frf.decay, fit.model.vector()
    gain = fit.covariance @ noise.whiten(channels_of(fit.model.slopes(s)))
    vectors = []
    for other in others:
        own, mean = vector, channels_of(other.mean)
        costs = []
        for _ in range(CHORDS):
            residual = noise.whiten(mean - channels_of(fit.model.replace(own).accelerance(s)))
            costs.append(float(residual @ residual))
            own = own + gain @ residual
        settled = _is_sound(fit.model.replace(own)) and abs(costs[-1] - costs[-2]) < SETTLED and costs[-1] < costs[0]
        vectors.append(own if settled else maximise(other, noise, fit.model, steps=FALLBACK).model.vector())
    return np.array(vectors)


def _is_sound(model: ModalModel) -> bool:
    return bool((model.pole.imag > 0).all() and np.isfinite(model.vector()).all())


def _cost(mean: Complex[np.ndarray, "K F"], noise: Noise, model: ModalModel, s: np.ndarray) -> float:
    return float((noise.whiten(mean - channels_of(model.accelerance(s))) ** 2).sum())


# -------- Jackknife
# Check of the maximum-likelihood covariance by the hits themselves: leave-one-hit-out.

NOTICED = 0.1
"""Relative change of a standard error from which a scatter ratio outside its band matters; assumed."""
BAND = 0.99
"""Probability that the ratio lies in its band if the covariance is right."""


@dataclass(frozen=True)
class Ratio:
    """Variance by leave-one-hit-out over that by maximum likelihood, for poles, pooled.

    Attributes:
        value: [-] pooled over poles (and postures).
        freedom: degrees of freedom: real numbers of the poles, times the number of hits minus one.
        effect: largest change of a reported standard error, as a logarithm; infinite where none is reported.
    """

    value: float
    freedom: int
    effect: float = math.inf

    @property
    def band(self) -> tuple[float, float]:
        """99 % interval of the ratio if the covariance is right."""
        low, high = chi2.interval(BAND, self.freedom)
        return float(low) / self.freedom, float(high) / self.freedom

    @property
    def outside(self) -> bool:
        """Whether the ratio lies outside this band."""
        low, high = self.band
        return not low <= self.value <= high

    @property
    def doubtful(self) -> bool:
        """Whether the ratio lies outside this band and changes reported standard errors."""
        return self.outside and self.effect > NOTICED

    @property
    def scale(self) -> float:
        """[-] factor on the covariance: the ratio times the square of Student's t over the normal at 95 %."""
        return self.value * (float(t.isf(0.025, self.freedom)) / 1.959964) ** 2


def jackknife(frf: Frf, noise: Noise, fit: Likelihood) -> Ratio:
    """Repeat the estimate without each hit in turn and compare the scatter of the poles with the covariance.

    Var = (H - 1) / H sum_h (x_h - mean)^2, as a squared distance in the covariance of all poles, which accounts for the
    correlated errors of close modes.

    References:
        Efron, Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 11.
    """
    count, size = len(frf.hits), fit.model.size
    poles = np.ravel([[r * size, r * size + 1] for r in fit.model.inside(frf.frequency)])
    others = [replace(frf, hits=np.delete(frf.hits, h, 0)) for h in range(count)]
    without = nearby(frf, noise, fit, others)[:, poles]
    apart = without - without.mean(0)
    precision = np.linalg.inv(fit.covariance[np.ix_(poles, poles)])
    value = (count - 1) / count * (apart @ precision * apart).sum() / len(poles)
    return Ratio(float(value), len(poles) * (count - 1))


def pooled(ratios: Sequence[Ratio]) -> Ratio:
    """Return the pooled ratio of several tests."""
    freedom = sum(ratio.freedom for ratio in ratios)
    return Ratio(float(sum(ratio.value * ratio.freedom for ratio in ratios) / freedom), freedom)


# -------- Selection
# Number of modes of a test: only those that the data support, with the reason for each rejected one.

FIRST_STEPS = 8
"""Steps of a search that compares two numbers of modes."""
ABOUT = 5
"""Fewest lines around a pole to estimate its participation."""
SHARPEST = 0.005
"""Relative standard deviation of a frequency that is sufficient, however sharp its resonance; assumed."""
BEYOND = 0.15
"""Starting distance of a mode outside the band from its end, relative to that frequency; assumed."""
MOST_ADDED = 8
"""Most modes added to those of the diagram."""


def starting_model(frf: Frf, noise: Noise, diagram: Diagram) -> ModalModel:
    """Return the chosen poles of a diagram with their shapes."""
    residues = diagram.shape[:, diagram.chosen].T.reshape(-1, len(frf.responses), len(frf.references))
    participation = np.linalg.svd(residues)[2][:, 0].T if len(residues) else np.zeros((len(frf.references), 0))
    return model_of(frf, noise, Poles(0, diagram.pole[diagram.chosen], participation.astype(complex)))


def select(
    frf: Frf, noise: Noise, start: ModalModel, candidates: np.ndarray | None
) -> tuple[Likelihood, tuple[Rejected, ...]]:
    """Add modes to a start while the data support more, and drop the unsupported ones.

    A mode stays if it lowers chi-squared by more than its parameters cost (Schwarz's criterion), is damped, and has a
    frequency uncertainty below its resonance width. Candidates are poles of few orders, modes split in two, and modes
    just outside the band whose tail the residuals cannot represent.

    Args:
        frf: of the test.
        noise: of the functions.
        start: modes of the stabilisation diagram.
        candidates: poles [rad/s] of too few orders; None where a person chose the modes, so that modes are added only
            outside the band.

    References:
        Schwarz, "Estimating the dimension of a model", Ann. Stat. 6, 1978.
    """
    fit, rejected = _begun(frf, noise, start)
    for _ in range(MOST_ADDED):
        more = _with_one_more(frf, noise, fit, _beyond(frf))
        if more is None and candidates is not None:
            more = _with_one_more(frf, noise, fit, _where_it_lacks(frf, noise, fit, candidates))
        larger, lost = (fit, []) if more is None else _pruned(frf, noise, more)
        if _schwarz(frf, larger) >= _schwarz(frf, fit):
            break
        fit, rejected = larger, [*rejected, *lost]
    return fit, tuple(rejected)


def _begun(frf: Frf, noise: Noise, start: ModalModel) -> tuple[Likelihood, list[Rejected]]:
    """Return the pruned fit of a start; if that loses a mode, also try with one outside the band, and take the better.

    If the residuals cannot represent the tail of a mode outside the band, the search models it with a mode of the start
    within the band, which is then lost. So the outside mode must be in the start.
    """
    found = _pruned(frf, noise, maximise(frf, noise, start))
    if not found[1]:
        return found
    starts = [_start_with(frf, noise, start, pole) for pole in _beyond(frf)]
    others = [_pruned(frf, noise, maximise(frf, noise, each)) for each in starts]
    return min([found, *others], key=lambda each: _schwarz(frf, each[0]))


def _with_one_more(frf: Frf, noise: Noise, fit: Likelihood, poles: Iterable[np.ndarray]) -> Likelihood | None:
    """Return the fit with the pole that lowers chi-squared most; None if no pole lowers it enough."""
    starts = [_start_with(frf, noise, fit.model, pole) for pole in poles]
    below = fit.chi_squared - _price(frf, fit.model)
    fits = [maximise(frf, noise, start, steps=FIRST_STEPS, below=below) for start in starts]
    best = min(fits, key=lambda each: each.chi_squared, default=fit)
    return None if best.chi_squared > below else maximise(frf, noise, best.model)


def _schwarz(frf: Frf, fit: Likelihood) -> float:
    return fit.chi_squared + len(fit.model.pole) * _price(frf, fit.model)


def _price(frf: Frf, model: ModalModel) -> float:
    """Return the decrease of chi-squared that justifies a mode."""
    return model.size * math.log(2 * frf.mean.size)


def _pruned(frf: Frf, noise: Noise, fit: Likelihood) -> tuple[Likelihood, list[Rejected]]:
    """Drop spurious modes one at a time, the most doubtful first."""
    rejected: list[Rejected] = []
    while True:
        for r, why in _doubtful(frf, fit):
            without = maximise(frf, noise, fit.model.without(r))
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
    """Return possibly spurious modes, certain ones first and then the weakest, with the reason where it is certain."""
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
    """Return the approximate decrease of chi-squared by a mode: the Wald statistic of its shape."""
    at = r * fit.model.size + np.arange(2, 2 + 2 * len(fit.model.shape))
    vector = fit.model.vector()[at]
    return float(vector @ np.linalg.pinv(fit.covariance[np.ix_(at, at)], hermitian=True) @ vector)


def _beyond(frf: Frf) -> list[np.ndarray]:
    """Return a pole below the band and one above."""
    ends = 2 * np.pi * frf.frequency[[0, -1]] * np.array([1 - BEYOND, 1 + BEYOND])
    return [np.array([end * (1j - 0.02)]) for end in ends]


def _where_it_lacks(frf: Frf, noise: Noise, fit: Likelihood, candidates: np.ndarray) -> Iterator[np.ndarray]:
    """Yield poles that may be missing where the fit is poor: candidates, and modes split in two."""
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
    """Return a start with one more pole: a new one, or two in place of the one between them."""
    pole, participation = model.pole, model.participation
    if len(poles) == 2:
        split = np.argmin(np.abs(pole - poles.mean()))
        beside = participation[:, [split, split]]
        pole, participation = np.delete(pole, split), np.delete(participation, split, 1)
    else:
        beside = _participation(frf, noise, model, poles[0])
    return model_of(frf, noise, Poles(0, np.append(pole, poles), np.concatenate([participation, beside], 1)))


def _participation(frf: Frf, noise: Noise, model: ModalModel, pole: complex) -> np.ndarray:
    """Return the participation of the references from the residuals around a pole."""
    left = frf.mean - model.accelerance(2j * np.pi * frf.frequency + frf.decay)
    apart = np.abs(2 * np.pi * frf.frequency - pole.imag)
    near = apart <= max(2 * abs(pole.real), np.sort(apart)[ABOUT])
    rows = np.moveaxis(left[..., near], 1, 2).reshape(-1, left.shape[1])
    return np.linalg.svd(rows, full_matrices=False)[2][0][:, None]


# -------- Estimate
# Entry point: from frequency response functions to modes with their joint covariance.

FEWEST_LINES = 20
"""Fewest lines of a band."""


@dataclass(frozen=True)
class Modes(ModalParameters):
    """Modes of a hammer test, with scaled shapes.

    The covariance is scaled by the ratio, and for the uncertainty of the weights. A shape is multiplied by the motion
    at the mode's reference [1/kg].

    Attributes:
        participation: (I, m) [-] complex motion of each reference, one at the reference of the mode.
        ratio: scatter between hits over the maximum-likelihood covariance, already applied to the covariance.
        misfit: [-] chi-squared over degrees of freedom: one where the model explains all but the scatter of the hits.
        converged: whether the search ended by its own criterion.
        model: all modes, including close ones outside the band, and residuals of the others.
        frf: the functions within the band.
    """

    participation: Complex[np.ndarray, "I m"]
    ratio: Ratio
    misfit: float
    converged: bool
    model: ModalModel
    frf: Frf

    @property
    def doubtful(self) -> bool:
        """Whether the scatter of the hits contradicts the maximum-likelihood covariance noticeably."""
        return self.ratio.doubtful

    @property
    def fitted(self) -> Complex[np.ndarray, "O I F"]:
        """Frequency responses of the modes [1/kg], at the lines within the band."""
        return self.model.accelerance(2j * np.pi * self.frf.frequency + self.frf.decay)


@threadpool_limits.wrap(limits=1)  # matrices are small: threads of BLAS would mostly wait for each other
def modes_of(frf: Frf, *, band: tuple[float, float] | None = None, near: Sequence[float] | None = None) -> Modes:
    """Identify the modes of a test with their joint covariance.

    Takes the stable poles of poly-reference least squares over orders; then fits all modes at once by maximum
    likelihood, weighted by the scatter of the hits. Leave-one-hit-out scales the covariance.

    Args:
        frf: frequency response functions with their single hits.
        band: (2,) [Hz] lines to use; by default all above 0 Hz.
        near: (m,) [Hz] overrides the choice of modes: the nearest pole of the diagram for each.

    Raises:
        InputError: too few lines in the band, too few hits, or no mode.
    """
    frf = within(frf, band)
    noise = noise_of(frf)
    every = diagram_of(frf, noise)
    diagram = every if near is None else chosen_near(every, near)
    start = starting_model(frf, noise, diagram)
    candidates = None if near is not None else diagram.pole[diagram.passing]
    fit, rejected = select(frf, noise, start, candidates)
    any_mode, remedy = len(fit.model.inside(frf.frequency)), "look at the functions and the band"
    require(any_mode, "", "functions without a mode", "a resonance", remedy, "frf")
    return _modes(fit, frf, diagram, rejected, jackknife(frf, noise, fit))


def within(frf: Frf, band: tuple[float, float] | None) -> Frf:
    """Return the functions at the lines of a band."""
    low, high = band or (0.0, math.inf)
    inside = (frf.frequency >= low) & (frf.frequency <= high) & (frf.frequency > 0)
    got, remedy = f"{inside.sum()} lines in the band", "widen the band, or record for longer"
    require(inside.sum() >= FEWEST_LINES, "", got, f"{FEWEST_LINES} or more", remedy, "band")
    finite, remedy = np.isfinite(frf.hits[..., inside]).all(), "look for a dead channel or a line without force"
    require(finite, "", "values that are not finite", "finite functions", remedy, "hits")
    return replace(frf, frequency=frf.frequency[inside], hits=frf.hits[..., inside])


def chosen_near(diagram: Diagram, near: Sequence[float]) -> Diagram:
    """Return the diagram with a choice of the poles nearest to these frequencies, preferring high orders."""
    any_pole = len(diagram.pole)
    require(any_pole, "", "no stable pole", "poles near those frequencies", "look at the functions", "near")
    latest = diagram.order / diagram.order.max() * 1e-3
    chosen = [int(np.argmin(np.abs(diagram.frequency - f) / f - latest)) for f in sorted(near)]
    all_differ, remedy = len(set(chosen)) == len(chosen), "name modes of which the diagram has poles"
    require(all_differ, "", "two frequencies with one pole", "a pole for each", remedy, "near")
    return replace(diagram, chosen=np.array(chosen, int))


def together(tests: Sequence[Modes]) -> tuple[Modes, ...]:
    """Return the modes of several tests with covariances scaled by their pooled ratio."""
    if not tests:
        return ()
    ratio = pooled([modes.ratio for modes in tests])
    scaled = [modes.covariance * (ratio.scale / modes.ratio.scale) for modes in tests]
    return tuple(replace(modes, covariance=own, ratio=ratio) for modes, own in zip(tests, scaled, strict=True))


def _modes(fit: Likelihood, frf: Frf, diagram: Diagram, rejected: tuple[Rejected, ...], ratio: Ratio) -> Modes:
    model = fit.model
    order = model.inside(frf.frequency)
    pole = model.pole[order]
    slopes = _slopes(model, order)
    covariance = slopes @ fit.covariance @ slopes.T * (WEIGHED * ratio.scale)
    frequency, damping = np.abs(pole) / (2 * np.pi), -pole.real / np.abs(pole)
    band = float(frf.frequency[0]), float(frf.frequency[-1])
    return Modes(
        frequency, damping, model.shape[:, order], covariance, frf.responses, band, diagram, rejected,
        model.participation[:, order], ratio, fit.chi_squared / fit.freedom, fit.converged, model, frf,
    )  # fmt: skip


def _slopes(model: ModalModel, order: np.ndarray) -> Float[np.ndarray, "n v"]:
    """Return the derivatives of frequencies, damping ratios and shapes with respect to the model's vector."""
    modes, outputs = len(order), 2 * len(model.shape)
    out = np.zeros(((2 + outputs) * modes, len(model.vector())))
    for place, r in enumerate(order):
        pole, own = model.pole[r], r * model.size
        size = abs(pole)
        out[place, own : own + 2] = np.array([pole.real, pole.imag]) / (2 * np.pi * size)
        out[modes + place, own : own + 2] = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        rows = 2 * modes + place * outputs
        out[rows : rows + outputs, own + 2 : own + 2 + outputs] = np.eye(outputs)
    return out
