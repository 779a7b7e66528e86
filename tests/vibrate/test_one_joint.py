"""An arm of one joint in motion: the fast method, the exact one and the sum over phases say the same.

Small enough for the quick tests; the paper's arm, other engines and the rates of errors are in the slow ones.
"""

from functools import cache

import numpy as np
from numpy.polynomial import Polynomial
from runs import along, off

from ident.arm.arm import Arm
from ident.arm.parts import Body, Drive, Joint, Point
from ident.vibrate.simulate import simulate, superposition

LINK = Body("link", 20.0, (0.5, 0.1, -0.1), np.diag([0.2, 1.0, 1.1]))
SHAFT = Body("shaft", 4.0, (0.0, 0.0, 0.05), np.diag([0.03, 0.03, 0.05]))
DRIVE = Drive("drive", "one", ratio=30.0, rotor_inertia=0.01, eccentric_mass=1.0, eccentricity=0.01, error=1e-4)
JOINT = Joint("one", k_bend=3e4, k_tors=1e4, tau_bend=1e-3, tau_tors=2e-3, shaft=(SHAFT,), link=(LINK,))
ARM = Arm("one joint", (JOINT,), (Point("tip", "one", (1.0, 0.0, 0.0)),), drives=(DRIVE,))
PHASES = "drive.phase", "drive.error_phase"
SWING = along(Polynomial([0, 0, 1.2, -0.8]), 1.0, (1,), (0.3,))
"""Half a turn a second at most: the imbalance passes the first frequencies."""


@cache
def shaken(method: str):
    return simulate(ARM.replace(dict(zip(PHASES, (0.4, 2.0), strict=True))), SWING, method=method, step=2e-3)


def test_the_fast_method_agrees_with_the_exact_equations():
    assert np.abs(shaken("exact").vibration).max() > 1e-3
    assert off(shaken("fast").vibration, shaken("exact").vibration) < 5e-4


def test_the_sum_over_phases_is_the_simulation_with_them():
    whole = superposition(ARM, SWING, PHASES, step=2e-3)
    assert off(whole.at(np.array([0.4, 2.0])), shaken("fast").vibration) < 1e-4
    peaks = whole.peaks(np.random.default_rng(0).uniform(0, 2 * np.pi, (2, 400)))
    assert (peaks <= whole.worst[:, None]).all()
    assert (peaks.max(1) > 0.99 * whole.worst).all()
    np.testing.assert_allclose(whole.division.sum(0), whole.worst, rtol=1e-12)
