"""Many posteriors, one population: mean and spread of each parameter over a fleet, and who stands out.

Each parameter theta_rj of robot r, mostly the logarithm of a stiffness, is healthy with probability 1 - share, normal
about mean_j with sd_j, or else off, normal about the same mean with the width `FAULT`. So faulty robots do not widen
the population (the mixture for outliers of Hogg, Bovy and Lang, 2010, arXiv:1008.4686, equation 17).

In two stages (Lunn, Barrett, Sweeting and Thompson, 2013, J. R. Stat. Soc. C 62, 551): each robot's posterior under a
wide interim prior first, then the population from these with the interim prior divided out. Of a normal approximation
that is algebra (`Likelihood`), exact for it; draws (`Draws`) are importance weighted (Hogg, Myers and Bovy, 2010,
Astrophys. J. 725, 2166, equation 9). Draws under a wide prior fail where they matter, as few fall where the population
is: they are made under the population that is known by then, and made again where their weights can't be trusted.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ident.inference.population_chains import FAULT, Chains, Draws, Likelihood, Robot, Under

WARM_UP, STEPS = 500, 1500
STEPS_OF_DRAWS = 4
"""Times as many steps where robots are known by draws, of which a step moves but some."""
LARGEST_K, LEAST_EFFECTIVE = 0.7, 200.0
"""Pareto k (Vehtari, Simpson, Gelman, Yao and Gabry, 2024, J. Mach. Learn. Res. 25, 72) above which, and effective
draws below which, weights can't be trusted."""
ROUNDS = 3
"""Times that a robot is drawn."""
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
        weights: by robot's number, of those that are, or were, known by draws.
        normal: numbers of robots that are taken by a normal approximation.
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
        return float(sum(each.variance for each in self.trusted))

    @property
    def trusted(self) -> tuple[Weights, ...]:
        """The weights of the robots that are known by draws."""
        return tuple(each for r, each in self.weights.items() if int(r) not in self.normal)

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


Redraw = Callable[[Sequence[int], Under], Sequence[Draws | None]]
"""Draws the robots of these numbers under a population; None for one of which that is not possible."""


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
        redraw: draws each robot that is known by a normal approximation, or whose weights can't be trusted; without,
            normal approximations do.
        steps: of each chain that are kept, where no robot is known by draws.
    """
    robots, result = tuple(robots), _sampled(tuple(robots), prior_mean, prior_sd, steps, seed)
    unsound = _unsound(result, range(len(robots)))
    for attempt in range(ROUNDS):
        if not unsound or redraw is None:
            break
        drawn = dict(zip(unsound, redraw(unsound, _wider(result)), strict=True))
        robots = tuple(drawn.get(r) or each for r, each in enumerate(robots))
        result = _sampled(robots, prior_mean, prior_sd, steps, seed + attempt + 1)
        unsound = _unsound(result, unsound)
    instead = tuple(_normal(each) if r in unsound else each for r, each in enumerate(robots))
    if any(isinstance(robots[r], Draws) for r in unsound):
        result = replace(_sampled(instead, prior_mean, prior_sd, steps, seed + ROUNDS + 1), weights=result.weights)
    return replace(result, normal=tuple(r for r, each in enumerate(instead) if isinstance(each, Likelihood)))


def _unsound(result: Population, robots: Iterable[int]) -> list[int]:
    return [r for r in robots if not (known := result.weights.get(str(r))) or not known.sound]


def _normal(robot: Robot) -> Likelihood:
    return robot.normal if isinstance(robot, Draws) else robot


def _wider(population: Population) -> Under:
    """Return a population's density, widened so that all that it may yet turn out to be is drawn from."""
    sd = np.minimum(WIDER * population.typical_sd, FAULT)
    return Under(population.next_mean, sd, max(float(population.share.mean()), LEAST_SHARE))


def weighed(draws: Draws, under: Under) -> Weights:
    """Say how well the weights of a robot's draws can be trusted under a population."""
    import arviz  # takes a second to import

    smoothed, k = arviz.psislw(under.log_density(draws.theta) - draws.log_prior)
    effective = 1 / float(np.exp(2 * smoothed).sum())  # they sum to one
    return Weights(float(k), effective, 1 / effective - 1 / len(smoothed))


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
            str(r): weighed(each, Under(mean.mean(0), np.exp(np.log(sd).mean(0)), float(share.mean())))
            for r, each in self.chains.drawn.items()
        }
        off, any_off = self.off / count, self.any_off / count
        return Population(mean, sd, share, self.origin + away, robot_sd, off, any_off, r_hat, weights)
