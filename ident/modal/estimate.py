"""From frequency response functions to modes with their joint covariance: the one entry."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float
from threadpoolctl import threadpool_limits

from ident.errors import InputError, Problem
from ident.modal.frf import Frf, Place
from ident.modal.jackknife import Ratio, jackknife, pooled
from ident.modal.likelihood import Likelihood
from ident.modal.modal_model import ModalModel
from ident.modal.noise import WEIGHED, noise_of
from ident.modal.selection import Rejected, select, starting_model
from ident.modal.stabilisation import Diagram, diagram_of

FEWEST_LINES = 20
"""Fewest lines of a band."""


@dataclass(frozen=True)
class Modes:
    """Modes of a test, ascending in frequency, with their joint covariance.

    Attributes:
        frequency: (m,) [Hz] undamped, |pole| / 2 pi.
        damping: (m,) [-] damping ratio.
        shape: (O, m) [1/kg] complex motion of each response, as product with that of the reference of the mode.
        participation: (I, m) [-] complex motion of each reference, one at the reference of the mode.
        covariance: (n, n) of frequencies, damping ratios, real and imaginary parts of the shapes mode by mode, scaled
            by the ratio and for the weights' own uncertainty; n = 2 m + 2 O m.
        ratio: of the scatter between hits to the covariance by maximum likelihood, which has scaled it.
        misfit: [-] chi-squared over degrees of freedom: one where the model explains all but the scatter of the hits.
        converged: whether the search for the most probable modes ended by its own criterion.
        model: modes with residuals of those outside the band, among which are modes where they are near.
        frf: the functions within the band.
        diagram: poles over orders.
        rejected: poles that were taken for no mode, with why.
    """

    frequency: Float[np.ndarray, "m"]
    damping: Float[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    participation: Complex[np.ndarray, "I m"]
    covariance: Float[np.ndarray, "n n"]
    ratio: Ratio
    misfit: float
    converged: bool
    model: ModalModel
    frf: Frf
    diagram: Diagram
    rejected: tuple[Rejected, ...]

    @property
    def responses(self) -> tuple[Place, ...]:
        """Places of the responses."""
        return self.frf.responses

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest line [Hz]."""
        return float(self.frf.frequency[0]), float(self.frf.frequency[-1])

    @property
    def sigma(self) -> Float[np.ndarray, "2 m"]:
        """(2, m) [Hz, -] standard deviations of frequencies and damping ratios."""
        return np.sqrt(np.diag(self.covariance))[: 2 * len(self.frequency)].reshape(2, -1)

    @property
    def correlation(self) -> Float[np.ndarray, "k k"]:
        """(2 m, 2 m) [-] of frequencies, then damping ratios."""
        count = 2 * len(self.frequency)
        sd = self.sigma.ravel()
        return self.covariance[:count, :count] / (sd[:, None] * sd)

    def of_shape(self, modes: Sequence[int]) -> Float[np.ndarray, "k k"]:
        """Return the joint covariance of the shapes of some modes: real parts, then imaginary ones, mode by mode."""
        count, outputs = 2 * len(self.frequency), 2 * len(self.shape)
        at = np.concatenate([count + mode * outputs + np.arange(outputs) for mode in modes])
        return self.covariance[np.ix_(at, at)]


@threadpool_limits.wrap(limits=1)  # matrices are small: threads of BLAS would mostly wait for each other
def modes_of(
    frf: Frf,
    *,
    band: tuple[float, float] | None = None,
    real: bool = False,
    near: Sequence[float] | None = None,
) -> Modes:
    """Identify the modes of a test with their joint covariance.

    Poles by poly-reference least squares over orders, those that last by themselves; then all modes at once by maximum
    likelihood, weighted by the scatter of the hits; leave-one-hit-out scales the covariance.

    Args:
        frf: frequency response functions with their single hits.
        band: (2,) [Hz] lines that count; all above 0 Hz when not given.
        real: whether shapes are real, as with proportional damping.
        near: (m,) [Hz] overrules the choice of modes: for each the pole of the diagram that lies nearest.

    Raises:
        InputError: the band has too few lines, there are too few hits, or no mode is found.
    """
    frf = within(frf, band)
    noise = noise_of(frf)
    diagram = diagram_of(frf, noise)
    if near is not None:
        diagram = chosen_near(diagram, near)
    start = starting_model(frf, noise, diagram)
    candidates = None if near is not None else diagram.pole[diagram.passing]
    fit, rejected = select(frf, noise, start, candidates, real=real)
    if not len(fit.model.inside(frf.frequency)):
        raise InputError(
            Problem("", "functions without a mode", "a resonance", "look at the functions and the band", "frf")
        )
    return _modes(fit, frf, diagram, rejected, jackknife(frf, noise, fit, real=real))


def within(frf: Frf, band: tuple[float, float] | None) -> Frf:
    """Return the functions at the lines of a band."""
    low, high = band or (0.0, math.inf)
    inside = (frf.frequency >= low) & (frf.frequency <= high) & (frf.frequency > 0)
    if inside.sum() < FEWEST_LINES:
        remedy = "widen the band, or record for longer"
        raise InputError(Problem("", f"{inside.sum()} lines in the band", f"{FEWEST_LINES} or more", remedy, "band"))
    if not np.isfinite(frf.hits[..., inside]).all():
        remedy = "look for a dead channel or a line without force"
        raise InputError(Problem("", "values that are not finite", "finite functions", remedy, "hits"))
    return replace(frf, frequency=frf.frequency[inside], hits=frf.hits[..., inside])


def chosen_near(diagram: Diagram, near: Sequence[float]) -> Diagram:
    """Return the diagram with the poles nearest to these frequencies chosen, of the highest orders."""
    if not len(diagram.pole):
        raise InputError(Problem("", "no stable pole", "poles near those frequencies", "look at the functions", "near"))
    latest = diagram.order / diagram.order.max() * 1e-3
    chosen = [int(np.argmin(np.abs(diagram.frequency - f) / f - latest)) for f in sorted(near)]
    if len(set(chosen)) < len(chosen):
        remedy = "name modes of which the diagram has poles"
        raise InputError(Problem("", "two frequencies with one pole", "a pole for each", remedy, "near"))
    return replace(diagram, chosen=np.array(chosen, int))


def together(tests: Sequence[Modes]) -> tuple[Modes, ...]:
    """Return the modes of several tests with covariances scaled by the ratio of all of them together."""
    ratio = pooled([modes.ratio for modes in tests])
    return tuple(
        replace(modes, covariance=modes.covariance * (ratio.scale / modes.ratio.scale), ratio=ratio) for modes in tests
    )


def _modes(fit: Likelihood, frf: Frf, diagram: Diagram, rejected: tuple[Rejected, ...], ratio: Ratio) -> Modes:
    model = fit.model
    order = model.inside(frf.frequency)
    pole = model.pole[order]
    slopes = _slopes(model, order)
    covariance = slopes @ fit.covariance @ slopes.T * (WEIGHED * ratio.scale)
    return Modes(
        np.abs(pole) / (2 * np.pi),
        -pole.real / np.abs(pole),
        model.shape[:, order],
        model.participation[:, order],
        covariance,
        ratio,
        fit.chi_squared / fit.freedom,
        fit.converged,
        model,
        frf,
        diagram,
        rejected,
    )


def _slopes(model: ModalModel, order: np.ndarray) -> Float[np.ndarray, "n v"]:
    """Return the derivative of frequencies, damping ratios and shapes by the model's vector."""
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
