"""The unknowns: names, values, transforms, ties and priors."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import DAMPING, STIFFNESS, Arm, stiffness_paths
from ident.errors import InputError, Problem

POSITIVE = ("mass", *STIFFNESS, *DAMPING)
"""Fields that are fitted as logarithms."""
WEAK_PRIOR = 1.0
"""Default standard deviation of ln(stiffness) about the arm file's value: a factor of 7 each way covers 95 %."""
LENGTH_SCALE = 0.1
"""Unit [m] in which a coordinate without a prior is fitted, so that all unknowns are of order one."""


class Parameter(eqx.Module):
    """One unknown number; with several paths, numbers that are tied to be equal.

    The fit works in theta: ln(value) for positive quantities, value / scale for the others. The prior, if any, is
    normal in theta, so log-normal for positive quantities.

    Attributes:
        paths: where the number sits in the model; the first one names the parameter.
        positive: fitted as its logarithm.
        start: the value that the fit starts from.
        centre: the prior's median.
        prior_sd: the prior's standard deviation in theta; infinite for no prior.
        scale: unit of theta for quantities of either sign.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    positive: bool = eqx.field(static=True)
    start: Float[Array, ""]
    centre: Float[Array, ""]
    prior_sd: Float[Array, ""]
    scale: Float[Array, ""]

    def __init__(
        self,
        paths: tuple[str, ...],
        positive: bool,
        start: Any,
        centre: Any,
        prior_sd: Any = math.inf,
        scale: Any = 1.0,
    ):
        self.paths, self.positive = paths, positive
        # arrays, so that other values need no new compilation
        self.start, self.centre, self.prior_sd, self.scale = (
            jnp.asarray(x, float) for x in (start, centre, prior_sd, scale)
        )

    @property
    def name(self) -> str:
        """The first path."""
        return self.paths[0]


class Parameters(eqx.Module):
    """The unknowns of a problem, in the order of theta."""

    items: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in order."""
        return tuple(item.name for item in self.items)

    def column(self, field: str) -> Float[Array, "P"]:
        """Return one field of all parameters."""
        return jnp.stack([getattr(item, field) for item in self.items])

    @property
    def positive(self) -> np.ndarray:
        """Which are fitted as logarithms."""
        return np.array([item.positive for item in self.items])

    def theta(self, values: Float[Array, "P *batch"]) -> Float[Array, "P *batch"]:
        """Return the unconstrained coordinates of physical values."""
        positive, scale = self._aligned(values)
        return jnp.where(positive, jnp.log(jnp.where(positive, values, 1.0)), values / scale)

    def values(self, theta: Float[Array, "P *batch"]) -> Float[Array, "P *batch"]:
        """Return the physical values of unconstrained coordinates."""
        positive, scale = self._aligned(theta)
        return jnp.where(positive, jnp.exp(jnp.where(positive, theta, 0.0)), theta * scale)

    def by_path(self, values: Float[Array, "P *batch"]) -> dict[str, Array]:
        """Return the physical values by path, ties spelled out."""
        return {path: value for item, value in zip(self.items, values, strict=True) for path in item.paths}

    def _aligned(self, x: Array) -> tuple[np.ndarray, Array]:
        shape = (-1,) + (1,) * (x.ndim - 1)
        return self.positive.reshape(shape), self.column("scale").reshape(shape)


def parameter(
    arm: Arm, *paths: str, start: float | None = None, prior_sd: float = math.inf, centre: float | None = None
) -> Parameter:
    """Make one number of the arm, or several tied ones, an unknown.

    Args:
        arm: gives the value that start and centre default to.
        paths: as in `Arm.get`; several are fitted as one number.
        start: where the fit starts.
        prior_sd: of ln(value) for masses, stiffnesses and damping, of the value itself in its SI unit otherwise.
        centre: the prior's median.

    Raises:
        InputError: no such number, or a positive quantity whose value is not.
    """
    value = next(float(arm.get(path)) for path in paths)
    positive = all(path.split(".")[1] in POSITIVE for path in paths)
    start = value if start is None else start
    centre = value if centre is None else centre
    if positive and not (start > 0 and centre > 0):
        remedy = f"give {paths[0]} a positive value in the arm file, or keep it (--fix {paths[0]})"
        raise InputError(Problem("", f"{min(start, centre):g}", "a value > 0", remedy, paths[0]))
    if not prior_sd > 0:
        raise InputError(Problem("", f"a prior width of {prior_sd:g}", "a width > 0", "correct it", paths[0]))
    scale = 1.0 if positive else (prior_sd if math.isfinite(prior_sd) else LENGTH_SCALE)
    return Parameter(paths, positive, start, centre, prior_sd / scale, scale)


def stiffness_parameters(
    arm: Arm,
    *,
    fixed: Iterable[str] = (),
    tied: Iterable[tuple[str, ...]] = (),
    free: Mapping[str, float] | None = None,
    prior_sd: float = WEAK_PRIOR,
    damping: bool = False,
) -> Parameters:
    """Make the bushing stiffnesses of all driven joints unknown, and whatever else is asked for.

    Args:
        arm: the arm.
        fixed: paths to keep at the arm's value.
        tied: groups of paths fitted as one number each.
        free: further paths with the width of their priors (see `parameter`; `math.inf` for none).
        prior_sd: width of the stiffnesses' log-normal priors about the arm's values; `math.inf` for none.
        damping: whether damping per stiffness is unknown as well: one number for all bending, one for all torsion.

    Raises:
        InputError: a path that the arm has not, one that is named twice, or nothing left to fit.
    """
    undriven = {joint.name for joint in arm.joints if not joint.driven}
    widths = {path: prior_sd for path in stiffness_paths(arm) if path.split(".")[0] not in undriven}
    widths |= dict(free or {})
    fixed, groups = tuple(fixed), [tuple(group) for group in tied]
    taken = [*fixed, *(path for group in groups for path in group)]
    for path in (*widths, *taken):
        arm.get(path)
    _refuse_twice(taken)
    if damping:
        whole = [tuple(f"{joint.name}.{field}" for joint in arm.joints) for field in DAMPING]
        groups += [rest for group in whole if (rest := tuple(path for path in group if path not in taken))]
        widths |= {path: prior_sd for group in whole for path in group if path not in fixed}
    group_of = {path: group for group in groups for path in group}
    unknown = dict.fromkeys(group_of.get(path, (path,)) for path in widths if path not in fixed)
    for group in groups:
        if group not in unknown:
            got, remedy = "=".join(group), "free one of them too"
            raise InputError(Problem("", got, "at least one unknown among them", remedy))
    items = [
        parameter(arm, *group, prior_sd=next(widths[path] for path in group if path in widths)) for group in unknown
    ]
    if not items:
        raise InputError(Problem("", "no unknown", "at least one", "fix fewer parameters"))
    return Parameters(tuple(items))


def _refuse_twice(paths: list[str]) -> None:
    for path in paths:
        if paths.count(path) > 1:
            remedy = "name it once among the fixed and the tied"
            raise InputError(Problem("", f"{path} twice", "each parameter once", remedy))
