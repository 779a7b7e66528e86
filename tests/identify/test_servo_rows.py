"""Rows of a campaign that a servo held: what they predict, what is fitted to them, and what is said of them."""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from equinox import filter_jit
from one_program import shown
from scipy.linalg import eig

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import linearize
from ident.arm.parts import Servo
from ident.errors import InputError
from ident.identify.conditions import bind
from ident.identify.damping import ModesOfRows
from ident.identify.fit import CampaignFit, fit_campaign
from ident.identify.modal_analysis import modal_analysis
from ident.identify.padding import LARGE, in_parts
from ident.identify.predict import ArmModel
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, is_damping
from ident.measure import Campaign, Measurement
from ident.report.report import text_of
from ident.studies.stiffness.fit_report import fit_sections

sys.path.append(str(Path(__file__).parents[1] / "arm"))
from test_servo import held, matrices, with_servo

slow = pytest.mark.slow

UNFOLDED, BENT = (0.0, 0.0, 0.0), tuple(np.deg2rad([40.0, -80.0, 40.0]))
SERVO = 100.0
PLACES = {"lateral torsion 1": 0, "vertical bending 1": 1, "lateral torsion 2": 3, "lateral torsion 3": 4}
"""Places of the modes among those with the servo on, unfolded: the motor's own is lateral torsion 2 or 3."""


@cache
def arm() -> Arm:
    return replace(lcd_arm(), servos=(Servo("servo1", "joint1", k_servo=SERVO, tau=2e-3),))


def frequency(mode: str | None, posture=UNFOLDED, **more) -> Measurement:
    return Measurement(kind="frequency", posture=posture, value=4.0, sigma=0.01, mode=mode, **more)


OF_PLACES = [frequency(mode, drives=drives) for drives in ("servo", "brake") for mode in PLACES]
OF_CAMPAIGN = [
    frequency(mode, (posture[0] + 0.01, *posture[1:]), drives=drives, where=f"c.csv:{2 + 8 * i + 4 * k + j}")
    for i, posture in enumerate((UNFOLDED, BENT))
    for k, drives in enumerate(("brake", "servo"))
    for j, mode in enumerate(("lateral torsion 1", "vertical bending 1", "lateral torsion 2", "vertical bending 2"))
]


@cache
def predicted() -> tuple[np.ndarray, np.ndarray]:
    """What the arm shows in all these rows, in one program."""
    values = shown(arm(), Campaign(measurements=(*OF_PLACES, *OF_CAMPAIGN)))
    return values[:8], values[8:]


@filter_jit
def with_servo_on(arm: Arm, posture):
    return linearize(at_posture(arm, posture, None, jnp.ones(1)))


@cache
def reference(posture) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies with the servo on and with the brake on, by the equations of motion."""
    direction = np.asarray(arm().stroke.direction)
    system = matrices(arm(), direction, np.asarray(posture))
    return with_servo(system, SERVO * float(arm().drives[0].ratio) ** 2), held(system)


@slow
def test_each_row_has_the_modes_of_what_held_its_motors():
    on, off = reference(UNFOLDED)
    values = predicted()[0]
    source = "equations of motion, modes by SciPy"
    what = "frequencies of a campaign, servo on"
    agrees(values[:4], on[list(PLACES.values())], "modal", what, source, rtol=1e-9, unit="Hz")
    what = "frequencies of a campaign, brake on"
    agrees(values[4:7], off[[0, 1, 3]], "modal", what, source, rtol=1e-9, unit="Hz")
    lower, upper = values[[2, 3]] / off[3]
    assert lower == pytest.approx(15.29 / off[3], abs=1e-3)
    assert upper == pytest.approx(20.12 / off[3], abs=1e-3)


@slow
def test_without_a_label_they_are_counted_with_the_motors_own():
    rows = tuple(replace(frequency(None, BENT, drives="servo"), value=4.0 + i) for i in range(5))
    values = shown(arm(), Campaign(measurements=rows))
    np.testing.assert_allclose(values, reference(BENT)[0][:5], rtol=1e-9)


def test_an_arm_without_servos_has_them_held():
    """And predicts the same as with the brake on: `test_predict.py`."""
    assert bind(lcd_arm(), Campaign(measurements=tuple(OF_PLACES))).servo is None
    assert bind(arm(), Campaign(measurements=tuple(OF_PLACES[4:]))).servo is None
    assert bind(arm(), Campaign(measurements=tuple(OF_PLACES))).servo.tolist() == [1.0, 0.0]


@slow
def test_damping_ratios_contain_the_servo():
    system = with_servo_on(arm(), np.zeros((3, 1)))
    M, C, H = (np.asarray(x[..., 0]) for x in (system.M, system.C, system.H))
    n = len(M)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, H), -np.linalg.solve(M, C)]])
    s = eig(state, right=False)
    s = s[(s.imag > 0)]
    s = s[np.argmin(np.abs(np.abs(s) / (2 * np.pi) - reference(UNFOLDED)[0][3]))]
    ratio = Measurement(
        kind="damping_ratio", posture=UNFOLDED, value=0.05, sigma=0.01, mode="lateral torsion 2", drives="servo"
    )
    own = {path: float(arm().get(path)) for path in arm().paths() if is_damping(path)}
    (value,) = ModesOfRows.of(
        ArmModel(arm(), bind(arm(), Campaign(measurements=tuple(OF_PLACES)))), {}, [ratio], []
    ).poles(own)
    what, source = "damping ratio with a servo", "SciPy's eigenvalues of the state matrix"
    agrees(value, -s.real / abs(s), "modal", what, source, rtol=1e-8)
    assert value > 0.02


def test_modes_beyond_the_motors_are_refused():
    with pytest.raises(InputError, match="vertical bending 1"):
        pose(arm(), Campaign(measurements=(frequency("lateral 10"),)))
    pose(arm(), Campaign(measurements=(frequency("lateral 10", drives="servo"),)))
    rows = tuple(replace(frequency(None, drives="servo"), value=4.0 + i) for i in range(11))
    pose(arm(), Campaign(measurements=rows[:10]))
    with pytest.raises(InputError, match="at most 10"):
        pose(arm(), Campaign(measurements=rows))


def campaign() -> Campaign:
    """What the arm would show, with brake and with servo, but for 0.02 % of scatter."""
    scatter = 1 + 2e-4 * np.random.default_rng(3).standard_normal(len(OF_CAMPAIGN))
    rows = [
        replace(row, value=float(x), sigma=2e-4 * float(x))
        for row, x in zip(OF_CAMPAIGN, predicted()[1] * scatter, strict=True)
    ]
    return Campaign(measurements=tuple(rows))


@cache
def fitted() -> CampaignFit:
    start = arm().replace({"servo1.k_servo": 1.15 * SERVO, "joint1.k_tors": 1.1 * float(arm().get("joint1.k_tors"))})
    return fit_campaign(start, campaign(), Unknowns(free={"servo1.k_servo": 0.5}), starts=1)


@slow
def test_a_servo_is_fitted_with_the_stiffnesses():
    best = fitted().parameters
    for path in ("servo1.k_servo", "joint1.k_tors", "joint2.k_tors", "joint3.k_tors"):
        assert float(best[path]) == pytest.approx(float(arm().get(path)), rel=0.02), path
    assert not fitted().contradictory
    report = text_of(fit_sections(fitted()), details=True)
    assert "servo was on in" not in report
    assert "nan" not in report
    assert np.isfinite([item.test.shift for item in fitted().assumptions.items]).all()


@slow
def test_large_campaigns_keep_what_held_the_motors_and_what_is_measured():
    rows = [
        replace(
            frequency("lateral torsion 1" if i % 2 else None, (1e-3 * i, -2e-3 * i, 1e-3 * i)),
            drives="servo" if i % 3 == 0 else "brake",
            of="pole" if i % 5 == 0 else "undamped",
        )
        for i in range(LARGE + 1)
    ]
    whole = bind(arm(), Campaign(measurements=tuple(rows)))
    parts = in_parts(whole)
    definitions = np.asarray(whole.definitions)
    for part, values in zip(parts.conditions, parts.values, strict=True):
        frequencies = np.concatenate([np.asarray(part.named.states), np.asarray(part.unnamed.states)])
        np.testing.assert_allclose(part.definitions, definitions[values[: len(frequencies)]])
        states = np.concatenate([np.asarray(whole.named.states), np.asarray(whole.unnamed.states)])[values]
        np.testing.assert_allclose(part.servo[frequencies], np.asarray(whole.servo)[states[: len(frequencies)]])


@slow
def test_modes_with_the_servo_on_are_shown_with_their_names():
    """The motor's own mode moves the tip as the pins turn: its line is that of the arm between bushings and pins."""
    analysis = modal_analysis(arm(), UNFOLDED, modes=10, drives="servo")
    np.testing.assert_allclose(analysis.modes.frequency, reference(UNFOLDED)[0], rtol=1e-9)
    labels = [str(label) for label in analysis.labels]
    assert {name: labels[place] for name, place in PLACES.items()} == {name: name for name in PLACES}
    line, displacement = analysis.outline
    np.testing.assert_allclose(displacement[:, -1], analysis.modes.motion[:, -1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(line[:, -1], modal_analysis(lcd_arm(), UNFOLDED, modes=9).outline[0][:, -1], rtol=1e-12)
    with pytest.raises(InputError, match="drives: got servo, expected brake"):
        modal_analysis(lcd_arm(), UNFOLDED, drives="servo")
