"""From files to frequency responses: against closed forms, and each mistake of file or table in one line."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import agrees
from hammer_files import oscillator

from ident.errors import InputError
from ident.measure.channels import ChannelRow, ChannelTable
from ident.measure.recordings import Channel, Recording
from ident.modal.frf import Processing
from ident.modal.hammer import modal_tests
from ident.modal.modes import modes_of
from ident.modal.recorded import rows_of

STEP, COUNT = 1e-3, 8000
FREQUENCY, RATIO, MASS = 6.0, 0.02, 10.0


def truth(s):
    w = 2 * np.pi * FREQUENCY
    return s**2 / MASS / (s**2 + 2 * RATIO * w * s + w**2)


def blocks(count=4, noise=1e-4, before=100, seed=4):
    """Force and acceleration of an oscillator, hit with different strength."""
    random = np.random.default_rng(seed)
    time = (np.arange(COUNT) - before) * STEP
    force, answer = oscillator(time, FREQUENCY, RATIO, MASS)
    size = 1 + 0.3 * random.random((count, 1))
    error = noise * random.standard_normal((2, count, COUNT))
    return size * force + error[0], size * answer + error[1]


def row(channel, role, **more):
    common = {
        "where": f"channels.csv:{3 if role == 'force' else 2}",
        "file": "a.uff",
        "posture": (0.0,),
        "point": "tip",
    }
    return ChannelRow(**common | {"channel": channel, "role": role, "direction": (0.0, 0.0, 1.0)} | more)


def table(*more, force=None, response=None):
    first = row("z", "response", **(response or {})), row("f", "force", **(force or {}))
    return ChannelTable("channels.csv", "", (*first, *more))


def recording(force, answer, step=STEP, units=("m/s^2", "N"), more=()):
    channels = (Channel("z", answer, units[0], step), Channel("f", force, units[1], step), *more)
    return {"a.uff": Recording("a.uff", "", channels)}


def refused(table, recordings, processing=None):
    with pytest.raises(InputError) as caught:
        modal_tests(table, recordings, processing)
    assert len(caught.value.problems) == 1
    return str(caught.value)


@pytest.mark.parametrize("window_end", [0.01, 1e-4])
def test_the_frequency_response_lies_on_the_line_of_the_window(window_end):
    """H(sigma + i omega) of the closed form, up to what of the decay the record cuts off: a common factor."""
    (test,) = modal_tests(table(), recording(*blocks()), Processing(window_end=window_end, band=(1.0, 40.0)))
    frf = test.frf
    assert frf.decay == pytest.approx(-np.log(window_end) / test.duration)
    expected = truth(frf.decay + 2j * np.pi * frf.frequency)
    left = window_end * np.exp(-RATIO * 2 * np.pi * FREQUENCY * test.duration)
    assert frf.hits.shape == (4, 1, 1, len(frf.frequency))
    what, source = "frequency response by force and response", "s^2 / (m (s^2 + 2 z w s + w^2)), window's line"
    agrees(frf.mean[0, 0], expected, "modal", what, source, largest=2 * left + 3e-4)
    assert test.coherence.min() > 0.999


def test_displacements_and_velocities_become_accelerations():
    force, answer = blocks(noise=0)
    (direct,) = modal_tests(table(), recording(force, answer), Processing(band=(2.0, 30.0)))
    velocity = np.cumsum(answer, 1) * STEP - answer * STEP / 2
    (derived,) = modal_tests(table(), recording(force, velocity, units=("m/s", "N")), Processing(band=(2.0, 30.0)))
    displacement = (np.cumsum(velocity, 1) * STEP - velocity * STEP / 2) * 1e3
    (twice,) = modal_tests(table(), recording(force, displacement, units=("mm", "N")), Processing(band=(2.0, 30.0)))
    for each in (derived, twice):
        np.testing.assert_allclose(each.frf.mean, direct.frf.mean, rtol=0, atol=0.01 * abs(direct.frf.mean).max())


def test_a_long_record_gives_the_same_as_blocks():
    force, answer = blocks(3)
    whole = recording(force.reshape(1, -1), answer.reshape(1, -1))
    (long,), (cut,) = (
        modal_tests(table(), each, Processing(band=(1.0, 30.0))) for each in (whole, recording(force, answer))
    )
    assert len(long.frf.hits) == 3
    at = 2j * np.pi * long.frf.frequency + long.frf.decay
    what, source = "frequency response by a long record", "the oscillator's closed form"
    agrees(long.frf.mean[0, 0], truth(at), "modal", what, source, largest=0.02)
    assert cut.duration == pytest.approx(long.duration, rel=0.02)


def test_an_arm_that_still_moves_before_a_hit_is_said():
    force, answer = blocks(3)
    swing = 1.0 * np.sin(2 * np.pi * FREQUENCY * STEP * np.arange(COUNT))
    (test,) = modal_tests(table(), recording(force, answer + swing * np.array([[0], [1], [0]])))
    assert test.remarks == test.moving == ("a.uff: the arm was still moving before hit 2",)
    assert not test.good


@pytest.mark.parametrize(("size", "noise", "moving"), [(0.0, 1.5, False), (1.0, 0.05, True)], ids=["noisy", "ringing"])
def test_a_slow_mode_that_rings_below_a_fast_one_is_seen_and_noise_is_no_motion(size, noise, moving):
    """Of the acceleration behind a hit the ringing is 8 %, of the velocity 21 %; of noise it is 17 % and 2 %.

    Across, the hit is not felt: there is noise alone.
    """
    force, answer = blocks(3, noise=0.0)
    time = (np.arange(COUNT) - 100) * STEP
    fast, slow = 12.0 * np.sin(2 * np.pi * 60 * time) * (time > 0), size * np.sin(2 * np.pi * FREQUENCY * time)
    error = noise * np.random.default_rng(5).normal(size=answer.shape)
    across = Channel("x", 0.05 * np.random.default_rng(6).normal(size=answer.shape), "m/s^2", STEP)
    channels = table(row("x", "response", direction=(1.0, 0.0, 0.0)))
    (test,) = modal_tests(channels, recording(force, answer + fast + slow + error, more=(across,)))
    assert bool(test.moving) == moving


def test_an_offset_of_the_sensors_is_taken_off():
    force, answer = blocks()
    plain, moved = (
        modal_tests(table(), recording(force + 2 * k, answer + k), Processing(band=(1.0, 30.0)))[0].frf.mean
        for k in (0, 1)
    )
    np.testing.assert_allclose(moved, plain, rtol=0, atol=1e-3 * abs(plain).max())


def test_a_window_of_the_analyser_counts_for_velocities_too():
    force, answer = blocks(noise=0)
    velocity, faded = np.cumsum(answer, 1) * STEP - answer * STEP / 2, np.exp(-0.4 * STEP * np.arange(COUNT))
    rows = table(force={"decay": 0.4}, response={"decay": 0.4})
    (test,) = modal_tests(
        rows, recording(force * faded, velocity * faded, units=("m/s", "N")), Processing(band=(2.0, 30.0))
    )
    expected = truth(test.frf.decay + 2j * np.pi * test.frf.frequency)
    what, source = "frequency response by velocities, analyser's window", "the oscillator's closed form"
    agrees(test.frf.mean[0, 0], expected, "modal", what, source, largest=0.01)


def test_a_window_of_the_analyser_counts_in_the_decay():
    force, answer = blocks(noise=0)
    faded = np.exp(-0.4 * STEP * np.arange(COUNT))
    rows = table(force={"decay": 0.4}, response={"decay": 0.4})
    plain, again = (
        modal_tests(t, recording(f, a), Processing(window_end=0.01, band=(1.0, 30.0)))[0]
        for t, f, a in ((table(), force, answer), (rows, force * faded, answer * faded))
    )
    assert again.frf.decay == pytest.approx(plain.frf.decay)
    np.testing.assert_allclose(again.frf.mean, plain.frf.mean, rtol=0, atol=1e-4 * abs(plain.frf.mean).max())


@pytest.mark.parametrize("label", ["V", "mV/g", "EU", ""])
def test_sensitivity_and_units_scale_as_they_say(label):
    force, answer = blocks(noise=0)
    volts = table(response={"unit": "g_0", "sensitivity": 0.1}, force={"unit": "kN"})
    scaled = recording(force / 1000, answer / 9.80665 * 0.1, units=(label, ""))
    (plain,), (again,) = modal_tests(table(), recording(force, answer)), modal_tests(volts, scaled)
    np.testing.assert_allclose(again.frf.mean, plain.frf.mean, rtol=1e-9)


@pytest.mark.parametrize(("label", "scale"), [("V", 1.0), ("mV", 1000.0)])
def test_a_sensitivity_in_volts_counts_for_files_in_any_voltage(label, scale):
    force, answer = blocks(noise=0)
    volts = table(response={"unit": "g", "sensitivity": 0.1, "in_volts": True})
    scaled = recording(force, answer / 9.80665 * 0.1 * scale, units=(label, "N"))
    (plain,), (again,) = modal_tests(table(), recording(force, answer)), modal_tests(volts, scaled)
    np.testing.assert_allclose(again.frf.mean, plain.frf.mean, rtol=1e-9)


UNITS = [
    ("", None, {}, "channels.csv:2, unit: got no unit of channel 'z', expected a unit such as m/s^2, g_0, m/s or mm: "
     "neither the file nor the table has one; fill the cell"),
    ("N", None, {}, "got 'N' of channel 'z', expected a unit of response, such as m/s^2, g_0, m/s or mm; "
     "write the unit and the sensitivity into the table"),
    ("g", "m/s^2", {}, "got 'm/s^2' of channel 'z', expected 'g', as in the file; correct one of them"),
    ("g's", "mm/s^2", {}, "got 'mm/s^2' of channel 'z', expected 'g's', as in the file; correct one of them"),
    ("mV/g", None, {}, "got 'mV/g' of channel 'z', expected a unit of response"),
    ("V", "m/s2", {}, "got 'm/s2' of channel 'z', expected 'V', as in the file; give its sensitivity"),
    ("m/s^2", "mm/s^2", {}, "got 'mm/s^2' of channel 'z', expected 'm/s^2', as in the file; correct one of them"),
    ("V", "g_0", {}, "got 'g_0' of channel 'z', expected 'V', as in the file; give its sensitivity"),
    ("EU", "g", {"sensitivity": 0.1, "in_volts": True},
     "got a sensitivity in volts of channel 'z', whose file is in 'EU', expected a file in one of V, mV, uV; "
     "write the file's number for one unit"),
    ("m/s^2", "g_0", {"sensitivity": 0.1}, "got a sensitivity of channel 'z', whose file is in 'm/s^2'"),
    ("m/s^2", None, {"quantity": "velocity"}, "got 'm/s^2' of channel 'z', expected a unit of velocity"),
    ("m/s^2", None, {"full_scale": 3.0}, "got a full scale without unit"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "said", "more", "words"), UNITS)
def test_units_are_never_guessed(file, said, more, words):
    rows = table(response={"unit": said or "", **more})
    assert words in refused(rows, recording(*blocks(), units=(file, "N")))


@pytest.mark.parametrize("said", ["", "g", "g_0"])
def test_g_of_a_file_is_standard_gravity_and_said(said):
    force, answer = blocks(noise=0)
    rows = table(response={"unit": said})
    (plain,), (again,) = (
        modal_tests(table(), recording(force, answer)),
        modal_tests(rows, recording(force, answer / 9.80665, units=("g", "N"))),
    )
    np.testing.assert_allclose(again.frf.mean, plain.frf.mean, rtol=1e-9)
    words = "a.uff: 'g' of 'z' is read as standard gravity, 9.80665 m/s^2"
    assert again.remarks == (() if said == "g_0" else (words,))


CONSTANT = [0.0, 3.0]


@pytest.mark.parametrize("level", CONSTANT)
@pytest.mark.parametrize("count", [1, 4])
def test_a_force_that_never_moves_is_refused(level, count):
    force, answer = blocks(count)
    line = refused(table(), recording(0 * force + level, answer))
    assert f"channels.csv:3, channel: got 'f' of 'a.uff' constant at {level:.4g} N, expected a force with hits" in line


@pytest.mark.parametrize("level", CONSTANT)
@pytest.mark.parametrize("count", [1, 4])
def test_noise_about_a_constant_force_is_no_hit(level, count):
    force, answer = blocks(count)
    noise = level + 0.01 * np.random.default_rng(7).standard_normal(force.shape)
    assert "a.uff: got no pulse of the force, expected at least one hit" in refused(table(), recording(noise, answer))


def test_a_block_without_a_hit_is_rejected_whatever_its_offset():
    force, answer = blocks(4)
    force[2] = force[2].max()
    (test,) = modal_tests(table(), recording(force, answer))
    assert [(each.number, each.reason) for each in test.rejected] == [(3, "no pulse of the force")]


def test_a_response_that_never_moves_is_refused():
    force, answer = blocks()
    assert "got 'z' of 'a.uff' without any motion" in refused(table(), recording(force, 0 * answer + 1))


def test_channels_of_different_lengths_are_refused():
    force, answer = blocks()
    line = refused(table(), recording(force[:, :-7], answer))
    assert line.startswith("channels.csv:2, channel: got channels of different lengths in 'a.uff': 7993 samples of")
    short = recording(force, answer, None, more=(Channel("t", np.arange(COUNT - 1)[None] * STEP),))
    line = refused(table(row("t", "time", unit="s")), short)
    assert "got 7999 times for 8000 samples of 'f', expected a time for each sample" in line


@pytest.mark.parametrize("step", [1e30, -1e-3, 1e-30, np.inf])
def test_a_sampling_that_nobody_means_is_refused(step):
    assert "samples of 'a.uff'" in refused(table(), recording(*blocks(), step))


def test_a_channel_that_cannot_be_used_is_refused_where_it_counts_and_nowhere_else():
    force, answer = blocks()
    flawed = Channel("m", abs(answer), "g", STEP, flaw="values over frequency", remedy="export both parts")
    made = recording(force, answer, more=(flawed,))
    assert modal_tests(table(row("m", "ignore")), made)
    line = refused(table(row("m", "response", point="elbow")), made)
    assert "got 'm' of 'a.uff': values over frequency, expected samples over time, or complex" in line
    assert line.endswith("; export both parts")


def test_two_channels_of_one_name_are_refused():
    force, answer = blocks()
    made = recording(force, answer, more=(Channel("z", 2 * answer, "m/s^2", STEP),))
    assert "got 'z' of 'a.uff': 2 channels of one name, in 'm/s^2', 'm/s^2', expected samples" in refused(table(), made)


def test_frequency_responses_beside_samples_do_not_hide_them():
    force, answer = blocks()
    response = Channel("H", np.ones((1, 40), complex), "g", 0.25, 0.25, "force", "N")
    (plain,), (again,) = (
        modal_tests(table(), made) for made in (recording(force, answer), recording(force, answer, more=(response,)))
    )
    np.testing.assert_array_equal(again.frf.hits, plain.frf.hits)


def test_sampling_that_is_missing_or_contradictory():
    force, answer = blocks()
    assert "got no sampling rate of 'a.uff', expected one: the file says none" in refused(
        table(), recording(force, answer, None)
    )
    other = table(response={"rate": 500.0})
    assert "got sampling of 500 and of 1000 Hz for 'a.uff'" in refused(other, recording(force, answer))
    assert modal_tests(table(response={"rate": 1 / STEP}), recording(force, answer, None))[0].duration > 7
    two = {**recording(force, answer), "b.uff": replace(recording(force, answer, 2 * STEP)["a.uff"], path="b.uff")}
    rows = table(row("z", "response", file="b.uff"), row("f", "force", file="b.uff"))
    assert "b.uff: got a rate of 500 Hz, expected 1000 Hz, as of 'a.uff'" in refused(rows, two)


def test_a_channel_of_times_gives_the_sampling():
    force, answer = blocks()
    times = np.arange(COUNT) * STEP * 1e3
    rows = table(row("t", "time", unit="ms"))
    made = recording(force, answer, None, more=(Channel("t", times[None]),))
    given, said = modal_tests(rows, made)[0], modal_tests(table(), recording(force, answer))[0]
    assert given.duration == pytest.approx(said.duration, rel=1e-12)
    uneven = recording(force, answer, None, more=(Channel("t", times[None] ** 1.1),))
    assert "a.uff, t: got an interval of" in refused(rows, uneven)


def test_values_that_are_no_number_are_refused_with_their_place():
    force, answer = blocks()
    answer[1, 70] = np.nan
    line = refused(table(), recording(force, answer))
    assert line.startswith("a.uff, block 2, sample 71, z: got 1 values that are no number, expected numbers;")


def test_a_missing_reference_is_refused():
    rows = ChannelTable("channels.csv", "", (row("z", "response"),))
    line = refused(rows, recording(*blocks()))
    assert line.startswith(
        "channels.csv:2, role: got no reference channel of 'a.uff', expected a channel of role force;"
    )


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (table(row("q", "response")), "got 'q', expected a channel of 'a.uff'; it has z, f"),
        (table(row("z", "response")), "got 'z' twice, expected each channel once"),
        (table(row("z", "response", file="c.uff")), "got 'c.uff', expected a file of the test"),
        (table(force={"posture": (1.0,)}), "got another posture than the file's first row"),
        (ChannelTable("channels.csv", "", (row("z", "ignore"),)), "got no row of a response"),
    ],
)
def test_a_table_that_does_not_fit_the_files(rows, words):
    assert words in refused(rows, recording(*blocks()))


def test_clipped_hits_are_rejected_by_name_and_a_test_of_them_alone_is_refused():
    force, answer = blocks(4)
    answer[2] = np.clip(answer[2], -1.0, 1.0)
    force[0] = np.clip(force[0], 0, 0.7 * force[0].max())
    (test,) = modal_tests(table(), recording(force, answer))
    assert [(each.number, each.reason.partition(":")[0]) for each in test.rejected] == [
        (1, "overload of the force"),
        (3, "overload of z"),
    ]
    assert len(test.frf.hits) == 2
    line = refused(table(), recording(force[:1].repeat(2, 0), answer[:2]))
    assert "a.uff: got no good hit (hit 1: overload of the force: " in line


def test_a_mains_line_is_said():
    force, answer = blocks()
    hum = answer + 0.01 * np.sin(2 * np.pi * 50 * STEP * np.arange(COUNT))
    (test,) = modal_tests(table(), recording(force, hum))
    assert [each for each in test.remarks if "mains at 50 Hz in z" in each]
    assert not modal_tests(table(), recording(force, answer))[0].remarks


def test_postures_are_tests_of_their_own_and_a_response_must_be_measured_by_each_force():
    made = recording(*blocks())["a.uff"]
    rows = table(*(row(each, role, file="b.uff", posture=(1.0,)) for each, role in (("z", "response"), ("f", "force"))))
    both = modal_tests(rows, {"a.uff": made, "b.uff": made})
    assert [test.posture for test in both] == [(0.0,), (1.0,)]
    rows = table(
        row("z", "response", file="b.uff", point="elbow"), row("f", "force", file="b.uff", direction=(1.0, 0.0, 0.0))
    )
    assert "got no response at elbow to the force at tip" in refused(rows, {"a.uff": made, "b.uff": made})


def test_hits_of_two_files_are_hits_of_one_test():
    force, answer = blocks(5)
    names = {f"{k}.uff": recording(force[k:k + 1], answer[k:k + 1])["a.uff"] for k in range(5)}  # fmt: skip
    rows = ChannelTable("channels.csv", "", tuple(replace(each, file="?.uff") for each in table().rows))
    (test,), (together,) = modal_tests(rows, names), modal_tests(table(), recording(force, answer))
    np.testing.assert_allclose(test.frf.hits, together.frf.hits, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda force: np.clip(force, 0, 0.7 * force.max()), "overload of the force"),
        (np.zeros_like, "no pulse of the force"),
    ],
)
def test_a_file_without_a_good_hit_is_rejected_where_its_place_has_another(change, reason):
    """As of an analyser that writes a file for each hit."""
    force, answer = blocks(4)
    force[1] = change(force[1]) + 1e-4 * np.random.default_rng(5).standard_normal(COUNT) * (reason[0] == "n")
    names = {f"{k}.uff": recording(force[k:k + 1], answer[k:k + 1])["a.uff"] for k in range(4)}  # fmt: skip
    rows = ChannelTable("channels.csv", "", tuple(replace(each, file="?.uff") for each in table().rows))
    (test,) = modal_tests(rows, names)
    assert [(each.file, each.number, each.reason.partition(":")[0]) for each in test.rejected] == [("1.uff", 1, reason)]
    (others,) = modal_tests(rows, {name: each for name, each in names.items() if name != "1.uff"})
    np.testing.assert_array_equal(test.frf.hits, others.frf.hits)


def test_a_roving_sensor_without_a_good_hit_is_refused_by_its_file():
    """Its place has no other file, though the force's place has."""
    force, answer = blocks(4)
    silent = 1e-4 * np.random.default_rng(5).standard_normal(force.shape)
    made = {"a.uff": recording(force, answer)["a.uff"], "b.uff": recording(silent, answer)["a.uff"]}
    rows = table(row("z", "response", file="b.uff", point="elbow"), row("f", "force", file="b.uff"))
    assert "b.uff: got no good hit (hit 1: no pulse of the force" in refused(rows, made)


def test_fewer_good_hits_at_one_point_are_said():
    force, answer = blocks(4)
    made = {"a.uff": recording(force, answer)["a.uff"], "b.uff": recording(force[:2], answer[:2])["a.uff"]}
    rows = table(row("z", "response", file="b.uff"), row("f", "force", file="b.uff", point="elbow"))
    (test,) = modal_tests(rows, made)
    assert test.frf.hits.shape[:3] == (2, 1, 2)
    assert test.remarks == ("2 hits count at each point, as many as at the one with fewest; others have up to 4",)


def test_finished_frequency_responses_of_an_analyser():
    frequency = 0.25 * np.arange(1, 200)
    response = truth(2j * np.pi * frequency) / (2j * np.pi * frequency) * 1e3
    channel = Channel("z", np.stack([response, 1.01 * response]), "mm/s", 0.25, 0.25, "f", "N")
    (test,) = modal_tests(table(response={"decay": 0.0}), {"a.uff": Recording("a.uff", "", (channel,))})
    found, what = test.frf.hits[0, 0, 0], "mobility of an analyser as accelerance"
    agrees(found, truth(2j * np.pi * frequency), "modal", what, "the oscillator's closed form", rtol=1e-9)
    np.testing.assert_allclose(test.frf.mean[0, 0], 1.005 * truth(2j * np.pi * frequency), rtol=1e-9)
    assert (test.frf.decay, test.duration) == (0.0, 0.0)
    windowed = Recording("a.uff", "", (replace(channel, values=channel.values[:1]),))
    (faded,) = modal_tests(table(force={"decay": 0.5}, response={"decay": 0.5}), {"a.uff": windowed})
    assert faded.frf.decay == 0.5


def sampled(start):
    """Force and acceleration of an oscillator that is hit at 0.1 s, sampled from a time [s] for each hit on."""
    time = np.asarray(start)[:, None] + np.arange(4 * COUNT) * STEP / 4
    made = [oscillator(row - 0.1, FREQUENCY, RATIO, MASS, pulse=0.05) for row in time]
    return (np.array(each)[:, ::4] for each in zip(*made, strict=True))


def started(force, answer, starts):
    """The recording with the times [s] at which force and response start."""
    made = recording(force, answer)["a.uff"]
    z, f = made.channels
    return {"a.uff": replace(made, channels=(replace(z, start=starts[1]), replace(f, start=starts[0])))}


@pytest.mark.parametrize("late", [0.02, -0.0237, 0.0004])
def test_channels_that_start_at_times_of_their_own_are_aligned(late):
    """Whole steps are cut, the rest of a step is a phase: the response is that of channels that start together."""
    band, begin = Processing(band=(2.0, 30.0)), np.array([0.0, 0.01, -0.02])
    force, _ = sampled(begin)
    _, answer = sampled(begin + late)
    (test,) = modal_tests(
        table(), started(force, answer, (tuple(begin.tolist()), tuple((begin + late).tolist()))), band
    )
    (wrong,) = modal_tests(table(), recording(force, answer), band)
    expected = truth(test.frf.decay + 2j * np.pi * test.frf.frequency)
    what, source = "frequency response of channels that start apart", "the oscillator's closed form"
    agrees(test.frf.mean[0, 0], expected, "modal", what, source, rtol=1e-7, largest=2e-3)
    before = truth(wrong.frf.decay + 2j * np.pi * wrong.frf.frequency)
    assert abs(np.angle(wrong.frf.mean[0, 0] / before)).max() > 0.07


def test_blocks_that_start_apart_are_cut_each_for_itself():
    force, answer = blocks()
    starts = ((0.0, 5.0, 9.0, 20.0), (0.05, 5.0, 8.97, 20.0))
    cut = np.stack([np.roll(row, -shift) for row, shift in zip(answer, (50, 0, -30, 0), strict=True)])
    (test,) = modal_tests(table(), started(force, cut, starts))
    ends = [(50, COUNT), (0, COUNT - 50), (0, COUNT - 50), (0, COUNT - 50)]
    parts = [np.stack([row[a:b] for row, (a, b) in zip(each, ends, strict=True)]) for each in (force, answer)]
    (expected,) = modal_tests(table(), recording(*parts))
    np.testing.assert_array_equal(test.frf.hits, expected.frf.hits)


def test_channels_that_start_together_are_left_as_they_are():
    force, answer = blocks()
    (expected,) = modal_tests(table(), recording(force, answer))
    together = (0.1, 7.3, 9.9, 12.0)
    for starts in ((5.123, 5.123), (together, together)):
        (test,) = modal_tests(table(), started(force, answer, starts))
        np.testing.assert_array_equal(test.frf.hits, expected.frf.hits)


def test_channels_without_a_common_span_are_refused_with_both_starts():
    line = refused(table(), started(*blocks(), (1.5, 60.0)))
    assert "got 'f' from 1.5 to 9.499 s and 'z' from 60 to 67.999 s in 'a.uff', expected channels that overlap" in line


def test_lines_of_frequency_responses_that_start_apart():
    frequency = 0.25 * np.arange(1, 200)
    full = Channel("z", truth(2j * np.pi * frequency)[None], "m/s^2", 0.25, 0.25, "f", "N")
    part = replace(full, name="x", values=full.values[:, 8:], start=2.25)
    rows = table(row("x", "response", direction=(1.0, 0.0, 0.0)))
    (test,) = modal_tests(rows, {"a.uff": Recording("a.uff", "", (full, part))})
    np.testing.assert_array_equal(test.frf.frequency, frequency[8:])
    np.testing.assert_array_equal(test.frf.hits[..., 0, :, :], test.frf.hits[..., 1, :, :])
    between = {"a.uff": Recording("a.uff", "", (full, replace(part, start=2.3)))}
    line = refused(rows, between)
    assert "got 'z' from 0.25 to 49.75 Hz and 'x' from 2.3 to 49.8 Hz in 'a.uff', expected the same lines" in line


def test_a_label_that_stands_for_two_sensors_is_said_with_its_id_lines():
    force, answer = blocks(2)
    made = recording(force[:1], answer)["a.uff"]
    z, f = made.channels
    line = refused(table(), {"a.uff": replace(made, channels=(replace(z, notes=("left, run 1", "right, run 1")), f))})
    assert "got 2 blocks of 'z' and 1 of 'f' in 'a.uff' (ID lines: 'left, run 1', 'right, run 1')" in line
    assert "got channels of different lengths in 'a.uff'" in refused(table(), recording(force, answer[:, :-1]))


def test_a_file_of_nodes_passes_unless_it_alone_is_named():
    nodes = Recording("b.uff", "", (), places={"1": (0.0, 0.0, 0.0)})
    made = recording(*blocks()) | {"b.uff": nodes}
    (expected,) = modal_tests(table(), recording(*blocks()))
    pattern = ChannelTable("channels.csv", "", tuple(replace(each, file="*.uff") for each in table().rows))
    for rows in (table(), pattern):
        np.testing.assert_array_equal(modal_tests(rows, made)[0].frf.hits, expected.frf.hits)
    line = refused(table(row("z", "response", file="b.uff")), made)
    assert "got nodes and no channel in 'b.uff', expected samples over time or frequency responses" in line


@pytest.mark.parametrize("force_noise", [0.003, 0.05])
def test_double_hits_of_different_gaps_tell_as_much_as_single_ones(force_noise):
    """Five of each, over three noises: between its pulses the window leaves out the noise of the force."""
    widths = []
    for rebounds in (np.zeros(5), np.linspace(0.2, 0.45, 5)):
        force, answer = blocks(5, noise=0.0)
        for hit, (share, gap) in enumerate(zip(rebounds, (31, 47, 65, 90, 140), strict=True)):
            for each in (force, answer):
                each[hit, gap:] += share * each[hit, :-gap].copy()
        found = []
        for seed in range(3):
            error = np.random.default_rng(seed).standard_normal((2, 5, COUNT)) * [[[force_noise]], [[0.02]]]
            made = recording(force + error[0], answer + error[1])
            (test,) = modal_tests(table(), made, Processing(band=(3.0, 30.0)))
            assert test.rejected == ()
            found.append(modes_of(test.frf))
            assert abs(found[-1].frequency[0] - FREQUENCY) < 4 * found[-1].sigma[0, 0]
            assert abs(found[-1].damping[0] - RATIO) < 4 * found[-1].sigma[1, 0]
        widths.append(np.mean([each.sigma[:, 0] for each in found], axis=0))
    np.testing.assert_allclose(widths[1], widths[0], rtol=0.2)


def test_a_line_is_left_out_only_where_all_hits_at_a_point_are_weak():
    """Equal double hits have gaps in their spectrum at odd multiples of half the reciprocal of their distance."""
    force, answer = blocks(4, noise=0.0)
    gaps = {"alike": (50, 50, 50, 50), "different": (50, 50, 62, 41)}
    weak = {}
    for name, own in gaps.items():
        f, a = force.copy(), answer.copy()
        for hit, gap in enumerate(own):
            f[hit, gap:] += force[hit, :-gap]
            a[hit, gap:] += answer[hit, :-gap]
        (test,) = modal_tests(table(), recording(f, a))
        weak[name] = np.abs(test.frf.frequency - 10.0).min()
        assert test.frf.frequency[-1] > 35
    assert weak["alike"] > 0.3
    assert weak["different"] < 0.1


@pytest.mark.parametrize("clock", ["timestamp", "X_Value", "Index"])
def test_numbers_of_channels_pass_over_a_clock_of_any_name(clock):
    """And over nothing else: a slow drift rises, but not at every sample."""
    force, answer = blocks()
    drifting = (
        answer + np.linspace(0, 1, answer.shape[-1]) + 0.01 * np.random.default_rng(0).standard_normal(answer.shape)
    )
    channels = [Channel(clock, np.broadcast_to(np.arange(float(force.shape[-1])), force.shape))]
    channels += [Channel("z", drifting), Channel("f", force)]
    numbered = ChannelTable("channels.csv", "", (row("1", "response"), row("2", "force")))
    assert [each.channel for each in rows_of(numbered, "a.uff", Recording("a.uff", "", tuple(channels)))] == ["z", "f"]
