"""What makes a moving arm vibrate, told from traces of which it is known: oscillators along the arm's modes."""

from functools import cache

import numpy as np
import pytest
from arms import lcd_arm
from moving_traces import case, verdict, vibration
from scipy.signal import decimate

from ident.vibrate.branches import Branches, branches
from ident.vibrate.motion import Motion, MovingTrace, stroke
from ident.vibrate.triage import Triage, triage

RATE, FINE = 200.0, 20
OFF = 1.015
"""By which the oscillators' frequencies are above those of the arm's modes."""


@cache
def run(percent: float = 16.0, profile: str = "cycloid") -> tuple[Motion, np.ndarray, Branches]:
    motion = stroke(lcd_arm().stroke, percent=percent, profile=profile, dwell=4.0 if profile == "trapezoid" else 2.0)
    time = np.arange(int(float(motion.duration) * RATE)) / RATE
    return motion, time, branches(lcd_arm(), motion, count=5, times=time)


def oscillator(force: np.ndarray, natural: np.ndarray, damping: float) -> np.ndarray:
    """The displacement of an oscillator of changing frequency under a force, by short steps of semi-implicit Euler."""
    x, v, found, step = 0.0, 0.0, [], 1 / RATE / FINE
    omega = 2 * np.pi * np.repeat(natural, FINE)
    for w, f in zip(omega.tolist(), np.repeat(force, FINE).tolist(), strict=True):
        v += step * (f - 2 * damping * w * v - w * w * x)
        x += step * v
        found.append(x)
    return np.array(found[FINE - 1 :: FINE])


@cache
def driven(percent: float = 16.0, order: float = 1) -> np.ndarray:
    """Of two modes under a force that turns with drive 2."""
    motion, time, along = run(percent)
    turn = order * 160 * motion(time)[0][1]
    speed = motion(time)[1][1]
    return sum(oscillator(speed**2 * np.cos(turn + k), OFF * along.median[k], 0.01) for k in (0, 1))


@cache
def rung(percent: float = 20.0) -> np.ndarray:
    """Of two modes under the acceleration of a trapezoid."""
    motion, time, along = run(percent, "trapezoid")
    return sum(oscillator(motion(time)[2][0], OFF * along.median[k], 0.01) for k in (0, 1))


def line(time: np.ndarray, frequency: float = 9.5) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * time + 1.0)


def noisy(values: np.ndarray, seed: int = 0) -> np.ndarray:
    return values + 0.05 * np.abs(values).max() * np.random.default_rng(seed).normal(size=len(values))


def told(values: np.ndarray, percent: float = 16.0, profile: str = "cycloid", offset: float = 0.02) -> Triage:
    motion, time, _ = run(percent, profile)
    return triage(lcd_arm(), [MovingTrace(time + offset, noisy(values), motion)])


def test_a_drive_is_told_with_all_that_turn_alike_and_the_mode_that_amplifies_it():
    found = told(driven()).findings
    assert [finding.kind for finding in found] == ["drive"]
    assert found[0].drives == (("drive2", 1), ("drive1", 2), ("drive3", 2))
    assert found[0].told
    assert found[0].share > 0.95
    assert found[0].modes
    assert found[0].next == "source"
    values = driven()
    strongest = run()[1][np.abs(values).argmax()]
    assert found[0].time == pytest.approx(strongest, abs=0.5)
    assert found[0].amplitude == pytest.approx(np.abs(values).max(), rel=0.1)


def test_modes_rung_by_the_command_and_a_line_are_told_apart():
    values = rung()
    line_too = values + 1.2 * values.std() * line(run(20.0, "trapezoid")[1])
    alone = told(values, 20.0, "trapezoid").findings[0]
    assert (alone.kind, alone.by_command, alone.told, alone.next) == ("mode", True, True, "profile")
    both = [finding for finding in told(line_too, 20.0, "trapezoid").findings if finding.kind != "unexplained"]
    assert {finding.kind for finding in both} == {"mode", "line"}
    assert all(finding.told for finding in both)
    steady = next(finding for finding in both if finding.kind == "line")
    assert steady.frequency == pytest.approx((9.5, 9.5), abs=0.02)
    assert steady.amplitude == pytest.approx(1.2 * values.std(), rel=0.1)
    energy = vibration(values) ** 2, (1.2 * values.std()) ** 2 / 2
    assert steady.share == pytest.approx(energy[1] / sum(energy), abs=0.1)  # where the band ends is not sharp


def test_traces_at_several_speeds_are_explained_together():
    traces = []
    for percent in (16.0, 20.0):
        motion, time, _ = run(percent)
        values = driven(percent)
        traces.append(MovingTrace(time, noisy(values + values.std() * line(time), int(percent)), motion))
    whole = triage(lcd_arm(), traces)
    assert sorted(finding.kind for finding in whole.findings) == ["drive", "line"]
    assert all(finding.told for finding in whole.findings)
    assert len(whole.time) == len(whole.noise) == 2
    np.testing.assert_allclose(whole.noise[0], 0.05 * np.abs(traces[0].values).max(), rtol=0.25)


def test_what_does_not_move_cannot_be_told():
    """At constant speed a drive is a line, and a line may be a drive; at rest neither moves."""
    joints = np.array([1.0, -2.0, 1.0])
    speed = 2 * np.pi * 6.0 / 320  # 6 Hz of drive 2
    even = Motion("even", [0.0, 20.0], np.array([speed * joints, 0.2 * joints])[:, None])
    still = Motion("still", [0.0, 20.0], (0.2 * joints)[None, None])
    time = np.arange(int(20 * RATE)) / RATE
    for motion, frequency in ((even, 6.0), (even, 9.5), (still, 9.5)):
        found = triage(lcd_arm(), [MovingTrace(time, noisy(line(time, frequency)), motion)]).findings
        assert found
        assert not any(finding.told for finding in found)
        assert {finding.next for finding in found} == {"speed"}


def test_noise_alone_is_no_finding():
    motion, time, _ = run()
    noise = np.random.default_rng(1).normal(size=len(time))
    assert triage(lcd_arm(), [MovingTrace(time, noise, motion)]).findings == ()


def test_a_shock_from_outside_is_a_mode_that_nothing_known_rings():
    _, time, along = run()
    shock = np.where(np.abs(time - 7.0) < 0.02, 1.0, 0.0)
    values = sum(oscillator(shock, OFF * along.median[k], 0.005) for k in (0,))
    found = told(values).findings[0]
    assert (found.kind, found.by_command) == ("mode", False)


@pytest.mark.parametrize("order", [0.6, 3.0])
def test_an_order_that_is_not_looked_at_is_unexplained_and_named_by_its_ratio(order):
    """Of a belt's slow pulley, or of a mesh: as large as what is known, and 20 times the noise."""
    (part,) = told(driven(order=order)).findings
    assert part.kind == "unexplained"
    assert part.drives[0] == ("drive2", pytest.approx(order, rel=0.01))
    assert part.share > 0.95
    assert part.amplitude == pytest.approx(np.abs(driven(order=order)).max(), rel=0.1)


def test_what_follows_nothing_is_not_counted_as_noise():
    """A frequency that sweeps against the speed: no noise, no drive, its size and range are said."""
    _, time, _ = run()
    turn = 2 * np.pi * (14.0 * time + 5.0 * np.sin(2 * np.pi * time / 9.0))  # 10.5 to 17.5 Hz
    found = told(3e-4 * np.sin(turn))
    (part,) = found.findings
    assert (part.kind, part.drives, part.track) == ("unexplained", (), None)
    assert part.share > 0.95
    assert part.amplitude == pytest.approx(3e-4, rel=0.25)
    assert 9.5 < part.frequency[0] < part.frequency[1] < 18.5
    assert found.noise[0] < 0.1 * 3e-4


def test_kicks_give_nothing_to_drives_that_never_excited_it():
    _, time, along = run()
    shock = sum(np.where(np.abs(time - at) < 0.011, 1.0, 0.0) for at in (6.0, 9.3, 12.1))
    values = sum(oscillator(shock, OFF * along.median[k], 0.01) for k in (0, 1, 2))
    found = told(values).findings
    assert (found[0].kind, found[0].told, found[0].next) == ("kicks", True, "kicks")
    assert found[0].share > 0.9
    assert not any(part.kind == "drive" for part in found)


def test_a_faster_record_says_the_same():
    motion, time, _ = run()
    fine = np.arange(5 * len(time)) / (5 * RATE)
    values = noisy(np.interp(fine, time, driven()))
    found = triage(lcd_arm(), [MovingTrace(fine, values, motion)])
    assert found.findings[0].drives[0] == ("drive2", 1)
    assert len(found.time[0]) == len(decimate(values, 5))


@pytest.mark.slow
def test_a_trace_of_the_papers_arm():
    """A drive and modes that the command rings; the benchmark has two hundred, of each kind."""
    one = case(5, seed=1)
    assert verdict(triage(one.arm, [one.trace]), one.truth) in ("right", "cannot tell")


def test_what_turns_with_a_drive_at_no_order_that_is_known_is_unexplained():
    """A belt: 0.3 mm of it, twenty times the noise."""
    (motion, _, along), ratio = run(), 0.35
    turn, speed = ratio * 160 * motion(run()[1])[0][1], motion(run()[1])[1][1]
    values = sum(oscillator(speed**2 * np.cos(turn + k), OFF * along.median[k], 0.01) for k in (0, 1))
    found = told(3e-4 * values / np.abs(values).max()).findings
    assert [finding.kind for finding in found] == ["unexplained"]
    assert found[0].drives[0][0] == "drive2"
    assert found[0].drives[0][1] == pytest.approx(ratio, rel=0.03)
    assert found[0].amplitude == pytest.approx(3e-4, rel=0.15)
