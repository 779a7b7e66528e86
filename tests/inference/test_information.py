"""What the data can tell, against closed forms of the linear-Gaussian case."""

import numpy as np
import pytest
from conformance import agrees

from ident.inference.information import information

NONE = np.full(3, np.inf)
NAMES = ("a", "b", "c")


def test_full_rank_covariance_is_the_inverse_information():
    J = np.random.default_rng(0).normal(size=(7, 3)) * 9
    known = information(J, NONE, NAMES)
    expected, what = np.linalg.inv(J.T @ J), "covariance without priors"
    agrees(known.covariance, expected, "inference", what, "(J' J)^-1, NumPy", rtol=1e-10)
    np.testing.assert_allclose(known.data_sd, known.sd, rtol=1e-10)
    assert known.rank == 3
    assert known.supported.all()
    assert not known.prior_share.any()
    assert known.trade_offs() == ()


def test_prior_adds_its_information():
    J = np.random.default_rng(1).normal(size=(5, 3))
    prior = np.array([0.5, 1.0, 2.0])
    known = information(J, prior, NAMES)
    expected = np.linalg.inv(J.T @ J + np.diag(1 / prior**2))
    source, shares = "(J' J + P^-1)^-1, NumPy", np.diag(expected) / prior**2
    agrees(known.covariance, expected, "inference", "covariance with priors", source, rtol=1e-10)
    agrees(known.prior_share, shares, "inference", "share of the priors", source, rtol=1e-10)


def test_two_parameters_that_only_their_sum_is_seen_of():
    J = np.array([[100.0, 100.0, 0.0], [0.0, 0.0, 50.0]])
    known = information(J, NONE, NAMES)
    assert known.rank == 2
    assert np.isinf(known.data_sd[:2]).all()
    assert known.data_sd[2] == pytest.approx(0.02)
    assert known.supported.tolist() == [False, False, True]
    (trade,) = known.trade_offs()
    assert trade.name in ("a", "b")
    np.testing.assert_allclose(trade.change, [1, -1, 0] if trade.name == "a" else [-1, 1, 0], atol=1e-12)


def test_trade_offs_leave_the_data_unchanged():
    J = np.random.default_rng(2).normal(size=(3, 6)) * 30
    known = information(J, np.ones(6), tuple("abcdef"))
    trades = known.trade_offs()
    assert known.rank == 3
    assert len(trades) == 3
    assert len({trade.name for trade in trades}) == 3
    for trade in trades:
        np.testing.assert_allclose(J @ trade.change, 0, atol=1e-10)
        assert trade.change[known.names.index(trade.name)] == pytest.approx(1)


def test_no_data_at_all_leave_everything_to_the_prior():
    known = information(np.zeros((2, 3)), np.ones(3), NAMES)
    assert known.rank == 0
    np.testing.assert_allclose(known.prior_share, 1)
    assert not known.supported.any()


def test_a_direction_known_within_a_factor_of_four_is_weak():
    known = information(np.diag([100.0, 100.0, 1 / np.log(4)]), NONE, NAMES)
    assert [d.weak for d in known.directions] == [False, False, True]
    assert known.rank == 3
    assert known.supported.tolist() == [True, True, False]
