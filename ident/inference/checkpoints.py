"""Chains as they grow, in memory and on disk: of bounded size, and gone on with to the bit."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int, UInt

from ident.inference.posterior import Posterior
from ident.store import Store

LAST = "last"
"""Name of the checkpoint's item; those of the draws have numbers."""


@dataclass(frozen=True)
class Walkers:
    """All walkers at one moment, with what is needed to move them on.

    Attributes:
        theta: (N, Q) where they are, one ensemble after the other.
        known: (N, columns) what `densities` says of these points.
        key: (624,) state of the Mersenne twister.
        position: (2,) its place, and whether a normal deviate is in store.
        deviate: that deviate.
        share: of the moves that are independent proposals.
    """

    theta: Float[np.ndarray, "N Q"]
    known: Float[np.ndarray, "N columns"]
    key: UInt[np.ndarray, "624"]
    position: Int[np.ndarray, "2"]
    deviate: float
    share: float


@dataclass(frozen=True)
class Draws:
    """A stretch of all chains.

    Attributes:
        theta: (n, ensembles, walkers, P)
        log_density: (n, ensembles, walkers) log posterior.
    """

    theta: Float[np.ndarray, "n ensembles walkers P"]
    log_density: Float[np.ndarray, "n ensembles walkers"]


@dataclass(frozen=True)
class Checkpoint:
    """The end of all chains so far.

    Attributes:
        steps: taken.
        thin: steps from one draw that is kept to the next.
        first, end: numbers of the first item of draws, and behind the last.
        accepted: (ensembles,) moves.
        check_at: steps at which the chains are diagnosed next.
        walkers: where they are.
    """

    steps: int
    thin: int
    first: int
    end: int
    accepted: Int[np.ndarray, "ensembles"]
    check_at: int
    walkers: Walkers


class Chains:
    """All draws that are kept: every step until there are too many, then every second one, every fourth, and so on."""

    def __init__(self, store: Store, most: int):
        """Take up what the store has, if that is whole; else begin anew.

        Args:
            store: where the draws go.
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
        """Steps from one draw that is kept to the next."""
        return self.last.thin if self.last else 1

    def whole(self) -> Draws:
        """Return all draws that are kept."""
        if len(self.parts) == 1:
            return self.parts[0]
        names = "theta", "log_density"
        return Draws(*(np.concatenate([getattr(part, name) for part in self.parts]) for name in names))

    def add(self, block: Draws, accepted: Int[np.ndarray, "ensembles"], walkers: Walkers, check_at: int) -> None:
        """Add a block of draws at every `thin`-th step, and the walkers at its end.

        Draws are written first and the checkpoint that names them last: killed at any moment, a run goes on from the
        checkpoint before.

        Raises:
            InputError: it can't be written; what was there is untouched.
        """
        steps, thin = self.steps, self.thin
        first, end = (self.last.first, self.last.end) if self.last else (0, 0)
        accepted = accepted + (self.last.accepted if self.last else 0)
        self.parts.append(_every(block, (-steps - 1) % thin, thin))
        if sum(part.log_density.size for part in self.parts) > self.most:
            self.parts, thin, first = [_every(self.whole(), 1, 2)], 2 * thin, end
        self.store.write(_name(end), self.parts[-1])
        before = self.last.first if self.last else 0
        count = len(block.theta)
        self.last = Checkpoint(steps + count, thin, first, end + 1, accepted, check_at, walkers)
        self.store.write(LAST, self.last)
        for number in range(before, first):
            self.store.remove(_name(number))


def _every(draws: Draws, first: int, step: int) -> Draws:
    return Draws(draws.theta[first::step], draws.log_density[first::step])


def identity(posterior: Posterior, settings: Mapping[str, object]) -> dict[str, str]:
    """Name what a chain depends on: the posterior, settings by name, and the libraries."""
    numbers = hashlib.sha256()
    for leaf in jax.tree.leaves(eqx.filter(posterior, eqx.is_array)):
        numbers.update(np.asarray(leaf).tobytes())
    return {
        "set of unknowns": ", ".join("=".join(item.paths) for item in posterior.parameters.items),
        "set of numbers (data, priors, arm)": numbers.hexdigest(),
        **{name: str(value) for name, value in settings.items()},
        **{f"version of {name}": version(name) for name in ("emcee", "jax", "ident")},
    }


def _name(number: int) -> str:
    return f"draws{number:05d}"
