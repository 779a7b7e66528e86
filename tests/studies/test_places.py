"""Points and directions of a channel table on the arm, against rotations written out by hand."""

import numpy as np
import pytest
from hammer_files import FOLDER

from ident.arm.chain import at_posture
from ident.description.file import read_arm
from ident.errors import InputError
from ident.measure.channels import ChannelRow, ChannelTable
from ident.measure.load import Load
from ident.studies.measuring.modal_campaign import in_base_frame, with_places

LCD = FOLDER.parent
POSTURE = tuple(np.radians([30.0, -70.0, 25.0]))


@pytest.fixture(scope="module")
def arm():
    return read_arm(LCD / "arm.toml").arm


def table(**more):
    common = {"where": "channels.csv:2", "file": "a", "channel": "z", "role": "response", "posture": POSTURE}
    row = ChannelRow(**common | {"point": "tip", "direction": (1.0, 0.0, 0.0), "frame": "body"} | more)
    return ChannelTable("channels.csv", "", (row,))


def refused(arm, **more):
    rows = table(**more)
    with pytest.raises(InputError) as caught:
        in_base_frame(with_places(arm, rows), rows)
    return str(caught.value)


@pytest.mark.parametrize(("joint", "angle"), [("joint1", 30), ("joint2", -40), ("joint3", -15)])
def test_a_direction_of_a_body_turns_with_all_pins_before_it(arm, joint, angle):
    rows = table(point="new", joint=joint, position=(0.1, 0.2, 0.3))
    (row,) = in_base_frame(with_places(arm, rows), rows).rows
    np.testing.assert_allclose(row.direction, [np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0], atol=1e-12)
    assert row.frame == "base"


def test_a_direction_of_the_base_stays(arm):
    rows = table(frame="base", direction=(0.6, 0.0, 0.8))
    assert in_base_frame(arm, rows).rows == rows.rows


def test_a_new_point_comes_before_the_end_point_where_it_was_said(arm):
    rows = table(point="corner", joint="joint3", position=(0.145, 0.5, 0.08))
    placed = with_places(arm, rows)
    assert [point.name for point in placed.points] == ["corner", "tip"]
    turn = np.radians(-15.0)
    expected = [0.145 * np.cos(turn) - 0.5 * np.sin(turn), 0.145 * np.sin(turn) + 0.5 * np.cos(turn), 0.08]
    np.testing.assert_allclose(np.asarray(at_posture(placed, np.array(POSTURE)).position)[:, 0], expected, atol=1e-12)
    assert with_places(arm, table()) is arm


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"point": "tp"}, "point: got 'tp', expected a point of LCD transfer arm, or joint and position"),
        ({"point": "a", "joint": "joint9", "position": (0, 0, 0)}, "joint: got 'joint9', expected a joint of LCD"),
        ({"joint": "joint3", "position": (0, 0, 0)}, "position: got a position of 'tip', expected none"),
        ({"load": Load(masses=((0.2, "corner"),))}, "load: got a load at 'corner', expected a point of LCD"),
        ({"load": Load(payloads=("glas",))}, "load: got 'glas', expected a payload of LCD transfer arm; did you mean"),
        ({"posture": (0.0,)}, "q1: got 1 joint angles, expected 3, as LCD transfer arm has"),
    ],
)
def test_what_the_arm_has_not_is_refused(arm, more, words):
    assert f"channels.csv:2, {words}" in refused(arm, **more)
