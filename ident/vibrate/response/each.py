"""The fast method for each of some arms, and for each of some sets of phases of what excites them, on all cores."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.jit import LONG_LOOPS, AnyArray, concrete, cores, is_traced, jit
from ident.vibrate.response.curved import refuse_curved
from ident.vibrate.response.fast import Fast
from ident.vibrate.response.fast_method import FastMethod, Linearised, Solution, vibration_of


def numbers_of(arm: Arm) -> dict[str, AnyArray]:
    """Return the numbers of an arm by path, but for those of its stroke, which is a motion already."""
    own = "" if arm.stroke is None else f"{arm.stroke.name}."
    return {path: x for path, x in arm.numbers().items() if not (own and path.startswith(own))}


def vibrations(
    arm: Arm,
    numbers: Mapping[str, Float[Array | np.ndarray, "batch"]],
    solve: FastMethod,
    sets: Sequence[Mapping[str, float]] = ({},),
    measure: Callable[[Float[np.ndarray, "3 T sets"]], np.ndarray] | None = None,
) -> Float[AnyArray, "*shape batch"]:
    """Return how the end point vibrates [m] with each of some numbers of the arm, by path; NaN where it collapses.

    Args:
        arm: the arm.
        numbers: all of it, see `numbers_of`: one program serves whichever differ.
        solve: the fast method.
        sets: numbers of what excites the arm, by path: with each of them instead, see `each_of`.
        measure: of an arm's vibrations with all sets `(3, T, sets)`; when None themselves, arms on a further axis.

    Raises:
        InputError: vibrations leave the tangents of curved springs, see `refuse_curved`.
    """

    def gather(of_sets: Any) -> Any:
        vibration, missed = of_sets if arm.springs else (of_sets, None)
        refuse_curved(arm, missed)
        return vibration if measure is None else measure(vibration)

    return each_of(arm, numbers, solve, _with_missed if arm.springs else vibration_of, sets, gather)


def _with_missed(solution: Solution) -> tuple[AnyArray, AnyArray | None]:
    return vibration_of(solution), solution.missed


def each_of(
    arm: Arm,
    numbers: Mapping[str, Array | np.ndarray],
    solve: FastMethod,
    keep: Callable[[Solution], Any],
    sets: Sequence[Mapping[str, float]] = ({},),
    gather: Callable[[Any], Any] = lambda of_sets: of_sets,
) -> Any:
    """Solve for an arm with each of these numbers (batch,), the last axis, and each of these sets, the one before.

    One after another on each core: one arm fills a core better than several side by side, whose intermediate values do
    not fit its cache. The linearised equations of an arm serve all sets. What is behind the samples is left out.

    Args:
        arm: the arm.
        numbers: all of it, by path.
        solve: the fast method.
        keep: gives what is kept of a solution, some of its times at once: arrays of rows and these times.
        sets: numbers of what excites the arm, by path; nothing else, for else the linearised equations are others.
        gather: gives what is kept of what an arm's sets have given, whose axis is the last.
    """
    samples, count = int(solve.samples), len(next(iter(numbers.values())))

    def cut(x: AnyArray) -> AnyArray:
        return x[..., :samples]

    turned = [{path: np.asarray(x) for path, x in own.items()} for own in sets]
    if is_traced(jax.tree.leaves((arm, numbers, solve))):
        solved = [jax.tree.map(cut, _traced(arm, dict(numbers), solve, keep, own)) for own in turned]
        arms = [jax.tree.map(lambda *x, k=k: jnp.stack([one[k] for one in x], -1), *solved) for k in range(count)]
        return jax.tree.map(lambda *x: jnp.stack(x, -1), *map(gather, arms))
    each = [{path: values[k, ...] for path, values in numbers.items()} for k in range(count)]

    def one(values: dict[str, Any], linear: Linearised, own: dict[str, Any]) -> Any:
        values = values | own
        response = _excited(arm, values, solve, linear)
        return jax.tree.map(cut, concrete(_sampled(arm, values, solve, linear, response, keep)))

    def gathered(of_sets: Sequence[Any]) -> Any:
        return gather(jax.tree.map(lambda *x: np.stack(x, -1), *of_sets))

    def all_sets(values: dict[str, Any]) -> Any:
        linear = linearised_for(arm, values, solve)
        return gathered([one(values, linear, own) for own in turned])

    if count >= cores():
        found = at_once([partial(all_sets, values) for values in each])
    else:
        linear = [linearised_for(arm, values, solve) for values in each]
        jobs = [partial(one, *pair, own) for pair in zip(each, linear, strict=True) for own in turned]
        done = at_once(jobs)
        found = [gathered(done[first : first + len(sets)]) for first in range(0, len(jobs), len(sets))]
    return jax.tree.map(lambda *x: np.stack(x, -1), *found)


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that solve: one a core, however many callers there are at once."""
    return ThreadPoolExecutor(cores(), "simulate")


def at_once(jobs: Sequence[Callable[[], Any]]) -> list[Any]:
    """Return what the jobs return, as many at once as there are cores; none of them may call this.

    The first to come compiles a program, for which the others wait.
    """
    futures = [_pool().submit(lambda job: jax.block_until_ready(job()), job) for job in jobs]
    try:
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()


@jit
def _traced(
    arm: Arm,
    numbers: dict[str, Any],
    solve: FastMethod,
    keep: Callable[[Solution], Any],
    own: dict[str, Any],
) -> Any:
    """Return what is kept of each arm, arms first, all by one program: for one that is traced or differentiated."""
    return jax.lax.map(lambda values: keep(solve(arm.replace(values | own))), numbers)


@jit
def linearised_for(arm: Arm, values: dict[str, Any], solve: FastMethod) -> Linearised:
    """Return the linearised equations of an arm with these numbers."""
    return solve.linearised(arm.replace(values))


@jit
def _excited(arm: Arm, values: dict[str, Array], solve: FastMethod, linear: Linearised) -> Fast:
    return solve.excited(arm.replace(values), linear)


@partial(jit, options=LONG_LOOPS)
def _sampled(
    arm: Arm,
    values: dict[str, Array],
    solve: FastMethod,
    linear: Linearised,
    solved: Fast,
    keep: Callable[[Solution], Any],
) -> Any:
    return solve.sampled(arm.replace(values), linear, solved, keep)
