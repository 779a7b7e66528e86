"""Draws from the posterior: several independent emcee ensembles about each optimum, resumable to the bit."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.inference.checkpoints import Block, identity, read_blocks, write_block
from ident.inference.diagnostics import Diagnosis, diagnose
from ident.inference.ensembles import BLOCK, SPLITS, Ensemble, block_of, first_states, states_after
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.posterior import Posterior
from ident.store import Store

FIRST_CHECK = 500
"""Steps after which the chains are diagnosed for the first time; then when they should do, or are a quarter longer."""
LEAST_ENSEMBLES = 4
EXCLUDED = 5.0
"""Standard deviations from a prior at which the data and it cannot both be right."""
JOINED = 1.05
"""R-hat over the ensembles about two optima below which they have met."""
RIVAL = 30.0
"""Optima whose cost is higher by more than this, a factor of 3e-7 in density, are left out."""


@dataclass(frozen=True)
class Settings:
    """How to sample.

    Attributes:
        ensembles: independent ensembles about each optimum; at least four, so that R-hat means something.
        walkers: in each ensemble; None for four times the number of unknowns, or twelve times where the data leave
            directions open or weakly known, as posteriors are thin and curved then.
        target_ess: bulk effective sample size at which to stop, for each unknown.
        max_steps: steps at which to stop in any case.
        seed: of everything.
        threads: ensembles that move at the same time; more than one only for a model that calls no LAPACK.
    """

    ensembles: int = 4
    walkers: int | None = None
    target_ess: float = 2000.0
    max_steps: int = 20000
    seed: int = 0
    threads: int = 1


DEFAULT = Settings()


@dataclass(frozen=True)
class Sample:
    """Draws from a posterior, and how far to trust them.

    Attributes:
        posterior: what was sampled.
        fit: where the ensembles started; the optima by which `basin` counts.
        settings: how it was sampled.
        theta: (steps, ensembles, walkers, P) all draws.
        log_density: (steps, ensembles, walkers) log posterior.
        basin: (ensembles,) optimum about which each ensemble is; the better one of two without a barrier between.
        started: (ensembles,) optimum about which each ensemble started.
        acceptance: (ensembles,) share of accepted moves.
        diagnosis: what the chains say of themselves, basin by basin.
    """

    posterior: Posterior
    fit: Fit
    settings: Settings
    theta: Float[np.ndarray, "steps ensembles walkers P"]
    log_density: Float[np.ndarray, "steps ensembles walkers"]
    basin: tuple[int, ...]
    started: tuple[int, ...]
    acceptance: Float[np.ndarray, "ensembles"]
    diagnosis: tuple[Diagnosis, ...]

    @property
    def batch(self) -> int:
        """Points that the posterior is compiled for."""
        return self.theta.shape[2] // SPLITS

    @property
    def basins(self) -> tuple[int, ...]:
        """The optima that were sampled about."""
        return tuple(dict.fromkeys(self.basin))

    @property
    def burn_in(self) -> int:
        """Steps that are not counted."""
        return max(d.burn_in for d in self.diagnosis)

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
    ones. A chain depends on model, data, priors, optima, walkers and seed alone: interrupted and resumed it is the
    same to the bit, and a higher target only makes it longer.

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
    walkers = _walkers(fit, posterior, settings)
    _check_bounded(fit, posterior)
    settings = replace(settings, walkers=walkers)
    # with noise that is known up to a factor only, so are the costs
    reach = math.inf if posterior.noise.items else fit.best.cost + RIVAL
    optima = [i for i, optimum in enumerate(fit.optima) if optimum.cost < reach]
    started = [optimum for optimum in optima for _ in range(settings.ensembles)]
    store = Store(folder, {**(provenance or {}), **identity(posterior, _chain_settings(settings, len(optima)))})
    blocks, about = read_blocks(store), [fit.optima[optimum] for optimum in started]
    ensembles = [Ensemble(posterior, walkers) for _ in started]
    check_at = FIRST_CHECK
    with ThreadPoolExecutor(settings.threads) as pool:
        for i in progress(range(settings.max_steps // BLOCK)):
            if i >= len(blocks):
                states = states_after(blocks[-1]) if blocks else first_states(posterior, about, walkers, settings.seed)
                blocks.append(block_of(list(pool.map(Ensemble.advance, ensembles, states))))
                write_block(store, i, blocks[-1])
            steps = (i + 1) * BLOCK
            if steps >= check_at:
                chains = blocks[: i + 1]
                missing = max(d.more_steps(settings.target_ess) for d in _diagnose(chains, _joined(chains, started)))
                if not missing:
                    break
                check_at = steps + min(missing, steps // 4)
    return _sample(fit, posterior, settings, blocks[: i + 1], started)


def _sample(
    fit: Fit, posterior: Posterior, settings: Settings, blocks: Sequence[Block], started: Sequence[int]
) -> Sample:
    theta, log = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("theta", "log_density"))
    accepted = np.concatenate([block.accepted for block in blocks]).sum(0) / (len(theta) * theta.shape[2])
    basin = _joined(blocks, started)
    diagnosis = _diagnose(blocks, basin)
    return Sample(posterior, fit, settings, theta, log, tuple(basin), tuple(started), accepted, diagnosis)


def _joined(blocks: Sequence[Block], started: Sequence[int]) -> list[int]:
    """Count optima as one whose ensembles have found the same distribution: no barrier lies between them."""
    basins, joined = list(dict.fromkeys(started)), list(started)
    for i, later in enumerate(basins):
        for earlier in basins[:i]:
            both = [earlier if b == later else b for b in joined]
            if later in joined and earlier in joined and _diagnose(blocks, both, only=earlier)[0].rhat.max() < JOINED:
                joined = both
    return joined


def _diagnose(blocks: Sequence[Block], basins: Sequence[int], only: int | None = None) -> tuple[Diagnosis, ...]:
    theta, basin = np.concatenate([block.theta for block in blocks]), np.array(basins)
    return tuple(diagnose(theta[:, basin == b]) for b in (dict.fromkeys(basins) if only is None else [only]))


def _walkers(fit: Fit, posterior: Posterior, settings: Settings) -> int:
    """Return the number of walkers of settings that can work."""
    count = len(posterior.parameters.items)
    curved = not all(direction.seen and not direction.weak for direction in fit.information.directions)
    walkers = settings.walkers or (12 if curved else 4) * count
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
    scaled = fit.jacobian / np.asarray(fit.problem.sigma)[:, None]
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


def _chain_settings(settings: Settings, optima: int) -> dict[str, int | None]:
    """Return the settings that a chain depends on; the others only say when it ends."""
    return {
        "number of optima": optima,
        "number of ensembles": settings.ensembles,
        "number of walkers": settings.walkers,
        "seed": settings.seed,
    }
