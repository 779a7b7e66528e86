import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import lcd_arm
from figures import HOSTILE, assert_tidy, fitted, made_up
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.image import imread

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.measure.kinds import KINDS
from ident.report.document import save
from ident.studies.stiffness.fit_figure import KIND_STYLES, fit_figure

pytestmark = pytest.mark.slow


def panel(figure, start):
    return next(a for a in figure.axes if a.get_legend() and a.get_legend().get_title().get_text().startswith(start))


def markers(axes):
    """Markers as (x, y, filled), from the top down."""
    lines = [line for line in axes.lines if line.get_marker() not in ("None", None, "")]
    white = to_rgba("white")
    found = [
        (float(x), float(y), to_rgba(line.get_markerfacecolor()) != white)
        for line in lines
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    ]
    return sorted(found, key=lambda marker: marker[1])


def labels_have_units(figure):
    labelled = [a.get_xlabel() for a in figure.axes if a.get_xlabel()]
    return bool(labelled) and all("[" in label and "]" in label for label in labelled)


@pytest.mark.parametrize(("name", "count"), [("table1", 3), ("campaign", 20)])
def test_fit_figure_shows_every_parameter_direction_and_measurement(name, count, tmp_path):
    result = fitted(name)
    figure = fit_figure(result)
    known = result.information
    parameters, directions = panel(figure, "Parameters"), panel(figure, "Combinations")
    assert [filled for _, _, filled in markers(parameters)] == result.supported.tolist()
    ratios = result.best.values / np.asarray(result.problem.parameters.column("centre"))
    np.testing.assert_allclose([x for x, _, _ in markers(parameters)], ratios)
    assert [filled for _, _, filled in markers(directions)] == [d.seen for d in known.directions]
    residuals = markers(panel(figure, "Residuals"))
    assert len(residuals) == count
    assert sorted(x for x, _, _ in residuals) == pytest.approx(sorted(-result.standardised))
    assert labels_have_units(figure)
    assert_tidy(figure)
    save(figure, tmp_path / "new" / f"{name}.png")
    assert imread(tmp_path / "new" / f"{name}.png").shape[1] > 1000


def keys(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_each_kind_of_measurement_has_a_marker_of_its_own():
    assert KIND_STYLES.keys() == KINDS.keys()
    assert len({(style["color"], style["marker"]) for style in KIND_STYLES.values()}) == len(KINDS)


def test_a_fit_in_doubt_says_so_and_rims_outliers():
    right = fitted("campaign")
    assert keys(panel(fit_figure(right), "Parameters")) == ["known, 95 % interval"]
    assert "outlier" not in keys(panel(fit_figure(right), "Residuals"))
    assert keys(panel(fit_figure(fitted("table1")), "Parameters")) == [
        "not determined by the data alone: with the prior"
    ]
    off = np.zeros(20)
    off[[2, 7]] = 30.0
    result = replace(right, predicted=right.predicted + off * np.asarray(right.problem.sigma))
    figure = fit_figure(result)
    assert figure.get_suptitle().endswith(": NOT USABLE")
    assert keys(panel(figure, "Parameters")) == ["not reported, as the fit is in doubt: by data and prior"]
    residuals = panel(figure, "Residuals")
    assert keys(residuals)[-1] == "outlier"
    rims = [to_rgba(line.get_markeredgecolor()) == to_rgba("black") for line in residuals.lines]
    rimmed = [float(x) for line, rim in zip(residuals.lines, rims, strict=True) if rim for x in line.get_xdata()]
    z = -result.standardised[result.outliers]
    assert len(z) >= 2
    assert sorted(x for x in rimmed if x) == pytest.approx(sorted(z))  # not the line at zero
    assert_tidy(figure)


def test_what_cannot_be_checked_is_hollow():
    result = fitted("table1")
    residuals = panel(fit_figure(result), "Residuals")
    assert result.row_tests.unchecked.tolist() == [False, True, False]
    assert [filled for _, _, filled in markers(residuals)] == [True, False, True]
    assert keys(residuals)[-1] == "unchecked"


def test_what_the_data_leave_open_is_hollow():
    filled = [marker[2] for marker in markers(panel(fit_figure(fitted("table1")), "Combinations"))]
    assert filled == [True, True, True, False, False, False]


@pytest.mark.parametrize(
    ("parameters", "measurements", "prior_sd"),
    [(1, 1, np.inf), (12, 3, 1.0), (12, 20, np.inf), (6, 59, 1.0), (9, 300, np.inf)],
)
def test_any_size_is_tidy(parameters, measurements, prior_sd):
    figure = fit_figure(made_up(parameters, measurements, prior_sd=prior_sd))
    assert len(markers(panel(figure, "Residuals"))) == measurements
    assert_tidy(figure)


def test_lengths_are_drawn_as_shifts():
    figure = fit_figure(made_up(6, 20))
    assert len(markers(panel(figure, "Parameters"))) == 4
    assert panel(figure, "Lengths").get_xlabel().endswith("[mm]")


def test_hostile_names_are_drawn_as_they_are(tmp_path):
    result = fitted("table1")
    arm = Arm(HOSTILE, lcd_arm().joints, lcd_arm().points)
    measured = tuple(replace(m, mode=None, point="$tip_$" if m.point else None) for m in result.campaign)
    campaign = replace(result.campaign, name=HOSTILE, measurements=measured)
    figure = fit_figure(replace(result, arm=arm, campaign=campaign))
    assert_tidy(figure)
    save(figure, tmp_path / "$hostile$.png")


def test_a_figure_is_saved_whole_or_not_at_all(tmp_path, monkeypatch):
    figure = Figure()
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
    figure = Figure()
    with pytest.raises(InputError) as error:
        save(figure, tmp_path / bad)
    assert len(str(error.value).splitlines()) == 1
    assert sorted(p.name for p in Path(tmp_path).iterdir()) == ["file", "folder"]
