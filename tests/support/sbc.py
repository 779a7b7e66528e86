"""Simulation-based calibration: where a truth drawn from the prior ranks among draws of its posterior.

If data are simulated at a truth drawn from the prior, truth and draws are exchangeable: the truth's rank among `L`
independent draws is uniform on 0..L, and the central interval of any probability holds the truth with that probability.

Talts, Betancourt, Simpson, Vehtari, Gelman, "Validating Bayesian inference algorithms with simulation-based
calibration", arXiv 1804.06788, 2018. That the log posterior ranks uniformly too, and tells what the parameters do not:
Modrak et al., "Simulation-based calibration checking for Bayesian computation", Bayesian Analysis 20(2), 2025.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.stats import binom, chisquare

from ident.inference.fit import fit
from ident.inference.posterior import evaluate, posterior
from ident.inference.problem import InverseProblem
from ident.inference.sample import Sample, Settings, sample
from ident.inference.search import evaluate as predictions

L = 99
"""Draws among which the truth is ranked: 100 ranks fall into 20 equal bins."""
BINS = (20, 10, 5, 4, 2)
EXPECTED = 10
"""Truths in each bin, at least, for the chi-squared distribution to hold."""
LEVELS = (0.5, 0.95)
NEGLIGIBLE = 0.005
"""Share of a separated optimum, by a normal about its draws, below which it cannot move a rank by one."""
RIVAL = 15.0
"""Optima whose cost is higher by more than this are counted and left out: they hold some exp(-7.5) of the whole."""
AGREE = 1.03
"""R-hat over the ensembles above which they do not agree; that of a short run that mixed is about 1.01."""
LONGER = 3
"""How many times longer a run is repeated if its ensembles do not agree."""
ALPHA = 0.01


@dataclass(frozen=True)
class Recovery:
    """One truth and what the posterior of its data says of it; the log posterior counts as one more parameter.

    Attributes:
        draw: number of the truth.
        truth: (P,) theta.
        rank: (P+1,) draws below the truth, of `L`.
        below: (P+1,) posterior probability below the truth.
        optima: separate ends of the fit.
        begun: those that the sampler began at.
        share: (basins,) probability of those that stayed separated.
        weighed: whether a lesser basin matters, by normal approximations.
        missed: whether the truth is more probable than the best optimum that the fit found.
        rhat, tau: the largest; R-hat over the ensembles, autocorrelation time [steps].
        steps: steps taken.
    """

    draw: int
    truth: list[float]
    rank: list[int]
    below: list[float]
    optima: int
    begun: int
    share: list[float]
    weighed: bool
    missed: bool
    rhat: float
    tau: float
    steps: int


def recover(
    problem: InverseProblem,
    draw: int,
    seed: int,
    settings: Settings,
    *,
    starts: int,
    spread: float,
    noise: float = 1.0,
    longer: int = LONGER,
) -> Recovery:
    """Draw a truth from the prior, simulate its data, fit and sample them, and rank the truth.

    Args:
        problem: model, sigmas and priors; its data are replaced, nothing is compiled anew.
        draw: number of the truth.
        seed: of the whole calibration.
        settings: of the sampler.
        starts: of the fit, which begins where the prior has its centre, not at the truth.
        spread: of the starts.
        noise: factor by which the data scatter more than their sigmas say; 1 or the calibration must fail.
        longer: how many times longer a run is repeated if its ensembles do not agree.
    """
    rng = np.random.default_rng([seed, draw])
    truth = np.asarray(problem.parameters.from_uniform(jnp.asarray(rng.uniform(size=len(problem.parameters.items)))))
    sigma = np.asarray(problem.sigma)
    data = np.asarray(predictions(problem, jnp.asarray(truth)).predicted) + noise * sigma * rng.standard_normal(
        len(sigma)
    )
    posed = eqx.tree_at(lambda p: p.measured, problem, jnp.asarray(data))
    found, target = fit(posed, starts=starts, spread=spread, seed=draw), posterior(posed)
    likely = tuple(optimum for optimum in found.optima if optimum.cost < found.best.cost + RIVAL)
    for times in dict.fromkeys((1, longer)):
        run = replace(settings, seed=draw, max_steps=times * settings.max_steps)
        drawn = sample(replace(found, optima=likely), target, run)
        if _rhat(drawn) < AGREE:
            break
    share, weighed = _shares(drawn)
    at = evaluate(target, np.stack([truth, found.best.theta]), drawn.batch).log_density
    known = np.append(truth, at[0])
    taken = [
        rng.permutation(_independent(drawn, basin))[:n]
        for basin, n in zip(drawn.basins, rng.multinomial(L, share), strict=True)
    ]
    below = [(_kept(drawn, basin) < known).mean((0, 1, 2)) for basin in drawn.basins]
    return Recovery(
        draw=draw,
        truth=truth.tolist(),
        rank=(np.concatenate(taken) < known).sum(0).tolist(),
        below=(share @ np.array(below)).tolist(),
        optima=len(found.optima),
        begun=len(likely),
        share=share.tolist(),
        weighed=weighed,
        missed=bool(at[0] > at[1]),
        rhat=_rhat(drawn),
        tau=float(max(d.tau.max() for d in drawn.diagnosis)),
        steps=len(drawn.theta),
    )


def _rhat(drawn: Sample) -> float:
    return float(max(d.rhat.max() for d in drawn.diagnosis))


def _kept(drawn: Sample, basin: int) -> np.ndarray:
    """Return theta and log posterior (steps, ensembles, walkers, P+1) after burn-in."""
    chosen = np.array(drawn.basin) == basin
    theta, log = (x[drawn.burn_in :, chosen] for x in (drawn.theta, drawn.log_density))
    return np.concatenate([theta, log[..., None]], -1)


def _independent(drawn: Sample, basin: int) -> np.ndarray:
    """Return draws (n, P+1) that are nearly independent, at least L.

    The walkers of one step are independent of each other once the ensemble is stationary (its density is the product
    of theirs); steps are taken an autocorrelation time apart.
    """
    kept = _kept(drawn, basin)[::-1]
    tau = drawn.diagnosis[drawn.basins.index(basin)].tau.max()
    apart = min(math.ceil(tau), len(kept) // math.ceil(L / kept[0, ..., 0].size))
    return kept[::apart].reshape(-1, kept.shape[-1])


def _shares(drawn: Sample) -> tuple[np.ndarray, bool]:
    """Return the probability of each basin by its normal approximation, and whether the lesser ones matter.

    Nested sampling would be exact, and takes minutes for one posterior as thin as these.
    """
    log = []
    for basin in drawn.basins:
        kept = _kept(drawn, basin).reshape(-1, len(drawn.posterior.parameters.items) + 1)
        log.append(kept[:, -1].max() + np.linalg.slogdet(np.cov(kept[:, :-1].T))[1] / 2)
    share = np.exp(np.array(log) - max(log))
    share /= share.sum()
    return share, bool(np.sort(share)[:-1].sum() > NEGLIGIBLE)


@dataclass(frozen=True)
class Verdict:
    """What many recoveries say.

    Attributes:
        bins: into which ranks were counted.
        p: (Q,) of the chi-squared test of each parameter's ranks.
        holm: (Q,) the same, corrected for Q tests.
        covered: (levels, Q) truths inside the central intervals.
        band: (levels, 2) where each of them lies with 99 %.
        wide: (levels, 2) where all of them lie with 99 %, at least.
    """

    bins: int
    p: np.ndarray
    holm: np.ndarray
    covered: np.ndarray
    band: np.ndarray
    wide: np.ndarray

    @property
    def uniform(self) -> bool:
        """Whether the ranks pass."""
        return bool((self.holm > ALPHA).all())

    @property
    def covers(self) -> bool:
        """Whether the intervals pass, all of them taken together."""
        return bool(((self.covered >= self.wide[:, :1]) & (self.covered <= self.wide[:, 1:])).all())

    @property
    def outside(self) -> int:
        """Coverages outside their own 99 % band; one in a hundred is to be expected."""
        return int(((self.covered < self.band[:, :1]) | (self.covered > self.band[:, 1:])).sum())


def judge(recoveries: list[Recovery]) -> Verdict:
    """Test ranks and coverage."""
    ranks, below = (np.array([getattr(r, name) for r in recoveries]) for name in ("rank", "below"))
    n, count = ranks.shape
    bins = next((b for b in BINS if n >= EXPECTED * b), BINS[-1])
    p = np.array([chisquare(np.bincount(rank * bins // (L + 1), minlength=bins)).pvalue for rank in ranks.T])
    order = np.argsort(p)
    holm = np.empty(count)
    holm[order] = np.minimum(1, np.maximum.accumulate(p[order] * np.arange(count, 0, -1)))
    covered = np.array([(np.abs(below - 0.5) <= level / 2).sum(0) for level in LEVELS])
    return Verdict(bins, p, holm, covered, _band(n, ALPHA), _band(n, ALPHA / covered.size))


def _band(n: int, alpha: float) -> np.ndarray:
    return np.array([binom.ppf([alpha / 2, 1 - alpha / 2], n, level) for level in LEVELS]).astype(int)


def report(names: tuple[str, ...], recoveries: list[Recovery], say: Callable[[str], None] = print) -> Verdict:
    """Print what was found."""
    found, n = judge(recoveries), len(recoveries)
    heads = "".join(f"{f'in {level:.0%}':>12s}" for level in LEVELS)
    say(f"\n{n} truths, ranks of {L + 1} in {found.bins} bins\n{'':20s}{'p':>9s}{'p, Holm':>9s}{heads}")
    for name, p, holm, covered in zip((*names, "log posterior"), found.p, found.holm, found.covered.T, strict=True):
        say(f"  {name:18s}{p:9.3f}{holm:9.3f}" + "".join(f"{c / n:12.1%}" for c in covered))
    for what, band in (("99 % band of each", found.band), ("99 % band of all", found.wide)):
        say(f"  {what:32s}" + "".join(f"{f'{low / n:.1%}..{high / n:.1%}':>14s}" for low, high in band))
    tally = {
        f"R-hat over ensembles above {AGREE}": sum(r.rhat >= AGREE for r in recoveries),
        "R-hat above 1.01, ident's own limit for a result": sum(r.rhat >= 1.01 for r in recoveries),
        f"run {LONGER} times longer, as R-hat was above {AGREE}": sum(
            r.steps > min(x.steps for x in recoveries) for r in recoveries
        ),
        "several optima found by the fit": sum(r.optima > 1 for r in recoveries),
        f"several within {RIVAL:.0f} of the least cost: ensembles about each": sum(r.begun > 1 for r in recoveries),
        "several basins that stayed separated": sum(len(r.share) > 1 for r in recoveries),
        f"of these, a lesser one above {NEGLIGIBLE:.1%}, by normal approximations": sum(r.weighed for r in recoveries),
        "truth more probable than the best optimum found": sum(r.missed for r in recoveries),
    }
    for what, count in tally.items():
        say(f"  {count:4d} {what}")
    say(f"  largest R-hat {max(r.rhat for r in recoveries):.3f}, autocorrelation time, median and largest, "
        f"{np.median([r.tau for r in recoveries]):.0f} and {max(r.tau for r in recoveries):.0f} steps")  # fmt: skip
    say(f"  ranks uniform: {found.uniform} (Holm p > {ALPHA}); intervals cover: {found.covers} (99 % band of all;"
        f" {found.outside} of {found.covered.size} outside their own)")  # fmt: skip
    return found
