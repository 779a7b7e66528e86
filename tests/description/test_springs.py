"""Curved springs in an arm file: read with unit and origin, written back, refused in one line."""

import pytest
from arms import DATA

from ident.arm.parts import CubicSpring, Spring
from ident.description.file import parse_arm, parse_document, update_file
from ident.errors import InputError

SHIPPED = (DATA / "lcd_arm" / "arm.toml").read_text(encoding="utf-8")
SPRING = """
[[spring]]
name = "spring2"
joint = "joint2"
direction = "torsion"
ratio2 = { value = 1.4, origin = "datasheet" }
ratio3 = { value = 1.8, origin = "datasheet" }
torque1 = { value = 29000, unit = "N*mm", origin = "datasheet" }
torque2 = { value = 108, unit = "N*m", origin = "assumed" }
"""
CUBIC = """
[[cubic_spring]]
name = "rubber"
joint = "joint1"
direction = "bending"
cubic = { value = 1e7, unit = "N*m/rad^3", origin = "measured" }
"""


def test_springs_are_read_with_their_origins():
    document = parse_document(SHIPPED + SPRING + CUBIC)
    arm, origins = document.arm, document.origins()
    broken, cubic = arm.springs
    assert isinstance(broken, Spring)
    assert isinstance(cubic, CubicSpring)
    assert (broken.joint, broken.direction, cubic.direction) == ("joint2", "torsion", "bending")
    numbers = {path: float(arm.get(path)) for path in arm.paths() if path.startswith(("spring2", "rubber"))}
    assert numbers == pytest.approx(
        {
            "spring2.ratio2": 1.4,
            "spring2.ratio3": 1.8,
            "spring2.torque1": 29.0,
            "spring2.torque2": 108.0,
            "rubber.cubic": 1e7,
        }
    )
    assert {path: origins[path] for path in numbers} == dict.fromkeys(numbers, "datasheet") | {
        "spring2.torque2": "assumed",
        "rubber.cubic": "measured",
    }


def test_other_numbers_are_written_in_the_units_of_the_file():
    text = update_file(SHIPPED + SPRING, {"spring2.torque1": 31.5, "spring2.ratio3": 2.0}, origin="calibrated")
    assert "31500" in text
    arm = parse_arm(text)
    assert float(arm.get("spring2.torque1")) == pytest.approx(31.5)
    assert float(arm.get("spring2.ratio3")) == 2.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"joint2"', '"joint7"', "'joint7'"),
        ('"torsion"', '"twist"', "'bending' or 'torsion'"),
        ("29000", "290000", "T2 = 108 N m"),
        ("1.4", "0.0", "> 0"),
        ('unit = "N*mm"', 'unit = "N*mm/deg"', "a unit such as N\\*m"),
        ('ratio3 = { value = 1.8, origin = "datasheet" }\n', "", "ratio3"),
        ('ratio2 = { value = 1.4, origin = "datasheet" }', "ratio2 = 1.4", "a table"),
        ('ratio2 = { value = 1.4, origin = "datasheet" }', "k2 = 1.4", "unknown key 'k2'"),
    ],
)
def test_a_spring_that_cannot_be_is_refused_in_lines_that_say_where(old, new, words):
    assert old in SPRING
    with pytest.raises(InputError, match=words) as refused:
        parse_arm(SHIPPED + SPRING.replace(old, new))
    first = SHIPPED.count("\n") + 1
    assert all(first < int(problem.where.rpartition(":")[2]) for problem in refused.value.problems)


def test_two_springs_of_one_bushing_are_refused():
    with pytest.raises(InputError, match="a second spring of joint2 in torsion"):
        parse_arm(SHIPPED + SPRING + SPRING.replace("spring2", "spring3"))
