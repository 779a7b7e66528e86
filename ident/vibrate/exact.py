"""The exact equations of motion integrated in time, with error control. The only module with diffrax."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.linalg import solve_positive
from ident.arm.multibody import Command, Multibody, residual
from ident.errors import ConvergenceError, ModelError
from ident.programs import LONG_LOOPS, RUNS_ONCE, AnyArray, jit
from ident.vibrate.motion import Motion

MAX_STEPS = 2_000_000
"""Steps of a section at most."""
EXPLICIT_STEPS = 20_000
"""Steps for a second of motion, by the stability of an explicit method, above which an implicit one takes less time."""
REACH = 3.0
"""Largest |rate| times step at which an explicit method of order eight stays stable, about."""
OMEGA = 2 * np.pi * 10
"""Rates are weighed against coordinates as at this frequency [rad/s]."""
NEAR = 1e-6
"""Differences of the state [rad, rad/s] by which derivatives are estimated: they choose the method only."""
SAMPLES = 250
"""Times of a section, after each of which progress is shown and the solution so far can be returned."""


Progress = Callable[[Iterable[int]], Iterator[int]]
"""Shows how far a loop is that runs over the numbers."""


class Exact(NamedTuple):
    """A solution of the exact equations.

    Attributes:
        y: (n, T) coordinates, see `kinematics`.
        yd: (n, T) their rates [1/s]
        steps: steps taken.
        method: name of the method.
        interrupted: [s] until when it was solved before the user stopped it; None if to the end.
    """

    y: Float[np.ndarray, "n T"]
    yd: Float[np.ndarray, "n T"]
    steps: int
    method: str
    interrupted: float | None = None


def acceleration(model: Multibody, command: Command, y: Array, yd: Array) -> Float[Array, "n"]:
    """Solve M(y) d2y/dt2 = -h(y, dy/dt, t) for the accelerations [rad/s^2].

    The residual is affine in the accelerations, so that all columns of M and h come from one evaluation at none and
    each of the unit accelerations.

    Args:
        model: gathered with `rank=1`.
        command: of the motors, (driven,) each.
        y: (n,) coordinates.
        yd: (n,) their rates.
    """
    n = y.shape[0]
    wide = Command(*(part[:, None] for part in command))
    unit_accelerations = jnp.concatenate([jnp.zeros((n, 1)), jnp.eye(n)], 1)
    R = residual(model, wide, y[:, None], yd[:, None], unit_accelerations)
    h = R[:, 0]
    return solve_positive(R[:, 1:] - h[:, None], -h)


def integrate(
    model: Multibody,
    motion: Motion,
    start: tuple[AnyArray, AnyArray],
    times: Float[np.ndarray, "T"],
    *,
    rtol: float = 1e-7,
    atol: float = 1e-10,
    max_steps: int = MAX_STEPS,
    progress: Progress = iter,
) -> Exact:
    """Integrate from rest or any other state; the first of the times is the start.

    An explicit method of order eight (Dormand, Prince) where its stability allows, else an implicit one of order five
    (Kvaerno); step sizes by error control, with a new start at each break of the motion.

    Args:
        model: gathered with `rank=1`, without batch axes of the arm's numbers.
        motion: the commanded motion.
        start: coordinates and their rates, (n,) each.
        times: increasing times at which the solution is wanted [s].
        rtol: relative tolerance of each step.
        atol: absolute tolerance of the coordinates [rad]; that of the rates is OMEGA as large.
        max_steps: steps of a section at which the integrator gives up.
        progress: shows how far it is, over the sections of the time span.

    Returns:
        The solution; where the user interrupts, up to the section before, which it says.

    Raises:
        ConvergenceError: the tolerance cannot be met.

    References:
        Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.5, II.10.
        Kvaerno, "Singly diagonally implicit Runge-Kutta methods with an explicit first stage", BIT 44, 2004.
    """
    if not np.isfinite(np.asarray(start[0])).all():
        raise ModelError(
            "the arm has no stable equilibrium where the motion starts; check stiffnesses, masses and units"
        )
    fastest = np.abs(np.linalg.eigvals(np.asarray(_linear(model, motion, start)))).max()  # rate at the start [1/s]
    method = "Dopri8" if float(fastest / REACH) < EXPLICIT_STEPS else "Kvaerno5"
    parts, steps, interrupted = [tuple(np.asarray(part)[:, None] for part in start)], 0, None
    sections, tolerances = _sections(times), (np.asarray(rtol), np.asarray(atol))
    try:
        for k in progress(range(len(sections))):
            state = parts[-1][0][:, -1], parts[-1][1][:, -1]
            answer = _solve(model, motion, state, sections[k], *tolerances, method, max_steps)
            solved, y, yd, took = map(np.asarray, answer)
            if not solved:
                raise ConvergenceError(
                    f"the simulation cannot meet its tolerance from {sections[k][0]:.4g} to {sections[k][-1]:.4g} s; "
                    "loosen the tolerance, or check stiffness, damping and motion there"
                )
            parts.append((y[:, 1:], yd[:, 1:]))
            steps += int(took)
    except KeyboardInterrupt:
        reached = (len(parts) - 1) * SAMPLES
        interrupted = float(times[reached]) if reached < len(times) - 1 else None
    y, yd = (np.concatenate(part, 1)[:, : len(times)] for part in zip(*parts, strict=True))
    return Exact(y, yd, steps, method, interrupted)


def _sections(times: Float[np.ndarray, "T"]) -> list[np.ndarray]:
    """Cut the times into sections of equal length, each beginning where the one before ends; the last may overhang."""
    count = -(-(len(times) - 1) // SAMPLES)
    beyond = times[-1] + (times[-1] - times[-2]) * np.arange(1, count * SAMPLES + 2 - len(times))
    whole = np.concatenate([times, beyond])
    return [whole[k * SAMPLES : (k + 1) * SAMPLES + 1] for k in range(count)]


@partial(jit, options=RUNS_ONCE)
def _linear(model: Multibody, motion: Motion, start: tuple[AnyArray, AnyArray]) -> Float[Array, "state state"]:
    """Return the derivatives of the rates at the start by the state there, by differences."""
    command = Command(*motion(motion.breaks[0]))

    def rates(state: Array) -> Array:
        y, yd = jnp.split(state, 2)
        return jnp.concatenate([yd, acceleration(model, command, y, yd)])

    state = jnp.concatenate(start)
    moved = jax.vmap(rates)(state + NEAR * jnp.eye(len(state) + 1, len(state)))
    return (moved[:-1] - moved[-1]).T / NEAR


@partial(jit, options=LONG_LOOPS)
def _solve(
    model: Multibody,
    motion: Motion,
    start: tuple[AnyArray, AnyArray],
    times: AnyArray,
    rtol: AnyArray,
    atol: AnyArray,
    method: str,
    max_steps: int,
) -> tuple[Array, Array, Array, Array]:
    import diffrax  # a program that is known needs no solver

    def rates(t: Any, state: tuple[Array, Array], _: Any) -> tuple[Array, Array]:
        y, v = state
        return OMEGA * v, acceleration(model, Command(*motion(t)), y, OMEGA * v) / OMEGA

    y, yd = start
    control = diffrax.PIDController(rtol=rtol, atol=atol)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        getattr(diffrax, method)(),
        times[0],
        times[-1],
        None,
        (y, yd / OMEGA),
        saveat=diffrax.SaveAt(ts=jnp.asarray(times)),
        stepsize_controller=diffrax.ClipStepSizeController(control, jump_ts=jnp.asarray(motion.breaks)),
        max_steps=max_steps,
        throw=False,
    )
    successful = solution.result == diffrax.RESULTS.successful
    y, v = (part.T for part in solution.ys)
    return successful, y, OMEGA * v, solution.stats["num_accepted_steps"]
