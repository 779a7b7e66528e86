"""The covariance of averaged functions: what it whitens has unit variance, whatever correlates channels and lines."""

import numpy as np
import pytest
from conformance import agrees
from known_modes import arm_like, directions, hammer_test

from ident.errors import InputError
from ident.modal.frf import Frf
from ident.modal.poles import noise_of

LINES = np.arange(1.0, 51.0, 0.125)


def scatter(rng, mixing, sd, hits=5):
    shape = (hits, len(mixing), 1, len(LINES))
    white = rng.normal(size=(*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    mixed = np.einsum("ab,hbif->haif", mixing, white) * sd
    return Frf(LINES, mixed, directions(len(mixing)), directions(1))


def test_channels_that_scatter_together_and_unlike_over_lines_are_whitened():
    rng = np.random.default_rng(0)
    mixing = np.array([[1.0, 0, 0], [0.8j, 0.6, 0], [0.3, -0.5, 0.4]])
    sd = 0.01 * (1 + 3 * np.exp(-(((LINES - 20) / 8) ** 2)))
    frf = scatter(rng, mixing, sd)
    noise = noise_of(frf)
    fresh = scatter(rng, mixing, sd, hits=400)
    white = noise.whiten(fresh.hits[:, :, 0] / 5**0.5)
    what, source = "variance of whitened functions", "1, of 400 fresh hits"
    agrees(white.var(), 1.0, "modal", what, source, atol=0.05)
    channels = white.reshape(400, 2, 3, -1).transpose(2, 0, 1, 3).reshape(3, -1)
    assert np.corrcoef(channels) == pytest.approx(np.eye(3), abs=0.05)
    assert np.mean(noise.sd[0] / (sd / 5**0.5)) == pytest.approx(1.0, abs=0.05)


def test_an_exponential_window_correlates_lines_and_is_accounted_for():
    rng = np.random.default_rng(1)
    truth = arm_like(rng)
    frf = hammer_test(truth, rng, decay=0.5)
    noise = noise_of(frf)
    apart = noise.whiten((frf.hits - truth.accelerance(frf.frequency, 0.5))[:, :, 0] / 5**0.5)
    plain = (frf.hits - truth.accelerance(frf.frequency, 0.5))[:, :, 0]
    assert abs(np.mean(plain[..., 1:] * plain[..., :-1].conj()) / np.mean(np.abs(plain) ** 2)) > 0.5
    over_time = (apart.reshape(5, 2, 6, 8, -1) ** 2).mean((0, 1, 2, 4))
    assert over_time == pytest.approx(np.ones(8), abs=0.2)


def test_a_line_of_the_mains_keeps_its_own_variance():
    rng = np.random.default_rng(2)
    frf = scatter(rng, np.eye(2), np.full(len(LINES), 0.01))
    mains = np.argmin(np.abs(LINES - 50.0))
    frf.hits[:, :, :, mains] += 0.5 * np.exp(2j * np.pi * rng.random((5, 1, 1)))
    sd = noise_of(frf).sd
    assert (sd[:, mains] > 10 * np.median(sd)).all()
    assert (sd[:, mains - 20] < 2 * np.median(sd)).all()


@pytest.mark.parametrize(("hits", "said"), [(2, "got 2 hits, expected 3 or more"), (0, "without scatter")])
def test_too_little_is_said(hits, said):
    frf = scatter(np.random.default_rng(3), np.eye(2), 0.01, hits=hits or 4)
    if not hits:
        frf = Frf(LINES, np.ones_like(frf.hits), frf.responses, frf.references)
    with pytest.raises(InputError, match=said):
        noise_of(frf)
