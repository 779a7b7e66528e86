"""Gradients, forward and reverse, against central differences; forward also where frequencies repeat and cross."""

from collections.abc import Callable
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, posture_of, random_arm, two_equal_arm
from conformance import agrees
from jaxtyping import Array
from scipy.optimize import brentq

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.arm.modes import damped_eigenvalues, linearize, natural_frequencies

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


def test_gradients_forward_and_reverse() -> None:
    """Each row to 1e-8 of its largest entry."""
    arm, posture, paths = case()
    f, at = partial(quantities, arm, posture, paths), jnp.ones(len(paths))
    both = jax.jit(lambda scale: (f(scale), jax.jacfwd(f)(scale), jax.jacrev(f)(scale)))
    _, *jacobians = both(at)
    for name, rows in differences(lambda scale: both(scale)[0], at).items():
        size = jnp.abs(rows).max(1, keepdims=True) + 1e-12
        for jacobian in jacobians:
            what, source = f"slopes of {name}, by jacfwd and jacrev", "central differences"
            agrees(jacobian[name] / size, rows / size, "modal", what, source, atol=1e-8)


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


def test_gradient_at_repeated_frequencies() -> None:
    """Finite; the sum over a pair is smooth, and right, though each one's share depends on the basis."""
    both = jax.jit(lambda scale: (column_frequencies(scale), jax.jacfwd(column_frequencies)(scale)))
    at = jnp.ones(len(REPEATED_PATHS))
    found, jacobian = both(at)
    assert np.isfinite(jacobian).all()
    cluster = np.array([(i, i + 1) for i in range(5) if abs(found[i + 1] / found[i] - 1) < 1e-12])
    assert len(cluster) == 2
    expected = differences(lambda scale: {"sum": both(scale)[0][cluster].sum(1)}, at)["sum"]
    ours = jacobian[cluster].sum(1)
    what = "slope of the sum of a repeated frequency"
    agrees(ours, expected, "modal", what, "central differences", largest=1e-8)


@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_deflection_gradient_is_finite_at_zero_deflection(mode: str) -> None:
    """The column stands straight: phi = 0, where careless rotation formulas divide by zero."""

    def tip(k: Array) -> Array:
        chain = at_posture(two_equal_arm().replace({"lower.k_bend": k}), jnp.zeros(2))
        return deflection(chain, equilibrium(chain))

    slope = jax.jit({"fwd": jax.jacfwd, "rev": jax.jacrev}[mode](tip))(8e3)
    assert jnp.abs(slope).max() == 0


# a crossing: torsion 1 and bending 1 of the LCD arm, unfolded, as the stiffness of joint 1 in torsion varies


@jax.jit
def with_slopes(k: Array) -> tuple[Array, Array]:
    """The two lowest frequencies and their derivatives."""
    arm = lcd_arm()

    def frequencies(k: Array) -> Array:
        return natural_frequencies(at_posture(arm.replace({"joint1.k_tors": k}), jnp.zeros(3)), 2)

    return frequencies(k), jax.jacfwd(frequencies)(k)


@cache
def crossing() -> float:
    """The stiffness at which the two lowest frequencies meet: bending does not feel joint 1 in torsion."""
    lcd_arm()  # read before anything is traced

    def gap(k: float) -> float:
        values, slope = (np.asarray(x) for x in with_slopes(k))
        return float(values[np.abs(slope).argmin()] - values[np.abs(slope).argmax()])

    return brentq(gap, 2e5, 2e6, xtol=1e-9, rtol=1e-15)


def test_gradient_at_a_crossing() -> None:
    """The sum is smooth. Each branch, taken by what it is on both sides, has the slope found on either side."""
    at = crossing()
    values, slope = (np.asarray(x) for x in with_slopes(at))
    assert abs(values[1] / values[0] - 1) < 1e-9
    assert np.isfinite(slope).all()
    h = 1e-3 * at
    by_differences = sum(
        w * (with_slopes(at + n * h)[0] - with_slopes(at - n * h)[0]).sum() / h for n, w in FOURTH_ORDER.items()
    )
    what = "slope of the sum of crossing frequencies"
    agrees(slope.sum(), by_differences, "modal", what, "central differences", rtol=1e-8)


def test_branches_swap_at_the_crossing() -> None:
    """Bending does not feel joint 1 in torsion: its slope is zero, as second before and as first after."""
    at = crossing()
    before, after = (np.asarray(with_slopes(at * factor)[1]) for factor in (0.99, 1.01))
    assert abs(before[1] / before[0]) < 1e-6
    assert abs(after[0] / after[1]) < 1e-6
    assert before[0] == pytest.approx(after[1], rel=0.1)
