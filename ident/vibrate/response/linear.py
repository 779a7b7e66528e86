"""The equations of motion linearised about the quasi-static deflection, at the nodes of time intervals: see `fast`.

The same whatever the sizes and phases of what excites the arm, so that they serve many simulations.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.linalg import inverse_unpivoted
from ident.arm.multibody import Multibody, balanced
from ident.arm.multibody_dynamics import residual, residual_of
from ident.arm.multibody_kinematics import Kinematics, Turning, bushing_rotations, deviations, kinematics, pins
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.few_sizes import where
from ident.vibrate.response.quasi_static import quasi_static_deflection, slope
from ident.vibrate.response.step_weights import GAUSS, STAGES, StepWeights
from ident.vibrate.response.time_intervals import NODE_PLACES, NODES, TimeIntervals, basis, interpolate, weights

ONCE, TWICE = ([p.integ(k) for p in basis(GAUSS)] for k in (1, 2))
"""Rate and value within a step by the stages' accelerations; h and h^2 are factors."""
A, B = np.array([[p(c) for p in ONCE] for c in GAUSS]), np.array([p(1.0) for p in ONCE])
A2, B2 = A @ A, B @ A
"""The same, of the method for first-order equations applied twice: unlike TWICE at the stages it is always stable."""
AT_NODES = weights(NODE_PLACES)
"""Weights of the nodes for value, slope and curvature at the nodes."""


class Linear(NamedTuple):
    """The linearised equations without what excites them, at the nodes of each interval.

    Attributes:
        quasi_static: coordinates at static equilibrium.
        K: stiffness.
        by_pin: derivatives of the residual by the pins' angles and their two rates; none without kinematic errors.
        residual: of the quasi-static deflection.
        kinematics: there.
        gain: the accelerations at the stages of a step about the node by the state at its start,
        yields: and by the forces at the stages.
        along: the state at the end of the step by that at its start.
    """

    quasi_static: Float[Array, "P n m"]
    K: Float[Array, "P n n m"]
    by_pin: tuple[Array, ...]
    residual: Float[Array, "P n m"]
    kinematics: Kinematics
    gain: Float[Array, "P m stages state"]
    yields: Float[Array, "P m stages stages"]
    along: Float[Array, "P m state state"]


def linearised(
    arm: Arm, model: Multibody, motion: Motion, grid: TimeIntervals, at: StepWeights, loads: Loads | None = None
) -> Linear:
    """Linearise the equations along a motion: the same for all eccentricities, phases and kinematic errors.

    Intervals that start at infinity are left out.

    Args:
        arm: the arm.
        model: its multibody model under the load, gathered with `rank=1`.
        motion: the commanded motion.
        grid: the time intervals.
        at: weights for the steps of an interval.
        loads: the load case.
    """
    slow = _slow(arm, model, motion, loads, grid._replace(steps=at.steps))
    n, state, stages = model.size, 2 * model.size, STAGES * model.size

    def interval(none: None, given: tuple[Array, ...]) -> tuple[None, tuple[Array, ...]]:
        _, h, M, D, K = given
        gain, yields = _transitions(M, D, K, jnp.asarray(at.about_nodes), h)
        drift, push = advance(h, n)
        return none, (gain, yields, drift + push @ gain)

    shapes = ((NODES, stages, state), (NODES, stages, stages), (NODES, state, state))
    real = where(lambda given: jnp.isfinite(given[0]), interval, *shapes)
    by_interval = jnp.asarray(grid.start), jnp.asarray(grid.step), slow.M, slow.D, slow.K
    transitions: tuple[Array, ...] = jax.lax.scan(real, None, by_interval)[1]
    return Linear(slow.quasi_static, slow.K, slow.by_pin, slow.residual, slow.kinematics, *transitions)


class _Slow(NamedTuple):
    """What changes with the posture alone, at the nodes of each interval."""

    quasi_static: Float[Array, "P n m"]
    M: Float[Array, "P n n m"]
    D: Float[Array, "P n n m"]
    K: Float[Array, "P n n m"]
    by_pin: tuple[Array, ...]
    residual: Float[Array, "P n m"]
    kinematics: Kinematics


def _slow(arm: Arm, model: Multibody, motion: Motion, loads: Loads | None, grid: TimeIntervals) -> _Slow:
    """Linearise the equations at the nodes, nothing exciting them: in the coordinates and in the pins' angles."""
    length = (grid.step * grid.steps)[:, None]
    smooth, commanded = balanced(model), command(model, motion, grid.nodes.ravel())
    y = quasi_static_deflection(arm, model, commanded.q, loads)
    none = jnp.zeros_like(y)

    def by_interval(x: Array) -> Array:
        return x.reshape((*x.shape[:-1], len(grid.start), NODES))

    line = [(interpolate(by_interval(y), W) / length**k).reshape(y.shape) for k, W in enumerate(AT_NODES)]
    turning = pins(smooth, commanded, Turning(*(deviations(model, part) for part in line)))

    def shifted(k: int, pin: Array) -> Array:
        angles = [part + pin if i == k else part for i, part in enumerate(turning.pin)]
        return residual_of(smooth, eqx.tree_at(lambda t: t.pin, turning, Turning(*angles)), *line)

    still = jnp.zeros((model.joints, *y.shape[1:]))
    slow = _Slow(
        quasi_static=y,
        M=slope(lambda ydd: residual(smooth, commanded, y, none, ydd), none),
        D=slope(lambda yd: residual(smooth, commanded, y, yd, none), none),
        K=slope(lambda y: residual(smooth, commanded, y, none, none), y),
        by_pin=tuple(slope(partial(shifted, k), still) for k in range(3)) if model.transmission_error else (),
        residual=residual_of(smooth, turning, *line),
        kinematics=kinematics(smooth, turning.pin, *(bushing_rotations(model, part) for part in line)),
    )
    return jax.tree.map(lambda x: jnp.moveaxis(by_interval(x), -2, 0), slow)


def advance(h: Array, n: int) -> tuple[Float[Array, "state state"], Float[Array, "state stages"]]:
    """Return how x and dx/dt at the end of a step follow from those at its start, and from the stages' accelerations.

    z' = drift z + push a.
    """
    unit = np.eye(n)
    drift = jnp.eye(2 * n) + h * np.kron([[0, 1], [0, 0]], unit)
    return drift, jnp.concatenate([h * h * np.kron(B2, unit), h * np.kron(B, unit)])


def _transitions(
    M: Array, D: Array, K: Array, about_nodes: Float[Array, "inner m m"], h: Array
) -> tuple[Float[Array, "m stages state"], Float[Array, "m stages stages"]]:
    """Return how the accelerations at the stages of a step follow from the state at its start, and from f.

    They are computed for steps about the nodes; between, they change as slowly as M, D and K do.
    """
    rows, known = [], []
    for i, W in enumerate(about_nodes):
        m, d, k = (interpolate(X, W) for X in (M, D, K))
        rows.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * A2[i, j] * k for j in range(STAGES)])
        known.append([-k, -d - h * GAUSS[i] * k])
    left, right = (jnp.concatenate([jnp.concatenate(row, 1) for row in part], 0) for part in (rows, known))
    yields, right = (jnp.moveaxis(X, -1, 0) for X in (inverse_unpivoted(left), right))
    return yields @ right, yields
