"""Profile likelihood: how far data and prior let each parameter move, with all others fitted again.

An independent check of the intervals of a fit. Those assume a quadratic cost; a profile follows the cost itself, and so
shows curved, bounded and open directions.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ident.errors import require
from ident.inference.fit import Fit
from ident.inference.information import half_width
from ident.inference.optima import BETTER, LINEAR, REACH, ConstrainedFit, Ending, Side, profile_path
from ident.inference.parameters import Parameter, Parameters
from ident.text import did_you_mean, one_line

LEVELS = (0.5, 0.683, 0.95)
FLAT = 0.01
"""Delta chi-squared below which an open profile counts as flat; assumed."""


@dataclass(frozen=True)
class Interval:
    """The values whose cost is at most a threshold above the optimum's.

    Attributes:
        level: probability that it covers the true value (asymptotically, if model and sigmas are right).
        low: theta; minus infinity if open.
        high: theta; infinity if open.
        endings: why it ends there, below and above.
    """

    level: float
    low: float
    high: float
    endings: tuple[Ending, Ending]


@dataclass(frozen=True)
class Profile:
    """The least cost as a function of one parameter.

    Attributes:
        item: the parameter.
        optimum: its fitted theta.
        sd: its standard deviation in theta in the linear approximation; infinite if undetermined there.
        theta: (N,) its values, ascending, including the optimum.
        delta_chi_squared: (N,) rise of the least cost there, data and priors, above the optimum's.
        converged: (N,) whether the other parameters' gradient vanishes there; if not, the profile may lie lower.
        intervals: one for each level, ascending, each inside the next.
        rivals: theta of competing optima within the highest level that lie outside its interval.
    """

    item: Parameter
    optimum: float
    sd: float
    theta: Float[np.ndarray, "N"]
    delta_chi_squared: Float[np.ndarray, "N"]
    converged: Bool[np.ndarray, "N"]
    intervals: tuple[Interval, ...]
    rivals: tuple[float, ...]

    @property
    def name(self) -> str:
        """The parameter's name."""
        return self.item.name

    @property
    def widest(self) -> Interval:
        """The interval of the highest level."""
        return self.intervals[-1]

    @property
    def beaten(self) -> float:
        """Fall of the cost below that of the fit, else 0; above 0 the fit is not the best optimum."""
        fall = -float(self.delta_chi_squared.min())
        return fall if fall > BETTER else 0.0

    @property
    def flat(self) -> tuple[bool, bool]:
        """Whether it is open and flat to its end, below and above: the data do not bound it on that side.

        Open and not flat is "practically non-identifiable", flat is "structurally" so.

        References:
            Raue et al., "Structural and practical identifiability analysis ...", Bioinformatics 25(15), 2009.
        """
        low, high = (ending is Ending.OPEN for ending in self.widest.endings)
        delta, theta = self.delta_chi_squared, self.theta
        below, above = delta[theta <= self.optimum], delta[theta >= self.optimum]
        return bool(low and below.max() < FLAT), bool(high and above.max() < FLAT)

    @property
    def halves(self) -> tuple[float, float]:
        """Halves of the widest interval, below and above the optimum, over the linear interval's half.

        1 if both are open, 0 if only the linear one is, infinite if only the profile is.
        """
        linear = half_width(self.widest.level) * self.sd
        below, above = self.optimum - self.widest.low, self.widest.high - self.optimum
        low, high = (1.0 if half == linear else half / linear for half in (below, above))
        return low, high

    @property
    def linear_interval(self) -> Interval:
        """The interval of the linear approximation at the highest level."""
        half = half_width(self.widest.level) * self.sd
        ending = Ending.CROSSED if math.isfinite(self.sd) else Ending.OPEN
        return Interval(self.widest.level, self.optimum - half, self.optimum + half, (ending, ending))

    @property
    def converged_inside(self) -> Bool[np.ndarray, "inside"]:
        """`converged` at the points within the widest interval."""
        return self.converged[(self.theta >= self.widest.low) & (self.theta <= self.widest.high)]

    @property
    def linear(self) -> bool:
        """Whether the widest interval agrees with the linear one."""
        return all(abs(half - 1) <= LINEAR for half in self.halves)

    def values(self, theta: Sequence[float] | Float[np.ndarray, "N"]) -> Float[np.ndarray, "N"]:
        """Return the parameter's physical values at these theta; an open side of a positive one is zero or infinity."""
        return np.asarray(Parameters((self.item,)).values(np.asarray(theta, float)[None])[0])


def threshold(level: float) -> float:
    """Return the chi-squared quantile with one degree of freedom."""
    return half_width(level) ** 2


def profile(
    fit: Fit,
    names: Iterable[str] | None = None,
    *,
    levels: Sequence[float] = LEVELS,
    reach: float = REACH,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> tuple[Profile, ...]:
    """Profile the cost of a fit over its parameters, one after the other.

    From the optimum theta_j moves outwards on both sides, and all other parameters are fitted again at each step,

        delta_chi_squared(theta_j) = min over the others of cost(theta) - cost(optimum).

    The interval has delta_chi_squared up to the chi-squared quantile (1 degree of freedom). The cost is that of the
    fit, with its priors: so this profiles the posterior density, or without priors (`prior_sd=math.inf`) the
    likelihood. A side that does not meet the threshold within `reach` is open; if the model ends first, the model
    bounds it.

    A profile follows only the region connected to the best optimum; `Profile.rivals` names the other optima.

    Args:
        fit: of any model.
        names: of the parameters, or of any number tied to them; all by default.
        levels: of the intervals.
        reach: see `REACH`.
        progress: wraps the numbers of the sides, two for each parameter, to show a bar.

    Raises:
        InputError: no such parameter, or an invalid level or reach.

    References:
        Wilks, "The large-sample distribution of the likelihood ratio", Ann. Math. Statist. 9(1), 1938.
        Venzon, Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", Appl. Statist.
        37(1), 1988.
    """
    which = check(fit.problem.parameters, names, levels=levels, reach=reach)
    levels = tuple(sorted(set(levels)))
    thresholds = [threshold(level) for level in levels]
    sides: list[Side] = []
    for number in progress(range(2 * len(which))):
        index, sign = which[number // 2], 2 * (number % 2) - 1
        constrained = ConstrainedFit(fit.problem, fit.best, fit.end, index)
        sides.append(profile_path(constrained, sign, constrained.limit(reach), thresholds))
    return tuple(_joined(fit, index, levels, *sides[2 * i : 2 * i + 2]) for i, index in enumerate(which))


def check(
    parameters: Parameters,
    names: Iterable[str] | None = None,
    *,
    levels: Sequence[float] = LEVELS,
    reach: float = REACH,
) -> tuple[int, ...]:
    """Check the arguments of `profile` before any work is done.

    Returns:
        The indices of the named parameters in theta, ascending, each once; of all if none is named.

    Raises:
        InputError: no such parameter, or an invalid level or reach.
    """
    require(1 < reach < math.inf, "reach", f"{reach:g}", "a finite factor > 1", "correct it")
    for level in levels:
        require(0 < level < 1, "", f"a level of {level:g}", "a level between 0 and 1, as 0.95", "correct it")
    require(len(levels), "", "no level", "at least one, as 0.95", "name one")
    place_of = {path: i for i, item in enumerate(parameters.items) for path in item.paths}
    names = tuple(names or ())
    for name in names:
        remedy = did_you_mean(name, list(place_of), "name one of the unknowns")
        require(name in place_of, "", f"{one_line(name)}, which is not fitted", "an unknown", remedy)
    return tuple(sorted({place_of[name] for name in names or place_of}))


def _joined(fit: Fit, index: int, levels: Sequence[float], below: Side, above: Side) -> Profile:
    """Join the two sides of a profile."""
    optimum = float(fit.best.theta[index])
    points = [*reversed(below.points), *above.points[1:]]
    intervals = tuple(
        Interval(level, optimum - low.distance, optimum + high.distance, (low.ending, high.ending))
        for level, low, high in zip(levels, below.bounds, above.bounds, strict=True)
    )
    top, last = threshold(levels[-1]), intervals[-1]
    others = [(float(o.theta[index]), o.score - fit.best.score) for o in fit.optima[1:]]
    return Profile(
        fit.problem.parameters.items[index],
        optimum,
        float(fit.information.sd[index]),
        np.array([float(point.theta[index]) for point in points]),
        np.array([point.delta_chi_squared for point in points]),
        np.array([point.converged for point in points]),
        intervals,
        tuple(theta for theta, delta in others if delta < top and not last.low <= theta <= last.high),
    )
