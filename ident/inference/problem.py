"""What inference needs of a model and of data, whatever the model: a predict function, values, sigmas, unknowns."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem
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
    """A model that can predict more values than were asked for, so that few sizes of programs serve all data."""

    def padded(self) -> tuple["Growing", np.ndarray]:
        """Return a model of more values, and which of its own values each of them repeats; all are among them."""
        raise NotImplementedError


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
    """

    model: Callable[..., Float[Array, "D *batch"]]
    measured: Float[AnyArray, "D"]
    sigma: Float[AnyArray, "D"]
    parameters: Parameters
    kinds: tuple[str, ...] = eqx.field(static=True)

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
            _wrong("measured", i, x, "a finite number", remedy) for i, x in enumerate(measured) if not np.isfinite(x)
        ]
        remedy = "give its standard deviation, infinite for a value that is only to be predicted"
        problems += [_wrong("sigma", i, x, "a number > 0", remedy) for i, x in enumerate(sigma) if not x > 0]
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

    def padded(self) -> tuple["InverseProblem", np.ndarray]:
        """Return the same problem with values that do not count, so many that few sizes occur, and where its own are.

        They may come in another order.
        """
        if not isinstance(self.model, Growing):
            return self, np.arange(len(self.kinds))
        model, source = self.model.padded()
        places = np.unique(source, return_index=True)[1]
        sigma = np.full(len(source), np.inf)
        sigma[places] = np.asarray(self.sigma)
        kinds = tuple(self.kinds[i] for i in source)
        return InverseProblem(model, np.asarray(self.measured)[source], sigma, self.parameters, kinds), places

    @property
    def data(self) -> Data:
        """What was measured."""
        return Data(self.measured, self.sigma)

    def weigh(
        self, predicted: Float[AnyArray, "D"], jacobian: Float[AnyArray, "D P"], theta: Float[AnyArray, "P"]
    ) -> tuple[Float[AnyArray, "D+P"], Float[AnyArray, "D+P P"]]:
        """Return residuals and their Jacobian by theta.

        The residuals are (predicted - measured) / sigma, then those of the priors, so half their sum of squares is
        the negative logarithm of the posterior density, up to a constant.
        """
        prior, slope = self.parameters.prior_residuals(theta)
        xp = library(predicted, jacobian, theta)
        measured, sigma = (np.asarray(x) if xp is np else x for x in (self.measured, self.sigma))
        residuals = xp.concatenate([(predicted - measured) / sigma, prior])
        return residuals, xp.concatenate([jacobian / sigma[:, None], xp.diag(slope)])

    def without(self, kind: str) -> "InverseProblem":
        """Return the problem in which values of one kind are predicted but not fitted."""
        sigma = np.where(np.array(self.kinds) == kind, np.inf, np.asarray(self.sigma))
        return eqx.tree_at(lambda p: p.sigma, self, jax.device_put(sigma))


def _wrong(name: str, place: int, value: float, expected: str, remedy: str) -> Problem:
    return Problem(f"value {place + 1}", f"{value:g}", expected, remedy, f"`{name}`")
