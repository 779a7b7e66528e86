"""Chains on disk as they grow: one item of a store a block."""

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


@dataclass(frozen=True)
class Block:
    """A stretch of all chains, and the random generators' states at its end; the walkers' places are its last draws.

    Attributes:
        theta: (steps, ensembles, walkers, P) draws.
        log_density: (steps, ensembles, walkers) log posterior.
        accepted: (1, ensembles) accepted moves.
        keys: (ensembles, 624) states of the Mersenne twisters.
        positions: (ensembles, 2) their places, and whether a normal deviate is in store.
        deviates: (ensembles,) that deviate.
    """

    theta: Float[np.ndarray, "steps ensembles walkers P"]
    log_density: Float[np.ndarray, "steps ensembles walkers"]
    accepted: Int[np.ndarray, "1 ensembles"]
    keys: UInt[np.ndarray, "ensembles 624"]
    positions: Int[np.ndarray, "ensembles 2"]
    deviates: Float[np.ndarray, "ensembles"]


def read_blocks(store: Store) -> list[Block]:
    """Return the blocks that are there, in order, up to the first that is missing or damaged."""
    blocks: list[Block] = []
    while isinstance(block := store.read(_name(len(blocks))), Block):
        blocks.append(block)
    return blocks


def write_block(store: Store, number: int, block: Block) -> None:
    """Keep a block.

    Raises:
        InputError: it can't be written; the blocks before are untouched.
    """
    store.write(_name(number), block)


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
    return f"block{number:05d}"
