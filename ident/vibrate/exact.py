"""The exact equations of motion integrated in time, with error control. The only module with diffrax."""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.linalg import solve_positive
from ident.errors import ModelError
from ident.vibrate.dynamics import Command, residual
from ident.vibrate.machine import Machine
from ident.vibrate.motion import Motion

MAX_STEPS = 2_000_000
"""Steps at which the integrator gives up."""
EXPLICIT_STEPS = 200_000
"""Steps of an explicit method, by its stability, above which an implicit one is taken."""
REACH = 3.0
"""Largest |rate| times step at which an explicit method of order eight stays stable, about."""


OMEGA = 2 * np.pi * 10
"""Rates are weighed against coordinates as at this frequency [rad/s]."""


class Exact(NamedTuple):
    """A solution of the exact equations.

    Attributes:
        y: (n, T) coordinates, see `dynamics`.
        yd: (n, T) their rates [1/s]
        steps: steps taken.
        rejected: steps rejected by the error control.
        method: name of the method.
    """

    y: Float[Array, "n T"]
    yd: Float[Array, "n T"]
    steps: int
    rejected: int
    method: str


def acceleration(machine: Machine, command: Command, y: Array, yd: Array) -> Float[Array, "n"]:
    """Solve M(y) d2y/dt2 = -h(y, dy/dt, t) for the accelerations [rad/s^2].

    The residual is affine in the accelerations, so that all columns of M and h come from one evaluation at none and
    each of the unit accelerations.

    Args:
        machine: gathered with `rank=1`.
        command: what the motors are told, (driven,) each.
        y: (n,) coordinates.
        yd: (n,) their rates.
    """
    n = y.shape[0]
    wide = Command(*(part[:, None] for part in command))
    trial = jnp.concatenate([jnp.zeros((n, 1)), jnp.eye(n)], 1)
    R = residual(machine, wide, y[:, None], yd[:, None], trial)
    h = R[:, 0]
    return solve_positive(R[:, 1:] - h[:, None], -h)


def integrate(
    machine: Machine,
    motion: Motion,
    start: tuple[Array, Array],
    times: Float[np.ndarray, "T"],
    *,
    rtol: float = 1e-7,
    atol: float = 1e-10,
) -> Exact:
    """Integrate from rest or any other state; the first of the times is the start.

    An explicit method of order eight (Dormand, Prince) where its stability allows, else an implicit one of order five
    (Kvaerno); step sizes by error control, with a new start at each break of the motion.

    Args:
        machine: gathered with `rank=1`, without sets.
        motion: what the motors are told.
        start: coordinates and their rates, (n,) each.
        times: increasing times at which the solution is wanted [s].
        rtol: relative tolerance of each step.
        atol: absolute tolerance of the coordinates [rad]; that of the rates is OMEGA as large.

    Raises:
        ModelError: the tolerance cannot be met.

    References:
        Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.5, II.10.
        Kvaerno, "Singly diagonally implicit Runge-Kutta methods with an explicit first stage", BIT 44, 2004.
    """
    method = "Dopri8" if _explicit_steps(machine, motion, start, times) < EXPLICIT_STEPS else "Kvaerno5"
    end, y, yd, steps, rejected = _solve(machine, motion, start, jnp.asarray(times), rtol, atol, method)
    if not end:
        reached = float(times[int(np.isfinite(np.asarray(y[0])).sum()) - 1])
        raise ModelError(
            f"the simulation cannot meet its tolerance beyond {reached:.4g} s; loosen --rtol, or check stiffness, "
            "damping and motion there"
        )
    return Exact(y, yd, int(steps), int(rejected), method)


def _explicit_steps(machine: Machine, motion: Motion, start: tuple[Array, Array], times: np.ndarray) -> float:
    command = Command(*motion(jnp.asarray(times[0])))

    def rates(state: Array) -> Array:
        y, yd = jnp.split(state, 2)
        return jnp.concatenate([yd, acceleration(machine, command, y, yd)])

    A = jax.jacfwd(rates)(jnp.concatenate(start))
    rate = np.abs(np.linalg.eigvals(np.asarray(A))).max()
    return float(rate * (times[-1] - times[0]) / REACH)


@jax.jit(static_argnames="method")
def _solve(
    machine: Machine,
    motion: Motion,
    start: tuple[Array, Array],
    times: Array,
    rtol: float,
    atol: float,
    method: str,
) -> tuple[Array, Array, Array, Array, Array]:
    def rates(t: Array, state: tuple[Array, Array], _: None) -> tuple[Array, Array]:
        y, v = state
        return OMEGA * v, acceleration(machine, Command(*motion(t)), y, OMEGA * v) / OMEGA

    y, yd = start
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        getattr(diffrax, method)(),
        times[0],
        times[-1],
        None,
        (y, yd / OMEGA),
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol, jump_ts=motion.breaks),
        max_steps=MAX_STEPS,
        throw=False,
    )
    done = solution.result == diffrax.RESULTS.successful
    stats = solution.stats
    y, v = (part.T for part in solution.ys)
    return done, y, OMEGA * v, stats["num_accepted_steps"], stats["num_rejected_steps"]
