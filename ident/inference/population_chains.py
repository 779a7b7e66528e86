"""The chains behind a population: what a robot is known by, and Gibbs steps over fleet and robots together."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincc, gammainccinv, ndtr, ndtri

FAULT = 0.5
"""Width in theta of what is off: a factor of 1.6. A population's sd is below it, uniform before the data (Gelman, 2006,
Bayesian Analysis 1, 515: of a hierarchical sd)."""
SHARE = (1.0, 49.0)
"""Beta prior of the share that is off: one parameter in fifty, worth as many as that."""
CHAINS = 4


@dataclass(frozen=True)
class Likelihood:
    """What one robot's data say, by a normal approximation in theta: exp(-theta' precision theta / 2 + shift' theta).

    Attributes:
        precision: (P, P) singular along directions that the data leave open.
        shift: (P,) precision times the theta that fits best.
    """

    precision: Float[np.ndarray, "P P"]
    shift: Float[np.ndarray, "P"]

    @classmethod
    def of_posterior(
        cls,
        mean: Float[np.ndarray, "P"],
        covariance: Float[np.ndarray, "P P"],
        prior_mean: Float[np.ndarray, "P"],
        prior_sd: Float[np.ndarray, "P"],
    ) -> "Likelihood":
        """Divide a normal interim prior out of a normal posterior."""
        known, prior = np.linalg.inv(covariance), 1 / np.square(prior_sd)
        return cls(known - np.diag(prior), known @ mean - prior * prior_mean)


@dataclass(frozen=True)
class Draws:
    """What one robot's data say, by draws from a known density.

    Attributes:
        theta: (n, P)
        log_prior: (n,) logarithm at each of that density over the likelihood, up to a constant: of draws from a
            posterior its prior's.
        normal: the normal approximation that takes their place where their weights can't be trusted.
    """

    theta: Float[np.ndarray, "n P"]
    log_prior: Float[np.ndarray, "n"]
    normal: Likelihood


Robot = Likelihood | Draws


@dataclass(frozen=True)
class Under:
    """A population's density, under which a robot is drawn: normal, or off with the width `FAULT`.

    Attributes:
        mean: (P,) in theta.
        sd: (P,) of the healthy.
        share: that is off.
    """

    mean: Float[np.ndarray, "P"]
    sd: Float[np.ndarray, "P"]
    share: float

    def log_density(self, theta: Float[np.ndarray, "n P"]) -> Float[np.ndarray, "n"]:
        """Return the logarithm of the density of each theta, up to a constant."""
        return np.asarray(log_density(theta, self.mean, self.sd, np.asarray(self.share)).sum(-1))


def log_density(theta: np.ndarray, mean: np.ndarray, sd: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the population's log density of each theta, `(..., P)`."""
    healthy, off = log_parts(theta, mean, sd, share)
    return np.logaddexp(healthy, off)


def log_parts(theta: np.ndarray, mean: np.ndarray, sd: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the log densities of being theta and healthy, and of being theta and off, less ln sqrt(2 pi)."""
    away = theta - mean
    healthy = np.log1p(-share) - np.log(sd) - (away / sd) ** 2 / 2
    return healthy, np.log(share) - np.log(FAULT) - (away / FAULT) ** 2 / 2


class Chains:
    """Gibbs chains over means, spreads, share, each robot's theta and what is off; `(chain, robot, parameter)`."""

    def __init__(
        self,
        robots: tuple[Robot, ...],
        prior_mean: np.ndarray,
        prior_sd: np.ndarray,
        rng: np.random.Generator,
        known_off: np.ndarray | None = None,
    ):
        self.robots, self.rng = robots, rng
        self.prior_mean, self.prior_precision = np.asarray(prior_mean), 1 / np.square(prior_sd)
        self.exact = [r for r, each in enumerate(robots) if isinstance(each, Likelihood)]
        self.drawn = {r: each for r, each in enumerate(robots) if isinstance(each, Draws)}
        known = [each for each in robots if isinstance(each, Likelihood)]
        count = len(self.prior_mean)
        self.precision = np.array([each.precision for each in known]).reshape(-1, count, count)
        self.shift = np.array([each.shift for each in known]).reshape(-1, count)
        self.mean = np.tile(self.prior_mean, (CHAINS, 1))
        self.sd = np.tile(rng.uniform(0.1, 0.9, (CHAINS, 1)) * FAULT, (1, count))
        self.share = np.full(CHAINS, SHARE[0] / sum(SHARE))
        self.known_off = np.zeros((len(robots), count), bool) if known_off is None else known_off
        self.off = np.tile(self.known_off, (CHAINS, 1, 1))
        self.theta = np.zeros((CHAINS, len(robots), count))
        self.weighed = list(self.drawn)
        self._take_the_draws()

    def step(self) -> None:
        """Draw everything once, each part given the others."""
        self._exact()
        self._among_the_draws()
        self._what_is_off()
        self._mean()
        self._sd()
        if not self.drawn:
            self._along_with_robots()
        off = self.off.sum((1, 2))
        self.share = self.rng.beta(SHARE[0] + off, SHARE[1] + self.off[0].size - off)

    def _width(self) -> np.ndarray:
        return np.where(self.off, FAULT, self.sd[:, None])

    def _exact(self) -> None:
        """Draw the theta of robots whose likelihood is normal."""
        if not self.exact:
            return
        weight = self._width()[:, self.exact] ** -2
        precision = self.precision + weight[..., None] * np.eye(weight.shape[-1])
        L = np.linalg.cholesky(precision)
        at = self.shift + weight * self.mean[:, None]
        z = self.rng.standard_normal(at.shape)[..., None]
        # precision^-1 at + L'^-1 z = L'^-1 (L^-1 at + z)
        half = np.linalg.solve(L, at[..., None]) + z
        self.theta[:, self.exact] = np.linalg.solve(np.swapaxes(L, -1, -2), half)[..., 0]

    def _take_the_draws(self) -> None:
        """Lay the draws of all robots side by side, and start at one of each."""
        self.counts = np.array([len(each.theta) for each in self.drawn.values()], int)
        most = self.counts.max(initial=0)
        self.draws = np.zeros((len(self.counts), most, len(self.prior_mean)))
        self.log_prior = np.zeros((len(self.counts), most))
        for i, each in enumerate(self.drawn.values()):
            self.draws[i, : self.counts[i]], self.log_prior[i, : self.counts[i]] = each.theta, each.log_prior
        start = self._picked()
        self.theta[:, self.weighed] = self.draws[np.arange(len(self.counts)), start]
        self.at = self.log_prior[np.arange(len(self.counts)), start]

    def _picked(self) -> np.ndarray:
        """Pick one of each robot's draws for each chain."""
        return (self.rng.uniform(size=(CHAINS, len(self.counts))) * self.counts).astype(int)

    def _among_the_draws(self) -> None:
        """Propose another of each robot's draws (Lunn et al. 2013, section 2.2)."""
        if not self.weighed:
            return
        each, picked = np.arange(len(self.counts)), self._picked()
        theta, log_prior, now = self.draws[each, picked], self.log_prior[each, picked], self.theta[:, self.weighed]
        gain = (self._log_density(theta) - self._log_density(now)).sum(-1) - log_prior + self.at
        taken = np.log(self.rng.uniform(size=gain.shape)) < gain
        self.theta[:, self.weighed] = np.where(taken[..., None], theta, now)
        self.at = np.where(taken, log_prior, self.at)

    def _log_density(self, theta: np.ndarray) -> np.ndarray:
        """Return the log density of each drawn robot's theta; what is known to be off can't be healthy."""
        healthy, off = log_parts(theta, self.mean[:, None], self.sd[:, None], self.share[:, None, None])
        return np.where(self.known_off[self.weighed], off, np.logaddexp(healthy, off))

    def _what_is_off(self) -> None:
        share = self.share[:, None, None]
        healthy, off = log_parts(self.theta, self.mean[:, None], self.sd[:, None], share)
        self.off = (np.log(self.rng.uniform(size=off.shape)) < off - np.logaddexp(healthy, off)) | self.known_off

    def _mean(self) -> None:
        weight = self._width() ** -2
        precision = weight.sum(1) + self.prior_precision
        at = (weight * self.theta).sum(1) + self.prior_precision * self.prior_mean
        self.mean = at / precision + self.rng.standard_normal(at.shape) / np.sqrt(precision)

    def _sd(self) -> None:
        """Draw the spreads: 1 / sd^2 is gamma distributed, above 1 / FAULT^2, where sd is uniform before the data."""
        healthy = ~self.off
        shape = np.maximum((healthy.sum(1) - 1) / 2, 0.5)
        half = np.maximum((healthy * (self.theta - self.mean[:, None]) ** 2).sum(1) / 2, 1e-300)
        above = gammaincc(shape, half / FAULT**2)
        drawn = gammainccinv(shape, np.maximum(self.rng.uniform(size=above.shape) * above, 1e-300))
        self.sd = np.minimum(np.sqrt(half / np.maximum(drawn, 1e-300)), FAULT)

    def _along_with_robots(self) -> None:
        """Move each mean, then each spread, with the robots moving along: (theta - mean) / width is held.

        Where data say little of single robots, a spread can't move against their theta (interweaving: Yu and Meng,
        2011, J. Comput. Graph. Stat. 20, 531). The density along a move is normal, of a spread within its bounds.
        """
        healthy = ~self.off
        for j in range(len(self.prior_mean)):
            of_mean = np.ones_like(self.theta[..., j])
            of_sd = healthy[..., j] * (self.theta[..., j] - self.mean[:, None, j]) / self.sd[:, None, j]
            self.mean[:, j] += (move := self._move(j, of_mean, True))
            self.theta[..., j] += move[:, None] * of_mean
            self.sd[:, j] += (move := self._move(j, of_sd, False))
            self.theta[..., j] += move[:, None] * of_sd

    def _move(self, j: int, direction: np.ndarray, is_mean: bool) -> np.ndarray:
        """Draw how far the mean or the spread of parameter j moves, with theta_j moving along this direction."""
        slope = self.shift[:, j] - np.einsum("rp,crp->cr", self.precision[:, j], self.theta)
        gradient = (direction * slope).sum(1)
        precision = (direction**2 * self.precision[:, j, j]).sum(1)
        if is_mean:
            gradient = gradient + self.prior_precision[j] * (self.prior_mean[j] - self.mean[:, j])
            precision = precision + self.prior_precision[j]
            return gradient / precision + self.rng.standard_normal(CHAINS) / np.sqrt(precision)
        sd = self.sd[:, j]
        precision = np.maximum(precision, 1e-12)
        centre, width = gradient / precision, 1 / np.sqrt(precision)
        sign = np.where(centre > 0, -1.0, 1.0)  # in the tail where ndtr keeps its digits
        ends = np.sort(sign * np.stack([(1e-9 - sd - centre) / width, (FAULT - sd - centre) / width]), 0)
        low, high = ndtr(ends)
        drawn = sign * ndtri(low + self.rng.uniform(size=CHAINS) * (high - low))
        move = centre + width * drawn
        return np.where(np.isfinite(move), np.clip(move, 1e-9 - sd, FAULT - sd), 0.0)
