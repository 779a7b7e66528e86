"""Estimates of the frequency response against their definitions, closed forms and simulated scatter."""

import numpy as np
import pytest
from conformance import agrees

from ident.modal.frf import ESTIMATORS, Frf, Place, checks, coherence, contributions

LINES = np.linspace(1.0, 10.0, 40)


def spectra(hits=6, noise=0.0, force_noise=0.0, seed=3):
    """Force and responses of a known H = 1 / (9 - f^2 + 0.4 i f) and 2 H."""
    random = np.random.default_rng(seed)
    white = lambda *shape: (random.standard_normal(shape) + 1j * random.standard_normal(shape)) / np.sqrt(2)  # noqa: E731
    true = np.stack([1 / (9 - LINES**2 + 0.4j * LINES)] * 2) * [[1], [2]]
    force = (1 + 0.3 * random.random((hits, 1))) * np.exp(1j * random.random((hits, 1)))
    answer = true * force[:, None]
    measured = force + force_noise * white(hits, len(LINES))
    return true, measured, answer + noise * white(*answer.shape)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_without_noise_each_hit_says_the_truth(estimator):
    true, force, answer = spectra()
    force = np.broadcast_to(force, (6, len(LINES)))
    found, what = (
        contributions(force, answer, estimator),
        f"frequency response by {estimator.capitalize()}, without noise",
    )
    agrees(found, np.stack([true] * 6), "modal", what, "1 / (9 - f^2 + 0.4 i f)", rtol=1e-12)
    np.testing.assert_allclose(coherence(force, answer), 1.0, rtol=1e-12)


def test_the_mean_is_the_estimate_by_its_definition():
    _, force, answer = spectra(noise=0.05, force_noise=0.05)
    f, x = force[:, None], answer
    h1 = (x * f.conj()).sum(0) / (abs(f) ** 2).sum(0)
    h2 = (abs(x) ** 2).sum(0) / (f * x.conj()).sum(0)
    one, two = (contributions(force, answer, each).mean(0) for each in ("h1", "h2"))
    agrees(one, h1, "modal", "estimate H1 with noise", "cross by auto spectrum of the force", rtol=1e-12)
    agrees(two, h2, "modal", "estimate H2 with noise", "auto by cross spectrum of the response", rtol=1e-12)
    hv = contributions(force, answer, "hv").mean(0)
    mean = np.sqrt(abs(h1) * abs(h2))
    agrees(abs(hv), mean, "modal", "estimate Hv with noise", "geometric mean of H1 and H2", rtol=1e-12)
    agrees(coherence(force, answer), abs(h1) / abs(h2), "modal", "coherence", "|H1| / |H2|", rtol=1e-12)


def test_one_hit_alone_is_a_ratio():
    _, force, answer = spectra(hits=1, noise=0.1)
    np.testing.assert_allclose(contributions(force, answer, "h1")[0], answer[0] / force[0], rtol=1e-12)


def test_noise_of_the_force_biases_h1_down_and_h2_not():
    true, force, answer = spectra(hits=400, force_noise=0.5)
    h1, h2 = (abs(contributions(force, answer, each).mean(0) / true).mean() for each in ("h1", "h2"))
    expected = 1 / (1 + 0.25 / np.mean((1 + 0.3 * np.linspace(0, 1, 1000)) ** 2))
    agrees(h1, expected, "modal", "bias of H1 by noise of the force", "1 / (1 + noise / signal)", atol=0.01)
    agrees(h2, 1.0, "modal", "bias of H2 by noise of the force", "none", atol=0.01)


@pytest.mark.parametrize("estimator", ["h1", "hv"])
def test_the_scatter_of_contributions_is_that_of_the_estimate(estimator):
    """Over 300 repeated tests the variance by contributions of one agrees with that of the estimates."""
    means, variances = [], []
    for seed in range(300):
        _, force, answer = spectra(hits=5, noise=0.02, seed=seed)
        force = np.broadcast_to(force, (5, len(LINES)))
        each = contributions(force, answer, estimator)
        means.append(each.mean(0))
        variances.append(each.var(0, ddof=1) / 5)
    ratio = np.var(means, 0, ddof=1).mean() / np.mean(variances)
    what, source = f"variance of {estimator.capitalize()} by its hits", "300 repeated tests"  # 80 lines x 300: 1 % sd
    agrees(ratio, 1.0, "modal", what, source, atol=0.05)


def frf(hits, responses, references, decay=0.0):
    return Frf(LINES, np.asarray(hits), tuple(responses), tuple(references), decay)


X, Z, DOWN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def accelerance(decay=0.0, sign=1.0):
    """Accelerance of a mass on a spring at its driving point."""
    s = decay + 2j * np.pi * LINES
    return sign * s**2 / (s**2 + 2 * 0.02 * 30 * s + 900)


@pytest.mark.parametrize("decay", [0.0, 0.5])
def test_a_driving_point_that_feeds_energy_is_a_reversed_direction(decay):
    hits = np.broadcast_to(accelerance(decay)[None, None, None], (3, 1, 1, len(LINES)))
    (good,) = checks(frf(hits, [Place("tip", Z)], [Place("tip", Z)], decay))
    (bad,) = checks(frf(hits, [Place("tip", Z)], [Place("tip", DOWN)], decay))
    assert good.good
    assert good.value == 0
    assert not bad.good
    assert bad.value == 1
    assert not checks(frf(hits, [Place("tip", Z)], [Place("base", Z)], decay))


def test_reciprocity_within_the_scatter_is_good_and_a_wrong_sensitivity_is_not():
    random = np.random.default_rng(2)
    own, cross = accelerance(), 0.3 * accelerance()
    noise = 0.01 * random.standard_normal((5, 2, 2, len(LINES)))
    matrix = np.array([[own, cross], [cross, own]])
    places = [Place("tip", X), Place("tip", Z)]
    assert all(check.good for check in checks(frf(matrix + noise, places, places)))
    wrong = matrix * np.array([1.0, 1.5])[:, None, None]
    bad = [check for check in checks(frf(wrong + noise, places, places)) if not check.good]
    assert [(check.name, check.places) for check in bad] == [("reciprocity", tuple(places))]
    what, source = "reciprocity error of a wrong sensitivity", "0.5 x 0.3 / sqrt(1.5), by hand"
    agrees(bad[0].value, 0.5 * 0.3 / np.sqrt(1.5), "modal", what, source, rtol=0.02)
