"""The unknowns: names, values, transforms, ties and priors."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

from ident.arm.arm import DAMPING, STIFFNESS, Arm, stiffness_paths
from ident.errors import InputError, Problem
from ident.identify.priors import Prior
from ident.text import did_you_mean

AnyArray = Array | np.ndarray
POSITIVE = ("mass", *STIFFNESS, *DAMPING)
"""Fields that are fitted as logarithms."""
WEAK_PRIOR = 1.0
"""Default standard deviation of ln(stiffness) about the arm file's value: a factor of 7 each way covers 95 %."""
LENGTH_SCALE = 0.1
"""Unit [m] in which a coordinate without a prior is fitted, so that all unknowns are of order one."""


class Parameter(eqx.Module):
    """One unknown number; with several paths, numbers that are tied to be equal.

    The fit works in theta: ln(value) for positive quantities, value / scale for the others. The prior, if any, is
    flat in theta within `flat` of the centre and normal beyond; with flat = 0, log-normal for positive quantities.

    Attributes:
        paths: where the number sits in the model; the first one names the parameter.
        positive: fitted as its logarithm.
        start: the value that the fit starts from.
        centre: the prior's median.
        prior_sd: standard deviation in theta of the prior's normal flanks; infinite for no prior.
        scale: unit of theta for quantities of either sign.
        flat: half the length in theta of the prior's flat part.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    positive: bool = eqx.field(static=True)
    start: Float[AnyArray, ""]
    centre: Float[AnyArray, ""]
    prior_sd: Float[AnyArray, ""]
    scale: Float[AnyArray, ""]
    flat: Float[AnyArray, ""]

    def __init__(
        self,
        paths: tuple[str, ...],
        positive: bool,
        start: Any,
        centre: Any,
        prior_sd: Any = math.inf,
        scale: Any = 1.0,
        flat: Any = 0.0,
    ):
        self.paths, self.positive = paths, positive
        # arrays, so that other values need no new compilation
        self.start, self.centre, self.prior_sd, self.scale, self.flat = (
            np.asarray(x, float) for x in (start, centre, prior_sd, scale, flat)
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

    def column(self, field: str) -> Float[AnyArray, "P"]:
        """Return one field of all parameters."""
        values = [getattr(item, field) for item in self.items]
        return _library(*values).stack(values)

    @property
    def positive(self) -> np.ndarray:
        """Which are fitted as logarithms."""
        return np.array([item.positive for item in self.items])

    def theta(self, values: Float[AnyArray, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the unconstrained coordinates of physical values."""
        positive, scale = self._aligned(values)
        xp = _library(values, scale)
        with np.errstate(divide="ignore", invalid="ignore"):  # as in jax: a value that can't be has no theta
            return xp.where(positive, xp.log(xp.where(positive, values, 1.0)), values / scale)

    def values(self, theta: Float[AnyArray, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the physical values of unconstrained coordinates."""
        positive, scale = self._aligned(theta)
        xp = _library(theta, scale)
        with np.errstate(over="ignore"):
            return xp.where(positive, xp.exp(xp.where(positive, theta, 0.0)), theta * scale)

    def prior_residuals(self, theta: Float[Array, "P *batch"]) -> tuple[Array, Array]:
        """Return the priors' residuals and their slopes by theta, `(P, *batch)` both.

        Half the sum of squares is the negative logarithm of the prior density, up to a constant. A slope is the
        inverse of a standard deviation; zero where the prior is flat.
        """
        centre, sd, flat = self._prior(theta.ndim)
        off = theta - centre
        beyond = jnp.sign(off) * jnp.maximum(jnp.abs(off) - flat, 0.0)
        return beyond / sd, jnp.where(jnp.abs(off) >= flat, 1 / sd, 0.0)

    def log_prior(self, theta: Float[Array, "P *batch"]) -> Float[Array, "*batch"]:
        """Return the logarithm of the prior density of theta; parameters without a prior count nothing."""
        _, sd, flat = self._prior(1)
        mass = jnp.where(jnp.isfinite(sd), 2 * flat + sd * math.sqrt(2 * math.pi), 1.0)
        return -(self.prior_residuals(theta)[0] ** 2).sum(0) / 2 - jnp.log(mass).sum()

    def from_uniform(self, u: Float[Array, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the theta at which the priors' distribution functions are u; NaN without a prior."""
        centre, sd, flat = self._prior(u.ndim)
        flank = sd * math.sqrt(math.pi / 2)
        whole = 2 * (flat + flank)
        below = sd * ndtri(jnp.minimum(u * whole / (2 * flank), 0.5))
        above = -sd * ndtri(jnp.minimum((1 - u) * whole / (2 * flank), 0.5))
        return centre + below + jnp.clip((u - 0.5) * whole, -flat, flat) + above

    @property
    def normal_sd(self) -> np.ndarray:
        """Standard deviations in theta of normal priors of about the same width; infinite without a prior."""
        return np.hypot(np.asarray(self.column("prior_sd")), np.asarray(self.column("flat")) / math.sqrt(3))

    @property
    def proper(self) -> np.ndarray:
        """Which parameters have a prior."""
        return np.isfinite(np.asarray(self.column("prior_sd")))

    def by_path(self, values: Float[AnyArray, "P *batch"]) -> dict[str, Any]:
        """Return the physical values by path, ties spelled out."""
        return {path: value for item, value in zip(self.items, values, strict=True) for path in item.paths}

    def _aligned(self, x: AnyArray) -> tuple[np.ndarray, AnyArray]:
        shape = (-1,) + (1,) * (x.ndim - 1)
        return self.positive.reshape(shape), self.column("scale").reshape(shape)

    def _prior(self, rank: int) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Return centre, standard deviation and flat half-length in theta, aligned with an array of this rank."""
        columns = self.theta(self.column("centre")), self.column("prior_sd"), self.column("flat")
        centre, sd, flat = (x.reshape((-1,) + (1,) * (rank - 1)) for x in columns)
        return centre, sd, flat


def _library(*arrays: Any) -> Any:
    """Return NumPy where all is NumPy's, for there each operation of jax would be a program of its own; else jax."""
    return np if all(isinstance(x, np.ndarray) for x in arrays) else jnp


def parameter(
    arm: Arm,
    *paths: str,
    start: float | None = None,
    prior_sd: float = math.inf,
    centre: float | None = None,
    prior: Prior | None = None,
) -> Parameter:
    """Make one number of the arm, or several tied ones, an unknown.

    Args:
        arm: gives the value that start and centre default to.
        paths: as in `Arm.get`; several are fitted as one number.
        start: where the fit starts.
        prior_sd: of ln(value) for masses, stiffnesses and damping, of the value itself in its SI unit otherwise.
        centre: the prior's median.
        prior: the prior in place of `centre` and `prior_sd`, for a positive quantity.

    Raises:
        InputError: no such number, a positive quantity whose value is not, or a prior for ln of one of either sign.
    """
    value = next(float(arm.get(path)) for path in paths)
    positive = all(path.split(".")[1] in POSITIVE for path in paths)
    flat, start = 0.0, value if start is None else start
    if prior is not None:
        if not positive:
            got = f"a prior on ln({paths[0]}), which may be negative"
            raise InputError(Problem("", got, "a mass, a stiffness or a damping time", "use --free NAME:WIDTH"))
        centre, prior_sd = math.sqrt(prior.low * prior.high), prior.sd
        flat = math.log(prior.high / prior.low) / 2
    centre = value if centre is None else centre
    if positive and not (start > 0 and centre > 0):
        remedy = f"give {paths[0]} a positive value in the arm file, or keep it (--fix {paths[0]})"
        raise InputError(Problem("", f"{min(start, centre):g}", "a value > 0", remedy, paths[0]))
    if not prior_sd > 0:
        raise InputError(Problem("", f"a prior width of {prior_sd:g}", "a width > 0", "correct it", paths[0]))
    scale = 1.0 if positive else (prior_sd if math.isfinite(prior_sd) else LENGTH_SCALE)
    return Parameter(paths, positive, start, centre, prior_sd / scale, scale, flat)


def stiffness_parameters(
    arm: Arm,
    *,
    fixed: Iterable[str] = (),
    tied: Iterable[tuple[str, ...]] = (),
    free: Mapping[str, float] | None = None,
    prior_sd: float = WEAK_PRIOR,
    priors: Mapping[str, Prior] | None = None,
    damping: bool = False,
) -> Parameters:
    """Make the bushing stiffnesses of all driven joints unknown, and whatever else is asked for.

    Args:
        arm: the arm.
        fixed: paths to keep at the arm's value.
        tied: groups of paths fitted as one number each.
        free: further paths with the width of their priors (see `parameter`; `math.inf` for none).
        prior_sd: width of the stiffnesses' log-normal priors about the arm's values; `math.inf` for none.
        priors: priors of single parameters by path, in place of that one.
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
    if not unknown:
        raise InputError(Problem("", "no unknown", "at least one", "fix fewer parameters"))
    own = dict(priors or {})
    for path in own:
        if not any(path in group for group in unknown):
            known = [path for group in unknown for path in group]
            remedy = did_you_mean(path, known, "free it, or drop its prior")
            raise InputError(Problem("", f"a prior for {path}, which is not fitted", "an unknown", remedy))
    return Parameters(tuple(_in_group(arm, group, widths, own) for group in unknown))


def _in_group(arm: Arm, group: tuple[str, ...], widths: Mapping[str, float], priors: Mapping[str, Prior]) -> Parameter:
    width = next(widths[path] for path in group if path in widths)
    return parameter(arm, *group, prior_sd=width, prior=next((priors[path] for path in group if path in priors), None))


def _refuse_twice(paths: list[str]) -> None:
    for path in paths:
        if paths.count(path) > 1:
            remedy = "name it once among the fixed and the tied"
            raise InputError(Problem("", f"{path} twice", "each parameter once", remedy))
