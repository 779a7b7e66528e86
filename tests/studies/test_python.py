"""What Python has besides the commands: frames as campaigns, numbers changed, figures in the user's own axes."""

import pickle

import matplotlib.pyplot as plt
import numpy as np
import pandas
import pytest
from commands import ARM, DATA

import ident
from ident.inference.problem import Parts
from ident.studies.shared import as_campaign

CAMPAIGN = DATA / "lcd_arm" / "campaign.csv"


def test_a_frame_with_the_columns_of_a_file_is_a_campaign():
    from_file, from_frame = ident.read_campaign(CAMPAIGN), as_campaign(pandas.read_csv(CAMPAIGN, comment="#"))
    assert [m.value for m in from_frame] == [m.value for m in from_file]
    assert [m.posture for m in from_frame] == [m.posture for m in from_file]
    assert (from_frame.name, from_frame.path) == ("campaign", "")


def test_a_wrong_cell_of_a_frame_is_refused_with_its_row():
    frame = pandas.read_csv(CAMPAIGN, comment="#")
    frame["unit"] = "kg"
    with pytest.raises(ident.InputError, match=r"^campaign:2, unit: "):
        as_campaign(frame)


def test_an_arm_with_a_number_changed_is_no_longer_that_of_its_file():
    arm = ident.read_arm(ARM)
    heavier = arm.replace({"link2.mass": 30.0})
    assert float(heavier.arm.get("link2.mass")) == 30.0 != float(arm.arm.get("link2.mass"))
    assert (heavier.path, heavier.sha256, heavier.name) == ("", "", arm.arm.name)
    assert "link2.mass" in arm.origins.keys() - heavier.origins.keys()
    with pytest.raises(ident.InputError, match=r"link2, mass: got -30 kg, expected a value >= 0"):
        arm.replace({"link2.mass": -30.0})
    with pytest.raises(ident.InputError, match=r"link2\.mass"):
        arm.replace({"link2.mas": 30.0})


def trace(folder, directions):
    path, time = folder / "sine.csv", np.arange(200) / 100
    head = ",".join(["time [s]", *(f"{each} [mm]" for each in directions)])
    np.savetxt(
        path, np.column_stack([time, *[np.sin(30 * time)] * len(directions)]), "%g", ",", header=head, comments=""
    )
    return path


def test_a_figure_of_one_panel_is_drawn_into_given_axes(tmp_path):
    figure, (left, right) = plt.subplots(1, 2)
    figures = ident.spectrum(trace(tmp_path, "x")).figures(ax=right)
    assert figures[""] is figures["spectrum"] is figure
    assert (right.get_title(), len(right.lines), len(left.lines)) == ("Amplitude spectrum", 1, 0)
    assert figure.axes == [left, right]
    figure.canvas.draw()
    plt.close(figure)


def test_a_figure_of_several_panels_needs_a_figure_of_its_own(tmp_path):
    figure, axes = plt.subplots()
    for result in (ident.spectrum(trace(tmp_path, "xz")), ident.predict(ARM)):
        with pytest.raises(
            ident.InputError, match=r"^ax: got axes, expected none, as the main figure does not have one"
        ):
            result.figures(ax=axes)
        assert not axes.get_title()
        assert not axes.lines
        assert result.figures()
    plt.close(figure)


def test_a_model_in_parts_can_be_pickled():
    parts = pickle.loads(pickle.dumps(Parts((), np.zeros((1, 1)), np.zeros(1))))
    assert (parts.split("whole"), parts.joined(["whole"])) == (["whole"], "whole")
