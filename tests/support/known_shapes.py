"""Campaigns of frequencies and shapes of the paper's arm, as the arm itself has them."""

from dataclasses import replace

import numpy as np
from arms import lcd_arm

from ident.arm.parts import Point
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Measurement

SKEW = (0.5, -1.2, 0.9)
CROSSING = (1.0855, -1.871, 1.0855)
"""[rad] where the two lowest modes are 5 % apart, as with the last joint turned out of line they repel each other."""
AXES = np.eye(3)
SD = 0.01


def with_elbow():
    arm = lcd_arm()
    return replace(arm, points=(Point("elbow", arm.joints[2].name, (0.5, 0.1, 0.0)), *arm.points))


def rows(arm, posture, modes=4):
    """The ratios of a posture's modes as the arm has them, with their frequencies."""
    known, found = modal_analysis(arm, posture, modes=modes), []
    names = [point.name for point in arm.points]
    for i, label in enumerate(map(str, known.labels)):
        hertz = float(known.modes.frequency[i])
        found.append(Measurement(kind="frequency", posture=posture, value=hertz, sigma=0.005 * hertz, mode=label))
        moved = np.asarray(known.modes.motion)[:, :, i]
        axis, point = np.unravel_index(np.argmax(np.abs(moved)), moved.shape)
        for p, name in enumerate(names):
            for d in range(3):
                if (d, p) != (axis, point):
                    found.append(
                        Measurement(
                            kind="shape",
                            posture=posture,
                            value=float(moved[d, p] / moved[axis, point]),
                            sigma=SD,
                            mode=label,
                            point=name,
                            direction=tuple(AXES[d]),
                            reference_point=names[point],
                            reference_direction=tuple(AXES[axis]),
                        )
                    )
    return tuple(found)
