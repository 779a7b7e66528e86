"""Small linear algebra against NumPy and SciPy."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg as sl
from conformance import agrees

from ident.arm.linalg import inverse_cholesky_factor, largest_eigenpairs, lowest_modes, solve_positive
from ident.programs import jit

pytestmark = pytest.mark.slow

EPS = 2.2e-16
SIZES = (3, 9, 36)
"""One joint, three, and the most that an arm may have."""
factor, pairs, low = jit(inverse_cholesky_factor), jit(largest_eigenpairs), jit(lowest_modes)
solved = jit(solve_positive)


def turned(eigenvalues: np.ndarray, seed: int = 0) -> np.ndarray:
    """A full symmetric matrix of given eigenvalues."""
    n = len(eigenvalues)
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))
    A = Q @ np.diag(eigenvalues) @ Q.T
    return (A + A.T) / 2


def random_positive(n: int, seed: int = 0) -> np.ndarray:
    return turned(np.random.default_rng(seed).uniform(1, 100, n), seed)


def block_diagonal(n: int) -> np.ndarray:
    return sl.block_diag(*(random_positive(3, seed) for seed in range(n // 3)))


SPECTRA = {
    "random": random_positive,
    "one repeated value": lambda n: turned(np.full(n, 3.0)),
    "pairs": lambda n: turned(np.repeat(np.arange(1.0, n + 1), 2)[:n]),
    "cluster of 1e-12": lambda n: turned(np.concatenate([2 + 1e-12 * np.arange(n - n // 3), np.ones(n // 3)])),
    "graded by 1e8": lambda n: turned(np.logspace(-8, 0, n)),
    "singular": lambda n: turned(np.concatenate([np.zeros(n // 2), np.arange(1.0, n - n // 2 + 1)])),
    "unit": np.eye,
    "diagonal": lambda n: np.diag(np.arange(1.0, n + 1)),
    "diagonal with repeats": lambda n: np.diag(np.arange(n) // 3 + 1.0),
    "blocks": block_diagonal,
    "equal blocks": lambda n: sl.block_diag(*[random_positive(3)] * (n // 3)),
    "tridiagonal": lambda n: 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1),
}


CLUSTERS = {
    "all": lambda n, near, others: near,
    "highest": lambda n, near, others: np.where(np.arange(n) < n // 2, near, others),
    "lowest": lambda n, near, others: np.where(np.arange(n) < n // 2, 0.01 * near, others),
    "of zeros": lambda n, near, others: np.where(np.arange(n) < n // 2, near - 1, others),
    "two": lambda n, near, others: np.where(np.arange(n) < n // 2, near, 3 * near),
    "three": lambda n, near, others: np.ceil(3 * others) * near,
}
SPREADS = (*(0.0,) * 6, 1e-16, 3e-16, 1e-15, 3e-15, 1e-14, 3e-14, 1e-13, 1e-12, 1e-10, 1e-8)
SEEDS = 300
"""Divided by the size: small matrices meet the worst less often, and cost less."""


def near_repeats(n: int) -> np.ndarray:
    """Matrices `(batch, n, n)` of clustered eigenvalues: which of them, how near, turned how."""
    matrices = []
    for cluster in CLUSTERS.values():
        for spread in SPREADS:
            for _ in range(SEEDS // n):
                rng = np.random.default_rng(len(matrices))
                near, others = 1 + spread * rng.uniform(0, 1, n), rng.uniform(0.1, 1, n)
                matrices.append(turned(cluster(n, near, others), len(matrices)))
    return np.stack(matrices)


@cache
def solved_pairs(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All matrices of a size, those of SPECTRA first, and what one program says of them."""
    A = np.concatenate([[np.asarray(make(n), float) for make in SPECTRA.values()], near_repeats(n)])
    values, V = (np.moveaxis(x, -1, 0) for x in pairs(jnp.moveaxis(A, 0, -1), n))
    return A, values, V


@pytest.mark.parametrize("n", SIZES)
def test_eigenpairs(n: int) -> None:
    """Values, residual and orthonormality, each to rounding times the largest eigenvalue and a modest n.

    Of repeated eigenvalues, exactly and nearly, the vectors are orthonormal and solve A v = lambda v. How LAPACK and
    the CPU round decides how near a shift comes to one of a cluster: hence so many matrices.
    """
    A, values, V = solved_pairs(n)
    expected = np.linalg.eigvalsh(A)[:, ::-1]
    largest, tolerance = expected[:, :1], 30 * n * EPS
    found, exact = values / largest, expected / largest
    what = "eigenvalues, clustered, repeated, graded, singular"
    agrees(found, exact, "mechanics", what, "NumPy (LAPACK)", atol=tolerance)
    assert (np.abs(A @ V - V * values[:, None]) / largest[..., None]).max() < tolerance
    off = np.abs(np.swapaxes(V, 1, 2) @ V - np.eye(n)).max((1, 2))
    assert off[: len(SPECTRA)].max() < tolerance
    assert off[len(SPECTRA) :].max() < (30 + n) * EPS


def test_lowest_modes_against_scipy() -> None:
    H, M = random_positive(9, 1), random_positive(9, 2)
    values, V = (np.asarray(x) for x in low(jnp.asarray(H), jnp.asarray(M), 9))
    agrees(values, sl.eigh(H, M, eigvals_only=True), "modal", "generalised eigenvalues", "SciPy's eigh", rtol=1e-11)
    assert np.abs(V.T @ M @ V - np.eye(9)).max() < 1e-11
    assert np.abs(V.T @ H @ V - np.diag(values)).max() < 1e-11 * values[-1]


def test_lowest_of_a_graded_problem_is_the_most_accurate() -> None:
    """Stiffnesses 1e8 apart: the lowest eigenvalues keep their digits, where eigh(H, M) loses eight."""
    exact = np.logspace(0, 8, 9)
    H = turned(exact)
    values = np.asarray(low(jnp.asarray(H), jnp.eye(9), 9)[0])[:3]
    reference = 1 / sl.eigh(np.eye(9), H, eigvals_only=True)[::-1][:3]
    # the matrix itself holds its lowest eigenvalue to 1e8 * EPS only: both answers share that error
    agrees(values, reference, "modal", "the lowest of stiffnesses 1e8 apart", "SciPy's eigh of the inverse", rtol=1e-8)


def test_whitener_and_solve() -> None:
    n = 9
    A = random_positive(n)
    W, b = np.asarray(factor(jnp.asarray(A))), np.random.default_rng(3).normal(size=n)
    expected = sl.solve_triangular(np.linalg.cholesky(A), np.eye(n), lower=True)
    what = "inverse Cholesky factor"
    agrees(W, expected, "mechanics", what, "SciPy's solve_triangular", rtol=1e-12, atol=1e-14)
    found, expected = solved(jnp.asarray(A), jnp.asarray(b)), np.linalg.solve(A, b)
    agrees(found, expected, "mechanics", "solution of a positive system", "NumPy's solve", rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("lowest", [-1.0, -1e-3])
def test_indefinite_gives_nan(lowest: float) -> None:
    A = jnp.asarray(turned(np.array([lowest, *range(1, 9)])))
    assert np.isnan(factor(A)).any()
    values, vectors = low(A, jnp.eye(9), 9)
    assert np.isnan(values).all()
    assert np.isnan(vectors).any()


def test_nan_stays_in_its_own_entry_of_the_batch() -> None:
    good, bad = random_positive(6), turned(np.array([-1.0, 1, 2, 3, 4, 5]))
    H = jnp.stack([jnp.asarray(good), jnp.asarray(bad), jnp.asarray(good)], -1)
    M = jnp.broadcast_to(jnp.eye(6)[..., None], H.shape)
    values = low(H, M, 6)[0]
    assert np.isnan(values[:, 1]).all()
    assert np.allclose(values[:, [0, 2]], np.linalg.eigvalsh(good)[:, None], rtol=1e-12)


def test_batch_equals_one_at_a_time() -> None:
    """And a few pairs are the first of all."""
    A = jnp.stack([jnp.asarray(random_positive(6, seed)) for seed in range(5)], -1)
    values, vectors = pairs(A, 3)
    for i in range(5):
        one = pairs(A[..., i], 3)
        assert np.allclose(values[:, i], one[0], rtol=1e-14)
        assert np.allclose(one[0], np.linalg.eigvalsh(A[..., i])[::-1][:3], rtol=30 * 6 * EPS)
        alignment = np.abs((vectors[..., i] * one[1]).sum(0))  # a vector's sign is free
        assert np.allclose(alignment, 1, rtol=1e-13)


@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_solves_are_differentiable(mode: str) -> None:
    A, b = random_positive(6), np.random.default_rng(5).normal(size=6)
    jacobian = {"fwd": jax.jacfwd, "rev": jax.jacrev}[mode]
    slope = jax.jit(jacobian(lambda s: solve_positive(jnp.asarray(A) + s * jnp.eye(6), jnp.asarray(b))))(0.0)
    inverse = np.linalg.inv(A)
    expected, what = -inverse @ inverse @ b, "slope of a solution, by jacfwd and jacrev"
    agrees(slope, expected, "mechanics", what, "-A^-2 b, NumPy's inverse", rtol=1e-10, atol=1e-8)
