"""Numbers in words, the hopeless ones too."""

import math

import pytest

from ident.present.text.words import as_factor, scatter


@pytest.mark.parametrize(
    ("sd", "words"),
    [(0.0213, "2.1 %"), (0.29, "29 %"), (0.7, "factor 2"), (13.0, "factor 4.4e+05"), (14.0, "factor over 1e+06")],
)
def test_a_scatter_is_in_percent_or_a_factor(sd, words):
    assert scatter(sd) == words


@pytest.mark.parametrize("log", [1e3, 1e300, math.inf])
def test_what_nothing_bounds_overflows_nothing(log):
    assert as_factor(log) == "over 1e+06"
