"""The order map of a triage: what it names, and that its texts stay within the figure."""

import numpy as np
import pytest
from figures import HOSTILE, assert_tidy

from ident.studies.cause.triage_figure import triage_figure
from ident.vibrate.spectra import spectrogram
from ident.vibrate.triage import Finding, Hypothesis, Triage

TIME = np.arange(2000) / 200.0
DRIVE = Hypothesis("drive", (("drive2", 1), ("drive1", 2)), None, (8 * np.sin(np.pi * TIME / 10),))
MODE = Hypothesis("mode", (), 0, (np.linspace(8, 4, len(TIME)),))
LINE = Hypothesis("line", (), None, (np.full(len(TIME), 9.5),))


def finding(kind, track, share, probability=1.0, **more):
    common = {"drives": (), "modes": (), "by_command": False, "trace": 0, "frequency": (9.5, 9.5)}
    common |= {"time": 4.0, "amplitude": 1e-3, "next": "source"}
    return Finding(kind=kind, track=track, share=share, probability=probability, **(common | more))


def figure(**more):
    findings = (
        finding("drive", 0, 0.6, drives=DRIVE.drives, modes=("vertical bending 1",)),
        finding("line", 2, 0.25, 0.5),
        finding("unexplained", None, 0.15),
    )
    triage = Triage(findings, (DRIVE, MODE, LINE), (("vertical bending 1",),), (TIME,), (1e-5,))
    values = 1e-3 * np.sin(2 * np.pi * 9.5 * TIME)
    return triage_figure(triage, spectrogram(TIME, values, segment_seconds=1.0), **more)


def test_the_order_map_names_what_was_found_and_what_was_compared():
    drawn = figure()
    legend = drawn.legends[0]
    assert [text.get_text() for text in legend.get_texts()] == [
        "1: drive2 or drive1 x 2, 60 %",
        "2: line at 9.5 Hz, 25 % (cannot tell)",
    ]
    assert "unexplained: 15 %" in legend.get_title().get_text()
    axes = drawn.axes[0]
    assert {text.get_text() for text in axes.texts} == {"drive2", "vertical bending 1", "1", "2"}
    widths = [line.get_linewidth() for line in axes.lines]
    assert widths == pytest.approx([2.2, 0.9, 2.2])
    mark = next(text for text in axes.texts if text.get_text() == "1")
    assert mark.xy == pytest.approx((4.0, 8 * np.sin(0.4 * np.pi)), abs=0.05)


def test_the_order_map_of_any_name_is_tidy():
    drawn = figure(title=HOSTILE)
    assert_tidy(drawn)
