"""Ensembles of walkers that emcee moves, a block of steps at a time."""

from collections.abc import Sequence

import emcee
import numpy as np

from ident.inference.checkpoints import Block
from ident.inference.fit import Optimum
from ident.inference.initial_walkers import initial_walkers
from ident.inference.posterior import Posterior, evaluate

BLOCK = 50
"""Steps between two checkpoints."""
SPLITS = 2
"""Parts of an ensemble that emcee moves in turn, and so the size of a batch: walkers over this."""

Moved = tuple[emcee.State, np.ndarray, np.ndarray, int]


class Ensemble:
    """One ensemble, moved a block at a time."""

    def __init__(self, posterior: Posterior, walkers: int):
        def density(points: np.ndarray) -> np.ndarray:
            return evaluate(posterior, points, walkers // SPLITS).log_density

        count = len(posterior.parameters.items)
        self.sampler = emcee.EnsembleSampler(walkers, count, density, vectorize=True, moves=_moves())

    def advance(self, state: emcee.State) -> Moved:
        """Return the state after one block, and the block's draws, log densities and accepted moves."""
        self.sampler.reset()
        state = self.sampler.run_mcmc(state, BLOCK, skip_initial_state_check=True)
        backend = self.sampler.backend
        return state, backend.get_chain(), backend.get_log_prob(), int(backend.accepted.sum())


def first_states(posterior: Posterior, optima: Sequence[Optimum], walkers: int, seed: int) -> list[emcee.State]:
    """Return where ensembles begin, one about each of these optima."""
    states = []
    for optimum, own in zip(optima, np.random.SeedSequence(seed).spawn(len(optima)), strict=True):
        spread, moves = own.spawn(2)
        points = initial_walkers(posterior, optimum, walkers, np.random.default_rng(spread), walkers // SPLITS)
        twister = np.random.RandomState(np.random.MT19937(moves)).get_state()
        states.append(emcee.State(points, random_state=twister))
    return states


def states_after(block: Block) -> list[emcee.State]:
    """Return the ensembles as they were at the end of a block."""
    return [
        emcee.State(points, log_prob=log, random_state=("MT19937", key, int(place), int(stored), float(deviate)))
        for points, log, key, (place, stored), deviate in zip(
            block.theta[-1], block.log_density[-1], block.keys, block.positions, block.deviates, strict=True
        )
    ]


def block_of(moved: Sequence[Moved]) -> Block:
    """Return what all ensembles have done as one block."""
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


def _moves() -> list[tuple[emcee.moves.Move, float]]:
    """Differences of walkers, for correlated posteriors; a third of them short, for curved ones; some stretches."""
    return [(emcee.moves.DEMove(), 0.4), (emcee.moves.DEMove(gamma0=0.3), 0.3), (emcee.moves.StretchMove(), 0.3)]
