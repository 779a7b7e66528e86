"""Lines of pulleys beside modes: found, named, taken out; and no mode is taken for one."""

import numpy as np
import pytest
from ambient_records import RATE, ambient_test, shaken

from ident.measure.series import Speed
from ident.modal.ambient import without_harmonics
from ident.modal.operational import operational_modes

pytestmark = pytest.mark.slow

BAND = (1.0, 28.0)


@pytest.fixture(scope="module")
def arm():
    return shaken(600.0)


def test_a_line_is_found_and_what_is_left_is_the_record_without_it():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, 40000))
    line = 0.2 * np.sin(2 * np.pi * 7.3712 * np.arange(40000) / RATE + 1)
    left, (found,) = without_harmonics(noise + line, 1 / RATE, [Speed("pump", 7.35)], (1.0, 25.0))
    assert (found.name, found.multiple) == ("pump", 1)
    assert found.frequency == pytest.approx(7.3712, abs=0.1 / 400)
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


@pytest.mark.parametrize("seed", range(3))
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
