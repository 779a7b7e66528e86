"""A curve in a word, and where it keeps a limit."""

import numpy as np
import pytest

from ident.vibrate.sweep import Axis, Sweep, below, curve, has_present, near, trend


@pytest.mark.parametrize(
    ("sizes", "shape"),
    [
        ([1, 1.02, 0.99, 1.01], "flat"),
        ([1, 1.02, 1.01, 2, 3], "rises"),
        ([3, 2.9, 2.95, 1], "falls"),
        ([3, 1, 1.05, 0.9, 2], "minimum"),
        ([1, 3, 2.9, 2.95, 2], "maximum"),
        ([1, 3, 1, 3], "wavy"),
    ],
)
def test_ripples_do_not_count(sizes, shape):
    values, sizes = np.arange(len(sizes), dtype=float), np.array(sizes, float)
    found = trend(values, sizes)
    assert found.shape == shape
    assert found.least == (values[sizes.argmin()], sizes.min())
    assert found.largest == (values[sizes.argmax()], sizes.max())
    mirrored = {"rises": "falls", "falls": "rises"}.get(shape, shape)
    assert trend(values, sizes[::-1].copy()).shape == mirrored


def test_the_limit_is_met_between_values():
    values = np.arange(5.0)
    assert below(values, np.array([0, 1, 0, 2, 1.0]), 0.5) == [(0, 0.5), (1.5, 2.25)]
    assert below(values, np.array([2, 2, 1, 2, 1.0]), 1.0) == [(2, 2), (4, 4)]
    assert below(values, np.ones(5), 2.0) == [(0, 4)]
    assert below(values, np.ones(5), 0.5) == []


def test_the_present_value_is_a_point_of_the_curve():
    axis = Axis(("fingers.com.x",), np.array([0.0, 1.0, 2.0]), 1.25)
    sweep = Sweep((axis,), "peak", np.arange(9.0).reshape(3, 3), np.array([1.1, 4.1, 7.1]))
    values, sizes = curve(sweep)
    np.testing.assert_array_equal(values, [0, 1, 1.25, 2])
    np.testing.assert_array_equal(sizes[:, 2], [1.1, 4.1, 7.1, 7.1])
    np.testing.assert_array_equal(near(axis, values), [False, True, True, True])


def test_near_is_a_factor_of_a_stiffness_and_nothing_is_near_a_value_out_of_range():
    values = np.geomspace(1, 16, 17)
    axis = Axis(("joint1.k_tors",), values, float(values[8]))
    assert near(axis, values).sum() == 3
    outside = Axis(("joint1.k_tors",), values, 20.0)
    assert not has_present(outside)
    assert not near(outside, values).any()
