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

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.linalg import solve_unpivoted
from ident.arm.rotations import matvec
from ident.vibrate.dynamics import command, residual
from ident.vibrate.machine import Machine, balanced
from ident.vibrate.motion import Motion
from ident.vibrate.panels import NODE_PLACES, STEPS, interpolate, panels, weights
from ident.vibrate.sag import sag, slope

STEP = 0.005
"""Longest time step [s]: at 5 Hz the phase lags by 1e-6 of a turn in each period."""
GAUSS = np.array([0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
"""Stages within a step."""
A = np.array([[0.25, 0.25 - np.sqrt(3) / 6], [0.25 + np.sqrt(3) / 6, 0.25]])
"""Weights of the stages' rates for the stages."""
B = np.array([0.5, 0.5])
"""Weights of the stages' rates for the step."""
STAGE_PLACES = (np.arange(STEPS)[:, None] + GAUSS).ravel()
"""The stages of a panel, in steps."""
AT_STAGES = weights(STAGE_PLACES / STEPS)
AT_ENDS = weights(np.arange(STEPS + 1) / STEPS)[:2]


class Fast(NamedTuple):
    """A solution of the linearised equations.

    Attributes:
        time: (E,) [s] ends of the steps, the start first.
        y: (n, E, *sets) coordinates, see `dynamics`.
        yd: (n, E, *sets) their rates [1/s]
        rest: (n, E, *sets) coordinates at rest in the posture of the moment.
        rest_rate: (n, E, *sets) their rates [1/s]
    """

    time: Float[np.ndarray, "E"]
    y: Float[Array, "n E *sets"]
    yd: Float[Array, "n E *sets"]
    rest: Float[Array, "n E *sets"]
    rest_rate: Float[Array, "n E *sets"]


def integrate(
    arm: Arm, machine: Machine, motion: Motion, end: float, loads: Loads | None = None, step: float = STEP
) -> Fast:
    """Integrate from rest at the first break of the motion.

    Args:
        arm: the arm; its numbers may be arrays `(*sets)`.
        machine: the same arm, gathered with rank `1 + len(sets)`.
        motion: what the motors are told.
        end: last time [s].
        loads: the load case of the machine.
        step: longest time step [s].
    """
    start = float(motion.breaks[0])
    starts, steps = panels(motion, start, end, step)
    ends = starts[:, None] + steps[:, None] * np.arange(1, STEPS + 1)
    return Fast(np.append(start, ends), *_integrate(arm, machine, motion, loads, starts, steps))


@jax.jit
def _integrate(
    arm: Arm, machine: Machine, motion: Motion, loads: Loads | None, starts: Array, steps: Array
) -> tuple[Array, Array, Array, Array]:
    def panel(state: tuple[Array, Array, Array], span: tuple[Array, Array]) -> tuple[tuple, tuple]:
        (x, v, seam), (start, h) = state, span
        rest, M, D, K = _linearized(arm, machine, motion, loads, start + h * STEPS * NODE_PLACES)
        line, line_rate = (interpolate(rest, W, 1) / (h * STEPS) ** k for k, W in enumerate(AT_ENDS))
        gain, own = _transitions(machine, motion, start, h, rest, M, D, K)
        v = v + jnp.where(start == starts[0], 0.0, seam - line_rate[:, 0])
        _, (xs, vs) = jax.lax.scan(_step, (x, v, h), (jnp.moveaxis(gain, 2, 0), jnp.moveaxis(own, 1, 0)))
        whole = (jnp.concatenate([first[None], rest]) for first, rest in ((x, xs), (v, vs)))
        parts = (*(jnp.moveaxis(part, 0, 1) for part in whole), line, line_rate)
        return (xs[-1], vs[-1], line_rate[:, -1]), parts

    none = jnp.zeros((machine.size, *jnp.broadcast_shapes(machine.offset.shape[3:], machine.stiffness.shape[4:])))
    _, parts = jax.lax.scan(panel, (none, none, none), (starts, steps))
    x, v, line, line_rate = (_joined(part) for part in parts)
    return line + x, line_rate + v, line, line_rate


def _joined(panels: Float[Array, "P n ends *sets"]) -> Float[Array, "n E *sets"]:
    """Put panels one after another; the last end of one is the first of the next."""
    ends = jnp.moveaxis(panels[:, :, 1:], 0, 1)
    return jnp.concatenate([panels[0][:, :1], ends.reshape((ends.shape[0], -1, *ends.shape[3:]))], 1)


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
    smooth, told = balanced(machine), command(machine, motion, times)
    rest = sag(arm, machine, told.q, loads)
    none = jnp.zeros_like(rest)
    M = slope(lambda ydd: residual(smooth, told, rest, none, ydd), none)
    D = slope(lambda yd: residual(smooth, told, rest, yd, none), none)
    K = slope(lambda y: residual(smooth, told, y, none, none), rest)
    return rest, M, D, K


def _transitions(
    machine: Machine, motion: Motion, start: Array, h: Array, rest: Array, M: Array, D: Array, K: Array
) -> tuple[Array, Array]:
    """Return how the accelerations at both stages of each step follow from the state at its beginning.

    Returns:
        gain (2n, 2n, STEPS, *sets) by x and dx/dt, own (2n, STEPS, *sets) by what shakes the arm.
    """
    reference = [interpolate(rest, W, 1) / (h * STEPS) ** k for k, W in enumerate(AT_STAGES)]
    f = -residual(machine, command(machine, motion, start + h * STAGE_PLACES), *reference)
    at_stages = (_by_stage(interpolate(X, AT_STAGES[0], 2), 2) for X in (M, D, K))
    left, right = [], []
    for i, (m, d, k, shake) in enumerate(zip(*at_stages, _by_stage(f, 1), strict=True)):
        left.append([(m if i == j else 0.0) + h * A[i, j] * d + h * h * (A @ A)[i, j] * k for j in range(2)])
        right.append([-k, -d - h * GAUSS[i] * k, shake[:, None]])
    solved = solve_unpivoted(*(jnp.concatenate([jnp.concatenate(row, 1) for row in rows], 0) for rows in (left, right)))
    return solved[:, :-1], solved[:, -1]


def _by_stage(x: Array, axis: int) -> tuple[Array, Array]:
    """Split the axis of all stages of a panel into the first and the second ones of each step."""
    return jax.lax.slice_in_dim(x, 0, None, 2, axis), jax.lax.slice_in_dim(x, 1, None, 2, axis)
