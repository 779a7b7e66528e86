"""Chains of the sampler: diagnosis during the run, and storage."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

import emcee.autocorr
import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int, UInt

from ident.codec import Store
from ident.inference.posterior import Posterior

# -------- Checkpoints
# Growing chains, in memory and on disk: of bounded size, and resumable to the bit.

LAST = "last"
"""Name of the checkpoint's item; those of the draws have numbers."""


@dataclass(frozen=True)
class Walkers:
    """All walkers at one moment, with the state needed to continue.

    Attributes:
        theta: (N, Q) their positions, one ensemble after the other.
        known: (N, columns) `densities` at these points.
        key: (624,) state of the Mersenne twister.
        position: (2,) position in that state, and whether a normal deviate is stored.
        deviate: that deviate.
        share: of independent proposals among the moves.
    """

    theta: Float[np.ndarray, "N Q"]
    known: Float[np.ndarray, "N columns"]
    key: UInt[np.ndarray, "624"]
    position: Int[np.ndarray, "2"]
    deviate: float
    share: float


@dataclass(frozen=True)
class Draws:
    """A block of all chains.

    Attributes:
        theta: (n, ensembles, walkers, P)
        log_density: (n, ensembles, walkers) log posterior.
    """

    theta: Float[np.ndarray, "n ensembles walkers P"]
    log_density: Float[np.ndarray, "n ensembles walkers"]


@dataclass(frozen=True)
class Checkpoint:
    """The present end of all chains.

    Attributes:
        steps: so far.
        thin: steps from one kept draw to the next.
        first, end: number of the first stored item of draws, and one past the last.
        accepted: (ensembles,) number of accepted moves.
        check_at: steps at which the chains are diagnosed next.
        walkers: at the end.
    """

    steps: int
    thin: int
    first: int
    end: int
    accepted: Int[np.ndarray, "ensembles"]
    check_at: int
    walkers: Walkers


class Chains:
    """All kept draws: every step until there are too many, then every second one, every fourth, and so on."""

    def __init__(self, store: Store, most: int):
        """Continue from the store if it is complete; else start from the beginning.

        Args:
            store: for the draws.
            most: draws, of all walkers together, above which every second step is dropped.
        """
        self.store, self.most = store, most
        self.parts: list[Draws] = []
        self.last: Checkpoint | None = None
        last = store.read(LAST)
        if isinstance(last, Checkpoint):
            parts = [store.read(_name(i)) for i in range(last.first, last.end)]
            if all(isinstance(part, Draws) for part in parts):
                self.parts, self.last = parts, last

    @property
    def steps(self) -> int:
        """Steps taken so far."""
        return self.last.steps if self.last else 0

    @property
    def thin(self) -> int:
        """Steps from one kept draw to the next."""
        return self.last.thin if self.last else 1

    def whole(self) -> Draws:
        """Return all kept draws."""
        if len(self.parts) == 1:
            return self.parts[0]
        names = "theta", "log_density"
        return Draws(*(np.concatenate([getattr(part, name) for part in self.parts]) for name in names))

    def add(self, block: Draws, accepted: Int[np.ndarray, "ensembles"], walkers: Walkers, check_at: int) -> None:
        """Add a block of draws at every `thin`-th step, and the walkers at its end.

        Draws are written first and the checkpoint that names them last: killed at any moment, a run continues from the
        checkpoint before.

        Raises:
            InputError: the store cannot be written; its content is untouched.
        """
        steps, thin = self.steps, self.thin
        first, end = (self.last.first, self.last.end) if self.last else (0, 0)
        accepted = accepted + (self.last.accepted if self.last else 0)
        self.parts.append(_every(block, (-steps - 1) % thin, thin))
        if sum(part.log_density.size for part in self.parts) > self.most:
            self.parts, thin, first = [_every(self.whole(), 1, 2)], 2 * thin, end
        self.store.write(_name(end), self.parts[-1])
        before = self.last.first if self.last else 0
        self.last = Checkpoint(steps + len(block.theta), thin, first, end + 1, accepted, check_at, walkers)
        self.store.write(LAST, self.last)
        for number in range(before, first):
            self.store.remove(_name(number))


def _every(draws: Draws, first: int, step: int) -> Draws:
    return Draws(draws.theta[first::step], draws.log_density[first::step])


def identity(posterior: Posterior, settings: Mapping[str, object]) -> dict[str, str]:
    """Return the inputs that identify a chain: the posterior, settings by name, and the libraries."""
    numbers = hashlib.sha256()
    for leaf in jax.tree.leaves(eqx.filter(posterior, eqx.is_array)):
        numbers.update(np.asarray(leaf).tobytes())
    return {
        "set of unknowns": ", ".join("=".join(item.paths) for item in posterior.parameters.items),
        "set of numbers (data, priors, arm)": numbers.hexdigest(),
        **{name: str(value) for name, value in settings.items()},
        **{f"version of {name}": version(name) for name in ("emcee", "jax", "ident-arm")},
    }


def _name(number: int) -> str:
    return f"draws{number:05d}"


# -------- Diagnostics
# Diagnosis of chains: autocorrelation time, effective sample size, R-hat.

BURN_IN = 5
"""Length of the burn-in in autocorrelation times; assumed."""
LONG_ENOUGH = 50
"""Chain length, in autocorrelation times, from which emcee's estimate of that time is reliable; rule of its manual."""
ENDLESS = 1e9
"""Number of steps that no run reaches."""
MIXED = 1.01
"""R-hat above which the ensembles have not mixed (Vehtari et al. 2021)."""


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of the ensembles about one optimum.

    Attributes:
        steps: of the chains.
        burn_in: steps to discard at the start.
        tau: (P,) [steps] integrated autocorrelation time, by emcee.
        bulk: (P,) bulk effective sample size, by ArviZ, each walker a chain.
        tail: (P,) effective sample size of the 5 % and 95 % quantiles.
        rhat: (P,) rank-normalised split R-hat over the ensembles, as walkers of one ensemble are not independent.
    """

    steps: int
    burn_in: int
    tau: Float[np.ndarray, "P"]
    bulk: Float[np.ndarray, "P"]
    tail: Float[np.ndarray, "P"]
    rhat: Float[np.ndarray, "P"]

    @property
    def mixed(self) -> bool:
        """Whether the ensembles agree."""
        return bool((self.rhat < MIXED).all())

    @property
    def long_enough(self) -> bool:
        """Whether the chains are long enough for a reliable autocorrelation time."""
        return bool(self.steps - self.burn_in >= LONG_ENOUGH * self.tau.max())

    def enough(self, target: float) -> bool:
        """Whether reliable chains have reached the target effective sample size."""
        return self.mixed and self.long_enough and bool(self.bulk.min() >= target)

    def more_steps(self, target: float) -> int:
        """Estimate the number of further steps needed."""
        counted = self.steps - self.burn_in
        to_mix = 0.0 if self.mixed else 2.0 * counted
        needed = max(LONG_ENOUGH * self.tau.max(), counted * target / self.bulk.min(), to_mix)
        return max(0, math.ceil(min(needed - counted, ENDLESS)))


def diagnose(theta: Float[np.ndarray, "n ensembles walkers P"], apart: int = 1) -> Diagnosis:
    """Diagnose ensembles that should sample the same distribution.

    Args:
        theta: their draws.
        apart: steps from one draw to the next.

    References:
        Goodman, Weare, "Ensemble samplers with affine invariance", 2010 (autocorrelation time over an ensemble).
        Vehtari, Gelman, Simpson, Carpenter, Buerkner, "Rank-normalization, folding, and localization: an improved
        R-hat", Bayesian Analysis 16(2), 2021.
    """
    import arviz  # takes a second to import

    length, ensembles, _, count = theta.shape
    by_walker = theta.reshape(length, -1, count)
    with np.errstate(invalid="ignore"):  # a walker that never moved: NaN, replaced by the chain's length
        tau = np.atleast_1d(emcee.autocorr.integrated_time(by_walker, tol=0, quiet=True))
    tau = np.where(np.isfinite(tau), np.maximum(tau, 1.0), length)
    burn_in = min(math.ceil(BURN_IN * tau.max()), length // 2)
    thin = max(1, int(tau.min() / 5))
    chains = by_walker[burn_in::thin].transpose(2, 1, 0)
    in_time = theta[burn_in::thin].transpose(3, 1, 0, 2).reshape(count, ensembles, -1)
    return Diagnosis(
        length * apart,
        burn_in * apart,
        tau * apart,
        np.array([arviz.ess(x, method="bulk") for x in chains]),
        np.array([arviz.ess(x, method="tail") for x in chains]),
        np.array([arviz.rhat(x) for x in in_time]),
    )
