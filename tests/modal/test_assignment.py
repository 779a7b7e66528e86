"""How probable a measured shape is as a computed one, of a batch of computations."""

import numpy as np
from conformance import agrees
from scipy.stats import multivariate_normal

from ident.modal.assignment import _log_density, likelihoods


def spread(rng, size):
    factor = rng.normal(size=(size, size))
    return 0.01 * (factor @ factor.T + np.eye(size))


def test_the_density_is_the_limit_of_a_wide_normal_factor():
    rng, width = np.random.default_rng(4), 100.0
    shapes, y, S = rng.normal(size=(3, 2)), rng.normal(size=6), spread(rng, 6)
    wide = []
    for shape in shapes.T:
        moved = np.kron(np.eye(2), shape[:, None])
        wide.append(multivariate_normal(np.zeros(6), S + width**2 * moved @ moved.T).logpdf(y))
    expected = np.array(wide) + np.log(2 * np.pi * width**2)
    what, source = "density of a measured shape", "SciPy's multivariate_normal, wide factor"
    agrees(_log_density(y, S, shapes), expected, "modal", what, source, rtol=1e-5, atol=1e-5)


def test_a_batch_is_as_one_at_a_time():
    rng = np.random.default_rng(5)
    shape, S = rng.normal(size=4) + 0.1j * rng.normal(size=4), spread(rng, 8)
    computed, hertz = rng.normal(size=(4, 3, 5)), np.sort(rng.uniform(4, 6, (3, 5)), 0)
    every = likelihoods(shape, S, computed, hertz, 5.0, 0.3)
    assert every.shape == (5, 3)
    for d in range(5):
        alone = likelihoods(shape, S, computed[..., d : d + 1], hertz[:, d : d + 1], 5.0, 0.3)
        assert np.allclose(every[d], alone[0], rtol=1e-12)


def test_a_mode_that_does_not_move_there_is_not_measured_there():
    rng = np.random.default_rng(6)
    shape, S = rng.normal(size=4) + 0.1j * rng.normal(size=4), spread(rng, 8)
    computed, hertz = np.zeros((4, 2, 1)), np.array([[5.0], [500.0]])
    computed[:, 0, 0] = shape.real
    found = likelihoods(shape, S, computed, hertz, 5.0, 0.3)
    assert np.isfinite(found[0, 0])
    assert found[0, 1] < found[0, 0] - 100
