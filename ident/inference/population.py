"""Many posteriors, one population: outliers of a fleet, then mean and spread of each parameter over the other robots.

First each robot is judged against the others (`deviations`), with one false-alarm probability for the whole fleet. A
significant deviation counts as a fault, and so does not widen the population. Each parameter theta_rj of robot r,
mostly the logarithm of a stiffness, is healthy with probability 1 - share: normal about mean_j with sd_j. Otherwise it
is faulty: normal about the same mean with the width `FAULT`. So a fault too small to be significant does not widen the
population either (mixture for outliers of Hogg, Bovy and Lang, 2010, arXiv:1008.4686, equation 17).

There are two stages (Lunn, Barrett, Sweeting and Thompson, 2013, J. R. Stat. Soc. C 62, 551): first each robot's
posterior under a wide interim prior, then the population from these with the interim prior divided out. For a normal
approximation (`Likelihood`) the division is exact algebra; draws (`Draws`) are importance weighted (Hogg, Myers and
Bovy, 2010, Astrophys. J. 725, 2166, equation 9). Under a wide prior too few draws fall into the population: so robots
are drawn under the current population, and drawn again if their weights cannot be trusted.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaincc, gammainccinv, ndtr, ndtri

# -------- Population chains
# The chains behind a population: likelihoods or draws of the robots, and Gibbs steps over fleet and robots together.

FAULT = 0.5
"""Width of the fault density in theta: a factor of 1.6. A population's sd is below it, with a uniform prior (Gelman,
2006, Bayesian Analysis 1, 515, on hierarchical sds)."""
SHARE = (1.0, 49.0)
"""Beta prior of the share of faulty parameters: one in fifty, with the weight of fifty parameters."""
CHAINS = 4


@dataclass(frozen=True)
class Likelihood:
    """Likelihood of one robot, as a normal approximation in theta: exp(-theta' precision theta / 2 + shift' theta).

    Attributes:
        precision: (P, P) singular along directions that the data do not determine.
        shift: (P,) precision times the best-fitting theta.
    """

    precision: Float[np.ndarray, "P P"]
    shift: Float[np.ndarray, "P"]


@dataclass(frozen=True)
class Draws:
    """Likelihood of one robot, as draws from a known density.

    Attributes:
        theta: (n, P)
        log_prior: (n,) logarithm of that density over the likelihood at each draw, up to a constant: for draws from a
            posterior, the log prior.
        normal: the normal approximation that replaces them if their weights cannot be trusted.
    """

    theta: Float[np.ndarray, "n P"]
    log_prior: Float[np.ndarray, "n"]
    normal: Likelihood


Robot = Likelihood | Draws


@dataclass(frozen=True)
class Under:
    """A population's density, under which a robot is drawn: healthy, or faulty with the width `FAULT`.

    Attributes:
        mean: (P,) in theta.
        sd: (P,) of healthy robots.
        share: of faulty parameters.
    """

    mean: Float[np.ndarray, "P"]
    sd: Float[np.ndarray, "P"]
    share: float

    def log_density(self, theta: Float[np.ndarray, "n P"]) -> Float[np.ndarray, "n"]:
        """Return the logarithm of the density of each theta, up to a constant."""
        return np.asarray(np.logaddexp(*log_parts(theta, self.mean, self.sd, np.asarray(self.share))).sum(-1))


def log_parts(theta: np.ndarray, mean: np.ndarray, sd: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the log densities of a healthy theta and of a faulty theta, less ln sqrt(2 pi)."""
    away = theta - mean
    healthy = np.log1p(-share) - np.log(sd) - (away / sd) ** 2 / 2
    return healthy, np.log(share) - np.log(FAULT) - (away / FAULT) ** 2 / 2


class Chains:
    """Gibbs chains over means, spreads, share, each robot's theta and its fault flags; `(chain, robot, parameter)`."""

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
        # the draws of all robots in one array, and a start at one draw of each
        self.counts = np.array([len(each.theta) for each in self.drawn.values()], int)
        most = self.counts.max(initial=0)
        self.draws = np.zeros((len(self.counts), most, count))
        self.log_prior = np.zeros((len(self.counts), most))
        for i, each in enumerate(self.drawn.values()):
            self.draws[i, : self.counts[i]], self.log_prior[i, : self.counts[i]] = each.theta, each.log_prior
        start = self._picked()
        self.theta[:, self.weighed] = self.draws[np.arange(len(self.counts)), start]
        self.at = self.log_prior[np.arange(len(self.counts)), start]

    def step(self) -> None:
        """Draw each block once, given the others."""
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
        """Draw theta of the robots with a normal likelihood."""
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
        """Return the log density of each drawn robot's theta; known faults keep the wide density."""
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
        """Move each mean, then each spread, together with the robots, at constant (theta - mean) / width.

        With weak data on single robots, a spread cannot move against their theta (interweaving: Yu and Meng, 2011,
        J. Comput. Graph. Stat. 20, 531). The density along a move is normal, for a spread within its bounds.
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
        """Draw the move of the mean or the spread of parameter j, with theta_j moving along this direction."""
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
        sign = np.where(centre > 0, -1.0, 1.0)  # the tail in which ndtr keeps its digits
        ends = np.sort(sign * np.stack([(1e-9 - sd - centre) / width, (FAULT - sd - centre) / width]), 0)
        low, high = ndtr(ends)
        drawn = sign * ndtri(low + self.rng.uniform(size=CHAINS) * (high - low))
        move = centre + width * drawn
        return np.where(np.isfinite(move), np.clip(move, 1e-9 - sd, FAULT - sd), 0.0)


# -------- Population

WARM_UP, STEPS = 500, 1500
STEPS_OF_DRAWS = 4
"""Factor on the number of steps if robots are given as draws, as a step moves only some of these robots."""
LARGEST_K, LEAST_EFFECTIVE = 0.7, 200.0
"""Pareto k (Vehtari, Simpson, Gelman, Yao and Gabry, 2024, J. Mach. Learn. Res. 25, 72) above which, and effective
draws below which, weights cannot be trusted."""
ROUNDS = 3
"""Most times that a robot is drawn."""
WIDER, LEAST_SHARE = 2.0, 0.05
"""For drawing a robot again: factor on the population's spread, and least share of faulty parameters."""
FALSE_ALARM = 0.03
"""False-alarm probability of a healthy fleet: below the nominal 5 %, as very unequal spreads raise it up to 5 %
(tests/benchmarks/README.md)."""
SPREADS = (0.003, 1.0)
"""Range [theta] of the search for a population's spread."""
TYPICAL, UNLIKE = (0.01, 0.5), 0.5
"""Prior of the spreads of one design's parameters, assumed: log-normal about one typical spread in this range; the
standard deviation of their logarithms is half-normal with this width."""
GRID = 60
"""Grid points of the integration over a spread."""
HIDDEN, FEW = 2, 60
"""Most faulty robots in a reference that can mask each other, and the fleet size above which masking is negligible and
not searched for."""
SETTLING = 3
"""Iterations between the population and each parameter's estimate given the population."""
DOUBTED = 0.01
"""p value below which this parameter is left free when another parameter of the same robot is judged."""
FAR = 18.0
"""Fall of the log likelihood below its maximum beyond which a spread counts as impossible."""


@dataclass(frozen=True)
class Deviations:
    """Deviation of each robot from the others.

    Attributes:
        difference: (R, P) own value less the other robots' mean [theta]; 0 without information in its data.
        sd: (R, P) standard deviation of that difference for a healthy robot.
        p: (R, P) two-sided p value for a healthy robot; 1 without information in its data.
        named: (robot, parameter) of each significant deviation, the clearest first.
        chance: probability, for each of these, that any parameter of a healthy fleet deviates as far.
    """

    difference: Float[np.ndarray, "R P"]
    sd: Float[np.ndarray, "R P"]
    p: Float[np.ndarray, "R P"]
    named: tuple[tuple[int, int], ...]
    chance: tuple[float, ...]

    @property
    def off(self) -> Bool[np.ndarray, "R P"]:
        """Which parameters deviate significantly."""
        off = np.zeros(self.p.shape, bool)
        for place in self.named:
            off[place] = True
        return off


@dataclass(frozen=True)
class Weights:
    """Reliability of the importance weights of a robot's draws.

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
    """Draws of a population's parameters, and each robot's estimate given the population.

    Attributes:
        mean: (n, P) draws of the means in theta.
        sd: (n, P) draws of the healthy robots' standard deviations.
        share: (n,) draws of the share of faulty parameters.
        robot_mean: (R, P) shrunk estimates in theta: posterior means by the robot's own data and the fleet.
        robot_sd: (R, P) their standard deviations.
        off: (R, P) probability that a parameter of a robot is faulty.
        r_hat: largest over means and spreads; 1 if the chains agree.
        weights: by robot index, for robots that are, or were, given as draws.
        normal: indices of robots in normal approximation.
    """

    mean: Float[np.ndarray, "n P"]
    sd: Float[np.ndarray, "n P"]
    share: Float[np.ndarray, "n"]
    robot_mean: Float[np.ndarray, "R P"]
    robot_sd: Float[np.ndarray, "R P"]
    off: Float[np.ndarray, "R P"]
    r_hat: float
    weights: Mapping[str, Weights]
    normal: tuple[int, ...] = ()

    @property
    def log_likelihood_variance(self) -> float:
        """Monte Carlo variance of the population's log-likelihood from the weights; should be below 1."""
        return float(sum(each.variance for each in self.trusted))

    @property
    def trusted(self) -> tuple[Weights, ...]:
        """Weights of the robots given as draws."""
        return tuple(each for r, each in self.weights.items() if int(r) not in self.normal)

    @property
    def next_mean(self) -> Float[np.ndarray, "P"]:
        """Mean in theta of the next healthy robot."""
        return self.mean.mean(0)

    @property
    def next_sd(self) -> Float[np.ndarray, "P"]:
        """Standard deviation in theta of the next healthy robot: spread and uncertainty of the mean."""
        return np.sqrt(np.square(self.sd).mean(0) + self.mean.var(0))


Redraw = Callable[[Sequence[int], Under], Sequence[Draws | None]]
"""Draws the robots of these indices under a population; None for a robot that cannot be drawn."""


def population(
    robots: tuple[Robot, ...],
    prior_mean: Float[np.ndarray, "P"],
    prior_sd: Float[np.ndarray, "P"],
    *,
    seed: int = 0,
    off: Bool[np.ndarray, "R P"] | None = None,
    redraw: Redraw | None = None,
    steps: int = STEPS,
) -> Population:
    """Infer a population from the likelihood of each robot.

    Args:
        robots: at least three, each as a normal likelihood or as draws.
        prior_mean: in theta, of the population's means.
        prior_sd: of the same.
        seed: of the chains.
        off: known faults, see `deviations`.
        redraw: draws each robot in normal approximation, or with weights that cannot be trusted; without it, the normal
            approximations stay.
        steps: kept steps of each chain if no robot is given as draws.
    """

    def sampled(robots: tuple[Robot, ...], seed: int) -> Population:
        return _sampled(Chains(robots, prior_mean, prior_sd, np.random.default_rng(seed), off), steps)

    result = sampled(robots, seed)
    unsound = _unsound(result, range(len(robots)))
    for attempt in range(ROUNDS):
        if not unsound or redraw is None:
            break
        # widened to cover what the population may become in the next round
        sd = np.minimum(WIDER * np.exp(np.log(result.sd).mean(0)), FAULT)
        under = Under(result.next_mean, sd, max(float(result.share.mean()), LEAST_SHARE))
        drawn = dict(zip(unsound, redraw(unsound, under), strict=True))
        robots = tuple(drawn.get(r) or each for r, each in enumerate(robots))
        result = sampled(robots, seed + attempt + 1)
        unsound = _unsound(result, unsound)
    instead = tuple(each.normal if r in unsound and isinstance(each, Draws) else each for r, each in enumerate(robots))
    if any(isinstance(robots[r], Draws) for r in unsound):
        result = replace(sampled(instead, seed + ROUNDS + 1), weights=result.weights)
    return replace(result, normal=tuple(r for r, each in enumerate(instead) if isinstance(each, Likelihood)))


def _unsound(result: Population, robots: Iterable[int]) -> list[int]:
    return [r for r in robots if not (known := result.weights.get(str(r))) or not known.sound]


def weighed(draws: Draws, under: Under) -> Weights:
    """Return the reliability of a robot's importance weights under a population."""
    import arviz  # takes a second to import

    smoothed, k = arviz.psislw(under.log_density(draws.theta) - draws.log_prior)
    effective = 1 / float(np.exp(2 * smoothed).sum())  # they sum to one
    return Weights(float(k), effective, 1 / effective - 1 / len(smoothed))


def _sampled(chains: Chains, steps: int) -> Population:
    """Run the chains, and return the population from their draws."""
    import arviz

    longer = STEPS_OF_DRAWS if chains.drawn else 1
    for _ in range(WARM_UP * longer):
        chains.step()
    kept, origin = [], chains.theta.mean(0)
    theta, squares, off = (np.zeros(origin.shape) for _ in range(3))
    for _ in range(steps * longer):
        chains.step()
        kept.append((chains.mean.copy(), chains.sd.copy(), chains.share))
        away = chains.theta - origin
        theta += away.sum(0)
        squares += (away**2).sum(0)
        off += chains.off.sum(0)
    mean, sd, share = (np.stack(part, 1) for part in zip(*kept, strict=True))
    count = share.size
    numbers = np.concatenate([mean, np.log(sd)], -1)
    r_hat = max(float(arviz.rhat(numbers[..., i])) for i in range(numbers.shape[-1]))
    away = theta / count
    robot_sd = np.sqrt(np.maximum(squares / count - away**2, 0.0))
    mean, sd, share = mean.reshape(count, -1), sd.reshape(count, -1), share.ravel()
    under = Under(mean.mean(0), np.exp(np.log(sd).mean(0)), float(share.mean()))
    weights = {str(r): weighed(each, under) for r, each in chains.drawn.items()}
    return Population(mean, sd, share, origin + away, robot_sd, off / count, r_hat, weights)


def deviations(
    robots: Sequence[Likelihood],
    prior_mean: Float[np.ndarray, "P"],
    prior_sd: Float[np.ndarray, "P"],
    false_alarm: float = FALSE_ALARM,
) -> Deviations:
    """Judge each robot against the others, and name the significant deviations.

    Parameter j of robot r is compared with its prediction from the other robots: given their spread tau_j, normal with
    the variance tau_j^2 + s_rj^2 + var(mean_j), s_rj from its own data and mean_j from theirs. Integrated over the
    posterior of tau_j this is a t test that includes the errors of the data and learns the design's spreads from the
    other parameters (a moderated t test: Smyth, 2004, Stat. Appl. Genet. Mol. Biol. 3, 3).

    The smallest p value is judged first, against the false-alarm probability over the number of tests (Holm, 1979,
    Scand. J. Stat. 6, 65). A significant value leaves all references, and the rest is judged again: so a fault makes no
    healthy robot look faulty, and masks no smaller one. Two or three similar faults would mask each other: so the
    reference is a mixture over which of the farthest others are faulty, as rare and as wide as in the population.

    Args:
        robots: at least three.
        prior_mean: in theta, start of the search for the population.
        prior_sd: of the same.
        false_alarm: probability of any significant deviation in a healthy fleet.
    """
    precision, shift = np.array([each.precision for each in robots]), np.array([each.shift for each in robots])
    own = np.linalg.solve(precision + np.diag(prior_sd**-2.0), (shift + prior_mean / prior_sd**2)[..., None])[..., 0]
    mean = np.median(own, 0)
    spread = np.clip(1.5 * np.median(np.abs(own - mean), 0), 0.02, 0.5)
    off, named, chance = np.zeros(own.shape, bool), list[tuple[int, int]](), list[float]()
    difference, sd, p = np.zeros(own.shape), np.zeros(own.shape), np.ones(own.shape)
    rounds = SETTLING
    while True:
        for _ in range(rounds):
            value, known = _of_each_parameter(precision, shift, mean, np.where(off | (p < DOUBTED), FAULT, spread))
            mean, spread, *judged = _by_the_others(value, known, off)
            difference, sd, p = (np.where(off, *each) for each in zip((difference, sd, p), judged, strict=True))
        tested = np.where(off, 1.0, p)
        corrected = tested * (tested < 1.0).sum()
        # The clearest of its robot and of its parameter: such deviations are independent of each other.
        clearest = (tested == tested.min(0)) & (tested == tested.min(1, keepdims=True))
        found = np.argwhere(clearest & (tested < 1.0) & (corrected <= false_alarm))
        if not len(found):
            return Deviations(difference, sd, p, tuple(named), tuple(chance))
        for r, j in sorted(found.tolist(), key=lambda place: float(p[tuple(place)])):
            named.append((r, j))
            chance.append(max(float(corrected[r, j]), *chance[-1:], 0.0))
            off[r, j] = True
        rounds = 2


def _of_each_parameter(
    precision: np.ndarray, shift: np.ndarray, mean: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return each robot's own value of each parameter and its precision, (R, P), the others integrated out.

    The others are normal about the population's mean with a width, (R, P). Precision 0 without information in the data.
    """
    weight = 1 / (width**2 * (1 + 1 / len(width)))  # the mean's variance falls with the number of robots
    covariance = np.linalg.inv(precision + weight[..., None] * np.eye(len(mean)))
    variance = np.einsum("rpp->rp", covariance)
    centre = np.einsum("rpq,rq->rp", covariance, shift + weight * mean)
    known = 1 / variance - weight  # the parameter's own prior divided out
    known = np.where(known > 1e-6 * weight, known, 0.0)
    return np.divide(centre / variance - weight * mean, known, out=np.zeros_like(known), where=known > 0), known


def _by_the_others(
    value: np.ndarray, known: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return mean and spread of the population, (P,), and difference, sd and p of each robot against others, (R, P).

    Args:
        value: (R, P) own values.
        known: (R, P) their precision.
        off: (R, P) values to leave out.
    """
    used = (known > 0) & ~off
    middle = np.array([np.median(own[some]) if some.any() else 0.0 for own, some in zip(value.T, used.T, strict=True)])
    away, own = np.where(known > 0, value - middle, 0.0), 1 / np.where(known > 0, known, 1.0)
    values, each = _Values(away, own, used, _suspects(away, own, used)), np.arange(len(middle))
    coarse = np.tile(np.linspace(np.log(SPREADS[0]), np.log(SPREADS[1]), GRID), (len(middle), 1))
    logs = [reference.log_evidence for reference in values.references(coarse)]
    likely = [log > log.max((0, -1), keepdims=True) - FAR for log in logs]
    some = np.any([part.any((0, 1)) for part in likely], axis=0)
    first, last = some.argmax(1), GRID - 1 - some[:, ::-1].argmax(1)
    low, high = coarse[each, np.maximum(first - 1, 0)], coarse[each, np.minimum(last + 1, GRID - 1)]
    grid = np.linspace(low, high, GRID, axis=1)
    whole, others = values.references(grid)
    prior = _prior_of_spreads(np.logaddexp.reduce(whole.log_evidence[:, 0], axis=0), grid)

    def weights(log_evidence: np.ndarray) -> np.ndarray:
        weight = np.exp(log_evidence - log_evidence.max((0, -1), keepdims=True)) * prior
        return np.asarray(weight / weight.sum((0, -1), keepdims=True))

    weight = weights(whole.log_evidence)[:, 0]
    mean, spread = middle + (weight * whole.mean[:, 0]).sum((0, -1)), np.exp((weight * grid).sum((0, -1)))
    weight = weights(others.log_evidence)
    difference = away[..., None] - others.mean
    variance = np.exp(2 * grid) + own[..., None] + others.variance
    told = (known > 0) & (used.sum(0) - used >= 2)
    p = np.where(told, (weight * 2 * ndtr(-np.abs(difference) / np.sqrt(variance))).sum((0, -1)), 1.0)
    between = (weight * difference).sum((0, -1))
    sd = np.sqrt((weight * (variance + (difference - between[..., None]) ** 2)).sum((0, -1)))
    return mean, spread, np.where(told, between, 0.0), sd, p


def _suspects(away: np.ndarray, own: np.ndarray, used: np.ndarray) -> list[np.ndarray]:
    """Return the sets of robots that may be faulty together, farthest first, (size, P) each: none, one, two."""
    count = len(away)
    most = min(HIDDEN, (count - 2) // 3) if count <= FEW else 0
    scale = np.median(np.abs(away), 0) + 1e-3
    far = np.where(used, np.abs(away) / np.sqrt(own + scale**2), -1.0)
    farthest = np.argsort(-far, 0, kind="stable")[: most + 1]
    sets = [list(some) for size in range(most + 1) for some in combinations(range(most + 1), size)]
    return [farthest[some] for some in sets]


class _Reference(NamedTuple):
    """Some robots' posterior of a population's mean, for each set of faulty others and each spread of a grid.

    Attributes:
        log_evidence: (C, ..., P, G) log likelihood of set and spread, the mean integrated out.
        mean: (C, ..., P, G) posterior mean of the population's mean.
        variance: (C, ..., P, G) its variance.
    """

    log_evidence: np.ndarray
    mean: np.ndarray
    variance: np.ndarray


class _Values(NamedTuple):
    """Each robot's own values, for the comparison with the others.

    Attributes:
        away: (R, P) offset from the robots' centre.
        variance: (R, P) by the robot's data.
        used: (R, P) whether a value belongs to the reference.
        sets: (size, P) robots each that may be faulty together, so that they cannot mask each other.
    """

    away: np.ndarray
    variance: np.ndarray
    used: np.ndarray
    sets: list[np.ndarray]

    def references(self, grid: np.ndarray) -> tuple[_Reference, _Reference]:
        """Return the reference of all robots, (C, 1, P, G), and those of all but one, (C, R, P, G)."""
        variance = np.exp(2 * grid) + self.variance[..., None]
        weight, x = self.used[..., None] / variance, self.away[..., None]
        parts = np.stack([self.used[..., None] * np.log(variance), weight, weight * x, weight * x**2])
        total, each = parts.sum(1, keepdims=True), np.arange(len(grid))
        found = []
        for off in self.sets:
            left = total - parts[:, off, each].sum(1, keepdims=True)
            whole, others = self._reference(left, off), self._reference(left - parts, off)
            itself = (off[:, None] == np.arange(len(x))[:, None]).any(0)
            log_evidence = np.where(itself[..., None], -np.inf, others.log_evidence)
            found.append((whole, others._replace(log_evidence=log_evidence)))
        whole, others = (_Reference(*map(np.stack, zip(*some, strict=True))) for some in zip(*found, strict=True))
        return whole, others

    def _reference(self, sums: np.ndarray, off: np.ndarray) -> _Reference:
        """Return the reference of robots with these sums, (4, ..., P, G), given the faulty ones, (size, P)."""
        weight = np.maximum(sums[1], 1e-12)  # for a parameter without information in any robot's data
        mean = sums[2] / weight
        log_evidence = -(sums[0] + np.log(weight) + np.maximum(sums[3] - weight * mean**2, 0.0)) / 2
        each = np.arange(off.shape[1])
        for x, own in zip(self.away[off, each], self.variance[off, each], strict=True):
            variance = FAULT**2 + own[:, None] + 1 / weight
            log_evidence = log_evidence - (np.log(variance) + (x[:, None] - mean) ** 2 / variance) / 2
        return _Reference(log_evidence + len(off) * np.log(SHARE[0] / SHARE[1]), mean, 1 / weight)


def _prior_of_spreads(log_evidence: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Return the prior density of each parameter's spread from the other parameters' spreads, (P, G), unnormalised."""
    low, high = np.log(TYPICAL)
    typical, unlike = map(np.ravel, np.meshgrid(np.linspace(low, high, 25), np.linspace(0.1, 3 * UNLIKE, 15)))
    density = np.exp(-(((grid[..., None] - typical) / unlike) ** 2) / 2) / unlike
    likelihood = np.exp(log_evidence - log_evidence.max(-1, keepdims=True)) * (grid[:, 1:2] - grid[:, :1])
    each = np.log((likelihood[..., None] * density).sum(1) + 1e-300)
    others = each.sum(0) - each - (unlike / UNLIKE) ** 2 / 2
    weight = np.exp(others - others.max(-1, keepdims=True))
    return np.asarray((density * weight[:, None]).sum(-1))
