import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm
from figures import HOSTILE, assert_tidy, fitted, made_up
from matplotlib.colors import to_rgba
from matplotlib.image import imread

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.identify.fit import Assumption, Assumptions
from ident.inference.fit import CrossPrediction
from ident.inference.information import ScoreTest
from ident.inference.scrutiny import Exchange
from ident.present.figures.fit import fit_figure
from ident.present.files.document import save

pytestmark = pytest.mark.slow


def panel(figure, start):
    return next(a for a in figure.axes if a.get_legend() and a.get_legend().get_title().get_text().startswith(start))


def markers(axes):
    """Single markers as (x, y, filled)."""
    lines = [line for line in axes.lines if line.get_marker() not in ("None", None, "")]
    white = to_rgba("white")
    return [
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]), to_rgba(line.get_markerfacecolor()) != white)
        for line in lines
    ]


def labels_have_units(figure):
    labelled = [a.get_xlabel() for a in figure.axes if a.get_xlabel()]
    return bool(labelled) and all("[" in label and "]" in label for label in labelled)


@pytest.mark.parametrize(("name", "count"), [("table1", 3), ("campaign", 20)])
def test_fit_figure_shows_every_parameter_direction_and_measurement(name, count, tmp_path):
    result = fitted(name)
    figure = fit_figure(result)
    known = result.information
    parameters, directions = panel(figure, "Parameters"), panel(figure, "Directions")
    assert [filled for _, _, filled in markers(parameters)] == result.supported.tolist()
    ratios = result.best.values / np.asarray(result.problem.parameters.column("centre"))
    np.testing.assert_allclose([x for x, _, _ in markers(parameters)], ratios)
    assert [filled for _, _, filled in markers(directions)] == [d.seen for d in known.directions]
    assert sum(t.get_text() == "open" for t in directions.texts) == sum(not d.seen for d in known.directions)
    residuals = markers(panel(figure, "Measured"))
    assert len(residuals) == count
    assert sorted(x for x, _, _ in residuals) == pytest.approx(sorted(-result.standardised))
    assert labels_have_units(figure)
    assert_tidy(figure)
    save(figure, tmp_path / "new" / f"{name}.png")
    assert imread(tmp_path / "new" / f"{name}.png").shape[1] > 1000


def keys(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_a_fit_in_doubt_says_withheld_and_rims_what_lies_too_far_off():
    right = fitted("campaign")
    assert keys(panel(fit_figure(right), "Parameters")) == ["known, 95 % interval"]
    assert "too far off" not in keys(panel(fit_figure(right), "Measured"))
    assert keys(panel(fit_figure(fitted("table1")), "Parameters")) == ["no interval by the data; shown with the prior"]
    off = np.zeros(20)
    off[[2, 7]] = 30.0
    result = replace(right, predicted=right.predicted + off * np.asarray(right.problem.sigma))
    figure = fit_figure(replace(result, exchanges=(Exchange((2, 7), 9.5),)))
    assert keys(panel(figure, "Parameters")) == ["withheld, as the fit is in doubt: what data and prior would tell"]
    residuals = panel(figure, "Measured")
    assert keys(residuals)[-1] == "too far off"
    rims = [to_rgba(line.get_markeredgecolor()) == to_rgba("black") for line in residuals.lines]
    rimmed = [float(line.get_xdata()[0]) for line, rim in zip(residuals.lines, rims, strict=True) if rim]
    z = -result.standardised[result.outliers]
    assert len(z) >= 2
    assert sorted(x for x in rimmed if x) == pytest.approx(sorted(z))  # not the line at zero
    said = " ".join(text.get_text() for axes in figure.axes for text in axes.texts)
    assert f"{len(z)} of 20 measurements lie too far from the fit" in said
    assert "With two values exchanged chi-squared would be 9.5" in said
    assert_tidy(figure)


def test_what_cannot_be_checked_is_hollow():
    result = fitted("table1")
    residuals = panel(fit_figure(result), "Measured")
    assert result.row_tests.unchecked.tolist() == [False, True, False]
    assert [filled for _, _, filled in markers(residuals)] == [True, False, True]
    assert keys(residuals)[-1] == "cannot be checked"


def test_what_the_data_ask_for_is_named():
    test = ScoreTest(0.2, True, np.zeros(6), True, 0.5, 6.0, 0.02)
    asking = Assumptions((Assumption("base rocks", "", test),), 0.5)
    figure = fit_figure(replace(fitted("campaign"), assumptions=asking))
    said = " ".join(text.get_text() for axes in figure.axes for text in axes.texts)
    assert "The data ask for an assumption to be dropped: base rocks" in said
    assert_tidy(figure)


def test_what_the_data_leave_open_is_hollow():
    filled = [marker[2] for marker in markers(panel(fit_figure(fitted("table1")), "Directions"))]
    assert filled == [True, True, True, False, False, False]


@pytest.mark.parametrize("prior_sd", [1.0, np.inf])
@pytest.mark.parametrize(("parameters", "measurements"), [(1, 1), (12, 3), (12, 20), (6, 59), (9, 300)])
def test_any_size_is_tidy(parameters, measurements, prior_sd, tmp_path):
    figure = fit_figure(made_up(parameters, measurements, prior_sd=prior_sd))
    assert len(markers(panel(figure, "Measured"))) == measurements
    assert_tidy(figure)
    save(figure, tmp_path / "f.png")


def test_lengths_are_drawn_as_shifts():
    figure = fit_figure(made_up(6, 20))
    assert len(markers(panel(figure, "Parameters"))) == 4
    assert panel(figure, "Lengths").get_xlabel().endswith("[mm]")


def test_contradictions_are_told_in_words():
    result = fitted("table1")
    measured, predicted = np.array([0.022]), np.array([0.0316])
    prediction = CrossPrediction("deflection", (2,), measured, predicted, np.array([-4.1]), 17.0, 1.0, 1.0)
    said = [t.get_text() for a in fit_figure(replace(result, cross_predictions=(prediction,))).axes for t in a.texts]
    assert any("CONTRADICTION" in text for text in said)
    assert any("lead to 31.6 mm, 4.1 sd" in text for text in said)


def test_hostile_names_are_drawn_as_they_are(tmp_path):
    result = fitted("table1")
    arm = Arm(HOSTILE, lcd_arm().joints, lcd_arm().points)
    measured = tuple(replace(m, mode=None, point="$tip_$" if m.point else None) for m in result.campaign)
    campaign = replace(result.campaign, name=HOSTILE, measurements=measured)
    figure = fit_figure(replace(result, arm=arm, campaign=campaign))
    assert_tidy(figure)
    save(figure, tmp_path / "$hostile$.png")


def test_a_figure_is_saved_whole_or_not_at_all(tmp_path, monkeypatch):
    figure = fit_figure(fitted("table1"))
    old = tmp_path / "f.png"
    old.write_bytes(b"old")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="no space left on device"):
        save(figure, old)
    assert old.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["f.png"]


@pytest.mark.parametrize("bad", ["file/f.png", "folder"])
def test_what_cannot_be_written_is_one_line(bad, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    figure = fit_figure(fitted("table1"))
    with pytest.raises(InputError) as error:
        save(figure, tmp_path / bad)
    assert len(str(error.value).splitlines()) == 1
    assert sorted(p.name for p in Path(tmp_path).iterdir()) == ["file", "folder"]
