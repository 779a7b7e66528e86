"""Transmission errors of a drive at orders of the file's choice: as data, in the equations, and what they excite."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA
from conformance import agrees
from driven_arms import random_state
from numpy.polynomial import Polynomial
from runs import along, vibration_at

from ident.arm.arm import Arm
from ident.arm.multibody import Command, Multibody, Turning, multibody, pins
from ident.arm.parts import Body, Drive, ErrorOrder, Joint, Point
from ident.description.file import parse_arm, parse_document, update_arm, update_file
from ident.errors import InputError
from ident.vibrate.branches import branches
from ident.vibrate.resonance import RATE, excitation, resonance_crossings
from ident.vibrate.simulate import simulate, superposition

SHIPPED = (DATA / "lcd_arm" / "arm.toml").read_text(encoding="utf-8")
DRIVE2 = SHIPPED.index("[[drive]]", SHIPPED.index('name = "drive1"'))
ONE, FOUR = (
    """
[[drive.errors]]
order = 1
amplitude = { value = 1.5, unit = "arcsec", origin = "measured" }
phase = { value = 30, unit = "deg", origin = "measured" }
""",
    """
[[drive.errors]]
order = 4
amplitude = { value = 1.0, unit = "arcsec", origin = "datasheet" }

""",
)
ARCSEC = np.deg2rad(1 / 3600)


def with_errors(*of_drive1: str) -> str:
    """The shipped arm file with some beneath its first drive."""
    return SHIPPED[:DRIVE2] + "".join(of_drive1) + SHIPPED[DRIVE2:]


@cache
def wavy() -> Arm:
    """Two joints, errors at orders 1, 2 and 4 of drive 1, at 2 and 4 of drive 2."""
    link = {"mass": 10.0, "com": (0.4, 0.0, 0.0), "inertia": np.diag([0.02, 0.5, 0.5])}
    joints = [
        Joint(f"joint{n}", offset=(0.8 * n - 0.8, 0, 0), k_bend=8e4, k_tors=6e4 / n, tau_bend=1e-3, tau_tors=1e-3,
              shaft=(Body(f"shaft{n}", 2.0),), link=(Body(f"link{n}", **link),))
        for n in (1, 2)
    ]  # fmt: skip
    errors = {"drive1": ((1, 3.0, 0.5), (4, 1.0, 0.0)), "drive2": ((4, 1.2, -2.0),)}
    numbers = {"eccentric_mass": 0.5, "eccentricity": 8e-3, "height": 0.05, "error": 3 * ARCSEC, "error_phase": 1.0}
    drives = [
        Drive(name, f"joint{n}", ratio=ratio, errors=tuple(
            ErrorOrder(name, order, amplitude=size * ARCSEC, phase=phase) for order, size, phase in errors[name]
        ), **numbers)
        for n, (name, ratio) in enumerate({"drive1": 100.0, "drive2": -80.0}.items(), 1)
    ]  # fmt: skip
    return Arm("wavy", joints, points=(Point("end", "joint2", (0.8, 0, 0)),), drives=drives)


MOTION = along(Polynomial([0.0, 0.0, 0.3, -0.1]), 1.5, direction=(1.0, -1.5), start=(0.0, 0.3))
"""Pulleys up to 5 Hz."""


def test_an_arm_file_has_them_and_keeps_them() -> None:
    document = parse_document(with_errors(ONE, FOUR))
    arm, origins = document.arm, document.origins()
    one, four = arm.drives[0].errors
    assert (one.name, one.order, four.name, four.order) == ("drive1_order1", 1, "drive1_order4", 4)
    paths = [f"drive1_order{end}" for end in ("1.amplitude", "1.phase", "4.amplitude", "4.phase")]
    assert [path for path in arm.paths() if "_order" in path] == paths == [p for p in origins if "_order" in p]
    assert [float(arm.get(path)) for path in paths] == pytest.approx([1.5 * ARCSEC, np.deg2rad(30), ARCSEC, 0])
    assert [origins[path] for path in paths] == ["measured", "measured", "datasheet", "assumed"]
    text = update_file(with_errors(ONE, FOUR), {paths[0]: 6 * ARCSEC}, origin="calibrated")
    assert 'value = 6.0, unit = "arcsec", origin = "calibrated"' in text
    changed = parse_arm(text).replace({paths[2]: 0.5 * ARCSEC})
    again = parse_arm(update_arm(text, changed, origin="derived")).numbers()
    assert {path: float(again[path]) for path in paths} == pytest.approx(
        {paths[0]: 6 * ARCSEC, paths[1]: np.deg2rad(30), paths[2]: 0.5 * ARCSEC, paths[3]: 0}, rel=1e-9
    )
    fraction = parse_arm(with_errors(FOUR.replace("4", "2.0125")))
    assert fraction.drives[0].errors[0].name == "drive1_order2p0125"
    assert float(fraction.get("drive1_order2p0125.amplitude")) == pytest.approx(ARCSEC)


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        *((FOUR.replace("4", order), f"got {order}, expected an order above 0") for order in ("0", "-1", "1001")),
        (FOUR.replace("4", "nan"), "expected a finite number"),
        (FOUR.replace("4", "2.0"), "got 2, expected another order"),
        (FOUR.replace("4", '"4"'), "expected a number"),
        (ONE + FOUR + ONE, "got order 1 a second time, expected each order once in a drive"),
        (FOUR.replace("order", "ordr"), "unknown key 'ordr'"),
        (FOUR.replace("1.0", "-1.0"), "amplitude.value: got -1.0, expected a number >= 0"),
    ],
)
def test_an_order_that_cannot_be_is_refused_at_its_line(errors: str, words: str) -> None:
    text = with_errors(errors)
    with pytest.raises(InputError) as caught:
        parse_document(text)
    problem = next(p for p in str(caught.value).splitlines() if words in p)
    line = int(problem.split(":")[1].split(",")[0])
    assert text.splitlines()[line - 1].startswith("amplitude" if "amplitude" in words else "ord")
    assert problem.count(";") >= 1  # with what to do


def turning(of: Multibody, state) -> list[jax.Array]:
    """Angles, rates and accelerations of the pins, their slopes and errors."""
    none = jnp.zeros(of.joints)
    return jax.tree.leaves(pins(of, Command(*(jnp.asarray(part) for part in state.command)), Turning(none, none, none)))


def test_order_2_of_the_sum_is_the_error() -> None:
    """Beside another order, in two halves, and in another place of the sum."""
    of, state = multibody(wavy()), random_state(np.random.default_rng(1), 2, 6)
    (A, *_), (chi, *_), nothing = of.drives.error, of.drives.error_phase, jnp.zeros(2)
    alone = replace(of, drives=replace(of.drives, orders=(2,), error=(A,), error_phase=(chi,)))
    summed = replace(of.drives, orders=(4, 2, 2), error=(nothing, A / 4, 3 * A / 4), error_phase=(nothing, chi, chi))
    for mine, other in zip(turning(replace(of, drives=summed), state), turning(alone, state), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-12)


@pytest.mark.slow
def test_the_fast_method_as_a_sum_over_phases_against_the_exact_method() -> None:
    phases = ("drive1_order1.phase", "drive2.phase", "drive1_order4.phase")
    given = np.array([2.0, -1.0, 0.7])
    arm = wavy().replace(dict(zip(phases, given, strict=True)))
    exact = np.asarray(simulate(arm, MOTION, method="exact", rate=RATE).vibration)
    whole = superposition(wavy(), MOTION, phases, rate=RATE)
    # measured: 7.3e-4
    what, source = "errors of several orders, sum over phases", "exact equations"
    agrees(vibration_at(whole, given), exact, "vibration", what, source, largest=1e-3, unit="m")
    assert (np.hypot(whole.cosine, whole.sine).max((1, 2)) > 0.03 * np.abs(exact).max()).all()
    assert whole.of_error.tolist() == [True, False, True]
    np.testing.assert_allclose(whole.division.sum(0), whole.worst, rtol=1e-12)


def test_resonance_lists_them() -> None:
    turning = excitation(wavy(), MOTION)
    assert [(s.drive, s.order) for s in turning.sources] == [
        *(("drive1", order) for order in (1, 2, 4)),
        *(("drive2", order) for order in (1, 2, 4)),
    ]
    near = resonance_crossings(branches(wavy(), MOTION), turning)
    assert {each.source.order for each in near} >= {2, 4}
    assert str(next(each.source for each in near if each.source.order == 4)).endswith(" x 4")
