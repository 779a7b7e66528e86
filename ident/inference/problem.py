"""What inference needs of a model and of data, whatever the model: a predict function, values, sigmas, unknowns."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.errors import InputError, Problem
from ident.inference.correlation import Correlation
from ident.inference.parameters import AnyArray, Parameters, library


class Data(NamedTuple):
    """What was measured, as a model sees it that has to tell what the values belong to.

    Attributes:
        measured: (D,) SI units.
        sigma: (D,) standard deviations; infinite for a value that must not help.
    """

    measured: Any
    sigma: Any


class Choice(NamedTuple):
    """What the values of a model belong to, where that is not sure from the start.

    Attributes:
        held: what the choice is known by at the next point; the model's own.
        settled: whether it is the most probable one here.
        cost: (D,) minus twice the logarithm of the probability of what was said of each value, such as a mode's label.
    """

    held: Any
    settled: Any
    cost: Any


class Choosing:
    """A model that chooses what the values belong to: anew at any point, or held from a point before.

    What it holds has three methods: `anew` lets it choose at the next point, with what the last one left unexplained;
    `ordered` and `likened` hold a choice by order and by likeness.
    """

    def unheld(self) -> Any:
        """Return what is held before the first step; None where there is nothing to choose."""
        raise NotImplementedError

    def holding(self, parameters: Mapping[str, Any], data: Data, held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict the values by the choice that is held."""
        raise NotImplementedError


class Growing:
    """A model of which few sizes of programs serve all data: it predicts what was measured repeatedly only once."""

    def padded(self) -> tuple["Growing", np.ndarray, np.ndarray]:
        """Return a model of one of few sizes, which of its own values each is like, and where each of its own is."""
        raise NotImplementedError

    def in_parts(self) -> "Parts | None":
        """Return a large model in parts of one size, None for one that stays whole."""
        return None


class Parts(NamedTuple):
    """A large model in parts of one size, so that one program of bounded memory serves all.

    Attributes:
        models: of each part; the first one is like the whole.
        source: (K, n) the whole's value that each value of each part is like.
        places: (D,) where each value of the whole is among all those of the parts, one part after the other.
        split: gives each part its own of what the whole holds.
        joined: puts together what the parts hold.
    """

    models: tuple[Any, ...]
    source: np.ndarray
    places: np.ndarray
    split: Callable[[Any], list[Any]]
    joined: Callable[[list[Any]], Any]


class Padded(NamedTuple):
    """A problem of one of few sizes, whose optima are those of another one.

    Attributes:
        problem: with one value for all that were measured of the same, and others that do not count.
        places: (D,) where each value of the other problem is.
        scatter: sum of squares that repeated values add to the cost wherever the parameters are.
    """

    problem: "InverseProblem"
    places: np.ndarray
    scatter: float


class InParts(NamedTuple):
    """A large problem in parts of one size.

    Attributes:
        problems: of each part, whose residuals are those of the whole together; the first one is like the whole.
        parts: of its model.
        scatter: sum of squares that repeated values add to the cost wherever the parameters are.
    """

    problems: "tuple[InverseProblem, ...]"
    parts: Parts
    scatter: float


class InverseProblem(eqx.Module):
    """Measured values and the model that predicts them.

    Attributes:
        model: `model(parameters) -> values (D, *batch)`, differentiable; parameters by path, `(*batch)` each. A plain
            function or an `equinox.Module` whose arrays may then change without a new compilation. One that chooses
            what its values belong to takes the data as well, see `Choosing`.
        measured: (D,) SI units.
        sigma: (D,) standard deviations; infinite for a value that is to be predicted but not fitted.
        parameters: the unknowns.
        kinds: (D,) kind of each value, a word.
        correlation: of the values' errors; None where they are independent. Change `sigma` by `with_sigma` then.
        vectors: (D,) number of the vector that each value is a component of, one of its own for any other value; None
            where there are no vectors.
    """

    model: Callable[..., Float[Array, "D *batch"]]
    measured: Float[AnyArray, "D"]
    sigma: Float[AnyArray, "D"]
    parameters: Parameters
    kinds: tuple[str, ...] = eqx.field(static=True)
    correlation: Correlation | None = None
    vectors: Int[np.ndarray, "D"] | None = None

    def __check_init__(self) -> None:
        """Refuse values and sigmas that can't be, which a search would only meet as a model without an answer.

        Raises:
            InputError: a measured value that is not finite, or a sigma that is not above zero.
        """
        if isinstance(self.measured, jax.core.Tracer) or isinstance(self.sigma, jax.core.Tracer):
            return
        measured, sigma = np.asarray(self.measured, float), np.asarray(self.sigma, float)
        remedy = "leave that value out"
        problems = [
            _wrong("measured", int(i), measured[i], "a finite number", remedy)
            for i in np.flatnonzero(~np.isfinite(measured))
        ]
        remedy = "give its standard deviation, infinite for a value that is only to be predicted"
        problems += [_wrong("sigma", int(i), sigma[i], "a number > 0", remedy) for i in np.flatnonzero(~(sigma > 0))]
        if problems:
            raise InputError(problems)

    def predict(self, theta: Float[Array, "P *batch"]) -> Float[Array, "D *batch"]:
        """Predict all values at theta, by the most probable choice where the model has one."""
        parameters = self.parameters.by_path(self.parameters.values(theta))
        return self.model(parameters, self.data) if isinstance(self.model, Choosing) else self.model(parameters)

    def holding(self, theta: Float[Array, "P"], held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict all values at theta by the choice that is held."""
        if not isinstance(self.model, Choosing) or held is None:
            return self.predict(theta), Choice(None, jnp.array(True), jnp.zeros_like(self.sigma))
        return self.model.holding(self.parameters.by_path(self.parameters.values(theta)), self.data, held)

    def unheld(self) -> Any:
        """Return what the model holds before the first step; None where it chooses nothing."""
        return self.model.unheld() if isinstance(self.model, Choosing) else None

    def padded(self) -> Padded:
        """Return the same problem in one of few sizes, repeated values as their mean; they may come in another order.

        With weights w = 1/sigma^2, the sum of w (predicted - measured)^2 over repeated values is that of their mean,
        W (predicted - mean)^2 with W the sum of w, and their scatter about it, which no parameter changes.
        """
        if not isinstance(self.model, Growing):
            return Padded(self, np.arange(len(self.kinds)), 0.0)
        model, source, places = self.model.padded()
        mean, spread, scatter = self.pooled(source, places)
        kinds = tuple(self.kinds[i] for i in source)
        return Padded(InverseProblem(model, mean, spread, self.parameters, kinds), places, scatter)

    def in_parts(self) -> "InParts | None":
        """Return a large problem in parts of one size, repeated values as their mean; None for one that stays whole.

        One with correlated errors, which have no such mean, is in one part if it is not large: predicted like any
        other, and weighed as it is.
        """
        if not isinstance(self.model, Growing):
            return None
        parts = self.model.in_parts() or (None if self.correlation is None else _one_part(*self.model.padded()))
        if parts is None:
            return None
        mean, spread, scatter = self.pooled(parts.source.ravel(), parts.places)
        values = (np.reshape(x, parts.source.shape) for x in (mean, spread))
        each = zip(parts.models, parts.source, *values, strict=True)
        problems = tuple(
            InverseProblem(model, own, sd, self.parameters, tuple(self.kinds[i] for i in source))
            for model, source, own, sd in each
        )
        return InParts(problems, parts, scatter)

    def pooled(self, source: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return mean, standard deviation and scatter of what was measured repeatedly; infinite sd where nothing was.

        Args:
            source: (n,) which of the problem's values each of the others is like.
            places: (D,) which of the others each of the problem's is.
        """
        measured, sigma = np.asarray(self.measured), np.asarray(self.sigma)
        weight = sigma**-2.0
        total = np.bincount(places, weight, len(source))
        several = (np.bincount(places, minlength=len(source)) > 1) & (total > 0)
        known = np.where(several, total, 1.0)
        mean = np.where(several, np.bincount(places, weight * measured, len(source)) / known, measured[source])
        alone = np.full(len(source), np.inf)
        alone[places] = sigma
        spread = np.where(several, known**-0.5, np.where(total > 0, alone, np.inf))
        scatter = float((((measured - mean[places]) / sigma)[several[places]] ** 2).sum())
        return mean, spread, scatter

    @property
    def data(self) -> Data:
        """What was measured."""
        return Data(self.measured, self.sigma)

    def scaled(self, x: Float[AnyArray, "D *batch"]) -> Any:
        """Return what values differ by as independent numbers of standard deviation 1, `(D, *batch)`: L^-1 x / sigma.

        L is the Cholesky factor of the correlation of a group's errors, 1 for a value in no group; a value that is not
        fitted counts nothing.
        """
        xp = library(x)
        sigma = np.asarray(self.sigma) if xp is np else self.sigma
        each = x / sigma.reshape((-1,) + (1,) * (x.ndim - 1))
        return each if self.correlation is None else self.correlation.whiten(each)

    def correlated(self, x: Float[np.ndarray, "D *batch"]) -> Float[np.ndarray, "D *batch"]:
        """Return independent standard normal numbers as errors in sigma, correlated as those of the values: L x."""
        return x if self.correlation is None else self.correlation.color(x)

    def correlations(self, places: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n n"]:
        """Return the correlation of the errors of some values."""
        return np.eye(len(places)) if self.correlation is None else self.correlation.matrix(places)

    def with_sigma(self, sigma: Float[np.ndarray, "D"]) -> "InverseProblem":
        """Return the problem with other standard deviations; one that is infinite takes its value out of its group."""
        counts = np.isfinite(sigma)
        problem = eqx.tree_at(lambda p: p.sigma, self, jax.device_put(np.asarray(sigma)))
        if self.correlation is None:
            return problem
        return eqx.tree_at(lambda p: p.correlation, problem, jax.device_put(self.correlation.among(counts)))

    def weigh(
        self, predicted: Float[AnyArray, "D"], jacobian: Float[AnyArray, "D P"], theta: Float[AnyArray, "P"]
    ) -> tuple[Float[AnyArray, "D+P"], Float[AnyArray, "D+P P"]]:
        """Return residuals and their Jacobian by theta.

        The residuals are (predicted - measured) / sigma, made independent within groups (`scaled`), then those of the
        priors, so half their sum of squares is the negative logarithm of the posterior density, up to a constant.
        """
        prior, slope = self.parameters.prior_residuals(theta)
        xp = library(predicted, jacobian, theta)
        measured = np.asarray(self.measured) if xp is np else self.measured
        residuals = xp.concatenate([self.scaled(predicted - measured), prior])
        return residuals, xp.concatenate([self.scaled(jacobian), xp.diag(slope)])

    def without(self, kind: str) -> "InverseProblem":
        """Return the problem in which values of one kind are predicted but not fitted."""
        return self.with_sigma(np.where(np.array(self.kinds) == kind, np.inf, np.asarray(self.sigma)))


def _one_part(model: Growing, source: np.ndarray, places: np.ndarray) -> Parts:
    return Parts((model,), source[None], places, lambda held: [held], lambda held: held[0])


def _wrong(name: str, place: int, value: float, expected: str, remedy: str) -> Problem:
    return Problem(f"value {place + 1}", f"{value:g}", expected, remedy, f"`{name}`")
