"""Whether parameters have changed between two fits: both data sets fitted again together, the changes free.

The fits share the prior and every parameter that does not change; these count once. A changing parameter has
theta = m - d/2 in the first and m + d/2 in the second, the prior on m. All changes together are tested by

    T = min(d = 0) - min(d free)

of chi-squared plus priors. Changes have a wide prior of their own, normal with the standard deviation `WIDE`, so
that a direction on which the data do not depend counts nothing. In the linear case T is then the sum of w z^2, z
standard normal, w = l / (1 + l), l the eigenvalues of the changes' information in units of that prior. Its mean sum(w)
and variance 2 sum(w^2) give a gamma distribution (Satterthwaite 1946, Biometrics Bulletin 2).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.fit import Fit
from ident.inference.information import half_width, holm
from ident.inference.search import look

WIDE = 1.0
"""Standard deviation of the prior of a change in theta: for a stiffness, a factor of e."""
OPEN = 0.5
"""Standard deviation of a change, relative to `WIDE`, from which it is open: a quarter or more comes from the prior."""
LEVEL = 0.05
"""Significance level: probability of reporting a change where there is none; the usual value."""


@dataclass(frozen=True)
class Change:
    """Changes from one fit to another, by the data of both.

    Attributes:
        names: (C,) parameters that may have changed.
        first: (C,) [SI] their values in the first.
        second: (C,) [SI] in the second.
        change: (C,) change of theta: ln of the ratio of a positive parameter.
        covariance: (C, C) of it, by data and priors.
        under_none: (C,) standard deviation of the estimated change if nothing has changed.
        statistic: T.
        mean: of T if nothing has changed, its degrees of freedom.
        variance: of T in that case.
        alone: (C,) p-value of the other changes' T if only this one is real.
    """

    names: tuple[str, ...]
    first: Float[np.ndarray, "C"]
    second: Float[np.ndarray, "C"]
    change: Float[np.ndarray, "C"]
    covariance: Float[np.ndarray, "C C"]
    under_none: Float[np.ndarray, "C"]
    statistic: float
    mean: float
    variance: float
    alone: Float[np.ndarray, "C"]

    @property
    def sd(self) -> Float[np.ndarray, "C"]:
        """Standard deviation of each change."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval(self) -> Float[np.ndarray, "C 2"]:
        """95 % intervals of the changes."""
        half = half_width(0.95) * self.sd
        return np.stack([self.change - half, self.change + half], 1)

    @property
    def open(self) -> Bool[np.ndarray, "C"]:
        """Which changes the data do not determine beyond their prior."""
        return self.sd > OPEN * WIDE

    @property
    def p_value(self) -> float:
        """Probability of a larger T if nothing has changed."""
        return chance(self.statistic, self.mean, self.variance)

    @cached_property
    def p_values(self) -> Float[np.ndarray, "C"]:
        """P-value of each parameter's change, corrected for their number (Holm)."""
        from scipy.special import ndtr

        return holm(2 * ndtr(-np.abs(self.change) / np.maximum(self.under_none, np.finfo(float).tiny)))

    @property
    def seen(self) -> bool:
        """Whether anything has changed."""
        return self.p_value < LEVEL

    @property
    def changed(self) -> Bool[np.ndarray, "C"]:
        """Which parameters have changed, each by itself."""
        return (self.p_values < LEVEL) & self.seen & ~self.open


def change(first: Fit, second: Fit, names: Sequence[str], *, singly: bool = True) -> Change:
    """Fit the data of two fits together and return the changes.

    Args:
        first: the earlier fit.
        second: the later one.
        names: parameters of both that may have changed; the others are the same, if both have them.
        singly: whether to test each change as the only one; if not, `alone` is NaN.
    """
    joint = _Joint(first, second, tuple(names))
    free, none = joint.solved()
    J, count = joint.jacobian(free)[: -len(names)], len(joint.names)
    seen = _seen(J[:, :count], J[:, count:])
    covariance = np.linalg.inv(seen + np.eye(len(names)) / WIDE**2)
    mean, variance = moments(seen)

    def alone(k: int) -> float:
        """Return the p-value of all other changes' T if only this one is real."""
        one = [*range(count), count + k]
        others = [i for i in range(count, len(free)) if i != count + k]
        least = min(joint.cost(joint.searched(start, one)) for start in (none, free))
        return chance(max(least - joint.cost(free), 0.0), *moments(_seen(J[:, one], J[:, others])))

    return Change(
        joint.changing,
        joint.values(0, free),
        joint.values(1, free),
        free[count:],
        covariance,
        np.sqrt(np.maximum(np.diag(covariance @ seen @ covariance), 0.0)),
        max(joint.cost(none) - joint.cost(free), 0.0),
        mean,
        variance,
        np.array([alone(k) if singly else np.nan for k in range(len(names))]),
    )


def power(seen: Float[np.ndarray, "C C"], change: Float[np.ndarray, "C"]) -> float:
    """Return the probability that a change of theta is noticed (`Change.seen`), in the linear case.

    T is then about a noncentral chi-squared number: without a change its mean and variance are those of `moments`, and
    the change raises its mean by what it adds to the minimum for d = 0.

    Args:
        seen: information on the changes with all other unknowns free.
        change: of theta.

    References:
        Patnaik, "The non-central chi-squared and F distributions and their applications", Biometrika 36 (1949) 202.
    """
    from scipy.stats import chi2, ncx2

    (mean, variance), score = moments(seen), seen @ change
    if not mean > 0:
        return 0.0
    scale, rise = variance / (2 * mean), score @ np.linalg.solve(seen + np.eye(len(seen)) / WIDE**2, score)
    return float(ncx2.sf(chi2.isf(LEVEL, mean / scale), mean / scale, rise / scale))


def _seen(shared: Float[np.ndarray, "R U"], own: Float[np.ndarray, "R C"]) -> Float[np.ndarray, "C C"]:
    """Return the information on some unknowns with the others free: a Schur complement."""
    cross = own.T @ shared
    whole: np.ndarray = own.T @ own - cross @ np.linalg.pinv(shared.T @ shared, hermitian=True) @ cross.T
    return whole


def moments(seen: Float[np.ndarray, "C C"]) -> tuple[float, float]:
    """Return mean and variance of T if nothing has changed."""
    levels = np.maximum(np.linalg.eigvalsh(seen), 0.0) * WIDE**2
    weights = levels / (1 + levels)
    return float(weights.sum()), float(2 * (weights**2).sum())


def chance(statistic: float, mean: float, variance: float) -> float:
    """Return the probability of a larger T, from a gamma distribution with this mean and variance."""
    from scipy.stats import gamma

    if not mean > 0:
        return 1.0
    scale = variance / mean
    return float(gamma.sf(statistic, mean / scale, scale=scale))


class _Joint:
    """Two problems as one: the unknowns of both, then the changes."""

    def __init__(self, first: Fit, second: Fit, changing: tuple[str, ...]):
        self.fits, self.changing = (first, second), changing
        own = [fit.problem.parameters.names for fit in self.fits]
        self.names = tuple(dict.fromkeys([*own[0], *own[1]]))
        self.ways = [self._way(names, share) for names, share in zip(own, (-0.5, 0.5), strict=True)]
        self.once = [True] * len(own[0]), [name not in own[0] for name in own[1]]
        self.known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def _way(self, names: Sequence[str], share: float) -> Float[np.ndarray, "P joint"]:
        """Return how the parameters of one problem follow from the unknowns of both."""
        way = np.zeros((len(names), len(self.names) + len(self.changing)))
        for row, name in enumerate(names):
            way[row, self.names.index(name)] = 1.0
            if name in self.changing:
                way[row, len(self.names) + self.changing.index(name)] = share
        return way

    def starts(self) -> list[Float[np.ndarray, "joint"]]:
        """Return the starts of the search: the mean of both fits with their difference, and each fit with no change."""
        thetas = [dict(zip(fit.problem.parameters.names, fit.best.theta, strict=True)) for fit in self.fits]
        apart = [thetas[1][name] - thetas[0][name] for name in self.changing]
        none = np.zeros(len(apart))
        one, other = ([{**thetas[1 - k], **thetas[k]}[name] for name in self.names] for k in (0, 1))
        middle = (np.array(one) + np.array(other)) / 2
        return [np.concatenate(each) for each in ((middle, apart), (one, none), (other, none), (middle, none))]

    def solved(self) -> tuple[Float[np.ndarray, "joint"], Float[np.ndarray, "joint"]]:
        """Return the best unknowns with the changes free, and with no change."""
        both, *rest = self.starts()
        none = min((self.searched(start, range(len(self.names))) for start in rest), key=self.cost)
        return min((self.searched(start, range(len(both))) for start in (both, none)), key=self.cost), none

    def searched(self, start: Float[np.ndarray, "joint"], moving: Sequence[int]) -> Float[np.ndarray, "joint"]:
        """Search by SciPy's least squares; only the named changes are free, the others stay zero."""
        from scipy.optimize import least_squares

        way = np.eye(len(start))[:, list(moving)]
        found = least_squares(lambda x: self.residuals(way @ x), way.T @ start, lambda x: self.jacobian(way @ x) @ way)
        whole: np.ndarray = way @ found.x
        return whole

    def residuals(self, joint: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "R"]:
        """Return the residuals of both data sets, of the priors once, and of the changes."""
        return self._weighed(joint)[0]

    def jacobian(self, joint: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "R joint"]:
        """Return their derivatives."""
        return self._weighed(joint)[1]

    def cost(self, joint: Float[np.ndarray, "joint"]) -> float:
        """Return the sum of their squares."""
        return float((self.residuals(joint) ** 2).sum())

    def values(self, which: int, joint: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "C"]:
        """Return the changing parameters [SI] of one problem."""
        parameters = self.fits[which].problem.parameters
        values = dict(zip(parameters.names, np.asarray(parameters.values(self.ways[which] @ joint)), strict=True))
        return np.array([float(values[name]) for name in self.changing])

    def _weighed(self, joint: Float[np.ndarray, "joint"]) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals and derivatives, computed once for each point: SciPy requests them one after the other."""
        key = joint.tobytes()
        if key not in self.known:
            self.known[key] = self._computed(joint)
        return self.known[key]

    def _computed(self, joint: Float[np.ndarray, "joint"]) -> tuple[np.ndarray, np.ndarray]:
        residuals, slopes, count = [], [], len(self.names)
        centre = joint.copy()
        centre[count:] = 0.0
        for fit, way, once in zip(self.fits, self.ways, self.once, strict=True):
            theta, problem = way @ joint, fit.problem
            here = look(problem, theta, fit.choice.held)
            fitted = np.isfinite(np.asarray(problem.sigma))
            off = np.asarray(here.predicted) - np.asarray(problem.measured)
            residuals.append(problem.scaled(off)[fitted])
            slopes.append(problem.scaled(np.asarray(here.jacobian))[fitted] @ way)
            prior, slope = (np.asarray(part)[once] for part in problem.parameters.prior_residuals(way @ centre))
            residuals.append(prior)
            slopes.append(slope[:, None] * np.where(np.arange(len(joint)) < count, way, 0.0)[once])
        residuals.append(joint[count:] / WIDE)
        slopes.append(np.eye(len(joint))[count:] / WIDE)
        return np.concatenate(residuals), np.concatenate(slopes)


# -------- Independent change
# Whether parameters have changed between two estimates without their data, treated as independent.
#
# The difference of the means is then normal, with the sum of both covariances, and the results of `change` have a
# closed form.


@dataclass(frozen=True)
class Estimate:
    """Estimate of some parameters, without the data behind it.

    Attributes:
        theta: (C,) their means: ln of a positive parameter [SI].
        covariance: (C, C) of it.
    """

    theta: Float[np.ndarray, "C"]
    covariance: Float[np.ndarray, "C C"]


def independent_change(names: Sequence[str], first: Estimate, second: Estimate) -> Change:
    """Return the changes from one estimate to another, treated as independent.

    A prior common to both counts twice: it draws the estimates together, and a change looks smaller.

    Args:
        names: (C,) of the parameters, all positive.
        first: the earlier estimate.
        second: the later one.
    """
    apart = second.theta - first.theta
    seen, own = np.linalg.inv(first.covariance + second.covariance), np.eye(len(names)) / WIDE**2

    def cost(change: Float[np.ndarray, "C"]) -> float:
        return float((change - apart) @ seen @ (change - apart) + change @ own @ change)

    covariance = np.linalg.inv(seen + own)
    found = covariance @ seen @ apart

    def alone(k: int) -> float:
        others, one = np.arange(len(names)) != k, np.zeros(len(names))
        one[k] = (seen @ apart)[k] / (seen + own)[k, k]
        left = seen[np.ix_(others, others)] - np.outer(seen[others, k], seen[k, others]) / seen[k, k]
        return chance(cost(one) - cost(found), *moments(left))

    return Change(
        tuple(names),
        np.exp(first.theta),
        np.exp(second.theta),
        found,
        covariance,
        np.sqrt(np.diag(covariance @ seen @ covariance)),
        cost(np.zeros_like(apart)) - cost(found),
        *moments(seen),
        np.array([alone(k) for k in range(len(names))]),
    )
