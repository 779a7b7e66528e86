"""Ensembles of walkers that emcee moves side by side, a block of steps at a time."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import emcee
import numpy as np
from emcee.moves import DEMove, StretchMove
from emcee.moves.red_blue import RedBlueMove
from jaxtyping import Float, Int

from ident.inference.checkpoints import Draws, Walkers
from ident.inference.information import information
from ident.inference.initial_walkers import initial_walkers
from ident.inference.least_squares import evaluate as fit_at
from ident.inference.linear_marginal import LinearMarginal
from ident.inference.marginal import Marginal
from ident.inference.moves import Apart, Independent, InReciprocals
from ident.inference.optima import Optimum
from ident.inference.posterior import evaluate

BLOCK = 50
"""Steps between two checkpoints."""
SPLITS = 2
"""Parts of an ensemble that emcee moves in turn."""
PARTS = 2
"""Parts of what is moved at the same time that two threads evaluate."""
TRIALS = 4
"""Points for each walker by which independent proposals are tried."""
WORTH = 0.25
"""Share of independent proposals that must be accepted for them to be made at all."""
MOST = 0.8
"""Share of the moves that they are at most: the others reach where no such proposal goes."""


def batch_size(ensembles: int, walkers: int) -> int:
    """Return the number of points that are evaluated together."""
    return -(-ensembles * walkers // (SPLITS * PARTS))


class Ensembles:
    """All ensembles of one run, about one or several optima."""

    def __init__(
        self,
        target: Marginal | LinearMarginal,
        optima: Sequence[Optimum],
        walkers: int,
        seed: int,
        pool: ThreadPoolExecutor,
    ):
        """Prepare.

        Args:
            target: what is sampled.
            optima: about which each ensemble begins.
            walkers: in each ensemble.
            seed: of everything.
            pool: threads that evaluate parts of a batch.
        """
        self.target, self.optima, self.walkers, self.seed, self.pool = target, optima, walkers, seed, pool
        self.positive = target.parameters.positive
        proposals = {id(optimum): _independent(target, optimum) for optimum in optima}
        self.proposals = [proposals[id(optimum)] for optimum in optima]
        self.sampler: emcee.EnsembleSampler | None = None

    def begin(self) -> Walkers:
        """Return walkers spread as the posterior about each optimum is.

        Where the normal approximation is good, they are draws from it, resampled by their importance (Rubin, "The
        calculation of posterior distributions by data augmentation: comment", JASA 82(398), 1987); else by
        `initial_walkers`.
        """
        moves, *own = np.random.SeedSequence(self.seed).spawn(1 + len(self.optima))
        rngs = [np.random.default_rng(each) for each in own]
        tried = [self._tried(proposal, rng) for proposal, rng in zip(self.proposals, rngs, strict=True)]
        share = min(accepted for accepted, _ in tried)
        if share >= WORTH:
            theta = np.concatenate([points for _, points in tried])
        else:
            batch, kept = batch_size(len(self.optima), self.walkers), ~self.target.integrated
            theta = np.concatenate(
                [
                    initial_walkers(self.target.posterior, optimum, self.walkers, rng, batch)[:, kept]
                    for optimum, rng in zip(self.optima, rngs, strict=True)
                ]
            )
        twister = np.random.RandomState(np.random.MT19937(moves)).get_state()
        return _walkers(theta, self._densities(theta), twister, min(share, MOST) * (share >= WORTH))

    def advance(self, start: Walkers, block: int) -> tuple[Draws, Int[np.ndarray, "ensembles"], Walkers]:
        """Return the draws of one block of steps, the moves accepted, and the walkers at its end.

        Args:
            start: where the walkers are.
            block: its number, which gives the factors' random numbers.
        """
        if self.sampler is None:
            self.sampler = self._sampler(start.share)
        twister = ("MT19937", start.key, *map(int, start.position), start.deviate)
        log_density, blobs = start.known[:, 0], start.known[:, 1:] if start.known.shape[1] > 1 else None
        state = emcee.State(start.theta, log_prob=log_density, blobs=blobs, random_state=twister)
        self.sampler.reset()
        state = self.sampler.run_mcmc(state, BLOCK, skip_initial_state_check=True)
        backend = self.sampler.backend
        accepted = backend.accepted.astype(int).reshape(len(self.optima), -1).sum(1)
        end = _walkers(state.coords, _columns(state.log_prob, state.blobs), state.random_state, start.share)
        known = _columns(backend.get_log_prob(), backend.get_blobs())
        return self._draws(backend.get_chain(), known, block), accepted, end

    def _draws(self, theta: np.ndarray, known: np.ndarray, block: int) -> Draws:
        rng = np.random.default_rng([self.seed, block])
        shape = len(theta), len(self.optima), self.walkers
        points, of_them = (x.reshape(-1, x.shape[-1]) for x in (theta, known))
        whole, log_density = self.target.completed(points, of_them, rng)
        return Draws(whole.reshape(*shape, -1), log_density.reshape(shape))

    def _densities(self, points: Float[np.ndarray, "n Q"]) -> Float[np.ndarray, "n columns"]:
        batch = batch_size(len(self.optima), self.walkers)
        return self.target.columns(evaluate(self.target.itself, points, batch, self.pool.map))

    def _sampler(self, share: float) -> emcee.EnsembleSampler:
        def density(points: np.ndarray) -> np.ndarray:
            known = self._densities(points)
            return known if known.shape[1] > 1 else known[:, 0]

        number, unknowns = len(self.optima) * self.walkers, len(self.positive)
        moves = [(Apart([move] * len(self.optima)), (1 - share) * part) for move, part in self._moves()]
        if share:
            moves.append((Apart(self.proposals), share))
        return emcee.EnsembleSampler(number, unknowns, density, vectorize=True, moves=moves)

    def _tried(self, proposal: Independent | None, rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """Return the share of independent proposals that would be accepted, and walkers drawn by importance."""
        if proposal is None:
            return 0.0, np.empty((0, len(self.positive)))
        points, log_proposal = proposal.draw(rng.standard_normal((TRIALS * self.walkers, len(self.positive))))
        log_weight = self._densities(points)[:, 0] - log_proposal
        log_weight = np.where(np.isfinite(log_proposal), log_weight, -np.inf)
        weight = np.exp(log_weight - log_weight.max())
        if (weight > 0).sum() < self.walkers:
            return 0.0, points[: self.walkers]
        here = rng.choice(len(points), len(points), p=weight / weight.sum())
        accepted = np.minimum(1.0, weight / weight[here]).mean()
        return float(accepted), points[rng.choice(len(points), self.walkers, replace=False, p=weight / weight.sum())]

    def _moves(self) -> list[tuple[RedBlueMove, float]]:
        """Differences of walkers and stretches: in reciprocals, where thin posteriors are flat, and as they are."""
        return [
            (InReciprocals(DEMove(), self.positive), 0.45),
            (InReciprocals(DEMove(gamma0=0.4), self.positive), 0.25),
            (InReciprocals(StretchMove(), self.positive), 0.1),
            (DEMove(gamma0=0.3), 0.1),
            (StretchMove(), 0.1),
        ]


def _independent(target: Marginal | LinearMarginal, optimum: Optimum) -> Independent | None:
    """Return draws from the normal approximation about an optimum; None where sigmas are unknown or it has none."""
    if target.posterior.noise.items:
        return None
    problem = target.posterior.problem
    scaled = problem.scaled(np.asarray(fit_at(problem, optimum.theta).jacobian))
    if not np.isfinite(scaled).all():
        return None
    names, kept = problem.parameters.names, ~target.integrated
    covariance = information(scaled, problem.parameters.normal_sd, names).covariance[np.ix_(kept, kept)]
    if not np.isfinite(covariance).all():
        return None
    return Independent(optimum.theta[kept], covariance, target.parameters.positive)


def _columns(log_density: np.ndarray, blobs: np.ndarray | None) -> np.ndarray:
    one = log_density[..., None]
    return one if blobs is None else np.concatenate([one, blobs], -1)


def _walkers(theta: np.ndarray, known: np.ndarray, twister: Any, share: float) -> Walkers:
    _, key, place, stored, deviate = twister
    return Walkers(theta, known, key, np.array([place, stored]), float(deviate), share)
