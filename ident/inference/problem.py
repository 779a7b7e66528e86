"""What inference needs of a model and of data, whatever the model: a predict function, values, sigmas, unknowns."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.inference.parameters import Parameters


class InverseProblem(eqx.Module):
    """Measured values and the model that predicts them.

    Attributes:
        model: `model(parameters) -> values (D, *batch)`, differentiable; parameters by path, `(*batch)` each. A plain
            function or an `equinox.Module` whose arrays may then change without a new compilation.
        measured: (D,) SI units.
        sigma: (D,) standard deviations; infinite for a value that is to be predicted but not fitted.
        parameters: the unknowns.
        kinds: (D,) kind of each value, a word.
    """

    model: Callable[[Mapping[str, Any]], Float[Array, "D *batch"]]
    measured: Float[Array, "D"]
    sigma: Float[Array, "D"]
    parameters: Parameters
    kinds: tuple[str, ...] = eqx.field(static=True)

    def predict(self, theta: Float[Array, "P *batch"]) -> Float[Array, "D *batch"]:
        """Predict all values at theta."""
        return self.model(self.parameters.by_path(self.parameters.values(theta)))

    def weigh(
        self, predicted: Float[Array, "D"], jacobian: Float[Array, "D P"], theta: Float[Array, "P"]
    ) -> tuple[Float[Array, "D+P"], Float[Array, "D+P P"]]:
        """Return residuals and their Jacobian by theta.

        The residuals are (predicted - measured) / sigma, then those of the priors, so half their sum of squares is
        the negative logarithm of the posterior density, up to a constant.
        """
        prior, slope = self.parameters.prior_residuals(theta)
        residuals = jnp.concatenate([(predicted - self.measured) / self.sigma, prior])
        return residuals, jnp.concatenate([jacobian / self.sigma[:, None], jnp.diag(slope)])

    def without(self, kind: str) -> "InverseProblem":
        """Return the problem in which values of one kind are predicted but not fitted."""
        sigma = np.where(np.array(self.kinds) == kind, np.inf, np.asarray(self.sigma))
        return eqx.tree_at(lambda p: p.sigma, self, jax.device_put(sigma))
