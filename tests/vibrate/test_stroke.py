"""Straight strokes: from end to end within the limits, one of which is reached, on whatever clock."""

import math
from typing import get_args

import numpy as np
import pytest
from conformance import agrees
from hypothesis import given, settings
from hypothesis import strategies as st
from ruckig import Result
from scipy.interpolate import PPoly

from ident.arm.parts import PROFILES as NAMES
from ident.arm.parts import Stroke
from ident.description.schema import Profile
from ident.errors import InputError, ModelError
from ident.vibrate.motion import PROFILES, cycloid_duration, stroke

DIRECTION = np.array([1.0, -2.0, 1.0])


NUMBERS = {"folded": -1.4, "unfolded": 0.0, "speed": 1.2, "acceleration": 4.0, "jerk": 30.0}


def path_with(profile="s-curve", **changes):
    return Stroke(DIRECTION, profile=profile, **(NUMBERS | changes))


PATH = path_with()


def alpha(motion):
    """alpha as scipy's polynomial; the directions of all joints are checked on the way."""
    c = np.asarray(motion.coefficients)
    np.testing.assert_allclose(c, c[..., :1] * DIRECTION, rtol=1e-12, atol=1e-12)
    return PPoly(c[..., 0], np.asarray(motion.breaks))


def peaks(motion):
    """Largest speed, acceleration and jerk of alpha, by a grid with ends and minimum jerk's peaks."""
    path = alpha(motion)
    x = np.append(np.linspace(0, 1, 401), (1 + np.array([-1, 1]) / np.sqrt(3)) / 2)[:, None] * np.diff(path.x)
    values = [[np.polyval(np.polyder(path.c[:, k], n), x[:, k]) for k in range(x.shape[1])] for n in (1, 2, 3)]
    return [float(np.abs(v).max()) for v in values]


def problems(**changes):
    options = {name: changes.pop(name) for name in ("percent", "profile", "dwell") if name in changes}
    with pytest.raises(InputError) as caught:
        stroke(path_with(**changes), **options)
    return [str(p) for p in caught.value.problems]


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("retract", [False, True])
def test_it_goes_from_end_to_end_at_rest(profile, retract):
    motion = stroke(PATH, profile=profile, retract=retract, dwell=0.5)
    first, last = (0.0, -1.4) if retract else (-1.4, 0.0)
    start = motion.on_piece(0, 0.0)
    arrived = motion.on_piece(len(motion.breaks) - 3, motion.arrival)
    np.testing.assert_allclose(start[0], first * DIRECTION, atol=1e-14)
    np.testing.assert_allclose(arrived[0], last * DIRECTION, atol=1e-14)
    np.testing.assert_allclose(motion(motion.arrival + 0.2)[0], last * DIRECTION, atol=1e-14)
    assert max(float(abs(start[1]).max()), float(abs(arrived[1]).max())) < 1e-13
    assert motion.breaks[0] == 0.0
    assert motion.breaks[-1] == pytest.approx(motion.arrival + 0.5, rel=1e-14)
    assert motion.name == f"{'retraction' if retract else 'extension'}, {profile}, 100 %"


SIZES = st.floats(0.1, 10)


@pytest.mark.parametrize("profile", PROFILES)
@given(distance=SIZES, speed=SIZES, acceleration=SIZES, jerk=SIZES, percent=st.floats(2, 300))
@settings(deadline=None, max_examples=25)
def test_limits_are_kept_and_one_is_reached(profile, distance, speed, acceleration, jerk, percent):
    path = path_with(folded=0.3, unfolded=0.3 + distance, speed=speed, acceleration=10 * acceleration, jerk=100 * jerk)
    motion = stroke(path, profile=profile, percent=percent)
    p = percent / 100
    limits = [speed * p, 10 * acceleration * p**2, 100 * jerk * p**3]
    used = np.divide(peaks(motion), limits)[: 2 if profile == "trapezoid" else 3]
    assert used.max() == pytest.approx(1.0, rel=1e-6)
    assert alpha(motion)(motion.breaks[-1]) == pytest.approx(0.3 + distance, abs=1e-12)


def test_the_trapezoid_is_the_textbooks():
    path = path_with(folded=0.0, unfolded=2.0, speed=1.0, acceleration=2.0, jerk=1e-3)
    motion = stroke(path, profile="trapezoid")
    what, expected = "times of a trapezoidal stroke", [0.0, 0.5, 2.0, 2.5]
    agrees(motion.breaks, expected, "vibration", what, "textbook, v / a", rtol=1e-12, unit="s")
    np.testing.assert_allclose(motion(np.array([0.25, 1.0, 2.25]))[2][0], [2.0, 0.0, -2.0], atol=1e-12)
    np.testing.assert_allclose(motion(np.array([0.5, 1.0, 2.0]))[0][0], [0.25, 0.75, 1.75], rtol=1e-12)


def test_the_s_curve_is_the_textbooks():
    """With all three limits reached, T = D/v + v/a + a/j."""
    motion = stroke(PATH)
    expected = 1.4 / 1.2 + 1.2 / 4.0 + 4.0 / 30.0
    what, source = "duration of an s-curve", "textbook, D/v + v/a + a/j"
    agrees(motion.duration, expected, "vibration", what, source, rtol=1e-12, unit="s")
    np.testing.assert_allclose(peaks(motion), [1.2, 4.0, 30.0], rtol=1e-9)


def test_the_s_curve_without_jerk_limit_is_the_trapezoid():
    bare, trapezoid = stroke(path_with(jerk=math.inf)), stroke(PATH, profile="trapezoid")
    np.testing.assert_array_equal(bare.breaks, trapezoid.breaks)
    np.testing.assert_array_equal(bare.coefficients, trapezoid.coefficients)


def test_the_cycloid_is_the_textbooks_to_the_last_digits():
    motion = stroke(path_with(folded=0.0, unfolded=1.0), profile="cycloid")
    T = float(motion.duration)
    assert cycloid_duration(1.0, (1.2, 4.0, 30.0)) == pytest.approx(T, rel=1e-15)
    s = np.linspace(0, 1, 4001)[:-1]
    q, qd, qdd = (np.asarray(state[0]) for state in motion(s * T))
    turn = 2 * np.pi * s
    expected, what = s - np.sin(turn) / (2 * np.pi), "way of a cycloid"
    agrees(q, expected, "vibration", what, "textbook, s - sin(2 pi s) / (2 pi)", atol=1e-14)
    np.testing.assert_allclose(qd * T, 1 - np.cos(turn), rtol=0, atol=1e-13)
    np.testing.assert_allclose(qdd * T**2, 2 * np.pi * np.sin(turn), rtol=0, atol=1e-12)
    assert len(motion.coefficients) <= 14


@pytest.mark.parametrize(
    ("limits", "touched"),
    [((1.0, 99.0, 9999.0), 2.0), ((99.0, 1.0, 9999.0), 2 * np.pi), ((99.0, 99.0, 1.0), 39.478418)],
)
def test_each_limit_can_set_the_cycloids_duration(limits, touched):
    order = 1 + int(np.argmin(limits))
    found, what = cycloid_duration(3.0, limits), "duration of a cycloid by each limit"
    agrees(found, (3.0 * touched) ** (1 / order), "vibration", what, "closed form", rtol=1e-8, unit="s")


def test_minimum_jerk_has_the_least_integral_of_the_jerk_squared():
    """720 D^2/T^5 (Flash and Hogan 1985), which no other profile of the same time falls below."""

    def integral(motion):
        jerk = alpha(motion).derivative(3)
        return float(
            (jerk(np.linspace(0, motion.arrival, 20001)[:-1] + motion.arrival / 40002) ** 2).mean() * motion.arrival
        )

    motion = stroke(path_with(folded=0.0, unfolded=1.0), profile="minimum-jerk")
    T = motion.arrival
    assert pytest.approx(max(1.875 / 1.2, (10 / np.sqrt(3) / 4.0) ** 0.5, (60 / 30.0) ** (1 / 3))) == T
    what, source = "integral of the squared jerk", "Flash and Hogan 1985, 720 D^2 / T^5"
    agrees(integral(motion), 720 / T**5, "vibration", what, source, rtol=1e-6)
    for profile in ("s-curve", "cycloid"):
        other = stroke(path_with(folded=0.0, unfolded=1.0), profile=profile)
        assert integral(other) * other.arrival**5 > 720 * 1.05


@pytest.mark.parametrize("profile", PROFILES)
def test_a_tenth_of_the_speed_is_the_same_path_slower(profile):
    full, tenth = stroke(PATH, profile=profile, dwell=1.0), stroke(PATH, profile=profile, dwell=1.0, percent=10)
    assert tenth.arrival == pytest.approx(10 * full.arrival, rel=1e-14)
    assert float(tenth.duration) == pytest.approx(10 * full.arrival + 1.0, rel=1e-14)
    t = np.linspace(0.01, 0.99, 57) * full.arrival
    for n, (fast, slow) in enumerate(zip(full(t), tenth(10 * t), strict=True)):
        np.testing.assert_allclose(slow, fast / 10**n, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("percent", [0.0, -1.0, 1000.5, math.nan])
def test_a_percentage_that_cannot_be(percent):
    (text,) = problems(percent=percent)
    assert text.startswith(f"percent: got {percent:g} %, expected above 0 and at most 1000 %; ")


def test_the_profile_is_the_path_s_own_unless_another_is_asked_for():
    own = stroke(path_with(profile="cycloid"))
    np.testing.assert_array_equal(own.coefficients, stroke(PATH, profile="cycloid").coefficients)
    np.testing.assert_array_equal(
        stroke(path_with(profile="cycloid"), profile="s-curve").coefficients, stroke(PATH).coefficients
    )
    assert tuple(PROFILES) == NAMES


def test_an_unknown_profile():
    assert problems(profile="S_curve") == [
        "profile: got 'S_curve', expected one of s-curve, trapezoid, cycloid, minimum-jerk; did you mean s-curve?"
    ]
    assert problems(profile="")[0].endswith("choose one of them")


def test_a_negative_dwell():
    (text,) = problems(dwell=-0.5)
    assert text == "dwell: got -0.5 s, expected a finite time of at least 0 s; correct the time"


def test_no_way_to_go():
    (text,) = problems(folded=0.5, unfolded=0.5)
    assert text == (
        "folded: got folded at 28.6479 deg and unfolded at 28.6479 deg, expected two different angles; "
        "correct the stroke"
    )
    assert len(problems(folded=math.nan)) == 1


def test_all_limits_that_cannot_be_are_told():
    assert problems(speed=0.0, acceleration=math.inf, jerk=-1.0) == [
        "speed: got 0 rad/s, expected a finite speed above 0; correct the limit",
        "acceleration: got inf rad/s^2, expected a finite acceleration above 0; correct the limit",
        "jerk: got -1 rad/s^3, expected a jerk above 0, or inf for none; correct the limit",
    ]
    assert problems(speed=math.nan)[0].startswith("speed: got nan rad/s")


def test_a_library_that_finds_nothing(monkeypatch):
    class Lost:
        def __init__(self, joints):
            self.joints = joints

        def calculate(self, request, answer):
            return Result.ErrorExecutionTimeCalculation

    monkeypatch.setattr("ident.vibrate.motion.Ruckig", Lost)
    with pytest.raises(ModelError, match=r"^no motion over 1.4 rad within .*jerk=30.*ErrorExecutionTimeCalculation; "):
        stroke(PATH)


def test_a_limit_reached_for_an_instant_only():
    """The speed limit is reached at the one time between two jerk phases; a piece of rounding's length is dropped."""
    distance = 5.683680012547728
    motion = stroke(path_with(folded=0.0, unfolded=distance, speed=1.0, acceleration=1.0, jerk=1.0))
    assert float(np.diff(motion.breaks).min()) > 1e-6
    assert alpha(motion)(motion.breaks[-1]) == pytest.approx(distance, abs=1e-11)


def test_an_arm_file_may_name_the_same_profiles():
    assert get_args(Profile.model_fields["value"].annotation) == NAMES
