"""Many posteriors, one population: mean and spread of each parameter over a fleet, and who stands out.

Each parameter theta_rj of robot r, mostly the logarithm of a stiffness, is healthy with probability 1 - share, normal
about mean_j with sd_j, or else off, normal about the same mean with the width `FAULT`. So faulty robots do not widen
the population (the mixture for outliers of Hogg, Bovy and Lang, 2010, arXiv:1008.4686, equation 17).

In two stages (Lunn, Barrett, Sweeting and Thompson, 2013, J. R. Stat. Soc. C 62, 551): each robot's posterior under a
wide interim prior first, then the population from these with the interim prior divided out. Of a normal approximation
that is algebra (`Likelihood`), exact for it; draws (`Draws`) are importance weighted (Hogg, Myers and Bovy, 2010,
Astrophys. J. 725, 2166, equation 9).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ident.inference.population_chains import FAULT, Chains, Draws, Likelihood, Robot, log_density

WARM_UP, STEPS = 500, 1500
STEPS_OF_DRAWS = 4
"""Times as many steps where robots are known by draws, of which a step moves but some."""
LARGEST_K, LEAST_EFFECTIVE = 0.7, 200.0
"""Pareto k (Vehtari, Simpson, Gelman, Yao and Gabry, 2024, J. Mach. Learn. Res. 25, 72) above which, and effective
draws below which, weights can't be trusted."""
ROUNDS = 3
"""Times that a robot is drawn again."""
WIDER, LEAST_SHARE = 2.0, 0.05
"""Factor on the population's spread under which it is drawn again, and share that is off there at least."""


@dataclass(frozen=True)
class Weights:
    """How well the weights of a robot's draws can be trusted.

    Attributes:
        k: Pareto k.
        effective: effective number of draws.
        variance: Monte Carlo variance of the logarithm of its mean weight.
    """

    k: float
    effective: float
    variance: float

    @property
    def sound(self) -> bool:
        """Whether they can be trusted."""
        return self.k <= LARGEST_K and self.effective >= LEAST_EFFECTIVE


@dataclass(frozen=True)
class Population:
    """A population, by draws of its numbers, and each robot in its light.

    Attributes:
        mean: (n, P) draws of the means in theta.
        sd: (n, P) draws of the healthy robots' standard deviations.
        share: (n,) draws of the share of parameters that are off.
        robot_mean: (R, P) shrunk estimates in theta: posterior means by the robot's own data and the fleet.
        robot_sd: (R, P) their standard deviations.
        off: (R, P) probability that a parameter of a robot is off.
        any_off: (R,) probability that any of its parameters is.
        r_hat: largest over means and spreads: 1 where the chains agree.
        weights: by robot's number, of those that are known by draws.
        normal: numbers of robots whose weights could not be trusted, taken by a normal approximation instead.
    """

    mean: Float[np.ndarray, "n P"]
    sd: Float[np.ndarray, "n P"]
    share: Float[np.ndarray, "n"]
    robot_mean: Float[np.ndarray, "R P"]
    robot_sd: Float[np.ndarray, "R P"]
    off: Float[np.ndarray, "R P"]
    any_off: Float[np.ndarray, "R"]
    r_hat: float
    weights: Mapping[str, Weights]
    normal: tuple[int, ...] = ()

    @property
    def log_likelihood_variance(self) -> float:
        """Monte Carlo variance of the population's log-likelihood by weights; shall be below 1."""
        return float(sum(each.variance for each in self.weights.values()))

    @property
    def typical_sd(self) -> Float[np.ndarray, "P"]:
        """Geometric mean of the draws of each spread: where weights are taken."""
        return np.exp(np.log(self.sd).mean(0))

    @property
    def next_mean(self) -> Float[np.ndarray, "P"]:
        """Mean in theta of the next healthy robot."""
        return self.mean.mean(0)

    @property
    def next_sd(self) -> Float[np.ndarray, "P"]:
        """Standard deviation in theta of the next healthy robot: the spread, and how uncertain its centre is."""
        return np.sqrt(np.square(self.sd).mean(0) + self.mean.var(0))


Redraw = Callable[[int, np.ndarray, np.ndarray, float], np.ndarray]
"""Draws theta (n, P) of robot number r again, under the population's density of these means, sds and share."""


def population(
    robots: tuple[Robot, ...],
    prior_mean: Float[np.ndarray, "P"],
    prior_sd: Float[np.ndarray, "P"],
    *,
    seed: int = 0,
    redraw: Redraw | None = None,
    steps: int = STEPS,
) -> Population:
    """Infer a population from what is known of each robot.

    Args:
        robots: three at least, each by its likelihood or by draws.
        prior_mean: in theta, of the population's means.
        prior_sd: of the same.
        seed: of the chains.
        redraw: draws a robot again whose weights can't be trusted; without, a normal approximation takes its place.
        steps: of each chain that are kept, where no robot is known by draws.
    """
    robots = tuple(robots)
    for attempt in range(ROUNDS + 1):
        result = _sampled(robots, prior_mean, prior_sd, steps, seed + attempt)
        unsound = [int(r) for r, each in result.weights.items() if not each.sound]
        if not unsound or redraw is None or attempt == ROUNDS:
            break
        wider = result.next_mean, WIDER * result.typical_sd, max(float(result.share.mean()), LEAST_SHARE)
        robots = tuple(_again(redraw, r, *wider) if r in unsound else each for r, each in enumerate(robots))
    if not unsound:
        return result
    instead = tuple(
        _normal(each) if r in unsound and isinstance(each, Draws) else each for r, each in enumerate(robots)
    )
    result = _sampled(instead, prior_mean, prior_sd, steps, seed + ROUNDS + 1)
    return replace(result, normal=tuple(unsound))


def _again(redraw: Redraw, r: int, mean: np.ndarray, sd: np.ndarray, share: float) -> Draws:
    theta = redraw(r, mean, np.minimum(sd, FAULT), share)
    return Draws(theta, log_density(theta, mean, np.minimum(sd, FAULT), np.asarray(share)).sum(-1))


def _normal(draws: Draws) -> Likelihood:
    """Return the normal approximation of a robot's likelihood, its prior divided out.

    The prior's logarithm is fitted by a parabola along each parameter; what is less than nothing is set to nothing.
    """
    theta = draws.theta - (centre := draws.theta.mean(0))
    terms = np.column_stack([np.ones(len(theta)), theta, theta**2])
    fitted = np.linalg.lstsq(terms, draws.log_prior, rcond=None)[0]
    slope, curvature = fitted[1 : 1 + len(centre)], -2 * fitted[1 + len(centre) :]
    precision = np.linalg.inv(np.cov(draws.theta.T).reshape(len(centre), -1)) - np.diag(curvature)
    eigenvalues, vectors = np.linalg.eigh(precision)
    precision = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
    return Likelihood(precision, precision @ centre - slope)


def _weighed(draws: Draws, mean: np.ndarray, sd: np.ndarray, share: float) -> Weights:
    import arviz  # takes a second to import

    log_weights = log_density(draws.theta, mean, sd, np.asarray(share)).sum(-1) - draws.log_prior
    smoothed, k = arviz.psislw(log_weights)
    effective = 1 / float(np.exp(2 * smoothed).sum())  # they sum to one
    return Weights(float(k), effective, 1 / effective - 1 / len(log_weights))


def _sampled(
    robots: tuple[Robot, ...], prior_mean: np.ndarray, prior_sd: np.ndarray, steps: int, seed: int
) -> Population:
    chains = Chains(robots, prior_mean, prior_sd, np.random.default_rng(seed))
    longer = STEPS_OF_DRAWS if chains.drawn else 1
    for _ in range(WARM_UP * longer):
        chains.step()
    total = _Sums(chains)
    for _ in range(steps * longer):
        chains.step()
        total.add()
    return total.result()


class _Sums:
    """What is kept of chains while they run."""

    def __init__(self, chains: Chains):
        self.chains = chains
        self.kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.theta, self.squares = np.zeros(chains.theta.shape[1:]), np.zeros(chains.theta.shape[1:])
        self.off, self.any_off = np.zeros(chains.theta.shape[1:]), np.zeros(chains.theta.shape[1])
        self.origin = chains.theta.mean(0)

    def add(self) -> None:
        """Take the chains' state into account."""
        chains = self.chains
        self.kept.append((chains.mean.copy(), chains.sd.copy(), chains.share))
        away = chains.theta - self.origin
        self.theta += away.sum(0)
        self.squares += (away**2).sum(0)
        self.off += chains.off.sum(0)
        self.any_off += chains.off.any(-1).sum(0)

    def result(self) -> Population:
        """Return the population that the chains have drawn."""
        import arviz

        mean, sd, share = (np.stack(part, 1) for part in zip(*self.kept, strict=True))
        count = share.size
        numbers = np.concatenate([mean, np.log(sd)], -1)
        r_hat = max(float(arviz.rhat(numbers[..., i])) for i in range(numbers.shape[-1]))
        away = self.theta / count
        robot_sd = np.sqrt(np.maximum(self.squares / count - away**2, 0.0))
        mean, sd, share = mean.reshape(count, -1), sd.reshape(count, -1), share.ravel()
        weights = {
            str(r): _weighed(each, mean.mean(0), np.exp(np.log(sd).mean(0)), float(share.mean()))
            for r, each in self.chains.drawn.items()
        }
        off, any_off = self.off / count, self.any_off / count
        return Population(mean, sd, share, self.origin + away, robot_sd, off, any_off, r_hat, weights)
