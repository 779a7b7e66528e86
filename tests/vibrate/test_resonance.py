"""Natural frequencies along a motion, where a pulley's turning meets them, and the vibration that this causes."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from arms import first_guess_arm, lcd_arm
from runs import about, held, hold_still
from scipy.signal import lsim

from ident.arm.arm import Arm
from ident.arm.modes import Label
from ident.arm.multibody import exciting_orders
from ident.arm.parts import Body, Drive, ErrorOrder, Joint, Point
from ident.errors import InputError, ModelError
from ident.vibrate.branches import Branches, branches, track
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.resonance import (
    RATE,
    Excitation,
    Source,
    excitation,
    magnification,
    resonance_crossings,
    sweep_number,
    with_amplitudes,
)
from ident.vibrate.simulate import superposition

slow = pytest.mark.slow

RATIO = 100.0


def one_joint_arm(**drive) -> Arm:
    """A link about one vertical axis: its natural frequencies are the same at every posture."""
    link = Body("link", 10.0, (0.4, 0.0, 0.0), np.diag([0.02, 0.5, 0.5]))
    joint = Joint("pin", axis=(0, 0, 1), k_bend=4e4, k_tors=3e4, tau_bend=1e-4, tau_tors=1e-4, link=(link,))
    drives = (Drive("motor", "pin", ratio=RATIO, **drive),)
    return Arm("one", (joint,), points=(Point("end", "pin", (0.8, 0.0, 0.0)),), drives=drives)


def speeding_up(acceleration: float = 0.5, seconds: float = 4.0) -> Motion:
    return Motion("ramp", [0.0, seconds], [[[acceleration / 2]], [[0.0]], [[0.0]]])


def made(frequency, damping: float = 0.01, seconds: float = 10.0) -> Branches:
    """Branches of given frequencies (B, T, *sets) over ten seconds."""
    frequency = np.asarray(frequency, float)
    count, points = frequency.shape[:2]
    time = np.linspace(0, seconds, points)
    labels = tuple(Label("vertical", "bending", b + 1) for b in range(count))
    return Branches(time, np.stack([time]), frequency, np.full(frequency.shape, damping), labels)


def turning(branches: Branches, line) -> Excitation:
    line = np.broadcast_to(np.asarray(line, float), branches.time.shape)
    rate = np.gradient(line, branches.time)
    return Excitation((Source("motor", "pin", 1, 1),), branches.time, line[None], rate[None])


@pytest.fixture(scope="module")
def extension():
    motion = stroke(first_guess_arm().stroke, percent=10, dwell=0.5)
    return motion, branches(first_guess_arm(), motion, times=np.linspace(0, float(motion.breaks[-1]), 301))


@slow
def test_branches_go_straight_through_a_crossing_where_sorted_frequencies_have_a_kink(extension):
    _, found = extension
    torsion, bending = found.median[:2]
    assert (torsion > bending)[0]
    assert (torsion < bending)[-1]
    rise = np.diff(np.stack([torsion, bending, np.sort(found.median[:2], axis=0)[0]]), n=2)
    moving = slice(40, 140)
    smooth, kinked = np.abs(rise[:2, moving]).max(), np.abs(rise[2, moving]).max()
    assert kinked > 4 * smooth
    assert [str(label) for label in found.labels] == ["lateral torsion 1", "vertical bending 1", "vertical bending 2"]
    assert not found.veerings
    assert all(change.branch == 2 for change in found.changes)


@slow
def test_branches_have_the_frequencies_and_damping_ratios_of_the_held_arm_by_scipy(extension):
    _, found = extension
    for k in (0, 100, 200, 300):
        lin = about(first_guess_arm(), held(tuple(np.degrees(found.posture[:, k]))))
        M, C, H = (np.asarray(part) for part in (lin.M, lin.C, lin.H))
        natural = np.sqrt(scipy.linalg.eigvalsh(H, M))[:3] / (2 * np.pi)
        assert np.sort(found.frequency[:, k]) == pytest.approx(natural, rel=2e-4)
    whole = np.block([[np.zeros_like(M), np.eye(len(M))], [-np.linalg.solve(M, H), -np.linalg.solve(M, C)]])
    s = np.linalg.eigvals(whole)
    s = sorted(s[s.imag > 0], key=abs)[:3]
    assert found.damping_ratio[:, -1] == pytest.approx(-np.real(s) / np.abs(s), rel=0.01)


@slow
def test_a_label_that_changes_is_told_with_the_time_of_it(extension):
    _, found = extension
    first, *_, last = found.changes
    assert str(first.before) == "lateral torsion 2"
    assert str(last.after) == "vertical bending 2"
    assert str(found.label(2, first.time - 0.01)) == "lateral torsion 2"
    assert found.label(2, last.time + 0.01) == found.labels[2]


@slow
def test_the_way_back_has_the_same_frequencies_on_the_same_clock():
    arm = lcd_arm()
    there, back = (branches(arm, stroke(arm.stroke, percent=10, retract=way)) for way in (False, True))
    order = [list(map(str, back.first_labels)).index(str(label)) for label in there.labels]
    assert there.frequency == pytest.approx(back.frequency[order, ::-1], rel=1e-4)


@slow
def test_an_arm_that_is_held_still_has_constant_frequencies():
    """Here those of any other posture, the lowest in closed form: torsion about the vertical axis."""
    found = branches(one_joint_arm(), hold_still([0.3], 1.0), count=2, times=[0.0, 0.4, 1.0])
    moving = branches(one_joint_arm(), speeding_up(), count=2, times=[0.0, 2.0])
    assert found.frequency == pytest.approx(np.repeat(moving.frequency[:, 1:], 3, axis=1), rel=1e-9)
    assert found.frequency[0] == pytest.approx(np.sqrt(3e4 / (0.5 + 10 * 0.4**2)) / (2 * np.pi), rel=1e-4)


def test_repeated_frequencies_are_no_veering():
    """Their shapes are any basis of the plane, at each posture another."""
    turn, s = np.random.default_rng(0).uniform(0, 2 * np.pi, 5), np.linspace(0, 1, 5)
    shapes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    mass = np.repeat(np.eye(2)[..., None], 5, axis=2)
    same, near = np.full((2, 5), 5.0), np.tile([[5.0], [5.001]], 5)
    assert track(s, same, shapes, mass, count=2, reach=0.0).mac.min() == pytest.approx(1.0)
    assert track(s, near, shapes, mass, count=2, reach=0.0).mac.min() < 0.9


def two_modes(s, gap):
    """Two oscillators whose frequencies cross at s = 0, coupled so that they come no nearer than `gap`."""
    H = np.array([[[25.0 + x, gap], [gap, 25.0 - x]] for x in s])
    values, shapes = np.linalg.eigh(H)
    mass = np.repeat(np.eye(2)[..., None], len(s), axis=2)
    return s, np.sqrt(values).T, np.moveaxis(shapes, 0, -1), mass


@pytest.mark.parametrize(
    ("gap", "exchange"), [(1e-4, True), (0.02, True), (0.5, False)], ids=["crossing", "narrow", "wide"]
)
def test_a_narrow_veering_is_a_crossing_and_a_wide_one_changes_the_shape(gap, exchange):
    found = track(*two_modes(np.linspace(-1, 1.03, 41), gap), count=2, reach=0.2)
    assert (found.place[:, 0] == found.place[::-1, -1]).all() == exchange
    assert found.mac.min() > 0.9


def test_what_cannot_be_followed_has_a_low_mac():
    found = track(*two_modes(np.array([-1.0, -0.05, 0.05, 1.0]), 0.05), count=2, reach=0.2)
    assert found.mac.min() < 0.9


@slow
def test_sets_are_followed_by_their_own_shapes():
    arm, motion = lcd_arm(), stroke(lcd_arm().stroke, percent=10)
    times = np.linspace(0, float(motion.breaks[-1]), 60)
    names = [f"joint{j}.k_{kind}" for j in (1, 2, 3) for kind in ("bend", "tors")]
    factors = np.array([0.8, 1.0, 1.2])
    some = branches(arm.replace({name: float(arm.get(name)) * factors for name in names}), motion, times=times)
    plain = branches(arm, motion, times=times)
    assert some.frequency.shape == (3, 60, 3)
    assert some.frequency[..., 1] == pytest.approx(plain.frequency, rel=1e-4)
    alone = branches(arm.replace({name: float(arm.get(name)) * 0.8 for name in names}), motion, times=times)
    assert some.frequency[:2, :, 0] == pytest.approx(alone.frequency[:2], rel=1e-3)
    assert (some.band()[0] < some.median).all()
    assert (some.median < some.band()[1]).all()


def test_pulley_frequencies_in_closed_form():
    time = np.linspace(0, 4, 9)
    found = excitation(one_joint_arm(), speeding_up(0.5), times=time, orders=(1,)).frequency
    expected = RATIO * 0.5 * time / (2 * np.pi)
    assert found[0, :-1] == pytest.approx(expected[:-1], rel=1e-12)
    assert found[0, -1] == 0.0  # the end is rest


def test_the_kinematic_error_excites_twice_a_turn_and_only_where_there_is_one():
    motion, time = speeding_up(), [0.5, 1.0]
    assert [s.order for s in excitation(one_joint_arm(), motion, times=time).sources] == [1]
    found = excitation(one_joint_arm(error=1e-5), motion, times=time)
    assert [s.order for s in found.sources] == [1, 2]
    assert found.frequency[1] == pytest.approx(2 * found.frequency[0])
    several = tuple(ErrorOrder("motor", order, amplitude=amplitude) for order, amplitude in ((4, 1e-5), (3, 0), (1, 1)))
    found = excitation(one_joint_arm(error=1e-5, errors=several), motion, times=time)
    assert [s.order for s in found.sources] == [1, 2, 4]
    assert [s.order for s in excitation(one_joint_arm(), motion, times=time, orders=(1, 3)).sources] == [1, 3]


@slow
def test_a_linear_ramp_crosses_when_the_closed_form_says():
    arm, time = one_joint_arm(), np.linspace(0, 3.9, 50)
    found = branches(arm, speeding_up(), count=1, times=time)
    natural, slope = float(found.frequency[0, 0]), RATIO * 0.5 / (2 * np.pi)
    (met,) = resonance_crossings(found, excitation(arm, speeding_up(), times=time), margin=0.1)
    assert met.crossings == pytest.approx([natural / slope], rel=1e-9)
    assert (met.start, met.end) == pytest.approx((0.9 * natural / slope, 1.1 * natural / slope), rel=1e-9)
    assert met.posture[0] == pytest.approx(0.25 * (natural / slope) ** 2, rel=2e-3)
    assert met.rate == pytest.approx(slope, rel=1e-9)
    assert met.distance == 0.0
    assert met.cycles == pytest.approx(natural * 0.2 * natural / slope, rel=1e-6)
    assert met.sweep_number == pytest.approx(slope / (met.damping_ratio * natural) ** 2)


def test_a_crossing_between_two_samples_is_not_missed():
    found = made(np.full((1, 11), 5.0))
    (met,) = resonance_crossings(found, turning(found, np.linspace(0, 100, 11)), margin=0.05)
    assert met.crossings == pytest.approx([0.5])
    assert met.end - met.start == pytest.approx(0.05)


def test_near_without_crossing():
    found = made(np.full((1, 101), 5.0))
    line = 4.8 - 0.02 * (found.time - 5) ** 2
    (met,) = resonance_crossings(found, turning(found, line), margin=0.1)
    assert met.crossings == ()
    assert met.crossing_probability == 0
    assert (met.time, met.distance, met.relative_distance) == pytest.approx((5.0, 0.2, 0.04))
    assert (met.start, met.end) == pytest.approx((5 - np.sqrt(15), 5 + np.sqrt(15)), abs=2e-3)
    assert not resonance_crossings(found, turning(found, line), margin=0.03)


def test_the_half_power_bandwidth_widens_the_margin():
    found = made(np.full((1, 101), 5.0), damping=0.1)
    line = turning(found, 4.3)
    assert resonance_crossings(found, line, margin=0.05)[0].margin == pytest.approx(0.2)
    assert not resonance_crossings(made(np.full((1, 101), 5.0), damping=0.01), line, margin=0.05)


def test_a_pulley_that_stands_still_is_never_near():
    found = made(np.full((1, 101), 5.0), damping=0.6)
    assert not resonance_crossings(found, turning(found, 0.0))
    assert resonance_crossings(found, turning(found, 1e-3))


def test_probability_is_the_share_of_the_sets():
    frequency = np.full((1, 101, 8), 5.0)
    frequency[..., ::2] = 50.0
    found = made(frequency)
    (met,) = resonance_crossings(found, turning(found, 4.7))
    assert met.probability == 0.5
    assert met.crossing_probability == 0.0
    (met,) = resonance_crossings(found, turning(found, np.linspace(4, 6, 101)))
    assert (met.probability, met.crossing_probability) == (0.5, 0.5)


def test_encounters_have_a_probability_each():
    frequency = np.repeat(np.linspace(5.0, 5.9, 10)[None, None], 101, axis=1)
    found = made(frequency)
    assert resonance_crossings(found, turning(found, 4.76), margin=0.1)[0].probability == pytest.approx(0.3)


def test_the_most_severe_encounter_comes_first():
    found = made(np.stack([np.full(1001, 5.0), np.full(1001, 9.0)]))
    fast_then_slow = np.where(found.time < 1, 8 * found.time, 8 + 0.2 * (found.time - 1))
    first, second = resonance_crossings(found, turning(found, fast_then_slow))
    assert first.natural == pytest.approx(9.0)
    assert second.natural == pytest.approx(5.0)
    assert first.severity > second.severity


@pytest.mark.parametrize(("frequency", "zeta"), [(5.0, 0.02), (7.0, 0.05)])
def test_magnification_of_steady_resonance_is_one_over_twice_the_damping_ratio(frequency, zeta):
    time = np.linspace(0, 30, 301)
    steady = np.full(301, frequency)
    found = magnification(time, steady, np.full(301, zeta), steady)
    assert found[-1] == pytest.approx(1 / (2 * zeta), rel=1e-6)
    assert found[1] == pytest.approx((1 - np.exp(-2 * np.pi * zeta * frequency * 0.1)) / (2 * zeta), rel=1e-6)
    apart = magnification(time, steady, np.full(301, zeta), 0.9 * steady)[-1]
    assert apart == pytest.approx(1 / np.hypot(1 - 0.81, 2 * zeta * 0.9), rel=0.06)


def test_magnification_of_a_fast_sweep_is_lewis_undamped_limit():
    time, rate, natural = np.linspace(0, 20, 4001), 0.5, 5.0
    found = magnification(time, np.full(4001, natural), np.zeros(4001), rate * time)
    assert found.max() == pytest.approx(3.67 * natural / np.sqrt(rate), rel=0.02)


def test_magnification_agrees_with_the_equation_of_motion():
    time, zeta, omega = np.linspace(0, 20, 200_001), 0.01, 2 * np.pi * 5.0
    line = 2.0 + 0.3 * time
    force = omega**2 * np.cos(2 * np.pi * (2.0 * time + 0.15 * time**2))
    _, y, _ = lsim(([1.0], [1.0, 2 * zeta * omega, omega**2]), force, time)
    found = magnification(time[::100], np.full(2001, 5.0), np.full(2001, zeta), line[::100])
    assert found.max() == pytest.approx(np.abs(y).max(), rel=0.05)


def test_sweep_number_in_closed_form():
    assert sweep_number(-2.0, 5.0, 0.02) == pytest.approx(2.0 / 0.01)


def no_drives(arm: Arm) -> Arm:
    return Arm(arm.name, arm.joints, arm.points)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: excitation(no_drives(one_joint_arm()), speeding_up()), "one: got no drive"),
        (lambda: excitation(one_joint_arm(), speeding_up(), orders=(0,)), "orders: got 0"),
        (lambda: excitation(one_joint_arm(), speeding_up(), orders=()), "orders: got none"),
        (lambda: excitation(one_joint_arm(), speeding_up(), times=[1.0, 0.5]), "times: got 2 times"),
        (lambda: branches(one_joint_arm(), speeding_up(), count=0), "count: got 0"),
        (lambda: branches(lcd_arm(), speeding_up()), "ramp: got 1 joint angles, expected 3"),
        (lambda: branches(replace_points(one_joint_arm()), speeding_up()), "one: got no named point"),
    ],
)
def test_what_cannot_be_is_refused(ask, words):
    with pytest.raises(InputError, match="got") as caught:
        ask()
    assert words in str(caught.value)


def replace_points(arm: Arm) -> Arm:
    return Arm(arm.name, arm.joints, drives=arm.drives)


def test_margin_and_times_are_checked():
    found = made(np.full((1, 11), 5.0))
    line = turning(found, 4.9)
    for margin in (0.0, 1.0, float("nan")):
        with pytest.raises(InputError, match="margin"):
            resonance_crossings(found, line, margin=margin)
    with pytest.raises(InputError, match="other times"):
        resonance_crossings(found, replace(line, time=line.time + 1))


@slow
def test_an_arm_that_collapses_is_named_with_the_posture():
    soft = one_joint_arm().replace({"pin.k_bend": 1e-3})
    with pytest.raises(ModelError, match=r"one has no stable equilibrium at \(0\) deg"):
        branches(soft, speeding_up())


@slow
def test_crossings_are_ranked_by_the_vibration_that_they_cause():
    """The simulation of one drive's imbalance alone, at the phases of its largest, moves the end point as far."""
    arm = lcd_arm()
    others = {f"{drive.name}.eccentricity": 0.0 for drive in arm.drives if drive.name != "drive2"}
    motion = stroke(arm.stroke, percent=20)
    near = resonance_crossings(branches(arm, motion), excitation(arm, motion))
    found = with_amplitudes(near, arm, motion)
    assert len(found) == len(near)
    weighed = [crossing.amplitude * crossing.probability for crossing in found]
    assert weighed == sorted(weighed, reverse=True)
    first = next(crossing for crossing in found if crossing.source.drive == "drive2")
    phases = [each.phase for each in exciting_orders(arm)]  # one program for both
    whole = superposition(arm.replace(others), motion, phases, rate=RATE)
    inside = (whole.time >= first.start) & (whole.time <= first.swells_until)
    k = phases.index("drive2.phase")
    each = np.hypot(whole.cosine[k], whole.sine[k])[:, inside]
    assert 0.5 * each.max() < first.amplitude <= np.linalg.norm(each, axis=0).max() * (1 + 1e-3)
    assert with_amplitudes((), arm, motion) == ()
