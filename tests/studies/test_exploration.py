"""What a page is told of an arm: what hangs on it, how fast the stroke passes each place, which loads it can show."""

import numpy as np
import pytest
from arms import lcd_arm

from ident.arm.chain import moments
from ident.identify.binding import loads_of
from ident.measure import Load
from ident.studies.look.exploration import exploration, mass_of, without
from ident.vibrate.motion import stroke

ARM = lcd_arm()


@pytest.mark.parametrize(
    ("load", "payload", "fixed", "present"),
    [
        ("glass", "", "own weight", 7.3),
        ("glass", "tip", "glass", 0.0),
        ("glass + 2 kg @ tip + 5 N -z @ tip", "tip", "glass + 5 N -z @ tip", 2.0),
        ("2 kg @ tip", "glass", "2 kg @ tip", 0.0),
    ],
)
def test_a_load_is_what_the_slider_moves_and_what_stays(load, payload, fixed, present):
    made = exploration(ARM, Load.parse(load), payload)
    assert made.fixed == Load.parse(fixed)
    assert made.carried.present == pytest.approx(present)
    assert mass_of(Load.parse(load), made.fixed, made.carried) == pytest.approx(present)
    assert made.carried.largest >= 2 * present


def test_another_load_is_none_that_the_slider_reaches():
    made = exploration(ARM, Load.parse("glass"), "glass")
    assert mass_of(Load.parse("glass + 1 kg @ tip"), made.fixed, made.carried) is None
    assert mass_of(Load(), made.fixed, made.carried) == 0
    assert without(Load.parse("glass + 1 kg @ tip"), made.carried) == Load.parse("1 kg @ tip")


@pytest.mark.parametrize(("load", "payload"), [("glass", "glass"), ("3 kg @ tip", "tip")])
def test_what_is_carried_has_the_moments_of_the_load(load, payload):
    carried = exploration(ARM, Load.parse(load), payload).carried
    with_load, alone = (moments(ARM, loads_of(ARM, Load.parse(text)), 0)[1] for text in (load, ""))
    for name in ("mass", "first", "second"):
        difference = np.asarray(getattr(with_load, name) - getattr(alone, name))[..., carried.joint]
        own = carried.present * np.asarray(getattr(carried.unit, name))[..., 0]
        np.testing.assert_allclose(own, difference, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("profile", ["s-curve", "trapezoid", "cycloid"])
def test_the_speed_is_that_of_the_stroke_where_it_passes(profile):
    motion = stroke(ARM.stroke, profile=profile)
    speed = exploration(ARM, Load(), "", motion).stroke
    assert np.degrees(speed.alpha[[0, -1]]) == pytest.approx([142, 0])
    assert (np.diff(speed.alpha) < 0).all()
    q, qd, _ = (np.asarray(x)[0] for x in motion(np.linspace(0.1, 0.9, 7) * motion.arrival))
    found = np.interp(-q, -speed.alpha, speed.rate)
    np.testing.assert_allclose(found, qd, rtol=1e-3)
