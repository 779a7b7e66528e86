"""Loads along the axes of a body: against the same loads, turned into the base frame by SciPy."""

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from one_program import predicted
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.identify.binding import loads_of
from ident.identify.problem import pose
from ident.measure import Campaign, Load, Measurement

POSTURE = (0.4, -1.1, 0.3)
TEXTS = ["30 N x of bracket @ tip", "30 N 0 0.6 -0.8 of fingers @ tip", "25 N*m about x of link2 @ tip"]
TURNS = {"bracket": 3, "fingers": 3, "link2": 2}
"""Pins that turn a body, all about z."""


def moved(load: Load) -> np.ndarray:
    """Return how the tip moves under a load."""
    rows = tuple(
        Measurement(
            kind="deflection_difference", posture=POSTURE, value=0.0, sigma=1.0, point="tip", direction=d, load=load
        )
        for d in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    )
    problem = pose(lcd_arm(), Campaign(measurements=rows)).problem
    return predicted(problem, problem.parameters.theta(problem.parameters.column("start")))


@pytest.mark.parametrize("text", TEXTS)
def test_a_load_along_a_bodys_axes_is_one_along_the_turned_axes(text):
    load = Load.parse(text)
    ((kind, vector, point, body),) = load.own
    turn = Rotation.from_euler("z", sum(POSTURE[: TURNS[body]]))
    turned = (tuple(turn.apply(vector)), point)
    base = Load(forces=(turned,)) if kind == "force" else Load(moments=(turned,))
    what, source = "deflection by loads along a body's axes", "the load turned by SciPy's Rotation"
    agrees(moved(load), moved(base), "statics", what, source, rtol=1e-12, atol=1e-15, unit="m")


def test_it_is_written_as_it_is_read_and_terms_add_up():
    load = Load.parse("10 N x of hand @ tip + 20 N x of hand @ tip + 3 N y @ tip + 2 kg @ elbow")
    assert load.own == (("force", (30.0, 0.0, 0.0), "tip", "hand"),)
    assert Load.parse(str(load)) == load
    assert "30 N x of hand @ tip" in str(load)


@pytest.mark.parametrize("text", ["30 N x of nobody @ tip", "30 N of hand @ tip", "30 N x of @ tip"])
def test_what_is_no_body_is_refused_in_one_line(text):
    with pytest.raises(InputError) as refused:
        moved(Load.parse(text))
    assert {str(problem).count("\n") for problem in refused.value.problems} == {0}


def test_in_motion_it_is_refused():
    """As the arm moves, the body turns."""
    with pytest.raises(InputError, match="give it in the base frame"):
        loads_of(lcd_arm(), Load.parse(TEXTS[0]))
