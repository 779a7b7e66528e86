"""Ramps and jerk times of a controller's knobs, against closed forms; what a file may say of the knobs."""

from itertools import pairwise

import numpy as np
import pytest
from arms import DATA, lcd_arm
from conformance import agrees
from knobs import table
from scipy.integrate import quad

from ident.description.file import parse_document
from ident.errors import InputError
from ident.studies.cure.knobs import setting, settings, typed
from ident.vibrate.motion import stroke
from ident.vibrate.schedule import Path
from ident.vibrate.shaping import averaged

OWN = lcd_arm().stroke
TEXT = (DATA / "lcd_arm" / "arm.toml").read_text(encoding="utf-8")


def knobs(*scales):
    document = parse_document(TEXT + "".join(table(each) for each in scales))
    return {knob.scales: knob for knob in document.controller.knob}


def left(motion, s):
    """Amplitude that the acceleration leaves of a mode with pole s, by quadrature over each piece."""
    breaks, total = np.asarray(motion.breaks), 0.0
    for low, high in pairwise(breaks):
        for part, unit in ((np.real, 1.0), (np.imag, 1j)):
            middle = (low + high) / 2
            k = int(np.searchsorted(breaks, middle) - 1)
            total += unit * quad(
                lambda t, k=k, part=part: part(float(motion.on_piece(k, np.array([t]))[2][0, 0]) * np.exp(-s * t)),
                low, high, epsabs=1e-12, epsrel=1e-11,
            )[0]  # fmt: skip
    return abs(total * np.exp(s * breaks[-1]))


def closed(s, speed, ramp, jerk_time, between):
    """The same of two ramps, averaged over the jerk time, their starts so far apart."""
    box = [(1 - np.exp(-s * each)) / (s * each) for each in (ramp, jerk_time) if each]
    return abs(speed * np.prod(box) * (1 - np.exp(-s * between)) * np.exp(s * (between + ramp + jerk_time)))


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.03])
@pytest.mark.parametrize(("ramp", "jerk_time"), [(1.0, 0.0), (0.7, 0.0), (1.0, 1 / 1.16)])
def test_what_a_ramp_and_a_jerk_time_leave_is_the_closed_form(ratio, ramp, jerk_time):
    """Of a mode of 4 Hz, and of one 16 % above; in periods of the first."""
    words, limits, averaging = setting({}, OWN, 0.5, ramp / 4, jerk_time / 4)
    assert (words, averaging) == ("", pytest.approx(jerk_time / 4, abs=1e-15))
    motion = stroke(limits, profile="trapezoid")
    motion = averaged(motion, averaging) if averaging else motion
    between = abs(float(OWN.unfolded - OWN.folded)) / 0.5
    for frequency in (4.0, 4.64):
        s = 2 * np.pi * frequency * (-ratio + 1j * np.sqrt(1 - ratio**2))
        expected = closed(s, 0.5, ramp / 4, jerk_time / 4, between)
        what = "what a ramp and a jerk time leave of a mode"
        agrees(left(motion, s), expected, "vibration", what, "closed form of averaged ramps", atol=1e-10, unit="rad/s")


def left_by_one_ramp(periods, s):
    """What the first ramp leaves, so many periods of 4 Hz long."""
    limits = setting({}, OWN, 0.5, periods / 4)[1]
    return left(stroke(limits, profile="trapezoid"), s)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.03])
def test_a_ramp_of_one_period_leaves_less_than_a_tenth_of_what_a_shorter_one_does(ratio):
    s = 2 * np.pi * 4.0 * (-ratio + 1j * np.sqrt(1 - ratio**2))
    assert left_by_one_ramp(1.0, s) < 0.1 * left_by_one_ramp(0.7, s)


def test_of_the_second_mode_of_the_paper_s_arm_a_ramp_of_the_first_keeps_61_percent():
    s = 2j * np.pi * 4.0 * 1.16
    assert left_by_one_ramp(1.0, s) / left_by_one_ramp(0.7, s) == pytest.approx(0.61, abs=0.005)  # as printed


def test_numbers_to_type_are_those_that_a_knob_takes():
    own = knobs("time", "speed", "ramp", "jerk time")
    words, limits, jerk_time = setting(own, OWN, np.radians(9.2), 0.2443, 0.2101)
    assert words == "OVERRIDE 100 %, VEL 10 %, ACC_T 244 ms, JERK_T 212 ms"
    assert float(limits.speed) == pytest.approx(np.radians(9.0))
    assert float(limits.acceleration) == pytest.approx(np.radians(9.0) / 0.244)
    assert jerk_time == pytest.approx(0.212)
    words, limits, jerk_time = setting(knobs("acceleration", "jerk"), OWN, np.radians(9.0), 0.25, 0.2)
    assert words == "ACC 36 %, JERK 180 deg/s^3"
    assert float(limits.acceleration) == pytest.approx(np.radians(36.0))
    assert jerk_time == pytest.approx(0.2)
    assert typed(own["ramp"], 9.0, 1.0) == ("ACC_T 4000 ms", 4.0)


def test_ramps_have_whole_periods_that_the_acceleration_allows():
    path = Path.of_stroke(lcd_arm(), OWN, 100.0)
    every = list(settings(knobs("speed", "ramp", "jerk time"), OWN, path, 100.0, (0.25, 0.21), [1.0, 0.2]))
    assert [name for name, *_ in every[:4]] == ["ramp 4/f1", "ramp 5/f1", "ramp 6/f1", "ramp 4/f1, jerk 3/f2"]
    assert every[6][0] == "ramp 1/f1, 20%", "a programmed speed leaves the acceleration alone: 90 deg/s in 0.9 s"
    for _, _, motion in every:
        time = np.linspace(0.0, motion.arrival, 4001)
        q, qd, qdd = (np.asarray(part) for part in motion(time))
        np.testing.assert_allclose(q[:, -1], OWN.unfolded * np.array([1, -2, 1]), atol=1e-9)
        assert np.abs(qdd[0]).max() <= float(OWN.acceleration) * (1 + 1e-9)
        assert np.abs(qd[0]).max() <= float(OWN.speed) * (1 + 1e-9)
    assert not list(settings(knobs("speed"), OWN, path, 100.0, (0.25, 0.21), [1.0])), "no knob for a ramp"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (table("speed", scales='"torque"'), "scales: got 'torque', expected 'time', 'speed'"),
        (table("ramp", unit='"%"'), "got '%', expected s or ms; give that unit to what scales ramp"),
        (table("ramp", range="[40, 30]"), "range: got [40.0, 30.0], expected lower limit < upper limit"),
        (table("time", range="[1, 50]"), "expected a range with 100 %"),
        (table("ramp") + table("ramp"), "several knobs that scale ramp, expected one"),
        (table("ramp", stepp=1), "unknown key 'stepp'"),
        ("\n[controller]\n", "the key knob"),
    ],
)
def test_a_controller_that_cannot_be_is_refused_in_one_line(text, said):
    with pytest.raises(InputError) as refused:
        parse_document(TEXT + text)
    (line,) = str(refused.value).splitlines()
    assert said in line
    assert line.startswith("arm.toml:")
