"""The equations of motion linearised about the sagging, moving arm and integrated panel by panel.

With y = y_r(t) + x, y_r the equilibrium at the posture of the moment:

    M(t) d2x/dt2 + D(t) dx/dt + K(t) x = f(t),   f = -residual(y_r, dy_r/dt, d2y_r/dt2)

M, D, K are the residual's exact derivatives there, gyroscopic and centrifugal terms included, without the turning
masses; f has them all. What is left out is of second order in x. M, D, K and y_r are smooth and are interpolated in
each panel of time; f is evaluated where it is needed. The method is Gauss's of order four, which follows slow modes
closely and stays stable for fast ones.

References:
    Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.7 (Gauss methods), II.14.
"""

from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import Polynomial

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.linalg import solve_unpivoted
from ident.arm.rotations import matvec
from ident.vibrate.dynamics import Command, residual
from ident.vibrate.machine import Machine, balanced
from ident.vibrate.motion import Motion
from ident.vibrate.sag import sag, slope

NODES = 6
"""Points of a panel at which the equations are linearised."""
STEP = 0.005
"""Longest time step [s]: at 5 Hz the phase lags by 1e-6 of a turn in each period."""
STEPS = 16
"""Steps of a panel."""
GAUSS = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Stages within a step."""
A = np.array([[0.25, 0.25 - np.sqrt(3) / 6], [0.25 + np.sqrt(3) / 6, 0.25]])
"""Weights of the stages' rates."""
B = np.array([0.5, 0.5])


class Fast(NamedTuple):
    """A solution of the linearised equations.

    Attributes:
        time: (T,) [s] ends of the steps, the start first.
        y: (n, T, *sets) coordinates, see `dynamics`.
        yd: (n, T, *sets) their rates [1/s]
    """

    time: Float[np.ndarray, "T"]
    y: Float[Array, "n T *sets"]
    yd: Float[Array, "n T *sets"]


def panels(motion: Motion, start: float, end: float, step: float = STEP) -> tuple[np.ndarray, np.ndarray]:
    """Divide a time span into panels of STEPS equal steps, none across a break: their starts and steps [s]."""
    breaks = np.asarray(motion.breaks)
    edges = np.unique(np.concatenate([[start, end], breaks[(breaks > start) & (breaks < end)]]))
    starts, steps = [], []
    for low, high in pairwise(edges):
        count = int(np.ceil((high - low) / (STEPS * step) - 1e-9))
        starts += list(low + (high - low) / count * np.arange(count))
        steps += [(high - low) / (count * STEPS)] * count
    return np.array(starts), np.array(steps)


def integrate(
    arm: Arm, machine: Machine, motion: Motion, start: float, end: float, loads: Loads | None = None, step: float = STEP
) -> Fast:
    """Integrate from rest at equilibrium.

    Args:
        arm: the arm; its numbers may be arrays `(*sets)`.
        machine: the same arm, gathered with rank `1 + len(sets)`.
        motion: what the motors are told.
        start: time at which the arm is at rest [s].
        end: last time [s].
        loads: the load case of the machine.
        step: longest time step [s].
    """
    starts, steps = panels(motion, start, end, step)
    y, yd = _integrate(arm, machine, motion, loads, starts, steps)
    ends = starts[:, None] + steps[:, None] * np.arange(1, STEPS + 1)
    return Fast(np.concatenate([[start], ends.ravel()]), y, yd)


@jax.jit
def _integrate(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, starts: Array, steps: Array
) -> tuple[Array, Array]:
    def panel(state: tuple[Array, Array], span: tuple[Array, Array]) -> tuple[tuple[Array, Array], tuple]:
        start, h = span
        rest, M, D, K = _linearized(arm, machine, motion, loads, start + h * STEPS * NODE_PLACES)
        line, line_rate = (_interpolate(rest, W, 1) / (h * STEPS) ** k for k, W in enumerate(AT_ENDS))
        gain, own = _transitions(machine, motion, start, h, rest, M, D, K)
        x, v = state[0] - line[:, 0], state[1] - line_rate[:, 0]
        _, (xs, vs) = jax.lax.scan(_step, (x, v, h), (jnp.moveaxis(gain, 2, 0), jnp.moveaxis(own, 1, 0)))
        y, yd = line[:, 1:] + jnp.moveaxis(xs, 0, 1), line_rate[:, 1:] + jnp.moveaxis(vs, 0, 1)
        return (y[:, -1], yd[:, -1]), (y, yd)

    first = sag(arm, machine, jnp.expand_dims(motion(starts[:1])[0], tuple(range(2, machine.offset.ndim - 1))), loads)
    start = first[:, 0], jnp.zeros_like(first[:, 0])
    _, (y, yd) = jax.lax.scan(panel, start, (starts, steps))
    joined = (jnp.moveaxis(part, 0, 1).reshape((part.shape[1], -1, *part.shape[3:])) for part in (y, yd))
    begin = (first, jnp.zeros_like(first))
    y, yd = (jnp.concatenate([zero, part], 1) for zero, part in zip(begin, joined, strict=True))
    return y, yd


def _step(state: tuple[Array, Array, Array], step: tuple[Array, Array]) -> tuple[tuple, tuple[Array, Array]]:
    """Advance x and dx/dt by one step."""
    (x, v, h), (gain, own) = state, step
    n = x.shape[0]
    a = matvec(gain, jnp.concatenate([x, v])) + own
    first, second = a[:n], a[n:]
    late = B @ A
    x, v = x + h * v + h * h * (late[0] * first + late[1] * second), v + h * (B[0] * first + B[1] * second)
    return (x, v, h), (x, v)


def _linearized(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, times: Array
) -> tuple[Array, Array, Array, Array]:
    """Return y_r (n, m, *sets) and M, D, K (n, n, m, *sets) at each of the times (m,)."""
    smooth = balanced(machine)
    command = _command(machine, motion, times)
    rest = sag(arm, machine, command.q, loads)
    none = jnp.zeros_like(rest)
    M = slope(lambda ydd: residual(smooth, command, rest, none, ydd), none)
    D = slope(lambda yd: residual(smooth, command, rest, yd, none), none)
    K = slope(lambda y: residual(smooth, command, y, none, none), rest)
    return rest, M, D, K


def _transitions(
    machine: Machine, motion: Motion, start: Array, h: Array, rest: Array, M: Array, D: Array, K: Array
) -> tuple[Array, Array]:
    """Return how the accelerations at both stages of each step follow from the state at its beginning.

    Returns:
        gain (2n, 2n, STEPS, *sets) by x and dx/dt, own (2n, STEPS, *sets) by what shakes the arm.
    """
    reference = [_interpolate(rest, W, 1) / (h * STEPS) ** k for k, W in enumerate(AT_STAGES)]
    command = _command(machine, motion, start + h * STAGE_PLACES)
    f = -residual(machine, command, *reference)
    stages = zip(*(_by_stage(_interpolate(X, AT_STAGES[0], 2), 2) for X in (M, D, K)), _by_stage(f, 1), strict=True)
    left, right = [], []
    for i, (m, d, k, shake) in enumerate(stages):
        left.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * (A @ A)[i, j] * k for j in range(2)])
        right.append([-k, -d - h * GAUSS[i] * k, shake[:, None]])
    solved = solve_unpivoted(*(jnp.concatenate([jnp.concatenate(row, 1) for row in rows], 0) for rows in (left, right)))
    return solved[:, :-1], solved[:, -1]


def _command(machine: Machine, motion: Motion, times: Array) -> Command:
    """Return what the motors are told at times (m,), with singleton axes for the sets."""
    ones = tuple(range(2, machine.offset.ndim - 1))
    return Command(*(jnp.expand_dims(part, ones) for part in motion(times)))


def _by_stage(x: Array, axis: int) -> tuple[Array, Array]:
    """Split the axis of all stages of a panel into the first and the second ones of each step."""
    return jax.lax.slice_in_dim(x, 0, None, 2, axis), jax.lax.slice_in_dim(x, 1, None, 2, axis)


def _interpolate(x: Array, W: np.ndarray, axis: int) -> Array:
    """Return the sum over the nodes on `axis` of x times their weights (nodes, places)."""
    weights = W.reshape((1,) * axis + W.shape + (1,) * (x.ndim - axis - 1))
    return (jnp.expand_dims(x, axis + 1) * weights).sum(axis)


def _weights(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weights (NODES, places) by which values at the nodes give value, slope and curvature elsewhere."""
    basis = [Polynomial.fromroots(np.delete(NODE_PLACES, k)) for k in range(NODES)]
    basis = [p / p(x) for p, x in zip(basis, NODE_PLACES, strict=True)]
    values, slopes, curvatures = (np.stack([p.deriv(k)(places) for p in basis]) for k in range(3))
    return values, slopes, curvatures


NODE_PLACES = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2
"""The nodes within a panel, 0 to 1."""
STAGE_PLACES = (np.arange(STEPS)[:, None] + GAUSS).ravel()
"""The stages of a panel, in steps."""
AT_STAGES = _weights(STAGE_PLACES / STEPS)
AT_ENDS = _weights(np.arange(STEPS + 1) / STEPS)[:2]
