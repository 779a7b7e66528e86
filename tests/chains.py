"""Models that are no arm: a linear one, and a chain of masses and springs."""

import jax.numpy as jnp
import numpy as np

from ident.arm.modes import lowest_eigenpairs, to_hertz
from ident.identify.parameters import Parameter, Parameters
from ident.identify.problem import InverseProblem

CENTRES, WIDTHS = np.array([0.3, -1.0, 2.0]), np.array([1.0, 0.5, 3.0])


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

    def model(p):
        return jnp.tensordot(jnp.asarray(A), jnp.stack([p[name] for name in names]), 1)

    problem = InverseProblem(model, jnp.asarray(measured), jnp.asarray(sigma), Parameters(items), ("x",) * 4 + ("y",))
    scaled = A * WIDTHS / sigma[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(3))
    mean = covariance @ (scaled.T @ (measured / sigma) + CENTRES / WIDTHS)
    return problem, mean, covariance


def storey_frequencies(parameters):
    """Natural frequencies [Hz] of storeys of 1000 kg on springs `k1.`, `k2.`, ... [N/m], the first on the ground."""
    k = jnp.stack([parameters[f"k{i}"] for i in range(1, 1 + len(parameters))])
    n, batch = k.shape[0], k.shape[1:]
    unit = jnp.eye(n).reshape((n, n) + (1,) * len(batch))
    upper = jnp.eye(n, k=1).reshape(unit.shape)
    above = jnp.concatenate([k[1:], jnp.zeros((1, *batch))])
    K = unit * (k + above)[:, None] - upper * above[:, None] - (upper * above[:, None]).swapaxes(0, 1)
    M = jnp.broadcast_to(1000.0 * unit, K.shape)
    return to_hertz(lowest_eigenpairs(K, M, n)[0])


def storey_problem(truth, sigma: float = 0.002, width: float = 1.0) -> InverseProblem:
    """The springs of a chain from all its frequencies, exact, with priors about 1e6 N/m."""
    measured = storey_frequencies({f"k{i + 1}": jnp.asarray(k) for i, k in enumerate(truth)})
    items = tuple(Parameter((f"k{i + 1}",), True, 1e6, 1e6, width) for i in range(len(truth)))
    return InverseProblem(
        storey_frequencies, measured, sigma * measured, Parameters(items), ("frequency",) * len(truth)
    )
