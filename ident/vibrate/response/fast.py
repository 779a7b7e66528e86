"""The equations of motion linearised about the quasi-static deflection and integrated interval by interval.

With y = y_r(t) + x, y_r the static equilibrium at the posture of the moment:

    M(t) d2x/dt2 + D(t) dx/dt + K(t) x = f(t),   f = -residual(y_r, dy_r/dt, d2y_r/dt2)

M, D, K are the residual's exact derivatives there, gyroscopic and centrifugal terms included, without the turning
masses; f has them all, and the kinematic error to first order. What is left out is of second order in x and in the
excitation. Whatever follows the posture alone is smooth and interpolated within each time interval, the method's
transition matrices too. The method is Gauss's of order six, which follows slow modes closely and stays stable for fast
ones.

References:
    Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.7 (Gauss methods), II.14.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.linalg import inverse_unpivoted
from ident.arm.modes import natural_frequencies
from ident.arm.multibody import Multibody, balanced, may_differ_from_zero
from ident.arm.multibody_dynamics import equations, imbalance, residual, residual_of
from ident.arm.multibody_kinematics import (
    Kinematics,
    Turning,
    bushings,
    deviations,
    kinematics,
    pins,
    transmission_error,
)
from ident.arm.rotations import matvec
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.few_sizes import where
from ident.vibrate.response.quasi_static import initial_equilibrium, quasi_static_deflection, slope
from ident.vibrate.response.step_weights import GAUSS, STAGES, STEPS, StepWeights
from ident.vibrate.response.time_intervals import (
    NODE_PLACES,
    NODES,
    TimeIntervals,
    Times,
    basis,
    between_nodes,
    evaluate,
    fastest,
    interpolate,
    weights,
)

ABSTRACT = 0.005
"""Step for an arm whose first frequency is not known [s]."""
ONCE, TWICE = ([p.integ(k) for p in basis(GAUSS)] for k in (1, 2))
"""Rate and value within a step by the stages' accelerations; h and h^2 are factors."""
A, B = np.array([[p(c) for p in ONCE] for c in GAUSS]), np.array([p(1.0) for p in ONCE])
A2, B2 = A @ A, B @ A
"""The same, of the method for first-order equations applied twice: unlike TWICE at the stages it is always stable."""
START, EDGES, AT_NODES = weights(np.array([0.0]))[0], weights(np.array([0.0, 1.0]))[1], weights(NODE_PLACES)
"""Weights of the nodes for value at the start of an interval, slopes at its edges, and everything at the nodes."""


class Fast(NamedTuple):
    """A solution of the linearised equations, step by step.

    Attributes:
        x: (P, S, n) deviation from the quasi-static deflection at the start of each step [rad]
        v: (P, S, n) its rate [1/s]
        a: (P, S, STAGES, n) its acceleration at the stages of each step [1/s^2]
        quasi_static: (P, n, m) coordinates at static equilibrium, at the nodes of the intervals.
    """

    x: Float[Array, "P S n"]
    v: Float[Array, "P S n"]
    a: Float[Array, "P S stages n"]
    quasi_static: Float[Array, "P n m"]

    def at(self, grid: TimeIntervals, time: Times) -> tuple[Float[Array, "n T"], Float[Array, "n T"]]:
        """Return the coordinates at any times of the intervals, and their rates."""
        k, s, share, h = grid.steps_of(time)
        x, v, a = self.x[k, s], self.v[k, s], self.a[k, s]
        once, twice = (evaluate(integral, share)[:, :, None] for integral in (ONCE, TWICE))
        h = h[:, None]
        x, v = x + h * share[:, None] * v + h**2 * (twice * a).sum(1), v + h * (once * a).sum(1)
        y, rate = between_nodes(grid, self.quasi_static, time)
        return y + x.T, rate + v.T


def step_for(arm: Arm, motion: Motion) -> float:
    """Return a step [s] at which the method errs less than the linearisation does, on the paper's arm.

    h = min(1 / (10 f_1), 1 / (3 f)), f_1 the first frequency of the stiffest arm at the stiffer end of the motion, and
    f the fastest excitation: |ratio| times the highest speed of the joint in turns a second, of each drive, twice that
    with a kinematic error. Accelerations interpolated over a step h = 1/(n f) follow the free way under a force of that
    frequency within (2 pi/n)^5 / 13400 of it: 0.3 % for n = 3. ABSTRACT for an arm that `jit` traces.
    """
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(arm)):
        return ABSTRACT
    ends = np.asarray(motion(np.asarray(motion.breaks)[[0, -1]])[0])
    first = float(np.max(_first_frequency(arm, ends.reshape((*ends.shape, *(1,) * len(arm.batch))))))
    speed, names = fastest(motion) / (2 * np.pi), [joint.name for joint in arm.driven]
    orders = [1 + may_differ_from_zero(drive.error) for drive in arm.drives]
    ratios = [np.abs(np.asarray(drive.ratio)).max() for drive in arm.drives]
    turning = [speed[names.index(drive.joint)] for drive in arm.drives]
    highest = max((o * r * s for o, r, s in zip(orders, ratios, turning, strict=True)), default=0.0)
    return min(0.1 / first if np.isfinite(first) else ABSTRACT, 1 / (3 * max(highest, 1e-9)))


@jit
def _first_frequency(arm: Arm, posture: AnyArray) -> Array:
    return natural_frequencies(at_posture(arm, posture), 1)


def integrate(
    arm: Arm, model: Multibody, motion: Motion, grid: TimeIntervals, at: StepWeights, loads: Loads | None = None
) -> Fast:
    """Integrate from rest at the first break of the motion.

    Intervals that start at infinity, and steps beyond those of an interval, are left out: what is filled up to one of
    few sizes takes no time, and one program serves many motions.

    Args:
        arm: the arm.
        model: its multibody model under the load, gathered with `rank=1`.
        motion: the commanded motion.
        grid: the time intervals; their steps are the method's.
        at: weights for so many steps.
        loads: the load case.
    """
    first, chunks = grid.start[0], jax.tree.map(jnp.asarray, (at.within, at.middles, at.in_steps, at.stages))

    def interval(state: tuple[Array, Array], given: tuple[Array, Array, _Slow]) -> tuple[tuple, tuple]:
        (z, seam), (start, h, slow) = state, given
        first_slope, last_slope = (interpolate(slow.quasi_static, EDGES) / (h * at.steps)).T
        gain, yields = _transitions(slow, jnp.asarray(at.about_nodes), h)
        drift, push = _advance(h, model.size)
        along = drift + push @ gain

        def begin(z: Array) -> Array:
            y, K = (interpolate(part, START)[..., 0] for part in (slow.quasi_static, slow.K))
            return jnp.concatenate([initial_equilibrium(model, motion, y, K) - y, jnp.zeros(model.size)])

        def go_on(z: Array) -> Array:
            return z.at[model.size :].add(seam - first_slope)

        def some_steps(z: Array, given: tuple[Array, ...]) -> tuple[Array, tuple]:
            within, middles, in_steps, stages = given
            f = _excitation(model, motion, slow, stages, start + h * in_steps, h * at.steps)
            own = _at_middles(middles, yields @ f)

            def step(z: Array, given: tuple[Array, Array, Array]) -> tuple[Array, Array]:
                share, kick, real = given
                return jnp.where(real, jnp.tensordot(share, along, 1) @ z + kick, z), z

            z, states = jax.lax.scan(step, z, (middles.T, (push @ own).T, within < at.steps))
            return z, (states, (_at_middles(middles, gain @ states.T) + own).T)

        parts: tuple[Array, ...]
        z = jax.lax.cond(start == first, begin, go_on, z)
        real = where(lambda given: given[0][0] < at.steps, some_steps, *((STEPS, row) for row in rows))
        z, parts = jax.lax.scan(real, z, chunks)
        return (z, last_slope), tuple(part.reshape((-1, part.shape[-1])) for part in parts)

    slow, rows = _slow(arm, model, motion, loads, grid._replace(steps=at.steps)), (2 * model.size, STAGES * model.size)
    times = jnp.asarray(grid.start), jnp.asarray(grid.step)
    rest = jnp.zeros(2 * model.size), jnp.zeros(model.size)
    real = where(lambda given: jnp.isfinite(given[0]), interval, *((at.within.size, row) for row in rows))
    states: Array
    a: Array
    states, a = jax.lax.scan(real, rest, (*times, slow))[1]
    x, v = jnp.split(states, 2, -1)
    return Fast(x, v, a.reshape((*a.shape[:2], STAGES, -1)), slow.quasi_static)


def _advance(h: Array, n: int) -> tuple[Float[Array, "state state"], Float[Array, "state stages"]]:
    """Return how x and dx/dt at the end of a step follow from those at its start, and from the stages' accelerations.

    z' = drift z + push a.
    """
    unit = np.eye(n)
    drift = jnp.eye(2 * n) + h * np.kron([[0, 1], [0, 0]], unit)
    return drift, jnp.concatenate([h * h * np.kron(B2, unit), h * np.kron(B, unit)])


def _at_middles(middles: Float[Array, "m S"], x: Float[Array, "m k S"]) -> Float[Array, "k S"]:
    """Return of values by each node's matrix what the matrix at the middle of the step gives: their weighted sum."""
    return (x * middles[:, None]).sum(0)


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
        kinematics=kinematics(smooth, turning.pin, *(bushings(model, part) for part in line)),
    )
    return jax.tree.map(lambda x: jnp.moveaxis(by_interval(x), -2, 0), slow)


def _excitation(
    model: Multibody, motion: Motion, slow: _Slow, stages: Float[Array, "3 m places"], time: Array, length: Array
) -> Float[Array, "stages S"]:
    """Return f at the stages of some steps, one above the other."""
    moving = jax.tree.map(lambda x: interpolate(x, stages[0]), slow.kinematics)
    commanded = command(model, motion, time)
    line = [interpolate(slow.quasi_static, stages[k]) / length**k for k in range(3)]
    turning = pins(model, commanded, Turning(*(deviations(model, part) for part in line)))
    turned = equations(model, moving, turning.slope, imbalance(model, moving, turning.pulley))
    f = interpolate(slow.residual, stages[0]) + turned
    for by_pin, deviation in zip(slow.by_pin, transmission_error(model, turning), strict=False):
        f = f + matvec(interpolate(by_pin, stages[0]), deviation)
    return -jnp.concatenate([f[:, stage::STAGES] for stage in range(STAGES)])


def _transitions(
    slow: _Slow, about_nodes: Float[Array, "inner m m"], h: Array
) -> tuple[Float[Array, "m stages state"], Float[Array, "m stages stages"]]:
    """Return how the accelerations at the stages of a step follow from the state at its start, and from f.

    They are computed for steps about the nodes; between, they change as slowly as M, D and K do.
    """
    rows, known = [], []
    for i, W in enumerate(about_nodes):
        m, d, k = (interpolate(X, W) for X in (slow.M, slow.D, slow.K))
        rows.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * A2[i, j] * k for j in range(STAGES)])
        known.append([-k, -d - h * GAUSS[i] * k])
    left, right = (jnp.concatenate([jnp.concatenate(row, 1) for row in part], 0) for part in (rows, known))
    yields, right = (jnp.moveaxis(X, -1, 0) for X in (inverse_unpivoted(left), right))
    return yields @ right, yields
