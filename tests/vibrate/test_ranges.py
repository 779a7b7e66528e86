"""From where to where a number is swept or may be changed, and what is refused."""

import numpy as np
import pytest
from arms import DATA

from ident.description.file import read_arm
from ident.errors import InputError
from ident.vibrate.sweep import Bound, Range, axis_of, variable_of
from ident.vibrate.variable import Variable

FILE = read_arm(DATA / "lcd_arm" / "arm.toml")


def values(*paths, bounds=None, count=None, percent=10.0, arm=FILE.arm):
    pair = bounds and tuple(bound if isinstance(bound, Bound) else Bound(bound) for bound in bounds)
    return axis_of(arm, Range(paths, pair, count), percent, FILE.extents)


def test_usual_ranges():
    stiffness = values("joint1.k_tors")
    present = float(FILE.arm.get("joint1.k_tors"))
    np.testing.assert_allclose(stiffness.values, present * np.geomspace(0.4, 2.5, 21))
    assert (stiffness.present, len(stiffness.values)) == (present, 21)
    np.testing.assert_allclose(values("fingers.com.x").values, np.linspace(1.04, 2.04, 21), err_msg="a fifth of 2.5 m")
    high = FILE.arm.replace({"bracket.com.x": 0.25})
    np.testing.assert_allclose(values("bracket.com.x", arm=high).values[[0, -1]], [0.192, 0.29], err_msg="clipped")
    np.testing.assert_allclose(values("tip.position.x").values[[0, -1]], [2.69, 2.89])
    np.testing.assert_allclose(values("speed").values, np.geomspace(4, 25, 21))
    np.testing.assert_allclose(values("drive1.phase").values[[0, -1]], [-np.pi, np.pi])


def test_bounds_as_they_are_and_as_multiples():
    np.testing.assert_allclose(values("speed", bounds=(4, 20), count=17).values, np.arange(4.0, 21.0))
    np.testing.assert_allclose(values("fingers.com.x", bounds=(1.0, 2.2), count=13).values, np.linspace(1, 2.2, 13))
    bounds = Bound(0.5, times=True), Bound(2.0, times=True)
    factors = values("link1.mass", bounds=bounds, count=3).values
    np.testing.assert_allclose(factors, [21, 42, 84])
    np.testing.assert_allclose(values("speed", bounds=bounds, count=3).values, [5, 10, 20])


def test_a_drive_that_turns_the_other_way():
    back = FILE.arm.replace({"drive1.ratio": -120.0})
    np.testing.assert_allclose(values("drive1.ratio", arm=back).values, -120 * np.geomspace(2.5, 0.4, 21))
    twice = Bound(0.5, times=True), Bound(2.0, times=True)
    np.testing.assert_allclose(values("drive1.ratio", arm=back, bounds=twice, count=3).values, [-240, -120, -60])
    with pytest.raises(InputError, match="bounds below 0"):
        values("drive1.ratio", arm=back, bounds=(-240, 240))


def test_what_may_be_changed_and_how_dear_that_is():
    present = float(FILE.arm.get("joint1.k_tors"))
    assert variable_of(FILE.arm, Range(("joint1.k_tors",))) == Variable(("joint1.k_tors",), present / 2, 2 * present)
    bounds = Bound(1.3), Bound(2.0, times=True)
    stiffer = variable_of(FILE.arm, Range(("joint1.k_tors",)), softer=False)
    assert stiffer == Variable(("joint1.k_tors",), present, 2 * present)
    shifted = variable_of(FILE.arm, Range(("fingers.com.x",), bounds, 3.0))
    assert shifted == Variable(("fingers.com.x",), 1.3, 2 * float(FILE.arm.get("fingers.com.x")), 3.0)
    high = FILE.arm.replace({"bracket.com.x": 0.25})
    usual = variable_of(high, Range(("bracket.com.x",)), FILE.extents)
    assert (usual.low, usual.high) == pytest.approx((0.15, 0.29)), "a decimetre either way, within the body"
    back = variable_of(FILE.arm.replace({"drive1.ratio": -120.0}), Range(("drive1.ratio",)))
    assert (back.low, back.high) == (-240.0, -60.0)
    with pytest.raises(InputError, match="got the speed, expected a number of the arm; sweep it"):
        variable_of(FILE.arm, Range(("speed",)))
    with pytest.raises(InputError, match="bounds about the present"):
        variable_of(FILE.arm, Range(("joint1.k_tors",), (Bound(1.5, times=True), bounds[1])))


@pytest.mark.parametrize(
    ("paths", "more", "words"),
    [
        (["joint1.k_tor"], {}, "did you mean joint1.k_tors?"),
        (["sped"], {}, "did you mean speed?"),
        (["stroke.speed"], {}, "sweep 'speed'"),
        (["link1.mass"], {"bounds": (2, 1)}, "got 2 to 1, expected a lower and a higher bound"),
        (["link1.mass"], {"bounds": (1, np.inf)}, "a lower and a higher bound"),
        (["link1.mass"], {"bounds": (0, 1)}, "got 0 to 1, expected bounds above 0"),
        (["link1.mass"], {"count": 1}, "got 1 values, expected a whole number from 2 to 500"),
        (["link1.mass"], {"count": 501}, "got 501 values"),
        (["link1.mass"], {"count": 2.5}, "got 2.5 values"),
        (["drive1.error"], {}, "got 0 at present"),
        (["bracket.inertia.xx"], {}, "got no bounds"),
        (["bracket.com.x"], {"bounds": (0, 0.3)}, "got 0 to 0.3 m, expected 0 to 0.29 m, within the body"),
        (["joint1.k_tors", "fingers.com.x"], {}, "a coordinate with other numbers"),
        (["joint1.k_tors", "speed"], {}, "the speed with others"),
        (["speed"], {"bounds": (4, 1001), "percent": 100.0}, "got 1001 %, expected at most 1000 %"),
        (["speed"], {"bounds": (4, 101)}, "at most 100 %; start from a higher `speed`"),
    ],
)
def test_refused(paths, more, words):
    with pytest.raises(InputError) as error:
        values(*paths, **more)
    assert words in str(error.value)
    assert len(error.value.problems) == 1
