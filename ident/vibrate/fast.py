"""The equations of motion linearised about the sagging, moving arm and integrated panel by panel.

With y = y_r(t) + x, y_r the equilibrium at the posture of the moment:

    M(t) d2x/dt2 + D(t) dx/dt + K(t) x = f(t),   f = -residual(y_r, dy_r/dt, d2y_r/dt2)

M, D, K are the residual's exact derivatives there, gyroscopic and centrifugal terms included, without the turning
masses; f has them all, and the kinematic error to first order. What is left out is of second order in x and in what
shakes. Whatever follows the posture alone is smooth and interpolated within each panel of time, the method's transition
matrices too. The method is Gauss's of order four, which follows slow modes closely and stays stable for fast ones.

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
from ident.arm.chain import Loads
from ident.arm.linalg import solve_unpivoted
from ident.arm.rotations import identity, matvec
from ident.vibrate.dynamics import equations, imbalance, residual, residual_of
from ident.vibrate.kinematics import Kinematics, Turning, bushings, command, deviations, inexactness, kinematics, pins
from ident.vibrate.machine import Machine, balanced
from ident.vibrate.motion import Motion
from ident.vibrate.panels import NODE_PLACES, Panels, interpolate, joined, weights
from ident.vibrate.sag import sag, slope

STEP = 0.005
"""Longest time step [s]: at 5 Hz the phase lags by 1e-6 of a turn in each period."""
GAUSS = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Stages within a step."""
A = np.array([[0.25, 0.25 - np.sqrt(3) / 6], [0.25 + np.sqrt(3) / 6, 0.25]])
"""Weights of the stages' rates for the stages."""
B = np.array([0.5, 0.5])
"""Weights of the stages' rates for the step."""


class Fast(NamedTuple):
    """A solution of the linearised equations at the ends of the steps.

    Attributes:
        y: (n, E) coordinates, see `kinematics`.
        yd: (n, E) their rates [1/s]
        rest: (n, E) coordinates at rest in the posture of the moment.
        rest_rate: (n, E) their rates [1/s]
    """

    y: Float[Array, "n E"]
    yd: Float[Array, "n E"]
    rest: Float[Array, "n E"]
    rest_rate: Float[Array, "n E"]


class _Places(NamedTuple):
    """Weights of the nodes for stages, ends and middles of a panel's S steps, and for stages of steps about nodes."""

    in_steps: np.ndarray
    stages: tuple[np.ndarray, ...]
    nodes: tuple[np.ndarray, ...]
    ends: tuple[np.ndarray, ...]
    middles: np.ndarray
    about_nodes: list[np.ndarray]


def _places(S: int) -> _Places:
    in_steps = (np.arange(S)[:, None] + GAUSS).ravel()
    return _Places(
        in_steps=in_steps,
        stages=weights(in_steps / S),
        nodes=weights(NODE_PLACES),
        ends=weights(np.arange(S + 1) / S)[:2],
        middles=weights((np.arange(S) + 0.5) / S)[0],
        about_nodes=[weights(NODE_PLACES + (place - 0.5) / S)[0] for place in GAUSS],
    )


def integrate(arm: Arm, machine: Machine, motion: Motion, grid: Panels, loads: Loads | None = None) -> Fast:
    """Integrate from rest at the first break of the motion.

    Args:
        arm: the arm.
        machine: the same arm under its load, gathered with `rank=1`.
        motion: what the motors are told.
        grid: panels of time; their steps are the method's.
        loads: the load case of the machine.
    """
    at = _places(grid.steps)

    def panel(state: tuple[Array, Array, Array], span: tuple[Array, Array]) -> tuple[tuple, tuple]:
        (x, v, seam), (start, h) = state, span
        length = h * grid.steps
        slow = _slow(arm, machine, motion, loads, at, start, length)
        line, line_rate = (interpolate(slow.rest, W, 1) / length**k for k, W in enumerate(at.ends))
        gain, yields = _transitions(slow, at, h)
        own = matvec(yields, _shaking(machine, motion, slow, at, start, h, length))
        v = v + jnp.where(start == grid.start[0], 0.0, seam - line_rate[:, 0])
        _, (xs, vs) = jax.lax.scan(_step, (x, v, h), (jnp.moveaxis(gain, 2, 0), jnp.moveaxis(own, 1, 0)))
        whole = (jnp.concatenate([first[None], rest]).T for first, rest in ((x, xs), (v, vs)))
        return (xs[-1], vs[-1], line_rate[:, -1]), (*whole, line, line_rate)

    none = jnp.zeros(machine.size)
    _, parts = jax.lax.scan(panel, (none, none, none), (jnp.asarray(grid.start), jnp.asarray(grid.step)))
    x, v, line, line_rate = (jax.vmap(joined, in_axes=1)(part) for part in parts)
    return Fast(line + x, line_rate + v, line, line_rate)


def _step(state: tuple[Array, Array, Array], step: tuple[Array, Array]) -> tuple[tuple, tuple[Array, Array]]:
    """Advance x and dx/dt by one step."""
    (x, v, h), (gain, own) = state, step
    n = x.shape[0]
    a = matvec(gain, jnp.concatenate([x, v])) + own
    first, second = a[:n], a[n:]
    late = B @ A
    x, v = x + h * v + h * h * (late[0] * first + late[1] * second), v + h * (B[0] * first + B[1] * second)
    return (x, v, h), (x, v)


class _Slow(NamedTuple):
    """What changes with the posture alone, at the nodes of a panel."""

    rest: Float[Array, "n m"]
    M: Float[Array, "n n m"]
    D: Float[Array, "n n m"]
    K: Float[Array, "n n m"]
    by_pin: tuple[Array, ...]
    residual: Float[Array, "n m"]
    kinematics: Kinematics


def _slow(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, at: _Places, start: Array, length: Array
) -> _Slow:
    """Linearise the equations at the nodes, nothing shaking: in the coordinates and in the pins' angles."""
    smooth, told = balanced(machine), command(machine, motion, start + length * NODE_PLACES)
    rest = sag(arm, machine, told.q, loads)
    none = jnp.zeros_like(rest)
    line = [interpolate(rest, W, 1) / length**k for k, W in enumerate(at.nodes)]
    turning = pins(smooth, told, Turning(*(deviations(machine, part) for part in line)))

    def shifted(k: int, pin: Array) -> Array:
        angles = [part + pin if i == k else part for i, part in enumerate(turning.pin)]
        return residual_of(smooth, eqx.tree_at(lambda t: t.pin, turning, Turning(*angles)), *line)

    still = jnp.zeros((machine.joints, *rest.shape[1:]))
    return _Slow(
        rest=rest,
        M=slope(lambda ydd: residual(smooth, told, rest, none, ydd), none),
        D=slope(lambda yd: residual(smooth, told, rest, yd, none), none),
        K=slope(lambda y: residual(smooth, told, y, none, none), rest),
        by_pin=tuple(slope(partial(shifted, k), still) for k in range(3)) if machine.inexact else (),
        residual=residual_of(smooth, turning, *line),
        kinematics=kinematics(smooth, turning.pin, *(bushings(machine, part) for part in line)),
    )


def _shaking(
    machine: Machine, motion: Motion, slow: _Slow, at: _Places, start: Array, h: Array, length: Array
) -> Float[Array, "m S"]:
    """Return f at both stages of each step, one above the other."""
    moving = jax.tree.map(lambda x: interpolate(x, at.stages[0], x.ndim - 1), slow.kinematics)
    told = command(machine, motion, start + h * at.in_steps)
    line = [interpolate(slow.rest, W, 1) / length**k for k, W in enumerate(at.stages)]
    turning = pins(machine, told, Turning(*(deviations(machine, part) for part in line)))
    f = interpolate(slow.residual, at.stages[0], 1) + equations(
        machine, moving, turning.slope, imbalance(machine, moving, turning.pulley)
    )
    for by_pin, deviation in zip(slow.by_pin, inexactness(machine, turning), strict=False):
        f = f + matvec(interpolate(by_pin, at.stages[0], 2), deviation)
    return -jnp.concatenate([jax.lax.slice_in_dim(f, stage, None, 2, 1) for stage in range(2)])


def _transitions(slow: _Slow, at: _Places, h: Array) -> tuple[Float[Array, "m m S"], Float[Array, "m m S"]]:
    """Return how the accelerations at both stages of each step follow from the state at its start, and from f.

    They are found for steps about the nodes, and change as slowly as M, D and K do.
    """
    rows, known = [], []
    for i, W in enumerate(at.about_nodes):
        m, d, k = (interpolate(X, W, 2) for X in (slow.M, slow.D, slow.K))
        rows.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * (A @ A)[i, j] * k for j in range(2)])
        known.append([-k, -d - h * GAUSS[i] * k])
    left, right = (jnp.concatenate([jnp.concatenate(row, 1) for row in part], 0) for part in (rows, known))
    unit = jnp.broadcast_to(identity(left.shape[0], left.ndim - 2), left.shape)
    solved = interpolate(solve_unpivoted(left, jnp.concatenate([right, unit], 1)), at.middles, 2)
    return solved[:, : left.shape[0]], solved[:, left.shape[0] :]
