"""What is said of motions along a path: times that add up, advice that works as it is printed."""

from types import SimpleNamespace

import numpy as np

from ident.studies.cure.motion_report import _candidates
from ident.studies.cure.motion_study import Candidate, MotionVerification
from ident.vibrate.motion import Motion


def candidate(arrival):
    motion = Motion("", np.array([0.0, arrival]), np.zeros((1, 1, 3)), arrival)
    checked = MotionVerification(4e-4, None)
    return Candidate(f"{arrival:g}", "speed", motion, np.full(5, 4e-4), 4e-4, 0.0, 1.0, (), None, checked)


def test_added_time_is_the_difference_of_the_times_beside_it():
    """3.14 and 4.46 s are printed as 3.1 and 4.5: 1.4 s apart, not the 1.32 s of unrounded times."""
    every = (candidate(3.14), candidate(4.46))
    table = _candidates(SimpleNamespace(candidates=every, recommended=None, limit=5e-4), every)
    assert [row[1:3] for row in table.texts] == [("3.1", "+0.0"), ("4.5", "+1.4")]
