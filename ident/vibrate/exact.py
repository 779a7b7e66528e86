"""The exact equations of motion integrated in time, with error control.

The coordinates are y = y_r(t) + x, with y_r and the linearised equations as in `fast`. At the stages of each step of
Gauss's method, of order six,

    residual(y, dy/dt, d2y/dt2) = 0

is solved by Newton's method for some steps together: the residual that is left excites the linearised equations, whose
solution is the correction. Their derivatives are those at rest, so corrections shrink by a constant factor only, some
hundred on the paper's arm, less the more it vibrates; what they converge to is exact. As the mass matrix changes with
the vibration, the residual is first multiplied by the mass matrix at rest and by the inverse of that where these steps
begin: so fine steps converge however much the arm vibrates. Steps are halved until the solution does not change.

References:
    Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", 1993, II.7 (Gauss methods).
    Deuflhard, "Newton Methods for Nonlinear Problems", 2004, section 2.1 (simplified Newton method).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.multibody import Command, mass_and_forces, residual
from ident.arm.rotations import matvec
from ident.errors import ConvergenceError, InputError
from ident.programs import LONG_LOOPS, AnyArray, concrete, jit
from ident.vibrate.fast import (
    EDGE_SLOPES,
    EDGE_VALUES,
    Fast,
    FastMethod,
    Linearised,
    Numbers,
    Solution,
    by_stage,
    linearised_for,
    numbers_of,
    on_device,
    refuse_collapse,
    sampled_for,
    samples_of,
    stepped,
)
from ident.vibrate.linear import (
    A2,
    FEWEST,
    GAUSS,
    STAGES,
    STEPS,
    A,
    Linear,
    advance,
    initial_equilibrium,
    interpolate,
    where,
)
from ident.vibrate.motion import Motion, command

RTOL, ATOL = 1e-6, 1e-10
"""By how much halving the steps may change the coordinates at the samples: relative to their largest change over the
motion, and [rad]. What is returned errs some 60 times less, by the order of the method; twice to ten times less where a
spring breaks or a belt goes slack, which costs the order. Rates between the steps err more, by 1e-5 of the largest."""
HALVINGS = 9
"""How often the steps are halved at most."""
CORRECTION, CORRECTIONS = 1e-12, 60
"""Largest correction of coordinates [rad] that ends Newton's method, and how many there are at most: 3 to 7 are needed,
where a spring is curved or a belt goes slack up to 35."""

State = tuple[AnyArray, AnyArray]
"""Coordinates and their rates, (n,) each [rad, rad/s]."""


def integrate(
    arm: Arm,
    motion: Motion,
    method: Callable[[float], FastMethod],
    step: float,
    start: State | None = None,
    *,
    rtol: float = RTOL,
    atol: float = ATOL,
    halvings: int = HALVINGS,
) -> Solution:
    """Integrate with steps halved until the solution does not change.

    Args:
        arm: the arm, without batch axes.
        motion: the commanded motion.
        method: gives the fast method for steps of a length [s].
        step: length of the first steps [s].
        start: at the first break of the motion; at rest in equilibrium when None.
        rtol: largest change of coordinates by the last halving, relative to that over the motion.
        atol: the same [rad], which is added.
        halvings: of the steps at most.

    Raises:
        ModelError: the arm collapses.
        ConvergenceError: the tolerance cannot be met.
    """
    setup = method(step)
    step = min(step, float(setup.grid.step.max()))  # where intervals are shorter, halving it would change nothing
    coarse = solved(arm, setup, start)
    refuse_collapse(motion, coarse.quasi_static)
    for _ in range(halvings):
        step /= 2
        try:
            setup = method(step)
        except InputError:  # too many steps
            break
        fine = solved(arm, setup, start)
        change, size = np.abs(fine.y - coarse.y).max(), np.abs(fine.y - fine.y[:, :1]).max()
        if change <= atol + rtol * size:
            return fine
        coarse = fine
    raise ConvergenceError(
        f"the simulation of {motion.name} cannot meet its tolerance with steps of {step:.2g} s; check stiffness, "
        "damping and motion: the arm may vibrate too much"
    )


def solved(arm: Arm, method: FastMethod, start: State | None = None) -> Solution:
    """Solve with the steps of a fast method, some intervals at a time, so that one program serves any number.

    NaN stands from where on Newton's method does not converge.

    Args:
        arm: the arm, without batch axes.
        method: the fast method for it.
        start: see `integrate`.
    """
    arm, values = on_device(arm), Numbers.of(numbers_of(arm))
    time, motion, grid, parts = method.samples.wanted, concrete(method.motion), concrete(method.grid), []
    firsts = range(0, int(np.isfinite(grid.start).sum()), FEWEST)
    times = np.split(time, np.searchsorted(time, grid.start[list(firsts[1:])]))
    at_rest = start is None
    state: AnyArray = np.zeros(0) if start is None else np.concatenate(start)
    for first, within in zip(firsts, times, strict=True):
        some = slice(first, first + FEWEST)
        own, inside = grid._replace(start=grid.start[some], step=grid.step[some]), within if len(within) else time[:1]
        part = replace(method.without_samples, grid=own)
        linear = linearised_for(arm, values, part)
        state = np.zeros(2 * linear.equations.quasi_static.shape[1]) if at_rest else state
        here, state = _solved(arm, values, part, linear, np.asarray(at_rest), state)
        at_rest = False
        sampled = replace(part, samples=samples_of(motion, inside))
        parts.append(concrete(sampled_for(arm, values, {}, sampled, linear, here, FastMethod.solution)))

    def joined(*sampled: np.ndarray) -> np.ndarray:
        return np.concatenate([x[0, ..., : len(within)] for x, within in zip(sampled, times, strict=True)], -1)

    return jax.tree.map(joined, *parts)


@partial(jit, options=LONG_LOOPS)
def _solved(
    arm: Arm, values: Numbers, method: FastMethod, linear: Linearised, at_rest: AnyArray, state: AnyArray
) -> tuple[Fast, Array]:
    """Return the solution within a grid, behind an axis of one as `sampled_for` takes it, and the state at its end."""
    arm = values.set_in(arm)
    model, motion, grid, at = method.model(arm), method.motion, method.grid, method.weights
    n, chunks = model.size, jax.tree.map(jnp.asarray, (at.within, at.middles, at.in_steps, at.stages))

    def from_rest(state: Array) -> Array:
        y, K = (interpolate(part[0], EDGE_VALUES)[..., 0] for part in (linear.equations[0], linear.equations.K))
        return jnp.concatenate([initial_equilibrium(model, motion, y, K), jnp.zeros(n)])

    def interval(state: Array, given: tuple[Array, Array, Linear]) -> tuple[Array, tuple]:
        start, h, here = given
        value, slope = (interpolate(here.quasi_static, W) for W in (EDGE_VALUES, EDGE_SLOPES))
        reference = jnp.concatenate([value, slope / (h * at.steps)])  # y_r and its rate at both ends
        push = advance(h, n)[1]

        def some_steps(z: Array, given: tuple[Array, ...]) -> tuple[Array, tuple]:
            within, middles, in_steps, stages = given
            real, commanded = within < at.steps, command(model, motion, start + h * in_steps)
            line = [interpolate(here.quasi_static, stages[k]) / (h * at.steps) ** k for k in range(3)]
            begun, rest = Command(*(part[:, 0] for part in commanded)), line[0][:, 0]
            still, moved = (mass_and_forces(model, begun, y, 0 * y)[0] for y in (rest, rest + z[:n]))
            balance = still @ jnp.linalg.inv(moved)

            def corrected(now: tuple) -> tuple:
                count, size, (z, states, a), shift = now
                y, yd, ydd = (part + x for part, x in zip(line, _at_stages(h, states, a), strict=True))
                off = residual(model, commanded, y, yd, ydd)
                off = off if here.lost is None else off + matvec(interpolate(here.lost, stages[0]), yd)
                more = stepped(here, middles, real, push, shift, by_stage(-balance @ off))
                size = jnp.abs(more[1][:, :n]).max() + h * h * jnp.abs(jnp.where(real[:, None], more[2], 0.0)).max()
                return count + 1, size, jax.tree.map(jnp.add, (z, states, a), more), jnp.zeros_like(shift)

            def go_on(now: tuple) -> Array:
                return (now[1] > CORRECTION) & (now[0] < CORRECTIONS)

            none = jnp.zeros(2 * n), *(jnp.zeros((STEPS, row)) for row in rows)
            _, size, found, _ = jax.lax.while_loop(go_on, corrected, (0, jnp.inf, none, z))
            z, *parts = jax.tree.map(lambda x: jnp.where(size <= CORRECTION, x, jnp.nan), found)
            return z, tuple(parts)

        guarded = where(lambda given: given[0][0] < at.steps, some_steps, *((STEPS, row) for row in rows))
        z, parts = jax.lax.scan(guarded, state - reference[:, 0], chunks)
        return z + reference[:, 1], tuple(part.reshape((-1, part.shape[-1])) for part in parts)

    rows = 2 * n, STAGES * n
    times = jnp.asarray(grid.start), jnp.asarray(grid.step)
    guarded = where(lambda given: jnp.isfinite(given[0]), interval, *((at.within.size, row) for row in rows))
    first: Array = jax.lax.cond(at_rest, from_rest, lambda state: state, jnp.asarray(state))
    last, (states, a) = jax.lax.scan(guarded, first, (*times, linear.equations))
    whole = Fast(states, a.reshape((*a.shape[:2], STAGES, -1)), linear.equations.quasi_static)
    return jax.tree.map(lambda x: x[None], whole), last


def _at_stages(
    h: Array, states: Float[Array, "S state"], a: Float[Array, "S stages"]
) -> list[Float[Array, "n places"]]:
    """Return x and its two derivatives at the stages of some steps, by the states at their starts, in order of time."""
    a = a.reshape((len(a), STAGES, -1))
    x, v = (part[:, None] for part in jnp.split(states, 2, 1))
    once, twice = (jnp.einsum("ij,sjn->sin", jnp.asarray(W), a) for W in (A, A2))
    at = x + h * GAUSS[:, None] * v + h * h * twice, v + h * once, a
    return [part.reshape((-1, part.shape[-1])).T for part in at]
