"""What data can tell about parameters, from the Jacobian at one point: directions, ranks, standard deviations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.inference.problem import InverseProblem

if TYPE_CHECKING:
    from ident.inference.fit import Fit
    from ident.inference.identifiability import Consistency

WEAK_ABOVE = 0.5
"""Standard deviation in theta above which a direction counts as weakly known: for a stiffness, a factor of 1.6;
assumed."""
OPEN_ABOVE = math.log(1e3)
"""The same above which it counts as open: whatever little the data say there, no prior would say less."""
ALONE = 0.05
"""Largest exponent of the others, relative to the first one's, with which a combination is one parameter; assumed."""
RANK_TOLERANCE = 1e-8
"""Singular values below this share of the largest are rounding."""


@dataclass(frozen=True)
class Direction:
    """A combination of parameters, with what the data say of it.

    Attributes:
        weights: (P,) unit vector in theta.
        sd: standard deviation of the data along it, in theta; infinite where they say nothing.
    """

    weights: Float[np.ndarray, "P"]
    sd: float

    @property
    def seen(self) -> bool:
        """Whether the data say anything about it."""
        return bool(np.isfinite(self.sd))

    @property
    def open(self) -> bool:
        """Whether they leave it open: they say nothing about it, or nothing within a factor of a thousand."""
        return not self.sd < OPEN_ABOVE

    @property
    def weak(self) -> bool:
        """Whether they say little."""
        return not self.open and self.sd > WEAK_ABOVE


@dataclass(frozen=True)
class Information:
    """What data, and prior, tell about the parameters around a point.

    Attributes:
        names: (P,) parameters.
        directions: (Q,) of the Q unknowns of interest, from the best known to the least known, orthogonal in theta;
            what is not exactly known beside them counts as noise.
        spent: number of directions of nuisances without a prior that the data see, and are spent on.
        data_sd: (P,) standard deviation in theta by the data alone; infinite where they leave the parameter open.
            What is known of nuisances counts with the data, but for each nuisance's own.
        covariance: (P, P) of theta by data and prior; infinite variances where neither says anything.
        prior_share: (P,) share of the prior in what is known of each parameter, from 0 to 1.
    """

    names: tuple[str, ...]
    directions: tuple[Direction, ...]
    data_sd: Float[np.ndarray, "P"]
    covariance: Float[np.ndarray, "P P"]
    prior_share: Float[np.ndarray, "P"]
    spent: int = 0

    @property
    def rank(self) -> int:
        """Number of directions that the data see."""
        return sum(direction.seen for direction in self.directions)

    @property
    def fixed(self) -> int:
        """Number of directions that the data do not leave open."""
        return sum(not direction.open for direction in self.directions)

    @property
    def sd(self) -> Float[np.ndarray, "P"]:
        """Standard deviation of each theta by data and prior."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def supported(self) -> np.ndarray:
        """Which parameters the data alone would give an interval for."""
        return self.data_sd < WEAK_ABOVE

    @property
    def open(self) -> np.ndarray:
        """Which parameters the data alone leave open, as directions."""
        return ~(self.data_sd < OPEN_ABOVE)

    @property
    def data_share(self) -> Float[np.ndarray, "P"]:
        """Share of the data alone in what is known of each parameter, from 0 to 1.

        What this and `prior_share` leave comes from the data together with the priors of other parameters.
        """
        with np.errstate(invalid="ignore"):
            share = np.diag(self.covariance) / self.data_sd**2
        return np.where(np.isfinite(share), np.minimum(share, 1 - self.prior_share), 0.0)

    @property
    def correlation(self) -> Float[np.ndarray, "P P"]:
        """Correlations by data and prior; NaN where a variance is infinite."""
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(self.sd, self.sd)

    def trade_offs(self) -> tuple["TradeOff", ...]:
        """Say for each open direction which parameter may move, and what then moves along."""
        open_space = np.array([d.weights for d in self.directions if d.open])
        return tuple(TradeOff(self.names[lead], row) for lead, row in _echelon(open_space))


@dataclass(frozen=True)
class TradeOff:
    """A change that the data would hardly notice, or not at all.

    Attributes:
        name: the parameter that may be chosen freely.
        change: (P,) change of each theta when that parameter's theta changes by one.
    """

    name: str
    change: Float[np.ndarray, "P"]


def half_width(level: float) -> float:
    """Return the half width of a normal distribution's central interval in standard deviations."""
    return NormalDist().inv_cdf(0.5 + level / 2)


def alone(weights: Float[np.ndarray, "P"]) -> Float[np.ndarray, "P"]:
    """Return the unit vector of one parameter where a combination is hardly anything else, else the combination."""
    size = np.abs(weights)
    first = int(np.argmax(size))
    if (np.delete(size, first) > ALONE * size[first]).any():
        return weights
    one = np.zeros_like(weights)
    one[first] = np.sign(weights[first])
    return one


def information(
    jacobian: Float[np.ndarray, "D P"],
    prior_sd: Float[np.ndarray, "P"],
    names: tuple[str, ...],
    nuisance: Bool[np.ndarray, "P"] | None = None,
) -> Information:
    """Weigh data against prior around a point.

    Args:
        jacobian: d(predicted / sigma)/d(theta) of the data.
        prior_sd: widths of the priors in theta, infinite for none.
        names: of the parameters.
        nuisance: which of them are known by their priors, and count as noise of the data; none by default.
    """
    own = np.ones(len(names), bool) if nuisance is None else ~nuisance
    cleared = np.zeros((jacobian.shape[0] + len(names), len(names)))[:, own]
    cleared[: len(jacobian)] = jacobian if own.all() else clear_of(jacobian, prior_sd, ~own)
    _, s, Vt = np.linalg.svd(cleared, full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s[0], 1e-300)
    sds = np.divide(1.0, s, out=np.full_like(s, np.inf), where=seen)
    weights = np.zeros((len(Vt), len(own)))
    weights[:, own] = [v * np.sign(v[np.argmax(np.abs(v))]) for v in Vt]
    directions = tuple(map(Direction, weights, sds.tolist()))
    both = np.vstack([jacobian, np.diag(1 / np.asarray(prior_sd))])
    _, s_both, Vt_both = np.linalg.svd(both, full_matrices=False)
    covariance = _covariance(s_both * (s_both > RANK_TOLERANCE * max(s_both[0], 1e-300)), Vt_both)
    variance = np.diag(covariance)
    share = np.where(np.isfinite(variance), variance, 0.0) / np.asarray(prior_sd) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        data = np.sqrt(variance / np.maximum(1 - share, 0.0))
    data[own] = np.sqrt(np.diag(_covariance(s * seen, Vt)))
    free = jacobian[:, ~own & np.isinf(prior_sd)]
    s_free = np.linalg.svd(free, compute_uv=False) if free.size else np.zeros(1)
    spent = int((s_free > RANK_TOLERANCE * max(s_free[0], 1e-300)).sum())
    return Information(names, directions, data, covariance, share, spent)


def clear_of(
    jacobian: Float[np.ndarray, "D P"], prior_sd: Float[np.ndarray, "P"], nuisance: Bool[np.ndarray, "P"]
) -> Float[np.ndarray, "D Q"]:
    """Return the Jacobian of the unknowns of interest as independent data see it that the nuisances scatter as well.

    With B the nuisances' columns times their priors' sds, the data scatter by 1 + B B' = U diag(1 + s^2) U' + rest; so
    the others' columns are multiplied by its inverse square root, 1 - U diag(1 - (1 + s^2)^-1/2) U'. What nuisances
    without a prior may do is projected out before.
    """
    sd, others = np.asarray(prior_sd), jacobian[:, ~nuisance]
    free, B = (jacobian[:, nuisance & known] for known in (np.isinf(sd), np.isfinite(sd)))
    U = reached(free)
    B, others = (x - U @ (U.T @ x) for x in (B * sd[nuisance & np.isfinite(sd)], others))
    U, s, _ = np.linalg.svd(B, full_matrices=False)
    return others - (U * (1 - (1 + s**2) ** -0.5)) @ (U.T @ others)


def _covariance(s: np.ndarray, Vt: np.ndarray) -> np.ndarray:
    """Return V s^-2 V', infinite variances for parameters that touch a direction with s = 0."""
    known = s > 0
    scaled = Vt[known] / s[known, None]
    covariance = scaled.T @ scaled
    touched = (np.abs(Vt[~known]) > 1e-6).any(0)
    covariance[touched, :] = covariance[:, touched] = np.nan
    covariance[touched, touched] = np.inf
    return covariance


def _echelon(rows: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Reduce a basis so that each row leads with one parameter of its own: reduced echelon form, full pivoting."""
    rows = rows.copy()
    leads: list[int] = []
    for i in range(len(rows)):
        rest = np.abs(rows[i:]).copy()
        rest[:, leads] = 0
        pivot, lead = np.unravel_index(np.argmax(rest), rest.shape)
        swap = np.array([i, i + pivot])
        rows[swap] = rows[swap[::-1]]
        rows[i] /= rows[i, lead]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, lead], rows[i])
        leads.append(int(lead))
    return sorted(zip(leads, rows, strict=True), key=lambda pair: pair[0])


# -------- Verdicts
# From a chance to a verdict: the levels, and the correction for how many values are tested together.

SUSPICIOUS = 3.0
"""Standard deviations beyond which a single normal value is suspicious; more where many are tested together."""
RARE = 2 * NormalDist().cdf(-SUSPICIOUS)
"""The chance of that: of a false alarm among all values, or all kinds of data, that are tested together."""
IMPROBABLE = 1e-3
"""Chance of so large a chi-squared below which model or sigmas are called wrong; of so small a one, sigmas or rows;
assumed."""


def rare(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Tell which of several chances are too small, with one false alarm in 1 / RARE sets of them at most (`holm`)."""
    return holm(chances) < RARE


def holm(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Return chances that hold for all of several tests together.

    Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Statist. 6, 1979: the smallest of n times
    n, the next one times n - 1, none less than those before it.
    """
    single = np.asarray(chances, float)
    order = np.argsort(single)
    stepwise = np.maximum.accumulate(single[order] * np.arange(len(single), 0, -1))
    return np.minimum(stepwise, 1.0)[np.argsort(order)]


def farthest(count: int) -> float:
    """Return the limit [sd] for the farthest of so many normal values."""
    return standard_deviations(RARE / max(count, 1))


def standard_deviations(chance: float) -> float:
    """Return how many standard deviations a normal value exceeds, up or down, with this chance."""
    return -NormalDist().inv_cdf(chance / 2) if chance / 2 > 0 else np.inf


def p_in_words(p: float, digits: int = 2) -> str:
    """Say a p-value: `p = 0.031`; below what a double holds `p < 1e-300`."""
    return "p < 1e-300" if p < 1e-300 else f"p = {p:.{digits}g}"


def chi_squared_in_words(test: "Fit | Consistency") -> str:
    """Write chi-squared with what it is compared with."""
    if not test.degrees_of_freedom > 0:
        return "no degrees of freedom are left, so chi-squared tests nothing"
    p = "" if math.isnan(test.p_value) else f" ({p_in_words(test.p_value)})"
    return f"chi-squared {test.chi_squared:.3g} on {test.degrees_of_freedom} degrees of freedom{p}"


def sigma_in_words(sd: float) -> str:
    """Say how many standard deviations a p-value amounts to: `4.1 sigma`; infinite is more than a double tells."""
    return f"{sd:.1f} sigma" if sd < np.inf else "over 38 sigma"


# -------- Score
# Is an assumption of the model violated? What that would move, and what evidence the data give.
#
# A model assumes that a base is rigid, and that no single value is wrong: both are amounts taken to be
# zero.

APART = 1e-6
"""Share of what an amount changes in the data, squared, below which the parameters can make up for all of it."""

NOTHING = 1e-6
"""Change of all data together [sd] by the plausible amount below which they do not depend on it: rounding."""

CHECKED = 0.01
"""Share of an error of a value, squared, that a fit does not absorb, below which the value cannot be checked: an error
of 10 times the limit, 38 sigma of 20 values, would pass in half of the cases."""
BLAMED = 20
"""Values and vectors too far off, of more of which no single one is sought that would explain the others."""


@dataclass(frozen=True)
class ScoreTest:
    """What one amount that a model takes to be zero would do to a fit, and whether the data ask for it.

    Attributes:
        amount: the plausible one.
        positive: whether it can't be below zero, so that only an amount above is asked for.
        shift: (P,) by how much that amount, were it modelled, would move each theta.
        seen: whether the data depend on it at all.
        apart: share of what it changes in the data, squared, for which no change of the parameters makes up.
        z: the score in standard deviations: normal if the amount is zero and model, sigmas and priors are right.
        sd: standard deviation of the amount by the data, as far as the model is linear.
    """

    amount: float
    positive: bool
    shift: Float[np.ndarray, "P"]
    seen: bool
    apart: float
    z: float
    sd: float

    @property
    def separable(self) -> bool:
        """Whether the data can tell it from the parameters."""
        return self.seen and self.apart > APART

    @property
    def p_value(self) -> float:
        """Chance of a score as far in the direction asked for; NaN where the data can't tell."""
        if not self.separable:
            return math.nan
        tail = NormalDist().cdf(-self.z if self.positive else -abs(self.z))
        return tail if self.positive else 2 * tail


def asked_for(tests: Sequence[ScoreTest]) -> tuple[int, ...]:
    """Return the places of those tests that ring, of the largest score first; Holm over all that can be told."""
    told = [place for place, test in enumerate(tests) if test.separable]
    rings = rare([tests[place].p_value for place in told])
    asked = [place for place, ring in zip(told, rings, strict=True) if ring]
    return tuple(sorted(asked, key=lambda place: -abs(tests[place].z)))


def score_tests(
    fit: "Fit",
    changes: Float[np.ndarray, "A D"],
    amounts: Float[np.ndarray, "A"],
    positive: Sequence[bool],
    without: Bool[np.ndarray, "D"] | None = None,
) -> tuple[ScoreTest, ...]:
    """Test several amounts that a model takes to be zero, each by itself, with the parameters profiled out.

    With r = (predicted - measured) / sigma and the residuals of the priors below it, S their Jacobian by theta and d
    that by an amount (zero for the priors), of which d_p = d - S (S'S)^-1 S'd is left when theta makes up for what it
    can,

        z = -d_p' r / |d_p|,        shift by an amount a = -(S'S)^-1 S'd a,

    |d_p|^2 = d'd - d'S (S'S)^-1 S'd being the information on the amount (Rao 1948). An amount that can't be negative is
    tested on one side, zero being a boundary: there the score keeps its normal law, unlike the likelihood ratio.

    Args:
        fit: the best optimum of it is looked at.
        changes: derivatives of the predictions [SI] by each amount, at zero.
        amounts: plausible ones, in the same unit.
        positive: whether each can't be below zero.
        without: data whose derivatives are not known: they are left out; none when None.

    References:
        Rao, "Large sample tests of statistical hypotheses concerning several parameters", Proc. Cambridge Philos. Soc.
        44, 1948. Verbeke, Molenberghs, "The use of score tests for inference on variance components", Biometrics 59,
        2003, section 3 (one-sided at a boundary).
    """
    count = len(fit.problem.kinds)
    kept = np.ones(count, bool) if without is None else ~without
    problem = fit.problem.with_sigma(np.where(kept, np.asarray(fit.problem.sigma), np.inf))
    residuals, slope = (np.asarray(x) for x in problem.weigh(fit.predicted, np.asarray(fit.jacobian), fit.best.theta))
    scaled = problem.scaled(np.where(kept, changes, 0.0).T)
    d = np.concatenate([scaled, np.zeros((len(residuals) - count, scaled.shape[1]))])
    basis, inverse = _factors(slope)
    alone = reached(slope[:count])
    left, of_data = d - basis @ (basis.T @ d), d[:count] - alone @ (alone.T @ d[:count])
    size = np.linalg.norm(left, axis=0)
    whole = np.linalg.norm(d, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        z, sd = -(left.T @ residuals) / size, 1 / size
        apart = (np.linalg.norm(of_data, axis=0) / whole) ** 2
    shift = -(inverse @ d) * amounts
    apart, seen = np.nan_to_num(apart), whole * amounts > NOTHING
    tests = zip(amounts, positive, shift.T, seen, apart, z, sd, strict=True)
    return tuple(ScoreTest(float(row[0]), row[1], row[2], bool(row[3]), *map(float, row[4:])) for row in tests)


@dataclass(frozen=True)
class RowTests:
    """Whether single values are wrong: the score test of a shift of each, or of each vector of values.

    Attributes:
        z: (D,) the shift in standard deviations, of the sign of predicted - measured: normal if all is right; NaN of a
            value that is not fitted, or for any error of which the parameters make up.
        left: (D,) share of an error of the value, squared, that is left when the parameters have made up for what they
            can, all other errors given; of a component of a vector that of the vector's best direction.
        chance: (D,) of so large a shift, of a component of a vector that of the whole vector; NaN where `z` is.
        units: (D,) number of the vector of each value, one of its own for any other value.
    """

    z: Float[np.ndarray, "D"]
    left: Float[np.ndarray, "D"]
    chance: Float[np.ndarray, "D"]
    units: Int[np.ndarray, "D"]

    @property
    def tested(self) -> int:
        """How many values and vectors are tested."""
        return len(np.unique(self.units[np.isfinite(self.chance)]))

    @property
    def limit(self) -> float:
        """Limit [sd] for the farthest of so many."""
        return farthest(self.tested)

    @property
    def outliers(self) -> Bool[np.ndarray, "D"]:
        """Which values, each with all components of its vector, are too far off for so many; Holm over all."""
        known = np.flatnonzero(np.isfinite(self.chance))
        units, first, place = np.unique(self.units[known], return_index=True, return_inverse=True)
        found = np.zeros(len(self.z), bool)
        found[known] = rare(self.chance[known][first])[place] if len(units) else False
        return found

    @property
    def unchecked(self) -> Bool[np.ndarray, "D"]:
        """Which fitted values cannot be checked: nothing else that is known tells what they should read."""
        return self.left < CHECKED


def row_tests(problem: InverseProblem, residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> RowTests:
    """Test a shift of each value by itself, the parameters profiled out: is that value wrong?

    With C the covariance of the errors, r = predicted - measured, J the Jacobian, P what the priors know, and e the
    value's unit vector,

        z = e' C^-1 r / (e' C^-1 V C^-1 e)^1/2,        V = C - J (J' C^-1 J + P)^-1 J',

    which is the score test (`score_tests`) of one more parameter that moves this value only, and of a linear model also
    the root of what such a parameter would take off the cost. Where errors are independent z is the residual over
    sigma (1 - h)^1/2, h being the value's leverage. Of a vector all components may be shifted at once: chi-squared.

    Args:
        problem: its `correlation`, `vectors` and finite `sigma` count.
        residuals: of the data, made independent, then of the priors, as of `InverseProblem.weigh`.
        slope: their Jacobian by all that is fitted.

    References:
        Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2(5), 1968. Cook,
        Weisberg, "Residuals and Influence in Regression", 1982, section 2.2.
    """
    count = len(problem.kinds)
    fitted = np.isfinite(np.asarray(problem.sigma))
    known = problem.errors
    basis = reached(slope)
    there = (residuals - basis @ (basis.T @ residuals))[:count]
    score, absorbed = (known.pull_back(part) for part in (there, basis[:count]))
    size = np.where(fitted, known.precision, 0.0)
    variance = size - (absorbed**2).sum(1)
    told = fitted & (variance > APART * size)
    z, left, chance = np.full(count, np.nan), np.full(count, np.nan), np.full(count, np.nan)
    z[told] = score[told] / np.sqrt(variance[told])
    left[fitted] = np.maximum(variance, 0.0)[fitted] / size[fitted]
    chance[told] = [2 * NormalDist().cdf(-abs(each)) for each in z[told].tolist()]
    units = np.arange(count) if problem.vectors is None else np.asarray(problem.vectors)
    for unit in np.flatnonzero(np.bincount(units[fitted]) > 1):
        from scipy.special import chdtrc  # takes a tenth of a second, which campaigns without vectors can spare

        own = np.flatnonzero(fitted & (units == unit))
        # in directions in which errors are independent of one size, so that what is left of them is a share
        shifts = np.eye(len(own)) if problem.correlation is None else _shifts(problem, own)
        L = np.linalg.inv(np.linalg.cholesky(shifts.T @ shifts))
        taken = L @ absorbed[own]
        share, ways = np.linalg.eigh(np.eye(len(own)) - taken @ taken.T)
        seen = share > APART
        squares = (ways.T @ (L @ score[own]))[seen] ** 2 / share[seen]
        chance[own] = chdtrc(len(squares), squares.sum()) if seen.any() else math.nan
        left[own] = share.max() if seen.any() else 0.0
    return RowTests(z, left, chance, units)


def blamed(
    problem: InverseProblem, residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]
) -> tuple[tuple[int, ...], ...]:
    """Return each value, or vector, without which no other one is too far off; none of many that are.

    A wrong value pulls the fit, so that right ones may look wrong as well. Where several are returned, the data can't
    tell which of them is wrong.

    Args:
        problem: as of `row_tests`.
        residuals: as there.
        slope: as there.

    Returns:
        Places of the value, or of the vector's components.
    """
    tests = row_tests(problem, residuals, slope)
    found, sigma = [], np.asarray(problem.sigma)
    units = np.unique(tests.units[tests.outliers])
    for unit in units if len(units) <= BLAMED else ():
        own = np.flatnonzero((tests.units == unit) & np.isfinite(sigma))
        shifts = np.pad(_shifts(problem, own), ((0, len(residuals) - len(sigma)), (0, 0)))
        if not row_tests(problem, residuals, np.hstack([slope, shifts])).outliers.any():
            found.append(tuple(own.tolist()))
    return tuple(found)


def _shifts(problem: InverseProblem, own: Int[np.ndarray, "n"]) -> Float[np.ndarray, "D n"]:
    """Return what a shift of each of some values by its sigma is, made independent."""
    shifts = np.zeros((len(problem.kinds), len(own)))
    shifts[own, np.arange(len(own))] = 1.0
    return np.asarray(problem.errors.whiten(shifts))


def reached(slope: Float[np.ndarray, "R P"]) -> Float[np.ndarray, "R K"]:
    """Return an orthonormal basis of what steps explain."""
    return _factors(slope)[0]


def _factors(slope: Float[np.ndarray, "R P"]) -> tuple[Float[np.ndarray, "R K"], Float[np.ndarray, "P R"]]:
    """Return an orthonormal basis of what a slope reaches, and its pseudo-inverse."""
    U, s, Vt = np.linalg.svd(slope, full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)
    return U[:, seen], (Vt[seen].T / s[seen]) @ U[:, seen].T
