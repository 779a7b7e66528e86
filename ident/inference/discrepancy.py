"""A model that is known to be wrong by a factor: model discrepancy as further unknowns."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import Choice, Choosing, Data, Growing, InverseProblem, Parts
from ident.text import did_you_mean

DISCREPANCY_PREFIX = "discrepancy."
"""What the names of discrepancies begin with; a kind of measurement follows."""
NARROWEST, WIDEST = 1e-6, 1e6
"""Widths of ln(factor): within a millionth there is none, and beyond a million there is no bound at all."""


class Discrepant(eqx.Module, Choosing, Growing):
    """A model whose predictions of one kind are all off by an unknown factor.

    A common factor, because geometry and masses that are taken wrong shift all values of a kind alike; scatter from
    one value to the next is noise.

    References:
        Kennedy, O'Hagan, "Bayesian calibration of computer models", J. R. Stat. Soc. B 63(3), 2001.

    Attributes:
        model: the model.
        kinds: (D,) kind of each value.
    """

    model: Callable[..., Float[Array, "D *batch"]]
    kinds: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, parameters: Mapping[str, Any], data: Data | None = None) -> Float[Array, "D *batch"]:
        """Predict values for parameters among which `discrepancy.KIND` are the factors."""
        rest, factor = self._split(parameters)
        if data is None or not isinstance(self.model, Choosing):
            return factor * self.model(rest)
        return factor * self.model(rest, _before(data, factor))

    def unheld(self) -> Any:
        """Return what the model holds before the first step."""
        return self.model.unheld() if isinstance(self.model, Choosing) else None

    def holding(self, parameters: Mapping[str, Any], data: Data, held: Any) -> tuple[Float[Array, "D"], Choice]:
        """Predict values by the choice that is held."""
        rest, factor = self._split(parameters)
        assert isinstance(self.model, Choosing)
        values, choice = self.model.holding(rest, _before(data, factor), held)
        return values * factor, choice

    def padded(self) -> tuple["Discrepant", np.ndarray, np.ndarray]:
        """Return a model of one of few sizes, which of its own values each is like, and where each of its own is."""
        if not isinstance(self.model, Growing):
            return self, np.arange(len(self.kinds)), np.arange(len(self.kinds))
        model, source, places = self.model.padded()
        return Discrepant(model, tuple(self.kinds[i] for i in source)), source, places

    def in_parts(self) -> Parts | None:
        """Return a large model in parts of one size, None for one that stays whole."""
        parts = self.model.in_parts() if isinstance(self.model, Growing) else None
        if parts is None:
            return None
        each = zip(parts.models, parts.source, strict=True)
        models = tuple(Discrepant(model, tuple(self.kinds[i] for i in source)) for model, source in each)
        return parts._replace(models=models)

    def _split(self, parameters: Mapping[str, Any]) -> tuple[dict[str, Any], Float[Array, "D *batch"]]:
        """Return the model's own parameters, and the factor on each value."""
        off = {
            name.removeprefix(DISCREPANCY_PREFIX): x
            for name, x in parameters.items()
            if name.startswith(DISCREPANCY_PREFIX)
        }
        batch = np.broadcast_shapes(*(jnp.shape(x) for x in parameters.values()))
        names = sorted(set(self.kinds))
        each = jnp.stack([jnp.broadcast_to(off.get(kind, 1.0), batch) for kind in names])
        factor = each[np.searchsorted(names, self.kinds)]
        return {name: x for name, x in parameters.items() if not name.startswith(DISCREPANCY_PREFIX)}, factor


def _before(data: Data, factor: Float[Array, "D *batch"]) -> Data:
    """Return the data as the model without its discrepancy would show them."""
    measured, sigma = (jnp.reshape(x, x.shape + (1,) * (factor.ndim - x.ndim)) for x in data)
    return Data(measured / factor, sigma / factor)


def with_discrepancy(problem: InverseProblem, widths: Mapping[str, float]) -> InverseProblem:
    """Return the problem in which the model may be off by a factor for each of these kinds of measurement.

    Args:
        problem: the problem.
        widths: standard deviation of ln(factor) by kind, such as 0.1 for ten percent.

    Raises:
        InputError: nothing of that kind was measured, or a width that is not positive.
    """
    for kind, width in widths.items():
        if kind not in problem.kinds:
            remedy = did_you_mean(kind, sorted(set(problem.kinds)), "name a kind of the campaign")
            raise InputError(Problem("", f"a discrepancy of {kind}", "a kind that was measured", remedy))
        if not NARROWEST <= width <= WIDEST:
            expected, remedy = f"a width from {NARROWEST:g} to {WIDEST:g}", f"as {kind}:0.1 for ten percent"
            raise InputError(Problem("", f"a discrepancy of width {width:g}", expected, remedy))
    more = tuple(Parameter((DISCREPANCY_PREFIX + kind,), True, 1.0, 1.0, width) for kind, width in widths.items())
    if not more:
        return problem
    return InverseProblem(
        Discrepant(problem.model, problem.kinds),
        problem.measured,
        problem.sigma,
        Parameters((*problem.parameters.items, *more)),
        problem.kinds,
        problem.correlation,
        problem.vectors,
    )
