"""Draws from the posterior: several independent emcee ensembles about each optimum, resumable to the bit."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import emcee
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.errors import InputError, Problem
from ident.inference.checkpoints import Block, identity, read_blocks, write_block
from ident.inference.diagnostics import Diagnosis, diagnose
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.initial_walkers import initial_walkers
from ident.inference.posterior import Posterior, evaluate
from ident.store import Store

BLOCK = 50
"""Steps between two checkpoints."""
FIRST_CHECK = 500
"""Steps after which the chains are diagnosed for the first time; then when they should do, or are a quarter longer."""
LEAST_ENSEMBLES = 4
EXCLUDED = 5.0
"""Standard deviations from a prior at which the data and it cannot both be right."""
SPLITS = 2
"""Parts of an ensemble that emcee moves in turn, and so the size of a batch: walkers over this."""
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
        fit: of the posterior's problem; gives optima and starting points.
        posterior: what to sample.
        settings: how.
        folder: where checkpoints are kept; None for none.
        provenance: what else must be equal for a checkpoint to be gone on with, by name.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: settings that cannot work, data and prior that leave a parameter open or exclude each other,
            checkpoints of another run.
        ModelError: the model has no answer about an optimum.
    """
    settings = _checked(fit, posterior, settings)
    # with noise that is known up to a factor only, so are the costs
    reach = math.inf if posterior.noise.items else fit.best.cost + RIVAL
    optima = [i for i, optimum in enumerate(fit.optima) if optimum.cost < reach]
    started = [optimum for optimum in optima for _ in range(settings.ensembles)]
    store = Store(folder, {**(provenance or {}), **identity(posterior, _chain_settings(settings, len(optima)))})
    blocks = read_blocks(store)
    movers = [_Mover(posterior, settings) for _ in started]
    check_at = FIRST_CHECK
    with ThreadPoolExecutor(settings.threads) as pool:
        for i in progress(range(settings.max_steps // BLOCK)):
            if i >= len(blocks):
                states = _states(blocks[-1]) if blocks else _begin(fit, posterior, settings, started)
                blocks.append(_join(list(pool.map(_Mover.advance, movers, states))))
                write_block(store, i, blocks[-1])
            steps = (i + 1) * BLOCK
            if steps >= check_at:
                chains = blocks[: i + 1]
                missing = max(d.more_steps(settings.target_ess) for d in _diagnose(chains, _joined(chains, started)))
                if not missing:
                    break
                check_at = steps + min(missing, steps // 4)
    return _sample(fit, posterior, settings, blocks[: i + 1], started)


class _Mover:
    """One ensemble, moved a block at a time."""

    def __init__(self, posterior: Posterior, settings: Settings):
        size = _size(settings) // SPLITS

        def density(points: np.ndarray) -> np.ndarray:
            return evaluate(posterior, points, size).log_density

        count = len(posterior.parameters.items)
        self.sampler = emcee.EnsembleSampler(_size(settings), count, density, vectorize=True, moves=_moves())

    def advance(self, state: emcee.State) -> tuple[emcee.State, np.ndarray, np.ndarray, int]:
        """Return the state after one block, and the block's draws, log densities and accepted moves."""
        self.sampler.reset()
        state = self.sampler.run_mcmc(state, BLOCK, skip_initial_state_check=True)
        backend = self.sampler.backend
        return state, backend.get_chain(), backend.get_log_prob(), int(backend.accepted.sum())


def _size(settings: Settings) -> int:
    assert settings.walkers is not None
    return settings.walkers


def _moves() -> list[tuple[emcee.moves.Move, float]]:
    """Differences of walkers, for correlated posteriors; a third of them short, for curved ones; some stretches."""
    return [(emcee.moves.DEMove(), 0.4), (emcee.moves.DEMove(gamma0=0.3), 0.3), (emcee.moves.StretchMove(), 0.3)]


def _begin(fit: Fit, posterior: Posterior, settings: Settings, started: Sequence[int]) -> list[emcee.State]:
    states = []
    for optimum, seed in zip(started, np.random.SeedSequence(settings.seed).spawn(len(started)), strict=True):
        spread, moves = seed.spawn(2)
        rng, size = np.random.default_rng(spread), _size(settings)
        points = initial_walkers(posterior, fit.optima[optimum], size, rng, size // SPLITS)
        twister = np.random.RandomState(np.random.MT19937(moves)).get_state()
        states.append(emcee.State(points, random_state=twister))
    return states


def _states(block: Block) -> list[emcee.State]:
    return [
        emcee.State(points, log_prob=log, random_state=("MT19937", key, int(place), int(stored), float(deviate)))
        for points, log, key, (place, stored), deviate in zip(
            block.theta[-1], block.log_density[-1], block.keys, block.positions, block.deviates, strict=True
        )
    ]


def _join(moved: Sequence[tuple[emcee.State, np.ndarray, np.ndarray, int]]) -> Block:
    states, theta, log, accepted = zip(*moved, strict=True)
    twisters = [state.random_state for state in states]
    return Block(
        np.stack(theta, 1),
        np.stack(log, 1),
        np.array([accepted]),
        np.stack([twister[1] for twister in twisters]),
        np.array([twister[2:4] for twister in twisters]),
        np.array([twister[4] for twister in twisters], float),
    )


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


def _checked(fit: Fit, posterior: Posterior, settings: Settings) -> Settings:
    """Return the settings with the number of walkers filled in."""
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
    return replace(settings, walkers=walkers)


def _chain_settings(settings: Settings, optima: int) -> dict[str, int | None]:
    """Return the settings that a chain depends on; the others only say when it ends."""
    return {
        "number of optima": optima,
        "number of ensembles": settings.ensembles,
        "number of walkers": settings.walkers,
        "seed": settings.seed,
    }
