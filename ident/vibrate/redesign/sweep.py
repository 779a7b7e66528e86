"""How the vibration depends on one or two numbers of the arm, or on its speed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.drive_check import check_drives
from ident.arm.fields import SPEED
from ident.errors import InputError, Problem
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.variable import Variable, apply, check_path, is_shifted, refuse_factor
from ident.vibrate.response.exact import Progress


@dataclass(frozen=True)
class Axis:
    """A number that is swept.

    Attributes:
        paths: the numbers that are changed together, see `Variable`; `("speed",)` for the speed.
        values: (K,) of the first of them [SI], or [%]
        present: as it is [SI or %]
    """

    paths: tuple[str, ...]
    values: Float[np.ndarray, "K"]
    present: float

    @property
    def name(self) -> str:
        """The paths with = between."""
        return "=".join(self.paths)

    @property
    def is_speed(self) -> bool:
        """Whether it is the speed of the motion."""
        return self.paths == (SPEED,)

    @property
    def shifted(self) -> bool:
        """Whether it is changed by a difference, not by a factor."""
        return is_shifted(self.paths[0])

    @property
    def variable(self) -> Variable:
        """The same as what may be changed."""
        return Variable(self.paths, float(self.values.min()), float(self.values.max()))


@dataclass(frozen=True)
class Sweep:
    """Amplitudes over a grid.

    Attributes:
        axes: one or two.
        measure: of the vibration, see `amplitude.MEASURES`.
        amplitude: (3, *grid) [m] of the arm itself.
        present: (3,) [m] as the arm is.
        draws: (3, *grid, D) [m] of draws; None without.
    """

    axes: tuple[Axis, ...]
    measure: str
    amplitude: Float[np.ndarray, "3 *grid"]
    present: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 *grid D"] | None = None

    @property
    def band(self) -> Float[np.ndarray, "2 3 *grid"]:
        """5 and 95 % quantiles over the draws [m]."""
        assert self.draws is not None
        return np.quantile(self.draws, (0.05, 0.95), axis=-1)

    def exceeds(self, limit: float) -> Float[np.ndarray, "*grid"]:
        """Return the share of draws that exceed a limit [m] in any direction."""
        assert self.draws is not None
        return (self.draws > limit).any(0).mean(-1)


def axis(arm: Arm, paths: Sequence[str], values: Float[np.ndarray, "K"], percent: float) -> Axis:
    """Return an axis; its present value is the arm's, or the percentage of the motion at hand."""
    values = np.unique(np.asarray(values, float))
    name = "=".join(paths)
    if not np.isfinite(values).all():
        raise InputError(Problem(name, "values that are not finite", "finite numbers", "correct them"))
    if tuple(paths) == (SPEED,):
        present = percent
    else:
        for path in paths:
            check_path(arm, path)
        present = float(arm.get(paths[0]))
    if not is_shifted(paths[0]) and (problems := list(refuse_factor(paths[0], present, values[[0, -1]]))):
        raise InputError(replace(problem, where=name) for problem in problems)
    return Axis(tuple(paths), values, present)


def sweep(evaluator: Evaluator, axes: Sequence[Axis], progress: Progress = iter) -> Sweep:
    """Simulate a motion at every point of a grid, and for every draw, by the fast method.

    A number is changed by a factor or a difference, which is that of every draw. At another speed the same path is
    passed on another clock, pauses included, and sampled as often.

    Args:
        evaluator: arm, motion and measure; it changes nothing by itself.
        axes: one or two, of which one may be the speed.
        progress: shows how far it is, over batches of simulations.

    Raises:
        InputError: see `simulate`; axes that share a number.
        ModelError: the arm has no stable equilibrium at some point of the grid, which is named.
    """
    _check(evaluator.arm, axes)
    if len(axes) > 2:
        raise InputError(Problem("axes", f"{len(axes)} of them", "one or two", "drop one"))
    turning = [axis for axis in axes if not axis.is_speed]
    points = list(product(*(axis.values for axis in turning)))
    places = np.array(points).reshape((len(points), len(turning)))
    evaluator = replace(evaluator, variables=tuple(axis.variable for axis in turning))
    ratios = [value / axis.present for axis in axes if axis.is_speed for value in axis.values]
    changes = _changes(evaluator, places)
    if ratios:
        present, whole = _at_speeds(evaluator, changes, ratios, progress)
    else:
        present, whole = np.split(evaluator.amplitudes(np.vstack([0 * changes[:1], changes]), progress), [1], 1)
    order = [axis for axis in axes if axis.is_speed] + turning
    whole = whole.reshape((3, *(len(axis.values) for axis in order), -1))
    whole = np.moveaxis(whole, [1 + order.index(axis) for axis in axes], range(1, 1 + len(axes)))
    own = whole[..., 1:] if evaluator.draws else None
    return Sweep(tuple(axes), evaluator.measure, whole[..., 0], present[:, 0, 0], own)


def sweeps(evaluator: Evaluator, axes: Sequence[Axis], progress: Progress = iter) -> tuple[Sweep, ...]:
    """Sweep several numbers one by one, the others as they are; all but the speed in one batch. See `sweep`."""
    _check(evaluator.arm, axes)
    turning = [axis for axis in axes if not axis.is_speed]
    by_name: dict[str, Sweep] = {axis.name: sweep(evaluator, [axis], progress) for axis in axes if axis.is_speed}
    if turning:
        evaluator = replace(evaluator, variables=tuple(axis.variable for axis in turning))
        as_it_is = np.array([axis.present for axis in turning])
        places = [np.where(np.arange(len(turning)) == k, x, as_it_is) for k, a in enumerate(turning) for x in a.values]
        whole = evaluator.amplitudes(_changes(evaluator, np.array([as_it_is, *places])), progress)
        ends = np.cumsum([1, *(len(axis.values) for axis in turning)])
        for axis, first, end in zip(turning, ends, ends[1:], strict=False):
            part = whole[:, first:end]
            own = part[..., 1:] if evaluator.draws else None
            by_name[axis.name] = Sweep((axis,), evaluator.measure, part[..., 0], whole[:, 0, 0], own)
    return tuple(by_name[axis.name] for axis in axes)


def _at_speeds(
    evaluator: Evaluator, changes: np.ndarray, ratios: Sequence[float], progress: Progress
) -> tuple[Float[np.ndarray, "3 1 D"], Float[np.ndarray, "3 places D"]]:
    """Simulate as it is and at several speeds, with as many samples and steps at each as at the slowest."""
    slowest = min(ratios)
    step = evaluator.step or replace(evaluator, motion=evaluator.motion.at_speed(100 * slowest)).step_for(changes)

    def run(ratio: float, changes: np.ndarray) -> Float[np.ndarray, "3 G D"]:
        clock, moved = ratio / slowest, evaluator.motion.at_speed(100 * ratio)
        return replace(evaluator, motion=moved, rate=evaluator.rate * clock, step=step / clock).amplitudes(changes)

    parts = [run(ratios[k], changes) for k in progress(range(len(ratios)))]
    return run(1.0, 0 * changes[:1]), np.concatenate(parts, 1)


def _changes(evaluator: Evaluator, places: Float[np.ndarray, "G V"]) -> Float[np.ndarray, "G V"]:
    columns = [
        np.asarray(v.change(evaluator.arm, column)) for v, column in zip(evaluator.variables, places.T, strict=True)
    ]
    return np.stack(columns, 1) if columns else np.zeros((len(places), 0))


def _check(arm: Arm, axes: Sequence[Axis]) -> None:
    """Refuse axes that share a number, and values that it can't have."""
    paths = [path for axis in axes for path in axis.paths]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if not axes or twice:
        got = f"{twice} twice" if twice else "nothing"
        raise InputError(Problem("axes", got, "different numbers", "drop one" if twice else "name one"))
    for axis in axes:
        for end in () if axis.is_speed else (axis.values[0], axis.values[-1]):
            variable = axis.variable
            check_drives(arm.replace(apply(arm.numbers(), [variable], [variable.change(arm, end)])))
