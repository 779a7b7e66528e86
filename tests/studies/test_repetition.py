"""Numbers that came out again: the same to rounding, or within their Monte Carlo error."""

import numpy as np
import pytest

from ident.studies.repetition import differences


def rows(*numbers):
    return [{"number": number} for number in numbers]


@pytest.mark.parametrize(("relative", "same"), [(0.3e-9, True), (3e-9, False), (-3e-9, False)])
def test_numbers_count_as_the_same_to_rounding(relative, same):
    found = list(differences(rows(1.0, 2e4), rows(1.0, 2e4 * (1 + relative))))
    assert [(each.row, each.column, each.before) for each in found] == ([] if same else [(1, "number", 2e4)])


def test_numbers_that_are_rounding_themselves_and_infinite_ones_are_the_same():
    assert not list(differences(rows(1e-17, 2.0, np.inf, np.nan), rows(-3e-16, 2.0, np.inf, np.nan)))


@pytest.mark.parametrize(
    ("old", "new"), [((np.inf,), (1.0,)), ((1.0,), (1.0, 2.0)), (("supported",), ("open",)), ((True,), (False,))]
)
def test_what_is_no_number_any_more_is_not_the_same(old, new):
    assert list(differences(rows(*old), rows(*new)))


def test_sampled_numbers_are_the_same_within_four_standard_errors_of_their_difference():
    within, beyond = 10 + 3.9 * 0.1 * np.sqrt(2), 10 + 4.1 * 0.1 * np.sqrt(2)
    assert [each.row for each in differences(rows(10.0, 10.0), rows(within, beyond), rows(0.1, 0.1))] == [1]
