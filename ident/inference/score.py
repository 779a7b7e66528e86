"""Does a fit miss something that its model takes for granted? What that would move, and whether the data ask for it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

from ident.inference.fit import Fit
from ident.inference.information import RANK_TOLERANCE
from ident.inference.verdicts import rare

APART = 1e-6
"""Share of what an amount changes in the data, squared, below which the parameters can make up for all of it."""

NOTHING = 1e-6
"""Change of all data together [sd] by the plausible amount below which they do not depend on it: rounding."""


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
    fit: Fit,
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
    alone, _ = _factors(slope[:count])
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


def _factors(slope: Float[np.ndarray, "R P"]) -> tuple[Float[np.ndarray, "R K"], Float[np.ndarray, "P R"]]:
    """Return an orthonormal basis of what a slope reaches, and its pseudo-inverse."""
    U, s, Vt = np.linalg.svd(slope, full_matrices=False)
    seen = s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)
    return U[:, seen], (Vt[seen].T / s[seen]) @ U[:, seen].T
