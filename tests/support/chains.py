"""Models that are no arm: a linear one, and a chain of masses and springs."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem

CENTRES, WIDTHS = np.array([0.3, -1.0, 2.0]), np.array([1.0, 0.5, 3.0])


class Linear(eqx.Module):
    """Values A @ (a, b, ...), of the parameters or of their logarithms: one program for all matrices of a shape."""

    A: Any
    names: tuple[str, ...] = eqx.field(static=True)
    logarithms: bool = eqx.field(static=True, default=False)

    def __call__(self, parameters: Mapping[str, Any]) -> Any:
        values = jnp.stack([parameters[name] for name in self.names])
        return jnp.tensordot(self.A, jnp.log(values) if self.logarithms else values, 1)


def linear_problem(seed: int = 0) -> tuple[InverseProblem, np.ndarray, np.ndarray]:
    """A linear-Gaussian problem of three unknowns and five values, with mean and covariance of its posterior."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(5, 3))
    sigma = rng.uniform(0.1, 0.4, 5)
    truth = CENTRES + WIDTHS * rng.normal(size=3)
    measured = A @ truth + sigma * rng.normal(size=5)
    names = ("a", "b", "c")
    items = tuple(
        Parameter((name,), False, centre, centre, 1.0, width)
        for name, centre, width in zip(names, CENTRES, WIDTHS, strict=True)
    )
    model = Linear(jnp.asarray(A), names)
    problem = InverseProblem(model, jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), ("x",) * 4 + ("y",))
    scaled = A * WIDTHS / sigma[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(3))
    mean = covariance @ (scaled.T @ (measured / sigma) + CENTRES / WIDTHS)
    return problem, mean, covariance


def storey_frequencies(parameters):
    """Natural frequencies [Hz] of storeys of 1000 kg on springs `k1`, `k2`, ... [N/m], the first on the ground.

    Clough, Penzien, "Dynamics of Structures", 3rd ed., ch. 8 (shear building).
    """
    k = jnp.stack([parameters[f"k{i}"] for i in range(1, 1 + len(parameters))])
    above = jnp.concatenate([k[1:], jnp.zeros_like(k[:1])])
    k, above = jnp.moveaxis(k, 0, -1), jnp.moveaxis(above, 0, -1)
    diagonal, upper = jnp.eye(k.shape[-1]), jnp.eye(k.shape[-1], k=1)
    off = upper * above[..., None]
    K = diagonal * (k + above)[..., None] - off - off.swapaxes(-1, -2)
    return jnp.moveaxis(jnp.sqrt(jnp.linalg.eigvalsh(K / 1000.0)) / (2 * jnp.pi), -1, 0)


def storey_problem(truth, sigma: float = 0.002, width: float = 1.0) -> InverseProblem:
    """The springs of a chain from all its frequencies, exact, with priors about 1e6 N/m."""
    measured = storey_frequencies({f"k{i + 1}": jnp.asarray(k) for i, k in enumerate(truth)})
    items = tuple(Parameter((f"k{i + 1}",), True, 1e6, 1e6, width) for i in range(len(truth)))
    return InverseProblem(
        storey_frequencies, measured, sigma * measured, Parameters(items), ("frequency",) * len(truth)
    )
