"""The unknowns: names, values, transforms, ties and priors."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array, Float

AnyArray = Array | np.ndarray


class Parameter(eqx.Module):
    """One unknown; with several paths, numbers tied to be equal.

    The fit works in theta: ln(value) for positive quantities, value / scale for the others. The prior, if any, is
    flat in theta within `flat` of the centre and normal beyond; with flat = 0, log-normal for positive quantities.

    Attributes:
        paths: of the number in the model; the first one names the parameter.
        positive: fitted as its logarithm.
        start: starting value of the fit.
        centre: the prior's median.
        prior_sd: standard deviation in theta of the prior's normal flanks; infinite for no prior.
        scale: unit of theta for quantities of either sign.
        flat: half the length in theta of the prior's flat part.
        nuisance: whether it is not of interest in itself, but uncertain within its prior.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    positive: bool = eqx.field(static=True)
    start: Float[AnyArray, ""]
    centre: Float[AnyArray, ""]
    prior_sd: Float[AnyArray, ""]
    scale: Float[AnyArray, ""]
    flat: Float[AnyArray, ""]
    nuisance: bool = eqx.field(static=True, default=False)
    __getattribute__ = object.__getattribute__

    def __init__(
        self,
        paths: tuple[str, ...],
        positive: bool,
        start: Any,
        centre: Any,
        prior_sd: Any = math.inf,
        scale: Any = 1.0,
        flat: Any = 0.0,
        *,
        nuisance: bool = False,
    ):
        self.paths, self.positive, self.nuisance = paths, positive, nuisance
        # arrays, so that new values need no new compilation
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
    __getattribute__ = object.__getattribute__  # equinox's makes a module of each method: half the time of a fit

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in order."""
        return tuple(item.name for item in self.items)

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the unknowns in the model, ties spelled out."""
        return tuple(path for item in self.items for path in item.paths)

    def column(self, field: str) -> Float[AnyArray, "P"]:
        """Return one field of all parameters."""
        values = [getattr(item, field) for item in self.items]
        return library(*values).stack(values)

    @property
    def theta_start(self) -> np.ndarray:
        """Starting theta of the fit."""
        return np.asarray(self.theta(self.column("start")))

    @property
    def theta_centre(self) -> np.ndarray:
        """Theta of the priors' medians."""
        return np.asarray(self.theta(self.column("centre")))

    @property
    def positive(self) -> np.ndarray:
        """Which are fitted as logarithms."""
        return np.array([item.positive for item in self.items])

    def theta(self, values: Float[AnyArray, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the unconstrained coordinates of physical values."""
        positive, scale = self._aligned(values)
        xp = library(values, scale)
        with np.errstate(divide="ignore", invalid="ignore"):  # as in jax: an impossible value has no theta
            return xp.where(positive, xp.log(xp.where(positive, values, 1.0)), values / scale)

    def values(self, theta: Float[AnyArray, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the physical values of unconstrained coordinates."""
        positive, scale = self._aligned(theta)
        xp = library(theta, scale)
        with np.errstate(over="ignore"):
            return xp.where(positive, xp.exp(xp.where(positive, theta, 0.0)), theta * scale)

    def prior_residuals(self, theta: Float[AnyArray, "P *batch"]) -> tuple[AnyArray, AnyArray]:
        """Return the priors' residuals and their slopes by theta, `(P, *batch)` both.

        Half the sum of squares is the negative logarithm of the prior density, up to a constant. A slope is the
        inverse of a standard deviation; zero where the prior is flat.
        """
        return self.prior(theta.ndim).residuals(theta)

    def log_prior(self, theta: Float[AnyArray, "P *batch"]) -> Float[AnyArray, "*batch"]:
        """Return the logarithm of the prior density of theta; parameters without a prior contribute nothing."""
        _, sd, flat = self.prior(1)
        mass = jnp.where(jnp.isfinite(sd), 2 * flat + sd * math.sqrt(2 * math.pi), 1.0)
        return -(self.prior_residuals(theta)[0] ** 2).sum(0) / 2 - jnp.log(mass).sum()

    def from_uniform(self, u: Float[Array, "P *batch"]) -> Float[AnyArray, "P *batch"]:
        """Return the theta at which the priors' distribution functions are u; NaN without a prior."""
        centre, sd, flat = self.prior(u.ndim)
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
    def nuisance(self) -> np.ndarray:
        """Which parameters are nuisances."""
        return np.array([item.nuisance for item in self.items], bool)

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

    def prior(self, rank: int) -> "Prior":
        """Return the priors in theta, aligned with an array of this rank."""
        columns = self.theta(self.column("centre")), self.column("prior_sd"), self.column("flat")
        centre, sd, flat = (x.reshape((-1,) + (1,) * (rank - 1)) for x in columns)
        return Prior(centre, sd, flat)


class Prior(NamedTuple):
    """Priors in theta: centres, standard deviations, half the lengths of their flat parts."""

    centre: AnyArray
    sd: AnyArray
    flat: AnyArray

    def residuals(self, theta: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return the residuals and their slopes by theta, see `Parameters.prior_residuals`."""
        off = theta - self.centre
        xp = library(off)
        beyond = xp.sign(off) * xp.maximum(xp.abs(off) - self.flat, 0.0)
        return beyond / self.sd, xp.where(xp.abs(off) >= self.flat, 1 / self.sd, 0.0)


def library(*arrays: Any) -> Any:
    """Return NumPy if all arrays are NumPy's, as each jax operation would be a program of its own there; else jax."""
    return np if all(isinstance(x, np.ndarray) for x in arrays) else jnp
