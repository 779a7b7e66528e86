"""What makes a peak: each cause true in turn, where none can be told, and the columns against closed forms."""

from dataclasses import replace

import numpy as np
import peaks
import pytest
from arms import lcd_arm
from scipy.integrate import solve_ivp

from ident.arm.multibody import possible_orders
from ident.errors import InputError
from ident.vibrate.motion import stroke
from ident.vibrate.source_causes import Band, _swinging, _with_mesh, check_peak
from ident.vibrate.source_problem import Channel, Prior, SourceProblem
from ident.vibrate.unit_response import Response, Run


def test_a_band_keeps_what_lies_in_it():
    """A sine 0.5 Hz off the middle turns at 0.5 Hz with half its amplitude; one at 1.5 times the frequency is gone."""
    time, band = np.arange(0.0, 20.0, 0.01), Band(9.5, 1.4, 100.0)
    real, imaginary = np.split(band(3.0 * np.sin(2 * np.pi * 10.0 * time)), 2)
    slow = real + 1j * imaginary
    np.testing.assert_allclose(np.abs(slow), 1.5, rtol=0.02)
    turned = np.angle(slow[1:] / slow[:-1]) / (2 * np.pi * band.step / 100.0)
    np.testing.assert_allclose(turned, 0.5, atol=0.01)
    assert np.abs(band(3.0 * np.sin(2 * np.pi * 14.2 * time))).max() < 0.03


def test_white_noise_stays_nearly_white_in_a_band():
    noise = np.random.default_rng(0).standard_normal(200_000)
    real, imaginary = np.split(Band(9.5, 1.4, 100.0)(noise), 2)
    slow = real + 1j * imaginary
    neighbours = abs(np.vdot(slow[1:], slow[:-1])) / np.vdot(slow, slow).real
    assert neighbours < 0.2
    assert real.std() == pytest.approx(imaginary.std(), rel=0.05)


def posed() -> SourceProblem:
    """A run of the paper's arm of which motion, sensors and times matter: nothing is simulated."""
    arm = lcd_arm()
    run = Run("15 %", stroke(arm.stroke, percent=15.0, dwell=2.0), None, peaks.SENSORS)
    time = np.arange(0.2, float(run.motion.breaks[-1]) - 0.2, 1 / peaks.RATE)
    channels = tuple(Channel(f"15 % {'yz'[k]}", 0, k, time, np.zeros(len(time))) for k in range(len(run.sensors)))
    return SourceProblem(arm, (run,), (0,), channels, tuple(possible_orders(arm)), Prior.of(arm, {}), 0.05)


def test_a_finger_swings_as_an_integrator_has_it():
    problem, time = posed(), np.arange(0.0, 10.0, 0.004)
    response = Response(problem.runs[0], time, {}, ())
    pushed = np.sin(2 * np.pi * 9.0 * time) * np.exp(-((time - 4) ** 2))
    channel = replace(problem.channels[0], time=time[10:-10], values=0 * time[10:-10])
    seen = _swinging(problem, problem.start, response, channel, pushed, (2 * np.pi * 9.5, 0.01))

    def rate(t, y):
        omega = 2 * np.pi * 9.5
        return [y[1], -0.02 * omega * y[1] - omega**2 * y[0] - np.sin(2 * np.pi * 9.0 * t) * np.exp(-((t - 4) ** 2))]

    expected = solve_ivp(rate, (0, 10), [0, 0], t_eval=channel.time, rtol=1e-8, atol=1e-12).y[0]
    assert np.abs(seen - expected).max() < 0.01 * np.abs(expected).max()


def test_belt_mesh_is_not_tested_without_teeth_nor_where_they_mesh_elsewhere():
    problem = posed()
    for teeth, why in (({}, "not given"), ({"belt1": 1.0}, "Hz at most")):
        meshed, untested = _with_mesh(problem, teeth, peaks.PEAK)
        assert meshed is problem
        assert why in untested["mesh"]


@pytest.mark.parametrize(
    ("peak", "teeth", "complaint"),
    [
        (40.0, {}, "peak: got 40 Hz, expected from"),
        (0.5, {}, "peak: got 0.5 Hz, expected from"),
        (9.5, {"belt9": 40.0}, "teeth: got 'belt9', expected one of belt1, belt2"),
        (9.5, {"belt1": 0.5}, "a whole number"),
        (9.5, {"belt1": 1e300}, "from 1 to 1000"),
        (None, {"belt1": 40.0}, "without a peak"),
    ],
)
def test_a_peak_that_the_traces_do_not_show_is_refused(peak, teeth, complaint):
    with pytest.raises(InputError) as refused:
        check_peak(posed(), peak, teeth)
    assert complaint in str(refused.value)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("kind", "speeds"),
    [("imbalance", (15.0,)), ("error", (15.0,)), ("mesh", (7.0, 15.0)), ("finger", (15.0,)), ("line", (15.0,))],
)
def test_each_cause_is_told_where_it_is_true(kind, speeds):
    """Of the paper's arm, with belts that mesh; the quick test has one joint: `test_one_joint.py`."""
    found = peaks.causes(peaks.problem(kind, 1, speeds=speeds))
    assert (found.causes[0].kind, found.told) == (kind, True)
    if kind == "line":
        assert found.causes[0].frequency == pytest.approx(peaks.frequency_of("line", 1), abs=0.01)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_where_the_speed_stands_still_no_wrong_cause_is_told_and_another_speed_would_tell():
    """A trace of the cruise of a trapezoid alone, in which drive 2 turns at 9.6 Hz all the time."""
    verdicts = []
    motions = {14.0: stroke(lcd_arm().stroke, percent=14.0, dwell=2.0)}
    for kind in ("imbalance", "error", "line"):
        posed = peaks.problem(kind, 0, speeds=(12.0,), profile="trapezoid", window=(7.7, 12.9))
        further = {speed: replace(posed.runs[0], motion=motion) for speed, motion in motions.items()}
        found = peaks.causes(posed, further=further)
        assert not found.told or found.causes[0].kind == kind
        assert found.told or found.speed in further
        verdicts.append(found.told)
    assert not all(verdicts)
