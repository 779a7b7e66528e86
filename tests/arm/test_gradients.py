"""Every gradient, forward and reverse, against central differences; also where frequencies repeat and cross."""

from collections.abc import Callable
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm, two_equal_arm
from jaxtyping import Array
from scipy.optimize import brentq

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection
from ident.arm.modes import damped_eigenvalues, linearize, modes, natural_frequencies

pytestmark = pytest.mark.slow

FOURTH_ORDER = {1: 2 / 3, 2: -1 / 12}
"""Weights of the central difference that is exact for polynomials of degree four."""
STEP = 1e-3
"""Relative change of a parameter: cut-off near STEP^4/30, rounding of f 1e-13/STEP."""


def case() -> tuple[Arm, Array, tuple[str, ...]]:
    """A random arm, more general than the paper's: any axes, a joint that is not driven."""
    rng = np.random.default_rng(5)
    arm = random_arm(rng, 3, undriven=(1,))
    paths = (
        *("j0.k_bend", "j1.k_tors", "j2.k_bend", "j0.tau_bend", "j2.tau_tors"),
        *("link1.mass", "shaft0.com.x", "motor1.com.y", "j1.offset.z", "j2.offset.x", "link2.inertia.xx"),
    )
    return arm, posture_of(arm, rng), paths


def quantities(arm: Arm, posture: Array, paths: tuple[str, ...], scale: Array) -> dict[str, Array]:
    """What an arm shows, as a function of factors on its parameters."""
    old = jnp.stack([arm.get(path) for path in paths])
    chain = at_posture(arm.replace(dict(zip(paths, old * scale, strict=True))), posture)
    system = linearize(chain)
    s = damped_eigenvalues(system)
    return {
        "frequency": natural_frequencies(chain, 4),
        "deflection": deflection(chain, system.phi)[:, -1],
        "damped": jnp.abs(s),
        "damping ratio": -s.real / jnp.abs(s),
    }


def differences(f: Callable[[Array], dict[str, Array]], at: Array) -> dict[str, Array]:
    """Jacobian by central differences."""

    def column(e: np.ndarray) -> dict[str, Array]:
        terms = [
            jax.tree.map(lambda a, b, w=w: w * (a - b) / STEP, f(at + n * STEP * e), f(at - n * STEP * e))
            for n, w in FOURTH_ORDER.items()
        ]
        return jax.tree.map(lambda *x: sum(x), *terms)

    return jax.tree.map(lambda *x: jnp.stack(x, -1), *(column(e) for e in np.eye(len(at))))


@cache
def reference() -> tuple[Callable[[Array], dict[str, Array]], Array, dict[str, Array]]:
    arm, posture, paths = case()
    f, at = partial(quantities, arm, posture, paths), jnp.ones(len(paths))
    return f, at, differences(jax.jit(f), at)


@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_gradients(mode: str) -> None:
    """Each row to 1e-8 of its largest entry."""
    f, at, expected = reference()
    jacobian = jax.jit({"fwd": jax.jacfwd, "rev": jax.jacrev}[mode](f))(at)
    for name, rows in expected.items():
        size = jnp.abs(rows).max(1, keepdims=True) + 1e-12
        assert (jnp.abs(jacobian[name] - rows) / size).max() < 1e-8, name


# repeated frequencies: the lower bending pair of a column of bodies of revolution


REPEATED_PATHS = (
    *("lower.k_bend", "upper.k_bend", "body_upper.mass", "body_upper.com.z", "upper.offset.z"),
    *("body_upper.inertia.xx", "body_lower.inertia.yy"),
)


def column_frequencies(scale: Array) -> Array:
    arm = two_equal_arm()
    old = jnp.stack([arm.get(path) for path in REPEATED_PATHS])
    arm = arm.replace(dict(zip(REPEATED_PATHS, old * scale, strict=True)))
    return natural_frequencies(at_posture(arm, jnp.zeros(2)), 6)


def pairs() -> list[tuple[int, int]]:
    found = np.asarray(jax.jit(column_frequencies)(jnp.ones(len(REPEATED_PATHS))))
    return [(i, i + 1) for i in range(5) if abs(found[i + 1] / found[i] - 1) < 1e-12]


def test_the_column_has_two_repeated_frequencies() -> None:
    assert len(pairs()) == 2


@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_gradient_at_repeated_frequencies(mode: str) -> None:
    """Finite; the sum over a pair is smooth, and right, though each one's share depends on the basis."""
    at = jnp.ones(len(REPEATED_PATHS))
    jacobian = jax.jit({"fwd": jax.jacfwd, "rev": jax.jacrev}[mode](column_frequencies))(at)
    assert np.isfinite(jacobian).all()
    cluster = np.array(pairs())
    expected = differences(jax.jit(lambda s: {"sum": column_frequencies(s)[cluster].sum(1)}), at)["sum"]
    ours = jacobian[cluster].sum(1)
    assert jnp.abs(ours - expected).max() < 1e-8 * jnp.abs(expected).max()


@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_deflection_gradient_is_finite_at_zero_deflection(mode: str) -> None:
    """The column stands straight: phi = 0, where careless rotation formulas divide by zero."""

    def tip(k: Array) -> Array:
        chain = at_posture(two_equal_arm().replace({"lower.k_bend": k}), jnp.zeros(2))
        return deflection(chain, linearize(chain).phi)

    slope = jax.jit({"fwd": jax.jacfwd, "rev": jax.jacrev}[mode](tip))(8e3)
    assert jnp.abs(slope).max() == 0


# a crossing: torsion 1 and bending 1 of the LCD arm, unfolded, as the stiffness of joint 1 in torsion varies


def lcd_frequencies(k: Array) -> Array:
    return natural_frequencies(at_posture(lcd_arm().replace({"joint1.k_tors": k}), jnp.zeros(3)), 2)


@cache
def crossing() -> float:
    """The stiffness at which the two lowest frequencies meet, found by their labels' motion."""
    arm = lcd_arm()  # read before anything is traced

    @jax.jit
    def gap(k: Array) -> Array:
        found = modes(at_posture(arm.replace({"joint1.k_tors": k}), jnp.zeros(3)), 2)
        vertical = jnp.abs(found.motion[2, -1]) > jnp.abs(found.motion[1, -1])
        return jnp.where(vertical, found.frequency, -found.frequency).sum()

    return brentq(gap, 2e5, 2e6, xtol=1e-9, rtol=1e-15)


def test_gradient_at_a_crossing() -> None:
    """The sum is smooth. Each branch, taken by what it is on both sides, has the slope found on either side."""
    at = crossing()
    values, slope = (np.asarray(jax.jit(f)(at)) for f in (lcd_frequencies, jax.jacfwd(lcd_frequencies)))
    assert abs(values[1] / values[0] - 1) < 1e-9
    assert np.isfinite(slope).all()
    assert np.allclose(slope, jax.jit(jax.jacrev(lcd_frequencies))(at), rtol=1e-9, atol=1e-18)
    f, h = jax.jit(lcd_frequencies), 1e-3 * at
    by_differences = sum(w * (f(at + n * h) - f(at - n * h)).sum() / h for n, w in FOURTH_ORDER.items())
    assert slope.sum() == pytest.approx(float(by_differences), rel=1e-8)


def test_branches_swap_at_the_crossing() -> None:
    """Bending does not feel joint 1 in torsion: its slope is zero, as second before and as first after."""
    at, slope = crossing(), jax.jit(jax.jacfwd(lcd_frequencies))
    before, after = (np.asarray(slope(at * factor)) for factor in (0.99, 1.01))
    assert abs(before[1] / before[0]) < 1e-6
    assert abs(after[0] / after[1]) < 1e-6
    assert before[0] == pytest.approx(after[1], rel=0.1)
