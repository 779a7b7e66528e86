"""Effective samples a second, beside emcee on MuJoCo + SciPy and NumPyro's NUTS: `python tests/benchmarks/sampling.py`.

One posterior: six stiffnesses by the shipped campaign. All counts are bulk effective sample sizes by ArviZ, of the
parameter that has the least. Optima are found beforehand and count for nobody's time. No test depends on any time.
"""

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import arviz
import emcee
import jax.numpy as jnp
import numpy as np
from numpyro.infer import MCMC, NUTS
from peer import Peer
from shell import DATA
from timing import machine

from ident.description.file import read_arm
from ident.identify.problem import pose
from ident.inference.fit import Fit, fit
from ident.inference.posterior import Posterior, evaluate, posterior
from ident.inference.sample import DEFAULT, Sample, Settings, initial_walkers, sample
from ident.measure import Campaign, read_campaign

TIMES = 20
"""How many times the effective samples a second of plain emcee over the peer ident is to reach."""
WALKERS = 24
Density = Callable[[np.ndarray], float]


def peer_density(target: Posterior, campaign: Campaign) -> Density:
    """Return the log posterior by MuJoCo and SciPy; a posture's frequencies are matched in ascending order."""
    problem = target.problem
    arm, parameters = read_arm(DATA / "arm.toml").arm, problem.parameters
    known, sigma = np.asarray(problem.measured), np.asarray(problem.sigma)
    centre = np.asarray(parameters.theta(parameters.column("centre")))
    width = np.asarray(parameters.column("prior_sd"))
    constant = -np.log(np.sqrt(2 * np.pi) * np.concatenate([sigma, width])).sum()
    states = []
    for posture in dict.fromkeys(m.posture for m in campaign):
        rows = [i for i, m in enumerate(campaign) if m.posture == posture and m.kind == "frequency"]
        drop = [i for i, m in enumerate(campaign) if m.posture == posture and m.kind == "deflection"]
        states.append((Peer(arm, np.array(posture)), np.array(rows)[np.argsort(known[rows])], drop))

    def density(theta: np.ndarray) -> float:
        values, k = np.empty(len(known)), np.exp(theta)
        for peer, rows, drop in states:
            values[rows], values[drop] = peer.exact(k, len(rows))
        off = np.concatenate([(values - known) / sigma, (theta - centre) / width])
        return float(constant - (off**2).sum() / 2)

    return density


def agreement(drawn: Sample, theirs: Density, count: int) -> None:
    """Compare both log posteriors at the optimum and at draws of the posterior."""
    draws = drawn.draws()
    some = draws[np.random.default_rng(0).choice(len(draws), count, replace=False)]
    points = np.vstack([drawn.fit.best.theta, some])
    ours = evaluate(drawn.posterior, points, drawn.batch).log_density
    off = np.abs([theirs(point) for point in points] - ours)
    same = off < 1e-5
    print(
        f"\nThe log posteriors differ by {off[0]:.1e} at the optimum, by {off[same].max():.1e} at most at {same.sum()}"
    )
    print(f"of it and {count} draws; at {(~same).sum()} draws the order of modes is not that of the labels.")
    assert same[0]
    assert same.mean() > 0.9


def bulk(chains: np.ndarray) -> float:
    """Return the effective sample size of draws (steps, chains, P), of the parameter that has the least."""
    return min(float(arviz.ess(x.T, method="bulk")) for x in np.moveaxis(chains, 2, 0))


class Rate:
    """Effective samples, and the seconds that they took."""

    def __init__(self, name: str, effective: float, seconds: float, remark: str):
        self.name, self.effective, self.seconds, self.remark = name, effective, seconds, remark

    @property
    def rate(self) -> float:
        """Effective samples a second."""
        return self.effective / self.seconds


def ident(found: Fit, target: Posterior, settings: Settings) -> tuple[Rate, Sample]:
    """Sample as `ident sample` does; starting points, burn-in and diagnosis count as time."""
    sample(found, target, replace(settings, max_steps=50))
    begin = time.perf_counter()
    drawn = sample(found, target, settings)
    spent = time.perf_counter() - begin
    ess = float(sum(d.bulk.min() for d in drawn.diagnosis))
    steps, (_, ensembles, walkers, _) = len(drawn.theta), drawn.theta.shape
    rhat, tau = max(d.rhat.max() for d in drawn.diagnosis), max(d.tau.max() for d in drawn.diagnosis)
    threads = f"{settings.threads} thread{'s'[: settings.threads > 1]}"
    remark = f"{ensembles} x {walkers} walkers, {steps} steps, tau {tau:.0f}, R-hat {rhat:.3f}"
    return Rate(f"ident, {threads}", ess, spent, remark), drawn


def plain(found: Fit, target: Posterior, theirs: Density, quick: bool) -> list[Rate]:
    """Default emcee, one call at a time. Its autocorrelation is that of the same moves over ident's fast density.

    The slow chain and the fast one begin alike with the same seed; they are compared as far as the slow one goes.
    """
    slow_steps, fast_steps = (30, 1500) if quick else (150, 4000)
    start = initial_walkers(target, found.best, WALKERS, np.random.default_rng(0), WALKERS // 2)
    state = emcee.State(start, random_state=np.random.RandomState(0).get_state())

    def fast(points: np.ndarray) -> np.ndarray:
        return evaluate(target, points, WALKERS // 2).log_density

    slow = emcee.EnsembleSampler(WALKERS, start.shape[1], theirs)
    quickly = emcee.EnsembleSampler(WALKERS, start.shape[1], fast, vectorize=True)
    begin = time.perf_counter()
    slow.run_mcmc(state, slow_steps)
    spent = time.perf_counter() - begin
    begin = time.perf_counter()
    quickly.run_mcmc(state, fast_steps)
    fast_spent = time.perf_counter() - begin
    off = np.abs(slow.get_chain() - quickly.get_chain()[:slow_steps]).max((1, 2))
    alike = slow_steps if (off < 1e-6).all() else int(np.argmax(off >= 1e-6))
    tau = float(emcee.autocorr.integrated_time(quickly.get_chain(), tol=0, quiet=True).max())
    burn_in = int(5 * tau)
    ess = bulk(quickly.get_chain(discard=burn_in))
    kept = fast_steps - burn_in
    print(
        f"\nPlain emcee: {WALKERS * slow_steps / spent:.0f} evaluations a second by MuJoCo + SciPy, tau {tau:.0f} steps"
    )
    print(
        f"of 24 walkers. Its chain is the fast one's for the first {alike} of {slow_steps} steps. Effective samples for"
    )
    print(f"it are those of the fast chain times {slow_steps} / {kept} steps, so that its burn-in costs no time.")
    return [
        Rate("plain emcee over MuJoCo + SciPy", ess * slow_steps / kept, spent, f"{slow_steps} steps, tau {tau:.0f}"),
        Rate("plain emcee over ident's density", ess, fast_spent, f"{fast_steps} steps, burn-in counts as time"),
    ]


def nuts(found: Fit, target: Posterior, quick: bool) -> list[Rate]:
    """NumPyro's NUTS, dense mass matrix, four chains, by ident's model and its reverse derivative."""
    warmup, draws = (100, 100) if quick else (300, 400)

    def potential(theta: Any) -> Any:
        return -target.evaluate(theta[:, None]).log_density[0]

    start = initial_walkers(target, found.best, 4, np.random.default_rng(0), WALKERS // 2)
    mcmc = MCMC(
        NUTS(potential_fn=potential, dense_mass=True),
        num_warmup=warmup,
        num_samples=draws,
        num_chains=4,
        chain_method="vectorized",
        progress_bar=False,
    )
    times = []
    for seed in (0, 1):  # the first time it is compiled
        mcmc.post_warmup_state = None
        begin = time.perf_counter()
        mcmc.warmup(jax.random.PRNGKey(seed), init_params=jnp.asarray(start), extra_fields=("num_steps",))
        jax.block_until_ready(mcmc.post_warmup_state)
        middle = time.perf_counter()
        mcmc.run(jax.random.PRNGKey(seed), extra_fields=("num_steps", "diverging"))
        jax.block_until_ready(mcmc.get_samples())
        times.append((middle - begin, time.perf_counter() - middle))
    chains, fields = np.asarray(mcmc.get_samples(group_by_chain=True)), mcmc.get_extra_fields()
    ess, (warming, drawing) = bulk(chains.swapaxes(0, 1)), times[-1]
    rhat = max(float(arviz.rhat(x)) for x in np.moveaxis(chains, 2, 0))
    steps, diverging = float(np.mean(fields["num_steps"])), int(np.sum(fields["diverging"]))
    remark = f"{draws} draws, {steps:.0f} gradients each, R-hat {rhat:.3f}, {diverging} divergent"
    return [
        Rate("NUTS, 4 chains side by side", ess, warming + drawing, f"{warmup} warm-up, " + remark),
        Rate("NUTS, 4 chains side by side, warm-up free", ess, drawing, remark),
    ]


def table(rates: list[Rate], reference: Rate) -> None:
    """Print rates and their ratio to one of them."""
    print(f"\n{'':46s}{'ESS':>8s}{'s':>8s}{'ESS/s':>9s}{'ratio':>8s}")
    for r in rates:
        ratio = r.rate / reference.rate
        print(f"  {r.name:44s}{r.effective:8.0f}{r.seconds:8.2f}{r.rate:9.4g}{ratio:8.3g}  {r.remark}")


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="shorter chains of the others, for trying")
    quick = parser.parse_args().quick
    print(machine())
    campaign = read_campaign(DATA / "campaign.csv")
    problem = pose(read_arm(DATA / "arm.toml").arm, campaign).problem
    found, target = fit(problem), posterior(problem)
    settings = replace(DEFAULT, max_steps=500) if quick else DEFAULT
    ours, drawn = ident(found, target, settings)
    theirs = peer_density(target, campaign)
    agreement(drawn, theirs, 20 if quick else 200)
    two, _ = ident(found, target, replace(settings, threads=2))
    slow, fast = plain(found, target, theirs, quick)
    others = nuts(found, target, quick)
    table([ours, two, slow, fast, *others], slow)
    best = max(ours, two, key=lambda r: r.rate)
    won = max((r for r in others if "free" not in r.name), key=lambda r: r.rate)
    print(f"\nident's effective samples a second are {ours.rate / slow.rate:.0f} (one thread) and"
          f" {two.rate / slow.rate:.0f} (two) times plain emcee's over MuJoCo + SciPy; at least {TIMES} are asked for:"
          f" {ours.rate >= TIMES * slow.rate}")  # fmt: skip
    first, second = (best, won) if best.rate > won.rate else (won, best)
    print(f"{first.name} wins over {second.name}: {first.rate / second.rate:.2g} times")
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
