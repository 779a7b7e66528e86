"""Belts that can run along the stroke: by the equations of elastic belts, and by hand."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm
from conformance import agrees

from ident.arm.belts import belt_mismatches
from ident.arm.multibody import multibody, stretch
from ident.description.file import read_arm, update_file

DIRECTION = np.array([1.0, -2.0, 1.0])
FIRST_GUESS = {
    "belt1.driver_radius": 0.06,
    "belt1.driven_radius": 0.03,
    "belt2.driver_radius": 0.03,
    "belt2.driven_radius": 0.06,
    "stroke.folded": np.radians(80.0),
}


def arm_of(*ratios, **changes):
    return lcd_arm().replace(FIRST_GUESS | {f"drive{j}.ratio": n for j, n in enumerate(ratios, 1)} | changes)


def stretches(arm):
    return {each.belt: each.stretch for each in belt_mismatches(arm)}


def test_drives_that_turn_alike_would_stretch_the_belts_by_metres():
    """The driver turns 119 times seen from the link, at 60 mm; the driven one 240 times the other way, at 30 mm."""
    found = stretches(arm_of(120, 120, 120))
    expected, source = (0.06 * 119 + 0.03 * 240) * np.radians(80), "turns of both pulleys, by hand"
    agrees(found["belt1"], expected, "mechanics", "stretch of a belt that cannot run", source, rtol=1e-6, unit="m")
    assert found["belt1"] == pytest.approx(20.02, abs=0.005)
    assert found["belt2"] == pytest.approx((0.03 * 238 + 0.06 * 120) * np.radians(80))


def test_drive_2_reversed_leaves_84_mm():
    found = stretches(arm_of(120, -120, 120))
    assert found == {"belt1": pytest.approx(0.06 * np.radians(80)), "belt2": pytest.approx(0.06 * np.radians(80))}


@pytest.mark.parametrize("ratios", [(161, -160, 161), (-160, 161, -160), (81, -80, 81)])
def test_one_drive_mounted_both_ways_lets_belts_of_two_to_one_run(ratios):
    """A drive of ratio N turns N + 1 times with its circular spline as output, -N times with its flexspline."""
    assert belt_mismatches(arm_of(*ratios, **{"belt1.stiffness": 1e15, "belt2.stiffness": 1e15})) == ()


@pytest.mark.parametrize("ratios", [(120, 120, 120), (120, -120, 120), (50, -70, -30)])
def test_it_is_the_stretch_of_elastic_belts_whose_pins_move_along_the_stroke(ratios):
    arm, alpha = arm_of(*ratios), 1e-3
    model = multibody(arm, elastic_belts=True)
    e = np.asarray(eqx.filter_jit(stretch)(model, jnp.zeros((3, 3)), jnp.asarray(alpha * DIRECTION), jnp.zeros(3)))
    np.testing.assert_allclose(e[0], -e[1], rtol=1e-9)
    longer = np.abs(e[0]) * np.radians(80) / alpha
    found, source = list(stretches(arm).values()), "equations of elastic belts, pins moved along the stroke"
    agrees(found, longer, "mechanics", "stretch of a belt over the stroke", source, rtol=1e-9, unit="m")


def test_the_remedies_that_it_names_let_the_belt_run():
    arm = arm_of(120, -120, 120)
    first = belt_mismatches(arm)[0]
    source = "a belt of two to one, by hand"
    agrees(first.ratio, -119, "mechanics", "ratio with which a belt runs", source, rtol=1e-6)
    assert "belt1" not in stretches(arm.replace({f"{first.drive}.ratio": first.ratio}))
    assert "belt1" not in stretches(arm.replace({"belt1.driven_radius": first.radius}))
    other_way = belt_mismatches(arm_of(120, 120, 120))[0]
    assert other_way.radius < 0
    assert "driven_radius" not in str(other_way)


def test_pretension_takes_up_a_small_mismatch():
    """0.06 m a radian over 1 degree is 1.05 mm, within the 1.25 mm by which 500 N stretch a span of 4e5 N/m."""
    short = {"stroke.folded": np.radians(1.0)}
    assert belt_mismatches(arm_of(120, -120, 120, **short)) == ()
    assert len(belt_mismatches(arm_of(120, -120, 120, **short, **{"belt1.pretension": 400.0}))) == 1


def test_a_file_says_it_in_one_line(tmp_path):
    text = (DATA / "lcd_arm" / "arm.toml").read_text()
    (tmp_path / "arm.toml").write_text(update_file(text, {"drive2.ratio": 121}, origin="assumed"))
    lines = list(map(str, belt_mismatches(read_arm(tmp_path / "arm.toml").arm)))
    assert len(lines) == 2
    assert all("\n" not in line and "mm over the stroke" in line and "it runs with drive" in line for line in lines)
