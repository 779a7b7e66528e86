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

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import natural_frequencies
from ident.arm.multibody import Multibody, may_differ_from_zero
from ident.arm.multibody_dynamics import equations, imbalance
from ident.arm.multibody_kinematics import Turning, deviations, pins, transmission_error
from ident.arm.rotations import matvec
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.few_sizes import where
from ident.vibrate.response.linear import ONCE, TWICE, Linear, advance
from ident.vibrate.response.quasi_static import initial_equilibrium
from ident.vibrate.response.step_weights import STAGES, STEPS, StepWeights
from ident.vibrate.response.time_intervals import (
    TimeIntervals,
    Times,
    between_nodes,
    evaluate,
    fastest,
    interpolate,
    weights,
)

ABSTRACT = 0.005
"""Step for an arm whose first frequency is not known [s]."""
START, EDGES = weights(np.array([0.0]))[0], weights(np.array([0.0, 1.0]))[1]
"""Weights of the nodes for value at the start of an interval, and slopes at its edges."""


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


def excited(model: Multibody, motion: Motion, grid: TimeIntervals, at: StepWeights, linear: Linear) -> Fast:
    """Integrate the linearised equations, with what excites the arm, from rest at the first break of the motion.

    Intervals that start at infinity, and steps beyond those of an interval, are left out: what is filled up to one of
    few sizes takes no time, and one program serves many motions.

    Args:
        model: the arm's multibody model under its load, gathered with `rank=1`.
        motion: the commanded motion.
        grid: the time intervals; their steps are the method's.
        at: weights for so many steps.
        linear: the equations without what excites, see `linearised`.
    """
    first, chunks = grid.start[0], jax.tree.map(jnp.asarray, (at.within, at.middles, at.in_steps, at.stages))

    def interval(state: tuple[Array, Array], given: tuple[Array, Array, Linear]) -> tuple[tuple, tuple]:
        (z, seam), (start, h, here) = state, given
        first_slope, last_slope = (interpolate(here.quasi_static, EDGES) / (h * at.steps)).T
        push = advance(h, model.size)[1]

        def begin(z: Array) -> Array:
            y, K = (interpolate(part, START)[..., 0] for part in (here.quasi_static, here.K))
            return jnp.concatenate([initial_equilibrium(model, motion, y, K) - y, jnp.zeros(model.size)])

        def go_on(z: Array) -> Array:
            return z.at[model.size :].add(seam - first_slope)

        def some_steps(z: Array, given: tuple[Array, ...]) -> tuple[Array, tuple]:
            within, middles, in_steps, stages = given
            f = _excitation(model, motion, here, stages, start + h * in_steps, h * at.steps)
            own = _at_middles(middles, here.yields @ f)

            def step(z: Array, given: tuple[Array, Array, Array]) -> tuple[Array, Array]:
                share, kick, real = given
                return jnp.where(real, jnp.tensordot(share, here.along, 1) @ z + kick, z), z

            z, states = jax.lax.scan(step, z, (middles.T, (push @ own).T, within < at.steps))
            return z, (states, (_at_middles(middles, here.gain @ states.T) + own).T)

        parts: tuple[Array, ...]
        z = jax.lax.cond(start == first, begin, go_on, z)
        real = where(lambda given: given[0][0] < at.steps, some_steps, *((STEPS, row) for row in rows))
        z, parts = jax.lax.scan(real, z, chunks)
        return (z, last_slope), tuple(part.reshape((-1, part.shape[-1])) for part in parts)

    rows = 2 * model.size, STAGES * model.size
    times = jnp.asarray(grid.start), jnp.asarray(grid.step)
    rest = jnp.zeros(2 * model.size), jnp.zeros(model.size)
    real = where(lambda given: jnp.isfinite(given[0]), interval, *((at.within.size, row) for row in rows))
    states: Array
    a: Array
    states, a = jax.lax.scan(real, rest, (*times, linear))[1]
    x, v = jnp.split(states, 2, -1)
    return Fast(x, v, a.reshape((*a.shape[:2], STAGES, -1)), linear.quasi_static)


def _at_middles(middles: Float[Array, "m S"], x: Float[Array, "m k S"]) -> Float[Array, "k S"]:
    """Return of values by each node's matrix what the matrix at the middle of the step gives: their weighted sum."""
    return (x * middles[:, None]).sum(0)


def _excitation(
    model: Multibody, motion: Motion, linear: Linear, stages: Float[Array, "3 m places"], time: Array, length: Array
) -> Float[Array, "stages S"]:
    """Return f at the stages of some steps, one above the other."""
    moving = jax.tree.map(lambda x: interpolate(x, stages[0]), linear.kinematics)
    commanded = command(model, motion, time)
    line = [interpolate(linear.quasi_static, stages[k]) / length**k for k in range(3)]
    turning = pins(model, commanded, Turning(*(deviations(model, part) for part in line)))
    turned = equations(model, moving, turning.slope, imbalance(model, moving, turning.pulley))
    f = interpolate(linear.residual, stages[0]) + turned
    for by_pin, deviation in zip(linear.by_pin, transmission_error(model, turning), strict=False):
        f = f + matvec(interpolate(by_pin, stages[0]), deviation)
    return -jnp.concatenate([f[:, stage::STAGES] for stage in range(STAGES)])
