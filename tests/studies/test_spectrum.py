"""`ident.spectrum` from Python: traces as values, files or simulated motions, and the file of a result."""

import numpy as np
import pytest
from arms import DATA
from reports import assert_one_screen, too_wide
from results import assert_comes_back

from ident import InputError, read_arm, read_trace
from ident.measure import Load, Log, Trace, read_pulleys
from ident.studies.working.simulate import SimulateOptions, simulate
from ident.studies.working.spectra import MarkedModes
from ident.studies.working.spectrum import SpectrumOptions, spectrum

pytestmark = pytest.mark.slow

ARM = DATA / "lcd_arm" / "arm.toml"
TIME = np.arange(1000) / 100


def sine(amplitude, frequency, kind="displacement", name="a.csv"):
    values = amplitude * np.sin(2 * np.pi * frequency * TIME)
    return Trace(name, "0" * 64, TIME, kind, {"x": values, "z": values / 2})


@pytest.fixture(scope="module")
def motion():
    return simulate(read_arm(ARM), SimulateOptions(speed=200.0, dwell=0.5, method="fast"))


FULL = SpectrumOptions(orders=(1.0, 2.0), spectrogram=True, decibel=True, direction=("x", "z"), upto=100)


@pytest.fixture(scope="module")
def full(motion):
    return spectrum(motion, FULL, arm=ARM)


def test_a_sine_stands_in_the_table_in_si():
    rows = spectrum(sine(4e-4, 5.0)).table()
    assert [(row["trace"], row["direction"], row["mode"]) for row in rows] == [("a", "x", None), ("a", "z", None)]
    assert [row["frequency"] for row in rows] == pytest.approx([5.0, 5.0], abs=1e-3)
    assert [row["amplitude"] for row in rows] == pytest.approx([4e-4, 2e-4], rel=1e-3)


def test_bands_and_peaks_of_a_sine():
    values = 3e-4 * np.sin(2 * np.pi * 5 * TIME) + 1e-6 * np.sin(2 * np.pi * 12 * TIME)
    result = spectrum(Trace("a.csv", "", TIME, "displacement", {"x": values, "y": values / 2}))
    assert result.band_rms(4.0, 6.0) == pytest.approx({"x": 3e-4 / np.sqrt(2), "y": 1.5e-4 / np.sqrt(2)}, rel=1e-3)
    assert result.band_rms(20.0, 30.0)["x"] < 1e-9
    (faint,) = result.peaks("y", low=8.0, high=20.0, count=1)
    assert (faint.frequency, faint.amplitude) == pytest.approx((12.0, 0.5e-6), rel=1e-3)
    largest = result.frequency[result.amplitudes["x"].argmax()]
    assert (largest, result.amplitudes["x"].max()) == pytest.approx((5.0, 3e-4), rel=1e-3)


def test_only_what_lies_between_two_times_counts():
    values = np.where(TIME < 5, np.sin(2 * np.pi * 5 * TIME), np.sin(2 * np.pi * 8 * TIME))
    trace = Trace("a.csv", "", TIME, "displacement", {"y": values})
    late = spectrum(trace, SpectrumOptions(start=5.5, end=9.0))
    assert [row["frequency"] for row in late.table()] == pytest.approx([8.0], abs=0.02)
    kept = late.spectra.traces["a"].time
    assert (kept[0], kept[-1]) == pytest.approx((5.5, 9.0))


def before_next(result):
    return result.report().partition("\nNext: ")[0]


def test_a_simulated_motion_is_analysed_as_its_file_is(motion, full, tmp_path):
    csv = motion.save(tmp_path)[0]
    from_file = spectrum(csv, FULL, arm=read_arm(ARM))
    assert from_file.report() == full.report()
    assert from_file.name == full.name == "arm.extend-200.spectrum"
    trace = read_trace(csv)
    given = spectrum(trace, FULL, arm=ARM, pulleys=read_pulleys(csv, trace), path=csv)
    assert before_next(given) == before_next(full), "the next command repeats the path"
    assert set(full.figures()) == {"spectrum", "x", "z"}
    assert "1 x drive1 and drive3" in " ".join(full.spectra.lines)
    assert_one_screen(full.report(), files=4)
    assert not too_wide(full.report(details=True))


def test_acceleration_beside_displacement_is_compared_as_acceleration():
    result = spectrum(sine(4e-4, 5.0), against=sine(0.7, 7.0, "acceleration"))
    assert list(result.spectra.traces) == ["a", "a.csv"]
    assert "differentiated twice" in result.sections().remark
    assert_one_screen(result.report(), files=6)
    assert result.spectra.kind == "acceleration"
    amplitudes = {row["trace"]: row["amplitude"] for row in result.table() if row["direction"] == "x"}
    assert amplitudes == pytest.approx({"a": 4e-4 * (10 * np.pi) ** 2, "a.csv": 0.7}, rel=2e-3)


def test_modes_of_an_arm_are_marked():
    arm = read_arm(ARM)
    options = SpectrumOptions(posture=(0.0, 0.0, 0.0), load="glass")
    result = spectrum(sine(1e-3, 4.1), options, arm=arm)
    modes = result.spectra.modes
    assert len(modes.bands) == 6
    assert modes.held
    assert result.table()[0]["mode"] == min(modes.bands, key=lambda label: abs(modes.bands[label][0] - 4.1))
    assert any("glass, at (0, 0, 0) deg" in section.title for section in result.sections().details)


def test_modes_along_the_motion_are_those_of_the_arm_held_at_its_postures(motion, full):
    """At the ends of the stroke each mode is at an end of its band, or within it."""
    modes = full.spectra.modes
    ends = np.degrees(motion.simulation.response.posture[:, [0, -1]])
    held = [spectrum(motion, SpectrumOptions(posture=tuple(ends[:, k])), arm=ARM).spectra.modes for k in (0, 1)]
    last = {label: band[0] for label, band in held[1].bands.items()}
    assert {label: along[-1] for label, along in modes.frequencies.items() if label in last} == pytest.approx(
        last, rel=1e-5
    )
    first = sorted(along[0] for along in modes.frequencies.values())
    assert first[:3] == pytest.approx(sorted(band[0] for band in held[0].bands.values())[:3], rel=1e-5)
    assert not modes.held
    assert any(f"along the motion from ({ends[0, 0]:.4g}," in section.title for section in full.sections().details)


def test_a_peak_is_named_by_what_is_longest_near_it_in_its_direction():
    frequencies = {
        "lateral torsion 1": np.array([8.0, 6.0, 4.0]),
        "vertical bending 1": np.array([5.0, 4.9, 4.8]),
        "vertical bending 2": np.array([9.0, 7.0, 5.0]),
    }
    modes = MarkedModes("an arm", Load(), (0.0,), (1.0,), frequencies)
    assert modes.near(4.9, 0.2, "vertical") == "vertical bending 1"
    assert modes.near(4.9, 1.2, "lateral") == "lateral torsion 1"
    assert modes.near(9.1, 0.2, "lateral") == "vertical bending 2"
    assert modes.near(12.0, 0.2, "vertical") is None


def test_a_path_that_does_not_cover_the_trace_is_refused():
    angles = dict.fromkeys(("joint1", "joint2", "joint3"), np.linspace(0, 0.5, 50))
    with pytest.raises(InputError, match=r"log.csv, time: got 0 to 5 s, expected the span of the trace, 0 to 9.99 s"):
        spectrum(sine(1e-3, 4.1), arm=ARM, path=Log("log.csv", "", np.linspace(0, 5, 50), angles))


@pytest.mark.parametrize("case", ["full", "bare"])
def test_a_saved_result_comes_back_as_it_was(full, tmp_path, case):
    result = full if case == "full" else spectrum(sine(4e-4, 5.0))
    saved = assert_comes_back(result, tmp_path)
    assert (saved.inputs["arm"] is None) is (case == "bare")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"upto": 0.0}, "upto: got 0, expected a number above 0"),
        ({"direction": ("y",)}, "direction: got 'y', expected some of x, z"),
        ({"posture": (0.0,)}, "posture: got it without `arm`"),
        ({"start": 8.0, "end": 3.0}, "start: got 0 samples up to `end`, expected a span within 0 to 9.99 s"),
        ({"window": "han"}, "did you mean hann"),
    ],
)
def test_options_that_cannot_be_are_refused_in_one_line(options, words):
    with pytest.raises(InputError) as error:
        spectrum(sine(4e-4, 5.0), SpectrumOptions(**options))
    assert words in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_traces_without_a_direction_in_common_are_refused():
    other = Trace("b.csv", "", TIME, "displacement", {"y": np.sin(TIME)})
    with pytest.raises(InputError, match="against: got a trace of other directions"):
        spectrum(sine(4e-4, 5.0), against=other)
