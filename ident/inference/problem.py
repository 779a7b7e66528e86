"""The interface of inference to any model and its data: a predict function, values, sigmas, unknowns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from operator import itemgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.errors import Problem, refusal, refuse, require
from ident.inference.parameters import AnyArray, Parameter, Parameters, library
from ident.text import did_you_mean

# -------- Correlation
# Values with correlated errors, in groups: their residuals are whitened group by group.
#
# With the correlation R of a group's errors and L L' = R, the numbers L^-1 (predicted - measured) / sigma are
# independent with standard deviation 1 (whitening: generalised least squares, Aitken, Proc. R. Soc. Edinburgh 55,
# 1936).

OWN_MIN = 1e-4
"""Least independent part of an error's standard deviation, given the other errors of its group."""


class Block(eqx.Module):
    """Groups of one size.

    Attributes:
        rows: (G, n) indices of each group's values.
        correlation: (G, n, n) of their errors.
        whitening: (G, n, n) inverse of its Cholesky factor over the fitted values; zero for the others.
        log_det: (G,) half the logarithm of its determinant over the fitted values.
    """

    rows: Int[AnyArray, "G n"]
    correlation: Float[AnyArray, "G n n"]
    whitening: Float[AnyArray, "G n n"]
    log_det: Float[AnyArray, "G"]


class Correlation(eqx.Module):
    """Which values have correlated errors, and how.

    Attributes:
        single: (S,) indices of the values without a group.
        blocks: groups, by size.
        order: (D,) index of each value in the sequence of single values, then those of the blocks.
    """

    single: Int[AnyArray, "S"]
    blocks: tuple[Block, ...]
    order: Int[AnyArray, "D"]

    def whiten(self, x: Float[AnyArray, "D *batch"]) -> Any:
        """Return whitened combinations, `(D, *batch)`, of the residuals over sigma: L^-1 x by group."""
        return self._mixed(x, [block.whitening for block in self.blocks])

    def pull_back(self, x: Float[np.ndarray, "D *batch"]) -> Float[np.ndarray, "D *batch"]:
        """Return L'^-1 x for each group: from whitened combinations back to values, the adjoint of `whiten`."""
        return np.asarray(self._mixed(x, [np.asarray(block.whitening).swapaxes(1, 2) for block in self.blocks]))

    def color(self, x: Float[np.ndarray, "D *batch"]) -> Float[np.ndarray, "D *batch"]:
        """Return L x for each group: correlated numbers from independent ones."""
        return np.asarray(self._mixed(x, [np.linalg.cholesky(block.correlation) for block in self.blocks]))

    def _mixed(self, x: AnyArray, matrices: Sequence[AnyArray]) -> Any:
        """Return the values of each group multiplied by its matrix, the others unchanged."""
        if not self.blocks:
            return x
        xp = library(x)
        parts = [x[self.single]]
        for block, matrix in zip(self.blocks, matrices, strict=True):
            parts.append(xp.einsum("gij,gj...->gi...", matrix, x[block.rows]).reshape((-1, *x.shape[1:])))
        return xp.concatenate(parts)[self.order]

    def inverse_among(self, places: Int[np.ndarray, "N K"]) -> Float[np.ndarray, "N K K"]:
        """Return the elements of R^-1 between the values of each of several sets."""
        whitening = [np.asarray(block.whitening) for block in self.blocks]
        return self._elements(places, [np.einsum("gji,gjk->gik", W, W) for W in whitening])

    def matrix(self, places: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n n"]:
        """Return the correlation of the errors of some values."""
        return self._elements(places[None], [np.asarray(block.correlation) for block in self.blocks])[0]

    def _elements(self, places: Int[np.ndarray, "N K"], matrices: Sequence[np.ndarray]) -> Float[np.ndarray, "N K K"]:
        """Return the elements of a block matrix, given group by group, between the values of several sets."""
        found = (places[:, :, None] == places[:, None]).astype(float)
        for block, matrix in zip(self.blocks, matrices, strict=True):
            rows = np.asarray(block.rows)
            group, member = np.full(len(self.order), -1), np.zeros(len(self.order), int)
            group[rows], member[rows] = np.arange(len(rows))[:, None], np.arange(rows.shape[1])
            own, at = group[places], member[places]
            both = own[:, :, None] == own[:, None]
            inside = matrix[own[:, :, None], at[:, :, None], at[:, None]]
            found = np.where(own[:, :, None] < 0, found, np.where(both, inside, 0.0))
        return found

    def moved(self, source: Int[np.ndarray, "D"]) -> "Correlation":
        """Return the same for values moved to other rows, each with its error: row i gets that of source[i]."""
        to = np.argsort(source)
        blocks = (eqx.tree_at(lambda b: b.rows, block, to[np.asarray(block.rows)]) for block in self.blocks)
        return _made(len(to), tuple(blocks))

    @property
    def precision(self) -> Float[np.ndarray, "D"]:
        """Diagonal of the inverse of the whole correlation; 0 for a value of a group that is not fitted."""
        parts = [np.ones(len(self.single))]
        parts += [(np.asarray(block.whitening) ** 2).sum(1).ravel() for block in self.blocks]
        return np.concatenate(parts)[np.asarray(self.order)]

    @property
    def log_det(self) -> Any:
        """Half the logarithm of the determinant of the whole correlation."""
        return sum(block.log_det.sum() for block in self.blocks)

    @property
    def groups(self) -> Int[np.ndarray, "D"]:
        """Number of each value's group, from 0; -1 for none."""
        found, number = np.full(len(self.order), -1), 0
        for block in self.blocks:
            for rows in np.asarray(block.rows):
                found[rows] = number
                number += 1
        return found

    def among(self, counts: Bool[np.ndarray, "D"]) -> "Correlation":
        """Return the same with only some values fitted; a group's correlation omits the others."""
        return _made(len(self.order), tuple(_block(block.rows, block.correlation, counts) for block in self.blocks))


def correlation(
    groups: Sequence[tuple[Sequence[int], Float[np.ndarray, "_ _"]]], counts: Bool[np.ndarray, "D"]
) -> Correlation | None:
    """Return the correlation of values.

    Args:
        groups: indices of each group's values, and the correlation of their errors; a value has at most one group.
        counts: (D,) whether a value is fitted.

    Returns:
        None if nothing is correlated.

    Raises:
        InputError: an impossible correlation.
    """
    sizes = sorted({len(rows) for rows, _ in groups})
    of_size = [[each for each in groups if len(each[0]) == size] for size in sizes]
    blocks = [(np.array([rows for rows, _ in own], int), np.array([R for _, R in own], float)) for own in of_size]
    return _made(len(counts), tuple(_block(*each, counts) for each in blocks)) if blocks else None


def _made(count: int, blocks: tuple[Block, ...]) -> Correlation:
    grouped = np.concatenate([np.zeros(0, int), *(block.rows.ravel() for block in blocks)])
    single = np.setdiff1d(np.arange(count), grouped)
    return Correlation(single, blocks, np.argsort(np.concatenate([single, grouped])))


def _block(rows: AnyArray, correlation: AnyArray, counts: np.ndarray) -> Block:
    rows, R = np.asarray(rows), np.asarray(correlation)
    used = counts[rows]
    both = used[:, :, None] & used[:, None, :]
    try:
        L = np.linalg.cholesky(np.where(both, R, np.eye(R.shape[-1])))
    except np.linalg.LinAlgError:
        expected = "a positive definite correlation in each group"
        raise refusal("", "errors that can't be so correlated", expected, "correct the covariance") from None
    own = np.diagonal(L, axis1=1, axis2=2)
    if (least := own.min(initial=1.0)) < OWN_MIN:
        got = f"an error that the others of its group fix to {least:.2g} of its standard deviation"
        remedy = "leave out the value that the others repeat, or correct the covariance"
        raise refusal("", got, f"at least {OWN_MIN:g}", remedy)
    log_det = np.log(own).sum(1)
    return Block(rows, R, np.where(both, np.linalg.inv(L), 0.0), log_det)


# -------- Problem


class Data(NamedTuple):
    """Measured values for a model that assigns them to modes.

    Attributes:
        measured: (D,) SI units.
        sigma: (D,) standard deviations; infinite for a value to ignore.
    """

    measured: Any
    sigma: Any


class Choice(NamedTuple):
    """Assignment of values to modes or the like, if it is uncertain.

    Attributes:
        held: state from which the model keeps the choice at the next point; in its own format.
        settled: whether it is the most probable one here.
        cost: (D,) label cost: minus twice the logarithm of the probability of each value's label.
    """

    held: Any
    settled: Any
    cost: Any


class Choosing:
    """A model that matches values to modes or the like: again at any point, or as at the point before.

    Its matching has three methods: `rematched` allows a new match at the next point, with the last match's residuals;
    `by_place` and `by_shape` keep a match by order and by shape.
    """

    def first_matching(self) -> Any:
        """Return the matching before the first step; None if there is nothing to match."""
        raise NotImplementedError

    def predict_matched(self, parameters: Mapping[str, Any], data: Data, held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict the values by a matching."""
        raise NotImplementedError


class Growing:
    """A model with programs of a few sizes for all data: it predicts repeated measurements only once."""

    def in_parts(self) -> "Parts":
        """Return a large model in parts of one size, any other in one part of one of few sizes."""
        raise NotImplementedError


def one_part(whole: Any) -> list[Any]:
    """Return the whole as its only part; a function of the module, so that a fit can be pickled."""
    return [whole]


class Parts(NamedTuple):
    """A model in parts of one size, so that one program of bounded memory serves all.

    Attributes:
        models: of each part; the first one is representative of the whole.
        source: (K, n) for each value of each part, the index of its value in the whole.
        places: (D,) for each value of the whole, its index among the parts' values, one part after the other.
        split: splits the whole's held matching into those of the parts.
        joined: joins the matchings of the parts.
    """

    models: tuple[Any, ...]
    source: np.ndarray
    places: np.ndarray
    split: Callable[[Any], list[Any]] = one_part
    joined: Callable[[list[Any]], Any] = itemgetter(0)


class InParts(NamedTuple):
    """A problem in parts of one size: one value stands for all repeated measurements, and padding has no weight.

    Attributes:
        problems: of each part; their residuals together are those of the whole; the first is representative of it.
        parts: of its model.
        scatter: sum of squares that repeated values add to the cost, independent of the parameters.
        whole: whether there is one part with the optima of the whole: no errors are correlated.
        first_matching: before the first step; None if the model matches nothing.
    """

    problems: "tuple[InverseProblem, ...]"
    parts: Parts
    scatter: float
    whole: bool
    first_matching: Any


class InverseProblem(eqx.Module):
    """Measured values and the model that predicts them.

    Attributes:
        model: `model(parameters) -> values (D, *batch)`, differentiable; parameters by path, `(*batch)` each. A plain
            function or an `equinox.Module` whose arrays may then change without a new compilation. A model that
            assigns its values to modes takes the data as well, see `Choosing`.
        measured: (D,) SI units.
        sigma: (D,) standard deviations; infinite for a value to predict but not to fit.
        parameters: the unknowns.
        kinds: (D,) kind of each value, a word.
        correlation: of the values' errors; None if they are independent. With it, change `sigma` by `with_sigma`.
        vectors: (D,) number of each component's vector; any other value has a number of its own; None without
            vectors.
    """

    model: Callable[..., Float[Array, "D *batch"]]
    measured: Float[AnyArray, "D"]
    sigma: Float[AnyArray, "D"]
    parameters: Parameters
    kinds: tuple[str, ...] = eqx.field(static=True)
    correlation: Correlation | None = None
    vectors: Int[np.ndarray, "D"] | None = None
    __getattribute__ = object.__getattribute__  # as of `Parameters`

    def __check_init__(self) -> None:
        """Refuse impossible values and sigmas: in a search they would look like a model without a solution.

        Raises:
            InputError: a measured value that is not finite, or a sigma that is not above zero.
        """
        if isinstance(self.measured, jax.core.Tracer) or isinstance(self.sigma, jax.core.Tracer):
            return
        measured, sigma = np.asarray(self.measured, float), np.asarray(self.sigma, float)
        remedy = "give its standard deviation, infinite for a value that is only to be predicted"
        refuse(
            Problem(f"value {i + 1}", f"{values[i]:g}", expected, remedy, name)
            for name, values, possible, expected, remedy in (
                ("`measured`", measured, np.isfinite(measured), "a finite number", "leave that value out"),
                ("`sigma`", sigma, sigma > 0, "a number > 0", remedy),
            )
            for i in np.flatnonzero(~possible)
        )

    def predict(self, theta: Float[Array, "P *batch"]) -> Float[Array, "D *batch"]:
        """Predict all values at theta, with the most probable choice if the model has one."""
        parameters = self.parameters.by_path(self.parameters.values(theta))
        return self.model(parameters, self.data) if isinstance(self.model, Choosing) else self.model(parameters)

    def predict_matched(self, theta: Float[Array, "P"], held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict all values at theta by a matching."""
        if not isinstance(self.model, Choosing) or held is None:
            return self.predict(theta), Choice(None, jnp.array(True), jnp.zeros_like(self.sigma))
        return self.model.predict_matched(self.parameters.by_path(self.parameters.values(theta)), self.data, held)

    def first_matching(self) -> Any:
        """Return the matching before the first step; None if the model matches nothing."""
        return self.model.first_matching() if isinstance(self.model, Choosing) else None

    @cached_property
    def in_parts(self) -> InParts:
        """The problem in parts of one of a few sizes, repeated values as their mean, possibly reordered.

        With weights w = 1/sigma^2, the sum of w (predicted - measured)^2 over repeated values is that of their mean,
        W (predicted - mean)^2 with W the sum of w, plus their scatter about it, which no parameter changes. This fails
        for correlated errors: such a problem is predicted in parts, but weighed as a whole.
        """
        if not isinstance(self.model, Growing):
            places = np.arange(len(self.kinds))
            return InParts((self,), Parts((self.model,), places[None], places), 0.0, True, self.first_matching())
        parts = self.model.in_parts()
        mean, spread, scatter = self.pooled(parts.source.ravel(), parts.places)
        values = (np.reshape(x, parts.source.shape) for x in (mean, spread))
        each = zip(parts.models, parts.source, *values, strict=True)
        problems = tuple(
            InverseProblem(model, own, sd, self.parameters, tuple(self.kinds[i] for i in source))
            for model, source, own, sd in each
        )
        one = len(problems) == 1
        first_matching = (problems[0] if one else self).first_matching()
        return InParts(problems, parts, scatter, one and self.correlation is None, first_matching)

    def pooled(self, source: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return mean, standard deviation and scatter of repeated values; infinite sd without a measurement.

        Args:
            source: (n,) for each pooled value, the index of one of the problem's values.
            places: (D,) for each of the problem's values, the index of its pooled value.
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
        """Measured values and their sigmas."""
        return Data(self.measured, self.sigma)

    def scaled(self, x: Float[AnyArray, "D *batch"]) -> Any:
        """Return differences of values, whitened to standard deviation 1, `(D, *batch)`: L^-1 x / sigma.

        L is the Cholesky factor of the correlation of a group's errors, 1 for a value without a group; a value that is
        not fitted has no weight.
        """
        xp = library(x)
        sigma = np.asarray(self.sigma) if xp is np else self.sigma
        each = x / sigma.reshape((-1,) + (1,) * (x.ndim - 1))
        return each if self.correlation is None else self.correlation.whiten(each)

    @property
    def errors(self) -> Correlation:
        """Correlation of the errors of all values, also of independent ones."""
        return self.correlation or _made(len(self.kinds), ())

    def with_sigma(self, sigma: Float[np.ndarray, "D"]) -> "InverseProblem":
        """Return the problem with other standard deviations; an infinite one takes its value out of its group."""
        counts = np.isfinite(sigma)
        problem = replace(self, sigma=jax.device_put(np.asarray(sigma)))
        if self.correlation is None:
            return problem
        return eqx.tree_at(lambda p: p.correlation, problem, jax.device_put(self.correlation.among(counts)))

    def weigh(
        self, predicted: Float[AnyArray, "D"], jacobian: Float[AnyArray, "D P"], theta: Float[AnyArray, "P"]
    ) -> tuple[Float[AnyArray, "D+P"], Float[AnyArray, "D+P P"]]:
        """Return residuals and their Jacobian by theta.

        The residuals are (predicted - measured) / sigma, whitened within groups (`scaled`), then those of the priors;
        half their sum of squares is the negative logarithm of the posterior density, up to a constant.
        """
        prior, slope = self.parameters.prior_residuals(theta)
        xp = library(predicted, jacobian, theta)
        measured = np.asarray(self.measured) if xp is np else self.measured
        residuals = xp.concatenate([self.scaled(predicted - measured), prior])
        return residuals, xp.concatenate([self.scaled(jacobian), xp.diag(slope)])


# -------- Discrepancy
# A model wrong by a factor: model discrepancy as further unknowns.

DISCREPANCY_PREFIX = "discrepancy."
"""Prefix of the names of discrepancies; the kind of measurement follows."""
NARROWEST, WIDEST = 1e-6, 1e6
"""Allowed widths of ln(factor): below a millionth there is no discrepancy, above a million no bound."""


class Discrepant(eqx.Module, Choosing, Growing):
    """A model whose predictions of one kind are all wrong by an unknown factor.

    The factor is common to a kind, as wrong geometry and masses shift all its values alike; scatter from one value to
    the next is noise.

    References:
        Kennedy, O'Hagan, "Bayesian calibration of computer models", J. R. Stat. Soc. B 63(3), 2001.

    Attributes:
        model: the model.
        kinds: (D,) kind of each value.
    """

    model: Callable[..., Float[Array, "D *batch"]]
    kinds: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, parameters: Mapping[str, Any], data: Data | None = None) -> Float[Array, "D *batch"]:
        """Predict values for parameters that include the factors of each kind."""
        rest, factor = self._split(parameters)
        if data is None or not isinstance(self.model, Choosing):
            return factor * self.model(rest)
        return factor * self.model(rest, _before(data, factor))

    def first_matching(self) -> Any:
        """Return the matching before the first step."""
        return self.model.first_matching() if isinstance(self.model, Choosing) else None

    def predict_matched(self, parameters: Mapping[str, Any], data: Data, held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict values by a matching."""
        rest, factor = self._split(parameters)
        assert isinstance(self.model, Choosing)
        values, choice = self.model.predict_matched(rest, _before(data, factor), held)
        return values * factor, choice

    def in_parts(self) -> Parts:
        """Return a large model in parts of one size, any other in one part of one of few sizes."""
        if not isinstance(self.model, Growing):
            places = np.arange(len(self.kinds))
            return Parts((self,), places[None], places)
        parts = self.model.in_parts()
        each = zip(parts.models, parts.source, strict=True)
        models = tuple(Discrepant(model, tuple(self.kinds[i] for i in source)) for model, source in each)
        return parts._replace(models=models)

    def _split(self, parameters: Mapping[str, Any]) -> tuple[dict[str, Any], Float[Array, "D *batch"]]:
        """Return the model's own parameters, and the factor on each value."""
        factors = [name for name in parameters if name.startswith(DISCREPANCY_PREFIX)]
        off = {name.removeprefix(DISCREPANCY_PREFIX): parameters[name] for name in factors}
        batch = np.broadcast_shapes(*(jnp.shape(x) for x in parameters.values()))
        rest = {name: x for name, x in parameters.items() if name not in factors}
        return rest, by_kind(off, self.kinds, batch)


def by_kind(factors: Mapping[str, Any], kinds: tuple[str, ...], batch: tuple[int, ...]) -> Float[Array, "D *batch"]:
    """Return the factor on each value from those of some kinds; 1 for the others."""
    names = sorted(set(kinds))
    each = jnp.stack([jnp.broadcast_to(factors.get(kind, 1.0), batch) for kind in names])
    return each[np.searchsorted(names, kinds)]


def _before(data: Data, factor: Float[Array, "D *batch"]) -> Data:
    """Return the data as the model without its discrepancy would show them."""
    measured, sigma = (jnp.reshape(x, x.shape + (1,) * (factor.ndim - x.ndim)) for x in data)
    return Data(measured / factor, sigma / factor)


def with_discrepancy(problem: InverseProblem, widths: Mapping[str, float]) -> InverseProblem:
    """Return the problem with a discrepancy factor of the model for each of these kinds of measurement.

    Args:
        problem: the problem.
        widths: standard deviation of ln(factor) by kind, such as 0.1 for ten percent.

    Raises:
        InputError: no measurement of that kind, or a width that is not positive.
    """
    for kind, width in widths.items():
        remedy = did_you_mean(kind, sorted(set(problem.kinds)), "name a kind of the campaign")
        require(kind in problem.kinds, "", f"a discrepancy of {kind}", "a kind that was measured", remedy)
        expected, remedy = f"a width from {NARROWEST:g} to {WIDEST:g}", f"as {kind}:0.1 for ten percent"
        require(NARROWEST <= width <= WIDEST, "", f"a discrepancy of width {width:g}", expected, remedy)
    more = tuple(Parameter((DISCREPANCY_PREFIX + kind,), True, 1.0, 1.0, width) for kind, width in widths.items())
    if not more:
        return problem
    parameters = Parameters((*problem.parameters.items, *more))
    return replace(problem, model=Discrepant(problem.model, problem.kinds), parameters=parameters)
