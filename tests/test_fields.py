"""What a number of the arm is, said once: every field, before every reader of it."""

import math
import re
from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from pydantic import TypeAdapter, ValidationError

from ident.arm.arm import Arm, check_drives
from ident.arm.fields import FIELDS, LOSS, field_of, fields_in
from ident.arm.parts import (
    Belt,
    Body,
    CubicSpring,
    Drive,
    ErrorOrder,
    Joint,
    MassDamping,
    Point,
    Servo,
    Spring,
    Stroke,
)
from ident.description import schema
from ident.errors import InputError
from ident.identify.unknowns import parameter
from ident.report.words import is_length, parameter_in_words, read_unit, unit_of, value_in_words
from ident.studies.shared import ArmOptions
from ident.studies.working.sweep_report import axis_in_words
from ident.units import stiffness_in
from ident.vibrate.sweep import Axis, changeable
from ident.vibrate.variable import Variable, apply, check, is_shifted

CLASSES = {
    part.__name__: part
    for part in (Body, Joint, Point, Drive, ErrorOrder, Belt, Servo, Spring, CubicSpring, Stroke, MassDamping)
}
TABLES = {part: getattr(schema, f"{part.replace('Mass', 'Arm')}Table") for part in CLASSES}
RANKS = {"()": 0, "(3,)": 1, "(3, 3)": 2}
EITHER_SIGN = {"com", "offset", "position", "height", "phase", "error_phase", "folded", "unfolded"}
NEVER_ZERO = {"k_bend", "k_tors", "driver_radius", "driven_radius", "speed", "acceleration", "jerk", "k_servo"}
NEVER_ZERO |= {"ratio2", "ratio3", "torque1", "torque2"}
BY_A_DIFFERENCE = EITHER_SIGN | {"inertia"}
ASKED = {"mass", "com", "k_bend", "k_tors", "tau_bend", "tau_tors", "eccentricity", "ratio"}

VALUES = (-0.01, 0.0, 0.01)

every_field = pytest.mark.parametrize("field", FIELDS, ids=lambda field: f"{field.part}.{field.name}")


@cache
def whole_arm() -> Arm:
    """The shipped arm with all that it has not: a servo, other damping, curved springs, errors of another order."""
    loss = {name: jnp.array(0.01) for name in LOSS}
    lossy = tuple(replace(joint, **loss) for joint in lcd_arm().joints[:2])
    springs = (
        Spring("spring3", "joint3", "bending", ratio2=1.5, ratio3=2.0, torque1=100.0, torque2=1e4),
        CubicSpring("cubic3", "joint3", "torsion", 1e6),
    )
    joints, servos = (*lossy, lcd_arm().joints[2]), (Servo("servo1", "joint1", k_servo=100.0),)
    drives = tuple(replace(drive, errors=(ErrorOrder(drive.name, 4, amplitude=1e-5),)) for drive in lcd_arm().drives)
    more = {"servos": servos, "springs": springs, "damping": MassDamping(alpha=0.1)}
    return replace(lcd_arm(), joints=joints, drives=drives, **more)


def possible(name: str) -> set[float]:
    """Of -0.01, 0 and 0.01 those that a number can be, by what it is in the docstrings of the parts."""
    if name == "ratio":
        return {-0.01, 0.01}
    return {0.01} | (set() if name in NEVER_ZERO else {0.0}) | ({-0.01} if name in EITHER_SIGN else set())


def path_of(field) -> str:
    """A path of the shipped arm to a number of this field."""
    names = {type(part).__name__: part.name for part in whole_arm().parts()} | {"Joint": "joint2", "Drive": "drive2"}
    return f"{names[field.part]}.{field.name}{list(field.ends)[-1]}"


def accepts(call, *values: float) -> set[float]:
    """The values that a call takes."""

    def taken(value: float) -> bool:
        try:
            call(value)
        except (InputError, ValidationError):
            return False
        return True

    return {value for value in values or VALUES if taken(value)}


def given(field, value: float) -> dict:
    """The number as an arm file has it."""
    number = {"value": [value] * 3 if field.rank else value, "origin": "assumed"}
    return number if field.unit == "-" else number | {"unit": field.unit.replace(" ", "*")}


def test_every_number_of_an_arm_is_a_field_and_every_field_a_number():
    arm = whole_arm()
    paths = {f"{part.name}.{field.name}{end}" for part in arm.parts() for field in fields_in(part)
             for end in field.ends}  # fmt: skip
    assert set(arm.paths()) == paths == set(arm.numbers())
    for part in arm.parts():
        arrays = {name for name, value in vars(part).items() if hasattr(value, "shape")}
        assert {field.name for field in fields_in(part)} == arrays - {"axis", "direction"}
    assert {field for part in arm.parts() for field in fields_in(part)} == set(FIELDS)


@every_field
def test_unit_and_rank_are_those_of_the_docstring(field):
    text = CLASSES[field.part].__doc__
    shape, unit = re.search(rf"^ +{field.name}: (\([^)]*\)) \[([^\]]+)\]", text, re.MULTILINE).groups()
    assert (RANKS[shape], unit) == (field.rank, field.unit)
    assert unit_of(path_of(field)) == field.unit
    value = whole_arm().replace({path_of(field): 0.5}).get(path_of(field))
    assert np.shape(value) == ()


@every_field
def test_fields_of_one_name_are_alike(field):
    like = [f for f in FIELDS if f.name == field.name]
    assert len({(f.unit, f.sign, f.logarithmic, f.rank, f.words, f.read_unit) for f in like}) == 1
    assert field_of(f"anything.{field.name}").name == field.name


@every_field
def test_the_arm_file_accepts_what_a_number_can_be(field):
    kind = TypeAdapter(TABLES[field.part].model_fields[field.name].annotation)
    if field.name != "inertia":  # which a body's mass and shape bound as well
        assert accepts(lambda value: kind.validate_python(given(field, value))) == possible(field.name)
    if field.unit != "-":
        with pytest.raises(ValidationError, match="'K'"):
            kind.validate_python(given(field, 0.01) | {"unit": "K"})


@every_field
def test_an_arm_is_refused_what_a_number_cannot_be(field):
    if field.part not in ("Drive", "ErrorOrder", "Belt", "Servo", "Stroke"):
        return
    named = {value: impossible(whole_arm().replace({path_of(field): value})) for value in VALUES}
    assert {value for value in VALUES if field.name not in named[value]} == possible(field.name)


def impossible(arm: Arm) -> list[str]:
    """The numbers that are refused for what they are, not for how they go with others."""
    try:
        check_drives(arm)
    except InputError as error:
        return [problem.column for problem in error.problems if "value" in problem.expected]
    return []


@every_field
def test_the_command_line_sets_what_a_number_can_be(field):
    assert accepts(lambda value: ArmOptions(set={path_of(field): float(value)})) == possible(field.name)


@every_field
def test_fit_and_redesign_vary_it_alike(field):
    path = path_of(field)
    arm = whole_arm().replace({path: 0.25})
    assert field.logarithmic == (field.name not in BY_A_DIFFERENCE)
    assert parameter(arm, path).positive == field.logarithmic
    variable = Variable((path,), 0.125, 0.5)
    assert variable.shifted == is_shifted(path) == (not field.logarithmic)
    expected = (-0.125, 0.25) if variable.shifted else (-math.log(2), math.log(2))
    np.testing.assert_allclose(variable.span(arm), expected, rtol=1e-12)
    at_zero = {0.0} if variable.shifted else set()
    assert accepts(lambda value: parameter(arm.replace({path: value}), path), 0.0) == at_zero
    if field.part != "Stroke":  # another stroke is another motion
        assert accepts(lambda value: check(arm.replace({path: value}), Variable((path,), -1.0, 1.0)), 0.0) == at_zero


def test_what_a_redesign_asks_for_unless_it_is_told():
    asked = {field_of(path).name for path in changeable(lcd_arm())}
    assert asked == ASKED
    assert not any(path.startswith("glass") for path in changeable(lcd_arm()))


@every_field
def test_words_and_units_that_people_read(field):
    path = path_of(field)
    size, unit = read_unit(path)
    if field.name in ("k_bend", "k_tors"):
        assert (size, unit) == (1.0, "N m/rad")
        with stiffness_in("N mm/deg"):
            size, unit = read_unit(path)
            assert (round(size, 10), unit) == (0.0572957795, "N mm/deg")
            assert value_in_words(path, 1.0) == "17.45 N mm/deg"
    else:
        assert (size, unit) == ((1e-3, "mm") if field.unit == "m" else (1.0, field.unit))
        assert value_in_words(path, 1.0) == f"1 {field.unit}".removesuffix(" -")
    assert is_length(path) == (field.unit == "m")
    assert axis_in_words(Axis((path,), np.array([1.0, 2.0]), 1.0)).startswith(path)


def test_words_of_what_is_fitted_and_swept_most():
    names = {"joint1.k_tors": "torsion of joint1", "joint1.tau_bend": "bending damping of joint1"}
    names |= {"link1.mass": "mass of link1", "link1.com.x": "link1.com.x"}
    assert {path: parameter_in_words(parameter(lcd_arm(), path)) for path in names} == names
    titles = {"joint1.k_tors": "joint1.k_tors, torsional stiffness of joint1", "link1.mass": "link1.mass"}
    titles |= {"link1.com.x": "link1.com.x, mass centre of link1, x", "speed": "speed, percent of full speed"}
    assert {path: axis_in_words(Axis((path,), np.array([1.0, 2.0]), 1.0)) for path in titles} == titles
    assert (unit_of("speed"), unit_of("stroke.speed"), unit_of("discrepancy.frequency")) == ("%", "rad/s", "-")


def test_a_ratio_of_either_sign_is_changed_by_a_factor():
    arm = lcd_arm().replace({"drive1.ratio": -120.0})
    variable = Variable(("drive1.ratio",), -240.0, -60.0)
    check(arm, variable)
    np.testing.assert_allclose(variable.span(arm), (-math.log(2), math.log(2)), rtol=1e-12)
    after = apply({"drive1.ratio": arm.get("drive1.ratio")}, [variable], [np.array(math.log(2))])
    assert float(after["drive1.ratio"]) == pytest.approx(-240)
    with pytest.raises(InputError, match="bounds below 0"):
        check(arm, Variable(("drive1.ratio",), -240.0, 60.0))
    with pytest.raises(InputError, match="bounds above 0"):
        check(lcd_arm(), Variable(("drive1.ratio",), -240.0, 240.0))
