"""Information of data on parameters, from the Jacobian at one point: directions, ranks, standard deviations."""

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
"""Standard deviation in theta above which a direction is weakly determined: for a stiffness, a factor of 1.6;
assumed."""
OPEN_ABOVE = math.log(1e3)
"""Standard deviation in theta above which a direction is not determined: any prior carries more information."""
ALONE = 0.05
"""A combination whose other exponents are all below this share of its largest is one parameter; assumed."""
RANK_TOLERANCE = 1e-8
"""Singular values below this share of the largest are rounding errors."""


@dataclass(frozen=True)
class Direction:
    """A combination of parameters, and how well the data determine it.

    Attributes:
        weights: (P,) unit vector in theta.
        sd: standard deviation by the data along it, in theta; infinite without any information.
    """

    weights: Float[np.ndarray, "P"]
    sd: float

    @property
    def seen(self) -> bool:
        """Whether the data depend on it at all."""
        return bool(np.isfinite(self.sd))

    @property
    def open(self) -> bool:
        """Whether it is not determined: the data do not depend on it, or leave more than a factor of a thousand."""
        return not self.sd < OPEN_ABOVE

    @property
    def weak(self) -> bool:
        """Whether it is weakly determined."""
        return not self.open and self.sd > WEAK_ABOVE


@dataclass(frozen=True)
class Information:
    """Information of data and prior on the parameters around a point.

    Attributes:
        names: (P,) parameters.
        directions: (Q,) of the Q unknowns of interest, from the best known to the least known, orthogonal in theta;
            nuisances count as noise.
        spent: degrees of freedom that nuisances without a prior take from the data.
        data_sd: (P,) standard deviation in theta by the data alone; infinite where they do not determine the parameter.
            The priors of nuisances count as data, except a nuisance's own prior in its own row.
        covariance: (P, P) of theta by data and prior; infinite variances where neither has information.
        prior_share: (P,) share of the prior in the information on each parameter, from 0 to 1.
    """

    names: tuple[str, ...]
    directions: tuple[Direction, ...]
    data_sd: Float[np.ndarray, "P"]
    covariance: Float[np.ndarray, "P P"]
    prior_share: Float[np.ndarray, "P"]
    spent: int = 0

    @property
    def rank(self) -> int:
        """Number of directions on which the data depend."""
        return sum(direction.seen for direction in self.directions)

    @property
    def fixed(self) -> int:
        """Number of directions that the data determine."""
        return sum(not direction.open for direction in self.directions)

    @property
    def sd(self) -> Float[np.ndarray, "P"]:
        """Standard deviation of each theta by data and prior."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def supported(self) -> np.ndarray:
        """Which parameters have a finite interval by the data alone."""
        return self.data_sd < WEAK_ABOVE

    @property
    def open(self) -> np.ndarray:
        """Which parameters the data alone do not determine, by the rule for directions."""
        return ~(self.data_sd < OPEN_ABOVE)

    @property
    def data_share(self) -> Float[np.ndarray, "P"]:
        """Share of the data alone in the information on each parameter, from 0 to 1.

        The rest, after this and `prior_share`, comes from the data together with the priors of other parameters.
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
        """For each undetermined direction, the free parameter and how the others compensate for it."""
        open_space = np.array([d.weights for d in self.directions if d.open])
        return tuple(TradeOff(self.names[lead], row) for lead, row in _echelon(open_space))


@dataclass(frozen=True)
class TradeOff:
    """A change of the parameters with little or no effect on the data.

    Attributes:
        name: the parameter that can be chosen freely.
        change: (P,) change of each theta when that parameter's theta changes by one.
    """

    name: str
    change: Float[np.ndarray, "P"]


def half_width(level: float) -> float:
    """Return the half width of a normal distribution's central interval in standard deviations."""
    return NormalDist().inv_cdf(0.5 + level / 2)


def alone(weights: Float[np.ndarray, "P"]) -> Float[np.ndarray, "P"]:
    """Return the unit vector of one parameter if the others in the combination are negligible, else the combination."""
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
        nuisance: which parameters count as noise of the data, within their priors; none by default.
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
    """Return the Jacobian of the unknowns of interest, whitened for the scatter that nuisances add to the data.

    With B the nuisances' columns times their priors' sds, the covariance of the data is 1 + B B' = U diag(1 + s^2) U' +
    rest; so the other columns are multiplied by its inverse square root, 1 - U diag(1 - (1 + s^2)^-1/2) U'. The columns
    of nuisances without a prior are projected out first.
    """
    sd, others = np.asarray(prior_sd), jacobian[:, ~nuisance]
    free, B = (jacobian[:, nuisance & known] for known in (np.isinf(sd), np.isfinite(sd)))
    U = reached(free)
    B, others = (x - U @ (U.T @ x) for x in (B * sd[nuisance & np.isfinite(sd)], others))
    U, s, _ = np.linalg.svd(B, full_matrices=False)
    return others - (U * (1 - (1 + s**2) ** -0.5)) @ (U.T @ others)


def _covariance(s: np.ndarray, Vt: np.ndarray) -> np.ndarray:
    """Return V s^-2 V'; variances are infinite for parameters that take part in a direction with s = 0."""
    known = s > 0
    scaled = Vt[known] / s[known, None]
    covariance = scaled.T @ scaled
    touched = (np.abs(Vt[~known]) > 1e-6).any(0)
    covariance[touched, :] = covariance[:, touched] = np.nan
    covariance[touched, touched] = np.inf
    return covariance


def _echelon(rows: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Reduce a basis to reduced echelon form with full pivoting: each row has its own leading parameter."""
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
"""Standard deviations beyond which a single normal value is suspicious; the limit rises with the number of tests."""
RARE = 2 * NormalDist().cdf(-SUSPICIOUS)
"""Probability of a false alarm among all values, or all kinds of data, tested together: that of `SUSPICIOUS`."""
IMPROBABLE = 1e-3
"""P-value of chi-squared below which the fit is rejected: too large, model or sigmas are wrong; too small, sigmas or
rows; assumed."""


def rare(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Return which p-values are too small, with at most one false alarm in 1 / RARE sets of tests (`holm`)."""
    return holm(chances) < RARE


def holm(chances: Sequence[float] | Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Return p-values corrected for the number of tests.

    Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Statist. 6, 1979: the smallest of n times
    n, the next one times n - 1, none less than its predecessors.
    """
    single = np.asarray(chances, float)
    order = np.argsort(single)
    stepwise = np.maximum.accumulate(single[order] * np.arange(len(single), 0, -1))
    return np.minimum(stepwise, 1.0)[np.argsort(order)]


def farthest(count: int) -> float:
    """Return the outlier limit [sd] for the farthest of `count` normal values."""
    return standard_deviations(RARE / max(count, 1))


def standard_deviations(chance: float) -> float:
    """Return the number of standard deviations that a normal value exceeds, up or down, with this probability."""
    return -NormalDist().inv_cdf(chance / 2) if chance / 2 > 0 else np.inf


def p_in_words(p: float, digits: int = 2) -> str:
    """Write a p-value: `p = 0.031`; below the range of a double `p < 1e-300`."""
    return "p < 1e-300" if p < 1e-300 else f"p = {p:.{digits}g}"


def chi_squared_in_words(test: "Fit | Consistency") -> str:
    """Write chi-squared with its degrees of freedom and p-value."""
    if not test.degrees_of_freedom > 0:
        return "no degrees of freedom are left, so chi-squared tests nothing"
    p = "" if math.isnan(test.p_value) else f" ({p_in_words(test.p_value)})"
    return f"chi-squared {test.chi_squared:.3g} on {test.degrees_of_freedom} degrees of freedom{p}"


def sigma_in_words(sd: float) -> str:
    """Write a p-value as standard deviations: `4.1 sigma`; infinite stands for more than a double resolves."""
    return f"{sd:.1f} sigma" if sd < np.inf else "over 38 sigma"


# -------- Score
# Is an assumption of the model violated? How far that would move the parameters, and the evidence in the data.
#
# A model assumes that the base is rigid, and that no single value is wrong: both are amounts taken to be
# zero.

APART = 1e-6
"""Squared share of an amount's effect that the parameters cannot absorb; below this it is not separable from them."""

NOTHING = 1e-6
"""Change of all data together [sd] by the plausible amount; below this the change is rounding."""

CHECKED = 0.01
"""Squared share of a value's error that the fit does not absorb; below this the value cannot be checked: an error of
10 times the limit, 38 sigma for 20 values, would pass in half of the cases."""
BLAMED = 20
"""Most outliers among which to search for a single one that explains the others."""


@dataclass(frozen=True)
class ScoreTest:
    """Effect of one amount that the model takes to be zero, and the evidence for it in the data.

    Attributes:
        amount: plausible size.
        positive: whether it cannot be negative, so that only a positive score counts.
        shift: (P,) change of each theta if that amount were modelled.
        seen: whether the data depend on it at all.
        apart: squared share of its effect on the data that no change of the parameters can absorb.
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
        """Whether the data can separate it from the parameters."""
        return self.seen and self.apart > APART

    @property
    def p_value(self) -> float:
        """P-value of the score, one-sided if the amount is positive; NaN where it is not separable."""
        if not self.separable:
            return math.nan
        tail = NormalDist().cdf(-self.z if self.positive else -abs(self.z))
        return tail if self.positive else 2 * tail


def asked_for(tests: Sequence[ScoreTest]) -> tuple[int, ...]:
    """Return the indices of the significant tests, largest score first; Holm over all separable ones."""
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

    With r = (predicted - measured) / sigma stacked on the residuals of the priors, S their Jacobian by theta, d that by
    an amount (zero for the priors), and d_p = d - S (S'S)^-1 S'd the part of d that theta cannot absorb,

        z = -d_p' r / |d_p|,        shift by an amount a = -(S'S)^-1 S'd a,

    where |d_p|^2 = d'd - d'S (S'S)^-1 S'd is the information on the amount (Rao 1948). A nonnegative amount has a
    one-sided test: at the boundary zero the score stays normal, unlike the likelihood ratio.

    Args:
        fit: its best optimum is tested.
        changes: derivatives of the predictions [SI] by each amount, at zero.
        amounts: plausible sizes, in the same unit.
        positive: whether each amount cannot be negative.
        without: data to leave out, as their derivatives are unknown; none when None.

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
    """Outlier tests: the score test of a shift of each value, or of each vector of values.

    Attributes:
        z: (D,) the shift in standard deviations, with the sign of predicted - measured: normal if all is right; NaN if
            the value is not fitted, or if the parameters absorb any error of it.
        left: (D,) squared share of the value's error that the parameters cannot absorb, all other errors given; for a
            component of a vector, that of the vector's best direction.
        chance: (D,) p-value of the shift; for a component, that of the whole vector; NaN where `z` is.
        units: (D,) number of each value's vector; any other value has a number of its own.
    """

    z: Float[np.ndarray, "D"]
    left: Float[np.ndarray, "D"]
    chance: Float[np.ndarray, "D"]
    units: Int[np.ndarray, "D"]

    @property
    def tested(self) -> int:
        """Number of values and vectors tested."""
        return len(np.unique(self.units[np.isfinite(self.chance)]))

    @property
    def limit(self) -> float:
        """Outlier limit [sd] for that number of tests."""
        return farthest(self.tested)

    @property
    def outliers(self) -> Bool[np.ndarray, "D"]:
        """Which values are outliers, with all components of a vector; Holm over all tests."""
        known = np.flatnonzero(np.isfinite(self.chance))
        units, first, place = np.unique(self.units[known], return_index=True, return_inverse=True)
        found = np.zeros(len(self.z), bool)
        found[known] = rare(self.chance[known][first])[place] if len(units) else False
        return found

    @property
    def unchecked(self) -> Bool[np.ndarray, "D"]:
        """Which fitted values cannot be checked: no other data or prior predicts them."""
        return self.left < CHECKED


def row_tests(problem: InverseProblem, residuals: Float[np.ndarray, "R"], slope: Float[np.ndarray, "R P"]) -> RowTests:
    """Test a shift of each value by itself, the parameters profiled out: is that value wrong?

    With C the covariance of the errors, r = predicted - measured, J the Jacobian, P the information of the priors, and
    e the value's unit vector,

        z = e' C^-1 r / (e' C^-1 V C^-1 e)^1/2,        V = C - J (J' C^-1 J + P)^-1 J',

    which is the score test (`score_tests`) of one more parameter that moves this value only. In a linear model z^2 is
    also the fall of the cost by that parameter. For independent errors z is the residual over sigma (1 - h)^1/2, with
    the value's leverage h. The components of a vector are shifted together: chi-squared.

    Args:
        problem: its `correlation`, `vectors` and finite `sigma` count.
        residuals: whitened residuals of the data, then those of the priors, as from `InverseProblem.weigh`.
        slope: their Jacobian by all fitted parameters.

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
        from scipy.special import chdtrc  # takes 0.1 s to import, only for campaigns with vectors

        own = np.flatnonzero(fitted & (units == unit))
        # in whitened directions, so that the part of an error not absorbed is a share
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
    """Return each value, or vector, whose removal leaves no other outlier; nothing if more than `BLAMED` are outliers.

    A wrong value pulls the fit, so that right ones may look wrong as well. If several are returned, the data cannot
    decide which of them is wrong.

    Args:
        problem: as in `row_tests`.
        residuals: as there.
        slope: as there.

    Returns:
        Indices of the value, or of the vector's components.
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
    """Return the whitened shift of each of some values by its sigma."""
    shifts = np.zeros((len(problem.kinds), len(own)))
    shifts[own, np.arange(len(own))] = 1.0
    return np.asarray(problem.errors.whiten(shifts))


def reached(slope: Float[np.ndarray, "R P"]) -> Float[np.ndarray, "R K"]:
    """Return an orthonormal basis of the column space of the slope."""
    return _factors(slope)[0]


def _factors(slope: Float[np.ndarray, "R P"]) -> tuple[Float[np.ndarray, "R K"], Float[np.ndarray, "P R"]]:
    """Return an orthonormal basis of a slope's column space, and its pseudo-inverse."""
    U, s, Vt = np.linalg.svd(slope, full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)
    return U[:, seen], (Vt[seen].T / s[seen]) @ U[:, seen].T
