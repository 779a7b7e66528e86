"""Unknowns: names, transforms, ties, and what is refused."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm

from ident.errors import InputError
from ident.identify.unknowns import Unknowns, parameter, stiffness_parameters


def test_six_stiffnesses_by_default_and_there_and_back():
    parameters = stiffness_parameters(lcd_arm())
    assert parameters.names == tuple(f"joint{j}.{k}" for k in ("k_bend", "k_tors") for j in (1, 2, 3))
    values = parameters.column("start") * 3.0
    np.testing.assert_allclose(parameters.values(parameters.theta(values)), values, rtol=1e-14)


def test_a_length_is_not_fitted_as_a_logarithm():
    parameters = stiffness_parameters(lcd_arm(), Unknowns(free={"joint2.offset.y": 0.01}))
    values = jnp.asarray(parameters.column("start")).at[-1].set(-0.02)
    theta = parameters.theta(values)
    assert theta[-1] == pytest.approx(-2.0)
    np.testing.assert_allclose(parameters.values(theta), values, rtol=1e-14)
    assert float(parameters.items[-1].prior_sd) == pytest.approx(1.0)


def test_batches_of_theta():
    parameters = stiffness_parameters(lcd_arm())
    theta = jnp.arange(12.0).reshape(6, 2)
    np.testing.assert_allclose(parameters.values(theta)[:, 1], parameters.values(theta[:, 1]))


def test_fixed_and_tied():
    parameters = stiffness_parameters(
        lcd_arm(), Unknowns(fixed=("joint1.k_bend",), tied=(("joint2.k_tors", "joint3.k_tors"),))
    )
    assert parameters.names == ("joint2.k_bend", "joint3.k_bend", "joint1.k_tors", "joint2.k_tors")
    by_path = parameters.by_path(jnp.arange(1.0, 5.0))
    assert by_path["joint3.k_tors"] == by_path["joint2.k_tors"] == 4.0


def test_a_tie_with_a_freed_mass_frees_the_group():
    parameters = stiffness_parameters(
        lcd_arm(), Unknowns(free={"link2.mass": 0.1}, tied=(("link1.mass", "link2.mass"),))
    )
    assert parameters.items[-1].paths == ("link1.mass", "link2.mass")
    assert float(parameters.items[-1].prior_sd) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"fixed": ("joint1.k_bendy",)}, "did you mean joint1.k_bend"),
        ({"free": {"link9.mass": 0.1}}, "link9.mass"),
        ({"tied": (("joint1.k_bend", "joint4.k_bend"),)}, "joint4.k_bend"),
        ({"tied": (("joint1.k_bend", "joint2.k_bend"),), "fixed": ("joint1.k_bend",)}, "twice"),
        ({"tied": (("link1.mass", "link2.mass"),)}, "at least one unknown"),
        ({"prior_sd": 0.0}, "a width from 1e-06"),
        ({"prior_sd": math.nan}, "a width from 1e-06"),
        ({"fixed": tuple(f"joint{j}.{k}" for k in ("k_bend", "k_tors") for j in (1, 2, 3))}, "no unknown"),
    ],
)
def test_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        stiffness_parameters(lcd_arm(), Unknowns(**arguments))


def test_a_positive_quantity_that_is_zero_is_refused():
    with pytest.raises(InputError, match="value > 0"):
        parameter(lcd_arm(), "joint1.k_bend", start=0.0)
