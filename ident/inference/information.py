"""What data can tell about parameters, from the Jacobian at one point: directions, ranks, standard deviations."""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

WEAK_ABOVE = 0.5
"""Standard deviation in theta above which a direction counts as weakly known: for a stiffness, a factor of 1.6."""
OPEN_ABOVE = math.log(1e3)
"""The same above which it counts as open: whatever little the data say there, no prior would say less."""
ALONE = 0.05
"""Largest exponent of the others, relative to the first one's, with which a combination is one parameter."""
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

        What this and `prior_share` leave is told by the data together with the priors of other parameters.
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
    directions = tuple(Direction(_among(own, _signed(v)), float(sd)) for v, sd in zip(Vt, sds, strict=True))
    both = np.vstack([jacobian, np.diag(1 / np.asarray(prior_sd))])
    _, s_both, Vt_both = np.linalg.svd(both, full_matrices=False)
    covariance = _covariance(s_both * (s_both > RANK_TOLERANCE * max(s_both[0], 1e-300)), Vt_both)
    variance = np.diag(covariance)
    share = np.where(np.isfinite(variance), variance, 0.0) / np.asarray(prior_sd) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        data = np.sqrt(variance / np.maximum(1 - share, 0.0))
    data[own] = np.sqrt(np.diag(_covariance(s * seen, Vt)))
    return Information(names, directions, data, covariance, share, _rank(jacobian[:, ~own & np.isinf(prior_sd)]))


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
    U, s, _ = np.linalg.svd(free, full_matrices=False)
    U = U[:, s > RANK_TOLERANCE * max(s[:1].max(initial=0.0), 1e-300)]
    B, others = (x - U @ (U.T @ x) for x in (B * sd[nuisance & np.isfinite(sd)], others))
    U, s, _ = np.linalg.svd(B, full_matrices=False)
    return others - (U * (1 - (1 + s**2) ** -0.5)) @ (U.T @ others)


def _rank(jacobian: Float[np.ndarray, "D n"]) -> int:
    s = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.zeros(1)
    return int((s > RANK_TOLERANCE * max(s[0], 1e-300)).sum())


def _among(own: np.ndarray, weights: np.ndarray) -> np.ndarray:
    whole = np.zeros(len(own))
    whole[own] = weights
    return whole


def _covariance(s: np.ndarray, Vt: np.ndarray) -> np.ndarray:
    """Return V s^-2 V', infinite variances for parameters that touch a direction with s = 0."""
    known = s > 0
    scaled = Vt[known] / s[known, None]
    covariance = scaled.T @ scaled
    touched = (np.abs(Vt[~known]) > 1e-6).any(0)
    covariance[touched, :] = covariance[:, touched] = np.nan
    covariance[touched, touched] = np.inf
    return covariance


def _signed(v: np.ndarray) -> np.ndarray:
    return v * np.sign(v[np.argmax(np.abs(v))])


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
