"""The clock of a recorder against that of a motion: truths in closed form, without any arm."""

import numpy as np
import pytest
from conformance import counted

from ident.errors import InputError
from ident.vibrate.clock import agreeing
from ident.vibrate.motion import Motion
from ident.vibrate.unit_response import Response, Run, Sensor

LENGTH, STROKE, TURNS = 6.0, 0.6, 27.0
"""Time [s] of a stroke, its way [m], and the turns of a pulley meanwhile: 8.4 Hz at most."""
GRAVITY = 9.81


def way(t):
    """Share of the stroke at some times: minimum jerk."""
    s = np.clip(t / LENGTH, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def vibration(t, phase):
    """Displacement [m] by a pulley that turns with the stroke; it grows with the square of its speed."""
    s = np.clip(t / LENGTH, 0, 1)
    speed = 30 * (s * (1 - s)) ** 2
    return 1e-4 * speed**2 * np.cos(2 * np.pi * TURNS * way(t) + phase)


def response(derivative, shares=way):
    """What a sensor along x would see, as the program states it: of the motion, and of a source's two components."""
    time = np.arange(0, LENGTH + 2, 1 / 250)
    cosine, sine = vibration(time, 0.0), vibration(time, -np.pi / 2)
    rows = np.zeros((9 if derivative == 2 else 3, len(time), 3))
    rows[0] = np.stack([0 * time, cosine, sine], 1)
    if derivative == 2:
        rows[3, :, 0] = STROKE * shares(time)
    breaks = np.array([0.0, LENGTH])
    run = Run(
        "run", Motion("stroke", breaks, np.zeros((2, 1, 1))), None, (Sensor("tip", (1, 0, 0), False, derivative),)
    )
    return Response(run, time, {"tip": rows}, (np.tile([[1.0], [0.0], [0.0]], len(time)),))


def record(derivative, offset, rate, noise, seed, vibrates=1.0, span=(-1.5, 2.5)):
    """Samples of a recorder: offset and rate lead to the motion's clock; accelerations by differences."""
    rng = np.random.default_rng(seed)
    time = np.arange((span[0] - offset), LENGTH + span[1] - offset, 1 / 100)
    at, h = time + offset + rate * (time - time.mean()), 1e-3
    phase = rng.uniform(-np.pi, np.pi)

    def moved(t):
        return vibrates * 1.3 * vibration(t, phase) + (STROKE * way(t) if derivative == 2 else 0.0)

    values = (moved(at + h) - 2 * moved(at) + moved(at - h)) / h**2 + 0.05 if derivative == 2 else moved(at)
    return time, values + noise * rng.standard_normal(len(time))


@pytest.mark.parametrize(("derivative", "noise"), [(2, 0.05), (0, 2e-5)])
def test_offset_and_rate_lie_within_their_errors(derivative, noise):
    seen, off = response(derivative), []
    for seed in range(40):
        offset, rate = np.random.default_rng(100 + seed).uniform((-5.0, -2e-4), (5.0, 2e-4))
        clock = agreeing(seen, [record(derivative, offset, rate, noise, seed)])
        off.append(
            ((clock.offset - offset) / clock.offset_sd, (clock.rate - rate) / clock.rate_sd, clock.offset - offset)
        )
    off = abs(np.array(off))
    signal = "acceleration" if derivative == 2 else "displacement"
    for name, count in zip(("offset", "rate"), (off[:, :2] < 1.96).sum(0), strict=True):
        what = f"clock's {name} within its interval, by {signal}"
        counted(count, 40, 0.85 * 40, 40, "verdict rates", what, "95 % promised, known clocks", expected=38)
    assert (off[:, :2] < 1.96).mean(0).max() < 1.0 or np.square(off[:, :2]).mean() > 0.2  # nor far too wide
    assert off[:, 2].max() < 0.25 / 8.4


def test_an_acceleration_shows_the_motion_itself_where_nothing_vibrates():
    for seed in range(10):
        clock = agreeing(response(2), [record(2, 1.3, 2e-4, 0.02, seed, vibrates=0.0)])
        assert abs(clock.offset - 1.3) < 0.1
        assert clock.offset_sd < 0.2


def test_a_mirrored_motion_is_not_taken_for_a_later_one():
    """The stroke slows down as it speeds up, with the other sign: half of it agrees half a stroke later."""
    time, values = record(2, 0.0, 0.0, 0.02, 1, vibrates=0.0)
    with pytest.raises(InputError, match="agree alike"):
        agreeing(response(2), [(time, -values)])


@pytest.mark.parametrize("derivative", [0, 2])
def test_steady_speed_and_noise_are_refused(derivative):
    """Offset and phase are one where the speed does not change; noise agrees with nothing."""
    time = np.arange(0, 30, 1 / 250)
    rows = np.zeros((9 if derivative == 2 else 3, len(time), 3))
    rows[0, :, 1:] = 1e-4 * np.stack([np.cos(2 * np.pi * 6 * time), np.sin(2 * np.pi * 6 * time)], 1)
    rows[3:4, :, 0] = 0.05 * time
    steady = response(derivative)
    steady = Response(steady.run, time, {"tip": rows}, (np.tile([[1.0], [0.0], [0.0]], len(time)),))
    for seed in range(10):
        rng = np.random.default_rng(seed)
        at = np.arange(5, 20, 1 / 100)
        size, noise = 1e-4 * (2 * np.pi * 6) ** derivative, 0.1 * rng.standard_normal(len(at))
        slow, fast = (np.cos(2 * np.pi * f * at + seed) + noise for f in (6, 30))  # cut at the ends of the record
        for seen, measured in ((steady, slow), (response(derivative), noise), (response(derivative), fast)):
            with pytest.raises(InputError, match=r"run: got a clock .* which agree alike, .* standstill .* `delay`"):
                agreeing(seen, [(at - 3.0, size * measured)])
