"""Numbers in words, the hopeless ones too."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arms import lcd_arm

from ident.arm.parts import Servo
from ident.inference.information import chi_squared_in_words, p_in_words, sigma_in_words, standard_deviations
from ident.measure import Campaign, Measurement
from ident.report.words import as_factor, beside, in_percent, kinds_in_words, percent, scatter, three_digits
from ident.studies.stiffness.fit_report import _residuals
from ident.studies.stiffness.warnings import drive_states, odd_numbers


def test_nothing_is_said_of_chi_squared_or_residuals_that_cannot_be_judged():
    """Four values and as many unknowns, each with a prior: what is left of chi-squared is the priors'."""
    test = SimpleNamespace(chi_squared=12.8, degrees_of_freedom=0, p_value=math.nan)
    assert chi_squared_in_words(test) == "no degrees of freedom are left, so chi-squared tests nothing"
    told = vars(test) | {"degrees_of_freedom": 4, "p_value": 0.012}
    assert chi_squared_in_words(SimpleNamespace(**told)) == "chi-squared 12.8 on 4 degrees of freedom (p = 0.012)"
    rows = [Measurement(kind="frequency", posture=(0.0,), value=4.0, sigma=0.1)] * 4
    z = {"farthest_off": (0, 1, 2, 3), "standardised": np.full(4, np.nan), "suspicious": np.zeros(4, bool)}
    fit = SimpleNamespace(campaign=Campaign(measurements=tuple(rows)), weights=None, cross_predictions=(), **z)
    fit.contradictory = False
    assert _residuals(fit) == "None of the 4 residuals can be judged: no measurement checks another."


@pytest.mark.parametrize(
    ("sd", "words"),
    [(0.0213, "2.1 %"), (0.29, "29 %"), (0.7, "factor 2"), (13.0, "factor 4.4e+05"), (14.0, "factor over 1e+06")],
)
def test_a_scatter_is_in_percent_or_a_factor(sd, words):
    assert scatter(sd) == words


@pytest.mark.parametrize("log", [1e3, 1e300, math.inf])
def test_what_nothing_bounds_overflows_nothing(log):
    assert as_factor(log) == "over 1e+06"


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (-0.0372, "-3.7 %"),
        (0.031, "+3.1 %"),
        (-0.999, "0.001 times"),
        (37.2, "38 times"),
        (3.2, "+320 %"),
        (0.00021, "+0.021 %"),
    ],
)
def test_a_difference_in_percent(share, words):
    assert in_percent(share) == words


@pytest.mark.parametrize(
    ("share", "words"), [(0.0086, "0.86 %"), (0.994, "99 %"), (1.0, "100 %"), (1.12, "112 %"), (-1.5, "-150 %")]
)
def test_a_share_has_no_power_of_ten(share, words):
    assert percent(share) == words


@pytest.mark.parametrize(("number", "words"), [(17.0, "17.0"), (184.2, "184"), (0.1239, "0.124"), (0.0, "0.00")])
def test_three_digits_end_in_no_point(number, words):
    assert three_digits(number) == words


@pytest.mark.parametrize(
    ("number", "limit", "words"),
    [
        (0.7071, 0.5, "0.71"),
        (0.4987, 0.5, "0.499"),
        (0.504, 0.5, "0.504"),
        (0.7065, 0.707, "0.7065"),
        (124.0, 0.5, "120"),
    ],
)
def test_two_digits_or_as_many_as_tell_the_side_of_a_limit(number, limit, words):
    assert beside(number, limit) == words
    assert (float(words) > limit) == (number > limit)


def test_kinds_of_measurement_in_the_plural():
    assert kinds_in_words(["deflection", "frequency"]) == "deflections and frequencies"
    assert kinds_in_words(["damping_ratio"]) == "damping ratios"
    assert kinds_in_words(["twist", "shape", "rotation"]) == "twists, shapes and rotations"


def test_rows_with_a_servo_on_are_warned_of_unless_the_arm_describes_it():
    rows = [
        Measurement(kind="frequency", posture=(0.0,) * 3, value=4.0, sigma=0.1, drives=d) for d in ("servo", "brake")
    ]
    mixed, servo = Campaign(measurements=tuple(rows)), Campaign(measurements=tuple(rows[:1]))
    (finding,) = drive_states(lcd_arm(), mixed)
    assert finding.text.endswith("the servo was on in row 1")
    assert finding.remedy == "fit them separately"
    assert "each k_tors includes its servo" in drive_states(lcd_arm(), servo)[0].text
    described = replace(lcd_arm(), servos=(Servo("servo1", "joint1", k_servo=100.0),))
    assert drive_states(described, mixed) == ()


def test_a_number_that_looks_wrong_is_warned_of_and_a_sound_arm_is_not():
    assert odd_numbers(lcd_arm()) == ()
    odd = odd_numbers(lcd_arm().replace({"drive1.ratio": 1e6}))
    assert [finding.text.split(": ")[1] for finding in odd] == ["drive1.ratio", "belt1"]
    assert "ident show" in odd[0].remedy


def test_what_a_double_does_not_hold_is_said_as_less_or_more():
    assert [p_in_words(p) for p in (0.031234, 1e-120, 0.0)] == ["p = 0.031", "p = 1e-120", "p < 1e-300"]
    assert [sigma_in_words(sd) for sd in (4.06, math.inf)] == ["4.1 sigma", "over 38 sigma"]
    assert standard_deviations(1e-322) > 38
    assert standard_deviations(5e-324) == math.inf  # half of it is 0
