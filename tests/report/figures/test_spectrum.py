import itertools

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation, Text

from ident.report.document import save
from ident.studies.working.spectrogram_figure import spectrogram_figure
from ident.studies.working.spectrum_figure import spectrum_figure
from ident.vibrate.spectra import amplitude_spectrum, spectrogram

TIME = np.arange(2000) / 200
BOTH = np.stack([1e-3 * np.sin(2 * np.pi * 5 * TIME), 3e-3 * np.sin(2 * np.pi * 9 * TIME)], axis=1)
MARKS = {"bending": (4.8, 4.8), "torsion of the joint": (4.12, 4.12), "finger $x$": (26.3, 26.3)}


def key(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()], legend.get_title().get_text().splitlines()


def drawn(figure):
    FigureCanvasAgg(figure).draw()
    return figure.canvas.get_renderer()


def test_spectrum_figure_says_what_is_drawn():
    figure = spectrum_figure({"simulated": amplitude_spectrum(TIME, BOTH)}, marks=MARKS)
    assert [axes.get_ylabel() for axes in figure.axes] == ["X: amplitude, 0-peak [mm]", "Z: amplitude, 0-peak [mm]"]
    assert figure.axes[-1].get_xlabel() == "frequency [Hz]"
    assert figure.axes[0].get_xlim() == (0, 20)
    names, notes = key(figure)
    assert names == ["simulated"]
    assert notes == [
        "Hann window, 1 segment of 10.0 s, resolution 0.10 Hz, ENBW 0.15 Hz",
        "beyond the axis: finger $x$: 26.30 Hz",
    ]


def test_spectrum_figure_draws_millimetres_of_each_direction():
    figure = spectrum_figure({"simulated": amplitude_spectrum(TIME, BOTH)})
    peaks = []
    for axes in figure.axes:
        frequency, amplitude = axes.lines[0].get_data()
        peaks += [(frequency[np.argmax(amplitude)], amplitude.max())]
        assert axes.get_ylim() == pytest.approx((0, 1.08 * amplitude.max()))
    assert np.array(peaks) == pytest.approx(np.array([(5.0, 1.0), (9.0, 3.0)]))


def test_spectra_made_differently_are_each_described_with_a_warning():
    series = {"simulated": amplitude_spectrum(TIME, BOTH), "measured": amplitude_spectrum(TIME, BOTH, segments=3)}
    names, notes = key(spectrum_figure(series))
    assert names == ["simulated", "measured"]
    assert notes[0].startswith("simulated: Hann window, 1 segment of 10.0 s")
    assert notes[1].startswith("measured: Hann window, mean power of 3 segments of 5.00 s, 50 % overlap")
    assert notes[2].startswith("resolutions differ: compare the heights of steady sines only")


def test_marks_stand_at_their_frequency_and_their_texts_do_not_touch():
    marks = {**MARKS, "a": (4.9, 4.9), "second": (9.5, 9.5), "at the edge": (19.5, 19.5), "in between": (12.0, 12.0)}
    figure = spectrum_figure({"simulated": amplitude_spectrum(TIME, BOTH)}, marks=marks)
    renderer = drawn(figure)
    texts = [child for child in figure.axes[0].get_children() if isinstance(child, Annotation)]
    assert sorted(text.get_text().strip() for text in texts) == sorted(
        f"{name}: {f:.2f} Hz" for name, (f, _) in marks.items() if f <= 20
    )
    boxes = {text.xy[0]: Text.get_window_extent(text, renderer) for text in texts}
    for one, other in itertools.combinations(boxes.values(), 2):
        assert not one.overlaps(other)
    for box in boxes.values():
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.bbox.y1
    assert boxes[4.9].y1 <= boxes[4.8].y0 < boxes[4.8].y1 <= boxes[4.12].y0
    for axes in figure.axes:
        assert {line.get_xdata()[0] for line in axes.lines[1:]} == {f for f, _ in marks.values() if f <= 20}


def test_a_mode_along_a_motion_is_a_shade_from_its_lowest_to_its_highest_frequency():
    figure = spectrum_figure({"simulated": amplitude_spectrum(TIME, BOTH)}, marks={"bending": (4.8, 7.9)})
    for axes in figure.axes:
        (shade,) = axes.patches
        assert (shade.get_x(), shade.get_x() + shade.get_width()) == pytest.approx((4.8, 7.9))
    drawn(figure)
    (text,) = [child for child in figure.axes[0].get_children() if isinstance(child, Annotation)]
    assert text.get_text().strip() == "bending: 4.80 to 7.90 Hz"


HOSTILE = "a$b_{\\frac$ %n \n $$ 玻璃" + "x" * 300


@pytest.mark.filterwarnings("ignore:Glyph")
def test_names_are_drawn_as_they_are():
    one = amplitude_spectrum(TIME, BOTH[:, 0])
    drawn(spectrum_figure({HOSTILE: one}, [HOSTILE], {HOSTILE: (5.0, 6.0), HOSTILE + "2": (30.0, 31.0)}))
    drawn(spectrogram_figure(grown().column(0), {HOSTILE: (TIME, TIME)}, title=HOSTILE))


def test_a_single_direction_needs_no_columns(tmp_path):
    figure = spectrum_figure({"one $": amplitude_spectrum(TIME, BOTH[:, 0])}, directions=["Z"])
    assert len(figure.axes) == 1
    save(figure, tmp_path / "one.png")
    assert (tmp_path / "one.png").stat().st_size > 10_000


def grown():
    return spectrogram(TIME, BOTH, segment_seconds=1.0)


def test_spectrogram_figure_says_what_is_drawn():
    lines = {"pulley 2": (TIME, np.where(TIME < 8, TIME, np.nan)), "bending": (np.array([0.0, 10.0]), np.full(2, 4.8))}
    figure = spectrogram_figure(grown().column(1), lines, title="Z at the tip")
    axes, bar = figure.axes
    names, notes = key(figure)
    assert names == ["pulley 2", "bending"]
    assert notes[0] == "Hann window, segments of 1.00 s, 75 % overlap, resolution 1.0 Hz, ENBW 1.5 Hz"
    assert notes[1] == "grey: less than half a segment from an end of the trace"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "frequency [Hz]")
    assert bar.get_ylabel() == "amplitude, 0-peak [mm]"
    assert figure.get_suptitle() == "Z at the tip"
    assert axes.get_xlim() == pytest.approx((0, 10), abs=0.3)
    np.testing.assert_array_equal(axes.lines[1].get_ydata(), [4.8, 4.8])
    drawn(figure)


@pytest.mark.parametrize(("decibel", "top", "bottom"), [(False, 3.0, 0.0), (True, 9.54, -50.46)])
def test_colours_of_a_spectrogram(decibel, top, bottom):
    figure = spectrogram_figure(grown().column(1), decibel=decibel)
    (mesh,) = figure.axes[0].collections
    assert mesh.get_clim() == pytest.approx((bottom, top), abs=0.01)
    cells = mesh.get_array()
    assert set(np.argmax(cells, axis=0)) == {9}
    corners = mesh.get_coordinates()
    np.testing.assert_allclose(
        corners[9, 0], [grown().time[0], 9.0]
    )  # a colour at each bin and segment, straight between
    assert corners[-1, -1, 1] - corners[-2, -1, 1] == pytest.approx(1.0)
    assert figure.axes[1].get_ylabel() == f"amplitude, 0-peak [{'dB re 1 mm' if decibel else 'mm'}]"
    drawn(figure)
