"""Frequencies beside those of another engine: sdypy-EMA's least-squares complex frequency-domain estimator."""

import numpy as np
import pytest
from known_modes import arm_like, hammer_test
from sdypy.EMA import Model

from ident.modal.modes import modes_of

LINES = np.arange(0.0, 60.0, 0.125)


def test_sdypy_finds_the_same_frequencies():
    """Well-separated modes of clean functions, where both work: to 0.1 %."""
    rng = np.random.default_rng(3)
    truth = arm_like(rng, outputs=4)
    frf = hammer_test(truth, rng, noise=2e-3, lines=LINES)
    peer = Model(frf=frf.mean[:, 0], freq=LINES, lower=5, upper=50, pol_order_high=40)
    peer.get_poles(show_progress=False)
    peer.select_closest_poles(list(truth.frequency[:5]), f_window=4)
    modes = modes_of(frf, band=(3.0, 55.0))
    assert np.array(peer.nat_freq) == pytest.approx(modes.frequency, rel=1e-3)
    assert np.array(peer.nat_xi) == pytest.approx(modes.damping, rel=0.1)
    assert modes.frequency == pytest.approx(truth.frequency[:5], rel=1e-4)
