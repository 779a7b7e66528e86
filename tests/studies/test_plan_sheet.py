"""The sheet of a plan: its channel table says what its page says, and `modal` finds the recordings by its names."""

import math
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from hammer_files import FOLDER, generator
from tapped import MG, RATE, tapped

import ident
from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.candidates import HammerPlan
from ident.measure import OWN_WEIGHT, Load
from ident.measure.channels import read_channels, recordings_of
from ident.modal.recorded import records, sources
from ident.studies.stiffness.plan_sheet import SheetPosture, write_sheet

POSTURE = (30.0, -60.0, 30.0)
"""[deg] where the hand's axes are the base's."""
SEEN = {"tip +y": 1, "tip +z": 2, "elbow +z": 5}
"""Sensors, each with its place among the responses of the made records."""
HEAD = {"created": "2026-11-30", "inputs": {}, "format": "ident-plan/10", "software": {}, "options": {}}


def planned(**other):
    frequency, damping = np.array([4.5, 4.9, 14.0, 18.0]), np.full(4, 0.004)
    places = ("tip y", "tip z", "elbow z"), ("tip y", "tip z")
    made = HammerPlan(tuple(np.radians(POSTURE)), OWN_WEIGHT, (), frequency, damping, *places, 5, np.eye(4), ())
    return replace(made, **other)


def posture(tap, number=1, mass=0.15, test=None):
    test = test or planned()
    angles = {f"q{i} [deg]": f"{angle:g}" for i, angle in enumerate(np.degrees(test.posture).round(3), 1)}
    word, first = ("tap", 1) if tap else ("hit", 2)
    sensors = tuple((f"{i}", *each.split()) for i, each in enumerate(SEEN, first))
    pushes = tuple((f"p{number}_{word}{i}", "tip", push) for i, push in ((1, "+y"), (2, "-z")))
    load = Load(masses=((mass, "tip"), (mass, "elbow"))) if mass else OWN_WEIGHT
    return SheetPosture(number, test, angles, word, load, sensors, pushes)


def sheet(tmp_path, *postures):
    folder = tmp_path / "test.sheet"
    write_sheet(folder, read_arm(FOLDER / "arm.toml"), postures, HEAD)
    return folder


def write_record(path, *columns, names):
    """Samples over time as a CSV of any recorder: names of its own, units in the header."""
    time = np.arange(len(columns[0])) / RATE
    np.savetxt(path, np.column_stack([time, *columns]), "%.8g", ",", header=f"time [s],{','.join(names)}", comments="")


def record_taps(folder, seed=3):
    rng = np.random.default_rng(seed)
    for file, directions in (("p1_tap1.csv", "yyyyy"), ("p1_tap2_again.TXT", "zzzzz")):
        values = tapped(POSTURE).record(rng, directions)[list(SEEN.values())] / (1000 * MG)
        write_record(folder / file, *values, names=("left [g_0]", "right [g_0]", "over [g_0]"))


def record_hits(folder):
    arm, rng = read_arm(FOLDER / "arm.toml").arm, np.random.default_rng(4)
    made = generator().system(arm, np.radians(POSTURE))
    for hit, direction in (("hit1", "y"), ("hit2", "z")):
        force, moved = generator().records(made, 0, direction, rng)  # alpha 0 has no fault
        for letter, pushed, values in zip("abcde", force, moved.swapaxes(0, 1), strict=True):
            names = ("hammer [N]", "a [m/s^2]", "b [m/s^2]", "c [m/s^2]")
            write_record(folder / f"p1_{hit}{letter}.csv", pushed, *values[list(SEEN.values())], names=names)


@pytest.mark.parametrize("tap", [True, False])
def test_the_table_says_what_the_page_says(tmp_path, tap):
    folder = sheet(tmp_path, posture(tap), posture(tap, 2, test=planned(posture=(0.0, 0.0, 0.0))))
    rows, page = read_channels(folder / "channels.csv").rows, unescape((folder / "sheet.html").read_text())
    assert len(rows) == 2 * 2 * (3 if tap else 4)
    first = [row for row in rows if row.file == rows[0].file]
    assert [row.role for row in first] == ["force"] * (not tap) + ["response"] * 3
    assert [row.channel for row in first] == [f"{i}" for i in range(1, len(first) + 1)]
    assert {row.excitation for row in rows} == {"tap" if tap else ""}
    assert [row.taps for row in first] == ([5, 5, 5] if tap else [5, 0, 0, 0])
    np.testing.assert_allclose([rows[0].posture, rows[-1].posture], [np.radians(POSTURE), np.zeros(3)], atol=1e-12)
    assert {str(row.load) for row in rows} == {generator().LOAD}
    letters = {(1, 0, 0): "+x", (0, 1, 0): "+y", (0, 0, 1): "+z", (0, 0, -1): "-z"}
    for row in rows:
        name = row.file.rstrip("*") if row.role == "force" else row.channel
        cells = f"<tr><td>{name}</td><td>{row.point}</td><td>"
        assert cells in page
        after = page.split(cells)[1].split("</td>")  # coordinates, then the direction
        assert letters[tuple(row.direction)] in "".join(part.split("</td>")[1] for part in page.split(cells)[1:])
        assert len(after[0].split(",")) == 3
    assert "joint1 30, joint2 -60, joint3 30 deg" in page
    assert "Sampling:</strong> 200 Hz or faster, 5 s after each" in page
    assert page.count("<figure>") == page.count('class="sheet posture"') == 2
    assert generator().LOAD in page
    assert all(box in page for box in ("temperature [C]", "serial number", "mounting"))
    assert "<td>2790, 0, 290</td>" not in page  # in the second posture the arm is stretched
    assert "<td>4790, 0, 290</td>" in page


def test_rate_and_length_follow_from_the_expected_modes():
    """200 Hz are 11 times 18 Hz; 2 / (4.9 - 4.5) Hz = 5 s; decays of 0.4 % and 0.1 % are ln(1000) / (zeta omega)."""
    assert (planned().rate, planned().duration) == (200.0, 5)
    assert planned(frequency=np.array([4.5, 4.9, 14.0, 26.0])).rate == 400.0
    assert planned(frequency=np.array([4.5, 4.501, 14.0, 18.0])).duration == 60
    quick = planned(frequency=np.array([4.5, 4.501, 14.0, 18.0]), damping_ratio=np.full(4, 0.02))
    assert quick.duration == math.ceil(math.log(1000) / (0.02 * 2 * math.pi * 4.5))
    assert (
        planned(frequency=np.array([0.5]), damping_ratio=np.zeros(1), auto_mac=np.eye(1)).duration == 40
    )  # 20 periods


def test_recordings_are_found_by_the_numbers_of_their_channels(tmp_path):
    taps, hits = (sheet(tmp_path / word, posture(word == "taps")) for word in ("taps", "hits"))
    record_taps(taps)
    table = read_channels(taps / "channels.csv")
    made = records(table, recordings_of(taps, table))
    assert [each.file for each in made] == ["p1_tap1.csv", "p1_tap2_again.TXT"]
    assert [each.channel for each in made[0].responses] == ["left", "right", "over"]
    assert {each.excitation for each in made} == {"tap"}
    record_hits(hits)
    table = read_channels(hits / "channels.csv")
    found = sources(table, recordings_of(hits, table))
    assert len(found) == 10
    assert {each.reference.direction for each in found} == {(0, 1, 0), (0, 0, -1)}
    assert all(each.force.max() > 50 for each in found)  # and no acceleration
    (taps / "p1_tap1.csv").write_text("time [s],left [g_0]\n0,1\n0.1,2\n0.2,1\n")
    table = read_channels(taps / "channels.csv")
    recorded = recordings_of(taps, table)
    with pytest.raises(InputError, match=r"got '2', expected a channel of 'p1_tap1.csv'; it has left"):
        records(table, recorded)


def test_a_channel_named_by_a_number_is_no_count(tmp_path):
    """The third channel is called 1."""
    folder = sheet(tmp_path, posture(True))
    values = np.random.default_rng(1).normal(size=(3, 500))
    write_record(folder / "p1_tap1.csv", *values, names=("2 [g]", "3 [g]", "1 [g]"))
    table = read_channels(folder / "channels.csv")
    (made,) = records(table, recordings_of(folder, table))
    assert [each.channel for each in made.responses] == ["1", "2", "3"]


def test_a_sheet_does_not_replace_the_table_of_recordings(tmp_path):
    folder = sheet(tmp_path, posture(True))
    record_taps(folder)
    before = (folder / "channels.csv").read_bytes()
    sheet(tmp_path, posture(True))
    with pytest.raises(InputError, match=r"test.sheet: got recordings by another channel table, .*--out"):
        sheet(tmp_path, posture(True, mass=0.2))
    assert (folder / "channels.csv").read_bytes() == before


def test_a_pin_becomes_a_point_of_the_arm_beside(tmp_path):
    made = posture(True)
    made = replace(made, sensors=(*made.sensors, ("4", "joint3_pin", "+x")))
    folder = sheet(tmp_path, made)
    arm = read_arm(folder / "arm.toml").arm
    assert [point.name for point in arm.points] == ["joint3_pin", "elbow", "tip"]
    assert "<td>joint3_pin</td>" in (folder / "sheet.html").read_text()


def test_planned_runs_have_no_sheet():
    options = ident.PlanOptions(sheet="tap")
    with pytest.raises(
        InputError, match="sheet: got a sheet of planned runs, expected hammer or tap tests; leave it out"
    ):
        ident.plan(FOLDER / "arm.toml", None, options, runs="runs.csv")


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("tap", [True, False])
def test_modal_makes_a_campaign_of_the_recordings(tmp_path, tap):
    """Frequencies against the poles that made the records."""
    folder = sheet(tmp_path, posture(tap))
    (record_taps if tap else record_hits)(folder)
    campaign = ident.modal_test(folder).campaign
    rows = [row for row in campaign if row.kind == "frequency"]
    assert len(rows) >= 3
    assert {row.load for row in rows} == {Load.parse(generator().LOAD)}
    np.testing.assert_allclose([row.posture for row in rows], len(rows) * [np.radians(POSTURE)], atol=1e-12)
    true = tapped(POSTURE).frequency
    assert all(np.abs(row.value / true - 1).min() < 0.01 for row in rows)
