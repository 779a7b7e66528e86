"""Modes of ambient vibration: against pyOMA_2 on the same records, against the model's poles, and what is in doubt.

And lines of pulleys beside modes: found, named, taken out; and no mode is taken for one.
"""

from dataclasses import replace

import numpy as np
import pytest
from ambient_records import RATE, ambient_test, as_record, shaken
from conformance import agrees, counted
from scipy.stats import binom

from ident.errors import InputError
from ident.measure.channels import ChannelRow, ChannelTable
from ident.measure.recordings import Channel, Recording
from ident.measure.speeds import Speed
from ident.modal.ambient import ROWS, ambient_tests, correlations_of, without_harmonics
from ident.modal.frf import Processing
from ident.modal.operational import operational_modes, realisations
from ident.modal.recorded import records

BAND = (1.0, 28.0)
SHARP = (0, 1, 3, 4)
"""Modes damped by less than 5 %."""


@pytest.fixture(scope="module")
def arm():
    return shaken(600.0)


@pytest.fixture(scope="module")
def record(arm):
    return arm.record(np.random.default_rng(11))


@pytest.fixture(scope="module")
def modes(record):
    return operational_modes(ambient_test(record, band=BAND))


@pytest.fixture(scope="module")
def peer(record):
    """Poles of pyOMA_2's SSI-cov of the same record, (frequency [Hz], damping ratio) for each order."""
    before = np.geterr()
    from pyoma2.functions.ssi import SSI_fast, SSI_poles, build_hank

    np.seterr(**before)  # importing pyOMA_2 switches warnings off
    scaled = record / record.std(1, keepdims=True)
    hankel, _ = build_hank(scaled, scaled, ROWS, "cov")
    _, A, C, _ = SSI_fast(hankel, ROWS, 60, step=2)
    frequency, damping, *_ = SSI_poles(hankel, A, C, 60, 1 / RATE, step=2)
    return frequency, damping


@pytest.mark.slow
def test_correlation_functions_are_those_of_their_definition(record):
    """Sums of blocks against products in a loop."""
    part = record[:, :400]
    made = correlations_of([part], (0, 4), 1 / RATE, lags=30, length=100)
    assert made.blocks.shape[1:] == (6, 2, 30)
    count = part.shape[1] - 29
    for lag in (0, 1, 17, 29):
        expected = part[:, lag : lag + count] @ part[[0, 4], :count].T / count
        what, source = "correlation functions of a record", "their definition, products in a loop"
        agrees(made.mean[..., lag], expected, "modal", what, source, largest=1e-12)
    without = made.samples.sum() - made.samples[1]
    np.testing.assert_allclose(made.without(1), (made.blocks.sum(0) - made.blocks[1]) / without)
    np.testing.assert_allclose(made.joined(2).mean, made.mean)


def test_exact_correlations_give_the_exact_poles():
    """R(k) = C A^(k-1) G of a known system."""
    rng = np.random.default_rng(2)
    poles = 2 * np.pi * np.array([4.0, 4.1, 11.0]) * (-0.02 + 1j)
    root = np.exp(poles / RATE)
    shapes, participation = rng.normal(size=(4, 3)) + 0.1j * rng.normal(size=(4, 3)), rng.normal(size=(2, 3))
    powers = root[:, None] ** np.arange(-1, 59)
    correlation = 2 * np.einsum("om,rm,mk->ork", shapes, participation, powers).real
    correlation[..., 0] = rng.normal(size=(4, 2))  # lag 0 has noise and is not used
    (found,) = realisations(correlation, 1 / RATE, [6])
    order = np.argsort(np.abs(found.pole))
    what, source = "poles by covariance-driven realisation", "R(k) = C A^(k-1) G of a known system"
    agrees(found.pole[order], poles, "modal", what, source, rtol=1e-6, unit="rad/s")
    mac = np.abs(np.sum(found.unit_shape[:, order].conj() * shapes / np.linalg.norm(shapes, axis=0), axis=0))
    np.testing.assert_allclose(mac, 1, atol=1e-6)


def quiet_response(noise, highest):
    """One displacement (1, T) with modes at 5 Hz (1 %) and 13 Hz (1.5 %), without anything above `highest` [Hz]."""
    rng, samples = np.random.default_rng(4), int(600 * RATE)
    s = 2j * np.pi * np.fft.rfftfreq(2 * samples, 1 / RATE)
    modes = [(2 * np.pi * hertz, damping) for hertz, damping in ((5.0, 0.01), (13.0, 0.015))]
    transfer = sum(1 / (s**2 + 2 * damping * omega * s + omega**2) for omega, damping in modes)
    forces = np.fft.rfft(rng.normal(size=2 * samples)) * (s.imag < 2 * np.pi * highest)
    moved = np.fft.irfft(transfer * forces)[:samples]
    return (moved / moved.std() + noise * rng.normal(size=samples))[None]


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_quiet_response_has_as_many_states_as_its_rank(noise):
    """A band-limited response without noise: its Hankel matrix has less rank than the highest order has states."""
    modes = operational_modes(ambient_test(quiet_response(noise, 25.0), band=(1.0, 20.0)))
    assert len(modes.frequency) == 2
    np.testing.assert_array_less(np.abs(modes.frequency - [5.0, 13.0]), 4 * modes.sigma[0])
    np.testing.assert_array_less(np.abs(modes.damping - [0.01, 0.015]), 4 * modes.sigma[1])


@pytest.mark.parametrize("kind", ["sine", "spike"])
def test_a_response_without_a_mode_is_refused(kind):
    time = np.arange(60000) / RATE
    values = np.sin(2 * np.pi * 5 * time) if kind == "sine" else (time == 1).astype(float)
    with pytest.raises(InputError, match=r"without a (mode|pole) that lasts"):
        operational_modes(ambient_test(values[None]))


@pytest.mark.slow
def test_poles_of_an_order_are_those_of_pyoma(arm, record, peer):
    """Those that are modes, of 30 states; what pyOMA_2 leaves out at the ends of the record is a thousandth of it."""
    scaled = record / record.std(1, keepdims=True)
    correlations = correlations_of([scaled], range(6), 1 / RATE, 2 * ROWS, 1000)
    (found,) = realisations(correlations.mean, correlations.step, [30])
    frequency, damping = (each[:, 15] for each in peer)
    for k in SHARP:
        own = found.pole[np.argmin(np.abs(found.pole - arm.poles[k]))]
        i = np.nanargmin(np.abs(frequency - abs(own) / (2 * np.pi)) + np.abs(damping + own.real / abs(own)))
        source, hertz = "pyOMA_2, SSI-cov, 30 states", abs(own) / (2 * np.pi)
        agrees(hertz, frequency[i], "modal", "frequencies of ambient vibration", source, rtol=9.99e-4, unit="Hz")
        agrees(-own.real / abs(own), damping[i], "modal", "damping of ambient vibration", source, atol=5e-4)


@pytest.mark.slow
def test_frequencies_are_those_of_pyoma_to_a_thousandth(arm, modes, peer):
    """Medians over orders, of each mode that is damped by less than 5 %."""
    frequency, damping = peer
    for k in SHARP:
        hertz = modes.frequency[np.argmin(np.abs(modes.frequency - arm.frequency[k]))]
        apart = np.abs(frequency - arm.frequency[k]) / arm.frequency[k] + np.abs(damping - arm.damping[k])
        best = np.nanmin(np.where(apart < 0.02, apart, np.nan), axis=0, initial=np.inf, where=np.isfinite(apart))
        at = np.nanargmin(np.where(np.isfinite(apart), apart, np.inf), axis=0)
        each = frequency[at, np.arange(len(at))][best < 0.02]
        assert len(each) >= 15
        what, source = "modes of ambient vibration, all orders", "pyOMA_2, SSI-cov, medians"
        agrees(hertz, np.median(each), "modal", what, source, rtol=9.99e-4, unit="Hz")


@pytest.mark.slow
def test_modes_are_those_of_the_model_within_their_covariance(arm, modes):
    """Each number within four standard deviations; their rate is in tests/benchmarks/ambient.py."""
    assert all(np.abs(modes.frequency / arm.frequency[k] - 1).min() < 0.01 for k in SHARP)
    for i, hertz in enumerate(modes.frequency):
        j = int(np.argmin(np.abs(arm.frequency - hertz)))
        assert abs(hertz - arm.frequency[j]) < 4 * modes.sigma[0, i]
        assert abs(modes.damping[i] - arm.damping[j]) < 4 * modes.sigma[1, i]
    assert np.linalg.eigvalsh(modes.covariance).min() > -1e-12 * np.trace(modes.covariance)
    assert not modes.doubtful


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say():
    """Twelve records of the two sharper modes up to 15 Hz of the straight arm, and the first: 99.9 % band of 95 %.

    At the tip alone: half the responses take an eighth of the time.
    """
    arm, inside, number = shaken(600.0, (0.0, 0.0, 0.0)), 0, 0
    for seed in range(12):
        modes = operational_modes(ambient_test(arm.record(np.random.default_rng(seed))[:3], band=(3.0, 15.0)))
        for frequency, damping in zip(arm.frequency[:3], arm.damping[:3], strict=True):
            i = int(np.argmin(np.abs(modes.frequency - frequency)))
            off = modes.frequency[i] - frequency, modes.damping[i] - damping
            inside += int((np.abs(off) < 1.96 * modes.sigma[:, i]).sum())
            number += 2
    low, high = binom.interval(0.999, number, 0.95)
    assert number == 72
    what, source = "modes of ambient records within their intervals", "95 % promised, known arm"
    counted(inside, number, low, high, "verdict rates", what, source, expected=0.95 * number)


@pytest.mark.slow
def test_units_of_responses_do_not_matter(record, modes):
    """The same record in other units, and one response as a velocity: poles alike, shapes those of accelerations."""
    factor = np.array([1, 10, 1, 1, 1e3, 1])
    slow = next(k for k, each in enumerate(modes.shape) if not np.isclose(each, 1).any())  # no shape is scaled by it
    order = tuple(int(k == slow) for k in range(6))
    scaled = operational_modes(replace(ambient_test(record * factor[:, None], band=BAND), order=order))
    np.testing.assert_allclose(scaled.frequency, modes.frequency, rtol=1e-9)
    others, shape = np.arange(6) != slow, scaled.shape / factor[:, None]
    one, two = shape[others], modes.shape[others]
    shape *= (one.conj() * two).sum(0) / (np.abs(one) ** 2).sum(0)
    np.testing.assert_allclose(shape[others], two, rtol=1e-6)
    pole = 2 * np.pi * modes.frequency * (-modes.damping + 1j * np.sqrt(1 - modes.damping**2))
    np.testing.assert_allclose(shape[slow] / modes.shape[slow], pole, rtol=0.03)


@pytest.mark.slow
def test_modes_can_be_chosen_and_what_is_not_there_is_said(record):
    test = ambient_test(record, band=BAND)
    chosen = operational_modes(test, near=(15.0, 5.77))
    np.testing.assert_allclose(chosen.frequency, (5.77, 15.0), rtol=0.01)
    with pytest.raises(InputError, match="no lasting pole near"):
        operational_modes(test, near=(9.0,))


@pytest.mark.slow
def test_short_records_are_refused_and_one_reference_is_said(record):
    with pytest.raises(InputError, match="got 30 s of responses without a force, expected at least 40 s"):
        ambient_test(record[:, :3000])
    brief = operational_modes(ambient_test(record[:, :20000], references=(2,), band=BAND))
    assert brief.doubtful
    assert any("WARNING: too short a record" in remark for remark in brief.remarks)
    assert any("one reference only: modes that coincide are seen as one" in remark for remark in brief.remarks)
    single = operational_modes(ambient_test(record[:1], references=(0,), band=BAND))
    assert any("one response only" in remark for remark in single.remarks)


def test_a_record_of_microseconds_is_refused_before_it_is_sampled_down():
    """By 50 samples a second of 25 million: a filter of gigabytes, of no use to 3000 samples."""
    noise = np.random.default_rng(3).normal(size=(2, 3000))
    with pytest.raises(InputError, match="e-05 s of responses without a force"):
        ambient_tests([replace(as_record(noise), step=1e-8)], Processing(band=(1.0, 12.0)))


@pytest.mark.slow
def test_noise_without_a_mode_is_refused():
    noise = np.random.default_rng(3).normal(size=(3, 20000))
    with pytest.raises(InputError, match="without a"):
        operational_modes(ambient_test(noise))


@pytest.mark.slow
def test_files_of_one_posture_are_one_test(record):
    halves = [as_record(record[:, :30000]), as_record(record[:, 30000:])]
    (test,) = ambient_tests(halves, Processing(band=BAND))
    assert test.files == ("ambient.h5", "ambient.h5")
    assert test.correlations.duration == pytest.approx(600 - 2 * 0.99)
    with pytest.raises(InputError, match=r"other references than 'ambient\.h5'"):
        ambient_tests([halves[0], as_record(record, references=(1,))], Processing())


@pytest.mark.parametrize("late", [7.0, 7.3, -2.46])
def test_responses_that_start_at_times_of_their_own_are_aligned(late):
    """Filtered noise is known between its samples: correlations are those of responses that start together."""
    count, kept = 12000, 11000
    lines = np.fft.rfftfreq(count)
    white = np.fft.rfft(np.random.default_rng(2).standard_normal((2, count))) / (1 + (lines / 0.25) ** 24)
    white[1] += white[0]

    def test_of(first, second, starts):
        moved = np.fft.irfft(white * np.exp(2j * np.pi * lines * np.array([[first], [second]])), count)[:, :kept]
        rows = [
            ChannelRow(where="channels.csv:2", file="a.h5", channel=name, role="response", posture=(0.0,), point="tip",
                       direction=axis, unit="m/s^2")
            for name, axis in (("x", (1.0, 0.0, 0.0)), ("z", (0.0, 0.0, 1.0)))
        ]  # fmt: skip
        channels = [Channel(n, v[None], "", 1 / RATE, s) for n, v, s in zip("xz", moved, starts, strict=True)]
        made = records(ChannelTable("channels.csv", "", tuple(rows)), {"a.h5": Recording("a.h5", "", tuple(channels))})
        return ambient_tests(made, Processing(band=(1.0, 28.0)))[0].correlations.mean

    begin = max(0, round(late))
    expected = test_of(begin, begin, (3.0, 3.0))
    np.testing.assert_array_equal(test_of(begin, begin, (0.0, 0.0)), expected)
    aligned = test_of(0.0, late, (3.0, 3.0 + late / RATE))
    np.testing.assert_allclose(aligned, expected, atol=2e-3 * abs(expected).max())
    assert abs(test_of(0.0, late, (3.0, 3.0)) - expected).max() > 0.2 * abs(expected).max()


def test_a_window_is_refused_where_no_decay_was_windowed(record):
    with pytest.raises(InputError, match=r"decay: got a window of 0.3 1/s, expected an ambient record without one"):
        ambient_tests([replace(as_record(record), decay=0.3)], Processing(band=BAND))


# -------- Lines of pulleys


def test_a_line_is_found_and_what_is_left_is_the_record_without_it():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, 40000))
    line = 0.2 * np.sin(2 * np.pi * 7.3712 * np.arange(40000) / RATE + 1)
    left, (found,) = without_harmonics(noise + line, 1 / RATE, [Speed("pump", 7.35)], (1.0, 25.0))
    assert (found.name, found.multiple) == ("pump", 1)
    what, source = "a pulley's line in noise", "the sine that was added"
    agrees(found.frequency, 7.3712, "modal", what, source, atol=0.1 / 400, unit="Hz")
    assert found.share == pytest.approx(0.02, rel=0.2)
    of_fit = np.sqrt(5 / 40000)
    assert (left - noise).std() < 1.5 * of_fit, "five numbers are fitted to 40000 samples of unit variance"


def test_nothing_is_found_where_nothing_turns():
    """Fifty records of noise, ten multiples each."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        record = rng.normal(size=(3, 6000))
        left, lines = without_harmonics(record, 1 / RATE, [Speed("pump", 2.0)], (1.0, 25.0))
        assert lines == ()
        assert left is record


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_a_harmonic_three_percent_beside_a_mode_is_named_and_no_mode(arm, seed):
    rng = np.random.default_rng(seed)
    speed = 1.03 * arm.frequency[seed]
    record = arm.record(rng, [(speed, 0.4), (2 * speed, 0.1)])
    named = operational_modes(ambient_test(record, f"{1.003 * speed:.5g} Hz @ pulley 1", BAND))
    plain = operational_modes(ambient_test(record, "", BAND))
    assert [str(line) for line in named.test.harmonics][:1] == [f"pulley 1 at {speed:.4g} Hz"]
    for modes in (named, plain):
        assert np.abs(modes.frequency / speed - 1).min() > 1e-3
        assert all(np.abs(modes.frequency / arm.frequency[k] - 1).min() < 0.01 for k in (0, 1, 3))
    assert any("of something that turns" in pole.why for pole in plain.rejected)


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.3, 1.0])
def test_a_harmonic_within_a_resonance_is_said(arm, amplitude):
    """A faint line is no line of the spectrum there, but a pole of little damping, or none."""
    speed = 1.01 * arm.frequency[0]
    record = arm.record(np.random.default_rng(5), [(speed, amplitude)])
    modes = operational_modes(ambient_test(record, f"{60 * speed:.6g} rpm @ pulley 1", BAND))
    said = [*(pole.why for pole in modes.rejected), *map(str, modes.test.harmonics), *modes.remarks]
    assert any("pulley 1" in each for each in said)
    if modes.test.harmonics:
        assert any("lies within the resonance of the mode at 5.6" in remark for remark in modes.remarks)
    else:
        doubtful = [each for each in modes.remarks if "may be that of pulley 1, which turns at 5.7" in each]
        assert any(f"the mode at {modes.frequency[1]:.4g} Hz" in each for each in doubtful)
    assert abs(modes.frequency[0] - arm.frequency[0]) < 4 * modes.sigma[0, 0]


@pytest.mark.slow
def test_a_speed_that_is_not_steady_is_named(arm):
    """A line that wanders by 0.1 %: what is left of it has next to no damping."""
    rng = np.random.default_rng(6)
    record = arm.record(rng)
    drift = np.cumsum(rng.normal(size=record.shape[1]))
    phase = 2 * np.pi * np.cumsum(9.0 * (1 + 1e-3 * drift / np.abs(drift).max())) / RATE
    heard = 0.3 * record.std(1, keepdims=True) * np.sin(phase)
    modes = operational_modes(ambient_test(record + heard, "9 Hz @ pulley 1", BAND))
    assert np.abs(modes.frequency - 9.0).min() > 0.1
    assert any("as of pulley 1, which turns at 9 Hz" in pole.why for pole in modes.rejected)
