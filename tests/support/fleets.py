"""Fleets whose robots have normal likelihoods, with known truths, and the joint model of all of them."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import t as student_t

from ident.inference.population import FALSE_ALARM, FAULT, SHARE, Deviations, Draws, Likelihood, deviations, population

OFF_BY = 6.0
"""A fault of the small form, in combined standard deviations of robot and population."""


@dataclass
class Fleet:
    """Truths and likelihoods: theta (R, P), mean (P,), sd (P,), and the standard deviation of each own fit."""

    theta: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    likelihoods: tuple[Likelihood, ...]


def gaussian_fleet(rng, robots=20, parameters=4, faulty=None, sd=None, off_by=OFF_BY):
    """Make a fleet, good and poor data mixed; robot `faulty` has its second parameter off by combined sds."""
    mean = 0.3 * rng.standard_normal(parameters)
    sd = np.full(parameters, sd) if sd else rng.uniform(0.03, 0.15, parameters)
    theta = mean + sd * rng.standard_normal((robots, parameters))
    likelihoods = []
    for r in range(robots):
        A = rng.standard_normal((parameters + 2, parameters)) * rng.choice([4.0, 15.0])
        if r == faulty:
            own = np.linalg.inv(A.T @ A + np.eye(parameters))[1, 1]
            theta[r, 1] = mean[1] - off_by * np.hypot(sd[1], np.sqrt(own))
        y = A @ theta[r] + rng.standard_normal(parameters + 2)
        likelihoods.append(Likelihood(A.T @ A, A.T @ y))
    return Fleet(theta, mean, sd, tuple(likelihoods))


def own_estimates(fleet):
    """Return each robot's own posterior mean under a standard normal prior."""
    return np.array([np.linalg.solve(e.precision + np.eye(len(e.shift)), e.shift) for e in fleet.likelihoods])


def drawn(likelihood, mean, sd, rng, count=2000):
    """Draw a robot's posterior under normal priors."""
    covariance = np.linalg.inv(likelihood.precision + np.diag(sd**-2.0))
    theta = rng.multivariate_normal(covariance @ (likelihood.shift + mean / sd**2), covariance, count)
    log_prior = -(((theta - mean) / sd) ** 2 / 2 + np.log(sd)).sum(1)
    return Draws(theta, log_prior, likelihood)


def drawn_again(likelihood, under, rng, count=2000):
    """Draw a robot's posterior under a population: exactly, from the mixture of all choices of what is off."""
    mean, sd, share, parameters = under.mean, under.sd, under.share, len(under.mean)
    choices = np.array(list(product((False, True), repeat=parameters)))
    moments, log_mass = [], []
    for off in choices:
        width = np.where(off, FAULT, sd)
        precision = likelihood.precision + np.diag(width**-2.0)
        at = likelihood.shift + mean / width**2
        centre = np.linalg.solve(precision, at)
        moments.append((centre, np.linalg.inv(precision)))
        prior = np.where(off, np.log(share), np.log1p(-share)) - np.log(width) - (mean / width) ** 2 / 2
        log_mass.append(prior.sum() + at @ centre / 2 - np.linalg.slogdet(precision)[1] / 2)
    mass = np.exp(np.array(log_mass) - max(log_mass))
    counts = rng.multinomial(count, mass / mass.sum())
    parts = [rng.multivariate_normal(*each, n) for each, n in zip(moments, counts, strict=True)]
    theta = rng.permutation(np.concatenate(parts))
    return Draws(theta, under.log_density(theta), likelihood)


def off_if_known(fleet, r):
    """Return the probability that a robot is off, for who knows the population: the sum over what may be off."""
    likelihood, share, log_mass = fleet.likelihoods[r], SHARE[0] / sum(SHARE), []
    for off in map(np.array, product((False, True), repeat=len(fleet.mean))):
        width = np.where(off, FAULT, fleet.sd)
        precision, at = likelihood.precision + np.diag(width**-2.0), likelihood.shift + fleet.mean / width**2
        prior = np.where(off, np.log(share), np.log1p(-share)) - np.log(width) - (fleet.mean / width) ** 2 / 2
        log_mass.append(prior.sum() + at @ np.linalg.solve(precision, at) / 2 - np.linalg.slogdet(precision)[1] / 2)
    mass = np.exp(np.array(log_mass) - max(log_mass))
    return 1 - mass[0] / mass.sum()


@dataclass
class GaussianFleet:
    """How a fleet of 20 with one faulty robot came out."""

    covered: np.ndarray
    own_error: float
    shrunk_error: float
    judged: Deviations
    if_known: np.ndarray
    faulty: int

    def found(self, chance=FALSE_ALARM):
        return self.faulty in {robot for robot, _ in named(self.judged, chance)}

    def false_alarms(self, chance=FALSE_ALARM):
        return len({robot for robot, _ in named(self.judged, chance)} - {self.faulty})

    @classmethod
    def tried(cls, seed, off_by=OFF_BY, steps=600):
        """Make the fleet of a seed, and infer its population."""
        rng = np.random.default_rng(seed)
        fleet = gaussian_fleet(rng, faulty=7, off_by=off_by)
        judged = deviations(fleet.likelihoods, np.zeros(4), np.ones(4), 0.1)
        off = deviations(fleet.likelihoods, np.zeros(4), np.ones(4)).off
        result = population(fleet.likelihoods, np.zeros(4), np.ones(4), seed=seed, off=off, steps=steps)
        covered = []
        for draws, truth in ((result.mean, fleet.mean), (result.sd, fleet.sd)):
            low, high = np.quantile(draws, [0.025, 0.975], 0)
            covered.append((low < truth) & (truth < high))
        known = np.array([off_if_known(fleet, r) for r in range(len(fleet.likelihoods))])
        own, shrunk = (np.mean((x - fleet.theta) ** 2) for x in (own_estimates(fleet), result.robot_mean))
        return cls(np.array(covered), float(own), float(shrunk), judged, known, 7)


def joint_nuts(fleet, seed, count=1500):
    """Sample the whole model at once by NumPyro's NUTS: what is off summed over, and told afterwards."""
    import jax
    import jax.numpy as jnp
    import numpyro
    import numpyro.distributions as dist
    from numpyro.infer import MCMC, NUTS

    precision = jnp.array([each.precision for each in fleet.likelihoods])
    shift = jnp.array([each.shift for each in fleet.likelihoods])

    def model():
        with numpyro.plate("parameters", len(fleet.mean)):
            mean = numpyro.sample("mean", dist.Normal(0.0, 1.0))
            sd = numpyro.sample("sd", dist.Uniform(0.0, FAULT))
        share = numpyro.sample("share", dist.Beta(*SHARE))
        theta = numpyro.sample("theta", dist.Normal(0.0, 10.0).expand(shift.shape).to_event(2).mask(False))
        healthy = jnp.log1p(-share) + dist.Normal(mean, sd).log_prob(theta)
        off = jnp.log(share) + dist.Normal(mean, FAULT).log_prob(theta)
        numpyro.factor("population", jnp.logaddexp(healthy, off).sum())
        numpyro.factor("data", (-0.5 * jnp.einsum("rp,rpq,rq->", theta, precision, theta) + (shift * theta).sum()))
        numpyro.deterministic("off", jax.nn.sigmoid(off - healthy))

    kernel = NUTS(model, target_accept_prob=0.9, max_tree_depth=7)
    chains = MCMC(
        kernel, num_warmup=700, num_samples=count, num_chains=4, chain_method="vectorized", progress_bar=False
    )
    chains.run(jax.random.PRNGKey(seed))
    return {name: np.asarray(values) for name, values in chains.get_samples().items()}


SPREADS = {
    "as data/fleet": lambda rng: np.array([0.06, 0.06, 0.06, 0.1, 0.1, 0.1]),
    "3 to 15 %": lambda rng: rng.uniform(0.03, 0.15, 6),
    "all 1 %": lambda rng: np.full(6, 0.01),
    "all 30 %": lambda rng: np.full(6, 0.3),
    "five 2 %, one 20 %": lambda rng: np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.2]),
}
"""Spreads of six parameters from robot to robot."""


def judged_fleet(rng, spread, faults=(), good=True, robots=8):
    """Make robots of six parameters, faults at (robot, parameter) each a factor of 0.6 lower; judge each by the others.

    Returns:
        What `deviations` says at a chance of a false alarm of 10 %, of which the first suffice for each smaller one;
        and the p values of leave-one-out t tests of the robots' own estimates.
    """
    theta = spread * rng.standard_normal((robots, 6))
    for place in faults:
        theta[place] += np.log(0.6)
    size = np.full(robots, 40.0) if good else rng.choice([4.0, 15.0], robots)
    A = size[:, None, None] * rng.standard_normal((robots, 8, 6))
    y = np.einsum("rdp,rp->rd", A, theta) + rng.standard_normal((robots, 8))
    likelihoods = [Likelihood(a.T @ a, a.T @ b) for a, b in zip(A, y, strict=True)]
    own = np.array([np.linalg.solve(each.precision, each.shift) for each in likelihoods])
    return deviations(likelihoods, np.zeros(6), np.ones(6), 0.1), leave_one_out_t(own)


def leave_one_out_t(own):
    """Return the two-sided p values of each robot's estimates, (R, P), against the other robots' mean and spread."""
    count = len(own) - 1
    mean = (own.sum(0) - own) / count
    variance = ((own**2).sum(0) - own**2 - count * mean**2) / (count - 1)
    return 2 * student_t.sf(np.abs(own - mean) / np.sqrt(variance * (1 + 1 / count)), count - 1)


def named(judged, chance):
    """Return what stands out at a chance of a false alarm."""
    return [place for place, own in zip(judged.named, judged.chance, strict=True) if own <= chance]
