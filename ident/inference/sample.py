"""Draws from the posterior: several independent emcee ensembles about each optimum, resumable to the bit."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.inference.checkpoints import Chains, identity
from ident.inference.diagnostics import Diagnosis, diagnose
from ident.inference.ensembles import BLOCK, SPLITS, Ensembles, batch_size
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.linear_marginal import MOVED, TRIED, LinearMarginal, linear_marginal, linear_nuisances, moved
from ident.inference.marginal import Marginal
from ident.inference.posterior import Posterior
from ident.store import Store

FIRST_CHECK = 100
"""Steps after which the chains are diagnosed first; then when they should do, or are half as long again."""
LEAST_ENSEMBLES = 4
EXCLUDED = 5.0
"""Standard deviations from a prior at which the data and it cannot both be right."""
JOINED = 1.05
"""R-hat over the ensembles about two optima below which they have met."""
ANEW = "explicit"
"""Folder within the folder for the chains that begin anew, with more nuisances sampled."""
RIVAL = 30.0
"""Optima whose cost is higher by more than this, a factor of 3e-7 in density, are left out."""


@dataclass(frozen=True)
class Settings:
    """How to sample.

    Attributes:
        ensembles: independent ensembles about each optimum; at least four, so that R-hat means something.
        walkers: in each ensemble; None for four times the number of unknowns that are sampled, or eight times where the
            data leave directions open or weakly known, as posteriors are thin and curved then.
        target_ess: bulk effective sample size at which to stop, for each unknown.
        max_steps: steps at which to stop in any case.
        seed: of everything.
        threads: parts of a step that are evaluated at the same time, two at most; more than one only for a model that
            calls no LAPACK.
        most_draws: draws, of all walkers together, above which only every second step is kept, then every fourth, and
            so on: neither memory nor checkpoints grow without end.
    """

    ensembles: int = 4
    walkers: int | None = None
    target_ess: float = 2000.0
    max_steps: int = 20000
    seed: int = 0
    threads: int = 1
    most_draws: int = 1_000_000


DEFAULT = Settings()


@dataclass(frozen=True)
class Sample:
    """Draws from a posterior, and how far to trust them.

    Attributes:
        posterior: what was sampled.
        fit: where the ensembles started; the optima by which `basin` counts.
        settings: how it was sampled.
        theta: (n, ensembles, walkers, P) all draws that are kept.
        log_density: (n, ensembles, walkers) log posterior.
        thin: steps from one draw to the next.
        basin: (ensembles,) optimum about which each ensemble is; the better one of two without a barrier between.
        started: (ensembles,) optimum about which each ensemble started.
        acceptance: (ensembles,) share of accepted moves.
        diagnosis: what the chains say of themselves, basin by basin.
        marginalised: nuisances that were integrated out, each with how far its derivatives at draws of the posterior
            would move the mean of an unknown [its sd].
    """

    posterior: Posterior
    fit: Fit
    settings: Settings
    theta: Float[np.ndarray, "n ensembles walkers P"]
    log_density: Float[np.ndarray, "n ensembles walkers"]
    thin: int
    basin: tuple[int, ...]
    started: tuple[int, ...]
    acceptance: Float[np.ndarray, "ensembles"]
    diagnosis: tuple[Diagnosis, ...]
    marginalised: Mapping[str, float] = field(default_factory=dict)

    @property
    def batch(self) -> int:
        """Points that the posterior is compiled for."""
        return batch_size(*self.theta.shape[1:3])

    @property
    def basins(self) -> tuple[int, ...]:
        """The optima that were sampled about."""
        return tuple(dict.fromkeys(self.basin))

    @property
    def burn_in(self) -> int:
        """Draws of each walker that are not counted."""
        return max(d.burn_in for d in self.diagnosis) // self.thin

    def draws(self, basin: int = 0) -> Float[np.ndarray, "n P"]:
        """Return the draws of theta about one optimum, burn-in left out."""
        chosen = self.theta[self.burn_in :, np.array(self.basin) == basin]
        return chosen.reshape(-1, chosen.shape[-1])


def sample(
    fit: Fit,
    posterior: Posterior,
    settings: Settings = DEFAULT,
    *,
    folder: Path | None = None,
    provenance: Mapping[str, str] | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Sample:
    """Sample a posterior until its effective sample size is reached; go on where an earlier run was stopped.

    Each optimum of the fit that matters gets ensembles of its own, as an ensemble does not cross between separated
    ones. Discrepancy factors are integrated out, and drawn given the rest; so are nuisances that act linearly, as far
    as their derivatives at draws of the posterior tell: with one that does not, the chains begin anew. A chain depends
    on model, data, priors, optima, walkers and seed alone: interrupted and resumed it is the same to the bit, and a
    higher target only makes it longer.

    Args:
        fit: of the posterior's problem; the ensembles start about its optima.
        posterior: what to sample.
        settings: how.
        folder: where checkpoints go; None for none.
        provenance: what else must be equal for a checkpoint to be gone on with, by name.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: settings that can't work, data and prior that leave a parameter open or exclude each other,
            checkpoints of another run.
        ModelError: the model has no answer about an optimum.
    """
    _check_bounded(fit, posterior)
    # with noise that is known up to a factor only, so are the costs
    reach = math.inf if posterior.noise.items else fit.best.score + RIVAL
    optima = [i for i, optimum in enumerate(fit.optima) if optimum.score < reach]
    started = [optimum for optimum in optima for _ in range(settings.ensembles)]
    names = () if posterior.noise.items or len(optima) > 1 else linear_nuisances(fit, settings.seed)
    while True:
        target = linear_marginal(posterior, fit.best, names) if names else Marginal(posterior)
        chosen = replace(settings, walkers=_walker_count(fit, target, settings))
        known = identity(posterior, _chain_settings(chosen, len(optima), names))
        chains = Chains(Store(folder, {**(provenance or {}), **known}), chosen.most_draws)
        with ThreadPoolExecutor(chosen.threads) as pool:
            about = [fit.optima[optimum] for optimum in started]
            ensembles = Ensembles(target, about, chosen.walkers or 0, chosen.seed, pool)
            _draw(ensembles, chains, started, chosen, progress)
        drawn = _sample(fit, posterior, chosen, chains, started)
        if not names:
            return drawn
        shift = moved(fit.problem, fit.best, names, spread_draws(drawn.draws()))
        if not (shift > MOVED).any():
            return replace(drawn, marginalised=dict(zip(names, shift.tolist(), strict=True)))
        names = tuple(name for name, far in zip(names, shift, strict=True) if far <= MOVED)
        folder = folder and folder / ANEW


def spread_draws(draws: Float[np.ndarray, "n P"]) -> Float[np.ndarray, "m P"]:
    """Return a few draws, evenly spread over all."""
    return draws[np.linspace(0, len(draws) - 1, TRIED).astype(int)]


def _draw(
    ensembles: Ensembles,
    chains: Chains,
    started: Sequence[int],
    settings: Settings,
    progress: Callable[[Iterable[int]], Iterable[int]],
) -> None:
    """Go on with chains until they will do."""
    check_at = chains.last.check_at if chains.last else FIRST_CHECK
    for block in progress(range(settings.max_steps // BLOCK)):
        steps = (block + 1) * BLOCK
        if steps < chains.steps:
            continue
        if steps > chains.steps:
            walkers = chains.last.walkers if chains.last else ensembles.begin()
            chains.add(*ensembles.advance(walkers, block), check_at)
        if steps >= check_at:
            missing = max(d.more_steps(settings.target_ess) for d in _diagnose(chains, _joined(chains, started)))
            if not missing:
                break
            check_at = steps + min(missing, steps // 2)


def _sample(fit: Fit, posterior: Posterior, settings: Settings, chains: Chains, started: Sequence[int]) -> Sample:
    basin, draws, last = _joined(chains, started), chains.whole(), chains.last
    accepted = last.accepted / (last.steps * draws.theta.shape[2]) if last else np.zeros(len(started))
    diagnosis = _diagnose(chains, basin)
    return Sample(
        posterior,
        fit,
        settings,
        draws.theta,
        draws.log_density,
        chains.thin,
        tuple(basin),
        tuple(started),
        accepted,
        diagnosis,
    )


def _joined(chains: Chains, started: Sequence[int]) -> list[int]:
    """Count optima as one whose ensembles have found the same distribution: no barrier lies between them."""
    basins, joined = list(dict.fromkeys(started)), list(started)
    for i, later in enumerate(basins):
        for earlier in basins[:i]:
            both = [earlier if b == later else b for b in joined]
            if later in joined and earlier in joined and _diagnose(chains, both, only=earlier)[0].rhat.max() < JOINED:
                joined = both
    return joined


def _diagnose(chains: Chains, basins: Sequence[int], only: int | None = None) -> tuple[Diagnosis, ...]:
    theta, basin = chains.whole().theta, np.array(basins)
    return tuple(
        diagnose(theta[:, basin == b], chains.thin) for b in (dict.fromkeys(basins) if only is None else [only])
    )


def _walker_count(fit: Fit, target: Marginal | LinearMarginal, settings: Settings) -> int:
    """Return the number of walkers of settings that can work."""
    count = len(target.parameters.items)
    curved = any(direction.weak or direction.open for direction in fit.information.directions)
    walkers = settings.walkers or (8 if curved else 4) * count
    if walkers < 2 * count or walkers % SPLITS:
        expected, remedy = f"an even number, at least {2 * count} for {count} unknowns", "correct `walkers`"
        raise InputError(Problem("", f"{walkers} walkers", expected, remedy))
    if settings.ensembles < LEAST_ENSEMBLES:
        expected, remedy = f"at least {LEAST_ENSEMBLES}: R-hat compares them", "correct `ensembles`"
        raise InputError(Problem("", f"{settings.ensembles} ensembles", expected, remedy))
    if settings.max_steps < BLOCK:
        raise InputError(Problem("", f"{settings.max_steps} steps", f"at least {BLOCK}", "correct `max_steps`"))
    return walkers


def _check_bounded(fit: Fit, posterior: Posterior) -> None:
    """Refuse data and prior that leave a parameter open, or exclude each other."""
    scaled = fit.problem.scaled(np.asarray(fit.jacobian))
    open_ones = np.isinf(information(scaled, fit.problem.parameters.normal_sd, fit.information.names).sd)
    if open_ones.any():
        names = ", ".join(np.array(fit.information.names)[open_ones])
        remedy = "give each a prior (`prior`), or fix it (`fix`)"
        raise InputError(Problem("", f"neither data nor a prior that bound {names}", "one of them", remedy))
    if not fit.information.rank:
        remedy = "measure what depends on them (see `ident check`), or fix fewer"
        raise InputError(Problem("", "no measurement that depends on any of the unknowns", "at least one", remedy))
    beyond = np.abs(np.asarray(fit.problem.parameters.prior_residuals(jnp.asarray(fit.best.theta))[0]))
    if beyond.max() > EXCLUDED and not posterior.noise.items:
        worst = int(np.argmax(beyond))
        name, value = fit.information.names[worst], fit.best.values[worst]
        got = f"a prior of {name} that excludes the data: they pull it to {value:.4g}, {beyond[worst]:.1f} sd beyond"
        raise InputError(Problem("", got, "a prior that they may agree with", "widen it, or check units (`prior`)"))


def _chain_settings(settings: Settings, optima: int, nuisances: tuple[str, ...]) -> dict[str, int | str | None]:
    """Return the settings that a chain depends on; the others only say when it ends."""
    return {
        **({"set of nuisances integrated out": ", ".join(nuisances)} if nuisances else {}),
        "number of optima": optima,
        "number of ensembles": settings.ensembles,
        "number of walkers": settings.walkers,
        "bound on draws": settings.most_draws,
        "seed": settings.seed,
    }
