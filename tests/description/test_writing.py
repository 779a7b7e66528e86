"""An arm written as TOML is read back as the same arm, whatever its numbers and words."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, random_arm
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.arm.arm import Arm
from ident.description.file import parse_arm, update_file
from ident.description.rewriting import arm_text, with_first
from ident.errors import InputError

WORDS = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=30)
SHIPPED = (DATA / "lcd_arm" / "arm.toml").read_text("utf-8")
ARM = parse_arm(SHIPPED)
FREE = sorted(
    path for path in ARM.numbers() if path.rpartition(".")[2] in ("k_bend", "k_tors", "tau_bend", "tau_tors", "error")
)


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 7), st.floats(1e-3, 1e9), st.booleans(), WORDS, WORDS)
def test_what_is_written_is_read_back(seed, joints, stiffness, limited, name, note):
    made = random_arm(np.random.default_rng(seed), joints)
    arm = Arm(name.strip() or "arm", tuple(_changed(j, stiffness, limited) for j in made.joints), made.points)
    text = arm_text(arm, origin="assumed", note=note, head=note)
    again = parse_arm(text)
    numbers, expected = again.numbers(), arm.numbers()
    assert set(numbers) == set(expected)
    for path, value in expected.items():
        np.testing.assert_allclose(numbers[path], value, rtol=1e-11, atol=2e-12, err_msg=path)
    for one, other in zip(again.joints, arm.joints, strict=True):
        np.testing.assert_allclose(one.limits, other.limits, rtol=1e-11)
        np.testing.assert_allclose(one.rates, other.rates, rtol=1e-11)


def _changed(joint, stiffness, limited):
    held = {"limits": (-1.5, 2.5), "rates": (1.5, 10.0, 99.0)} if limited else {}
    return replace(joint, k_bend=stiffness, k_tors=stiffness / 3, **held)


@settings(max_examples=15)
@given(st.dictionaries(st.sampled_from(FREE), st.floats(0.5, 2.0), max_size=8))
def test_a_file_whose_numbers_are_changed_keeps_all_others(factors):
    values = {path: float(ARM.get(path)) * factor for path, factor in factors.items()}
    numbers = parse_arm(update_file(SHIPPED, values, origin="calibrated")).numbers()
    for path, value in ARM.numbers().items():
        np.testing.assert_allclose(numbers[path], values.get(path, value), rtol=1e-11, err_msg=path)


def test_a_file_whose_joints_are_no_tables_has_no_place_for_a_base():
    with pytest.raises(InputError, match=r"arm\.toml: got joints that are no tables"):
        with_first("joint", 'joint = [{ name = "a" }]', "", "arm.toml")
