"""Draws from the posterior: several independent emcee ensembles about each optimum, resumable to the bit."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import emcee
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from emcee.moves import DEMove, StretchMove
from emcee.moves.red_blue import RedBlueMove
from jaxtyping import Bool, Float, Int

from ident.codec import Store
from ident.errors import ModelError, refusal, require
from ident.inference.chains import Chains, Diagnosis, Draws, Walkers, diagnose, identity
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.optima import Optimum
from ident.inference.posterior import (
    MOVED,
    TRIED,
    LinearMarginal,
    Marginal,
    Posterior,
    evaluate,
    linear_marginal,
    linear_nuisances,
    moved,
)
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate as fit_at
from ident.inference.search import solve

# -------- Initial walkers
# Initial points of an ensemble, already distributed approximately as the posterior.

TRIES = 20
"""Most rounds of drawing to get enough points with a solution of the model; assumed."""
NARROW = 0.1
"""Spread of the noise scales of initial walkers, in widths of their priors."""


def initial_walkers(
    posterior: Posterior, optimum: Optimum, count: int, rng: np.random.Generator, batch: int
) -> Float[np.ndarray, "count P"]:
    """Draw points about an optimum by repeated fits to perturbed data and priors.

    Every measured value and every prior's centre is moved by its own uncertainty, and the fit is repeated from the
    optimum. For a linear model these are exact draws from the posterior. For a thin curved posterior, as of six
    stiffnesses and three values, the points follow the curve, and those of a normal approximation would not.

    Args:
        posterior: the posterior.
        optimum: of its problem.
        count: number of points.
        rng: source of randomness.
        batch: number of points per evaluation of the density.

    Raises:
        ModelError: no such point exists.

    References:
        Bardsley, Solonen, Haario, Laine, "Randomize-then-optimize", SIAM J. Sci. Comput. 36(4), 2014.
    """

    def point() -> np.ndarray:
        end = solve(_perturbed(posterior.problem, rng), jnp.asarray(optimum.theta))
        scales = [NARROW * float(item.prior_sd) * rng.standard_normal() for item in posterior.noise.items]
        return np.concatenate([np.asarray(end.theta), scales])

    walkers = np.zeros((0, len(posterior.parameters.items)))
    for _ in range(TRIES):
        points = np.array([point() for _ in range(count)])
        points = points[np.isfinite(points).all(1)]
        if len(points):
            walkers = np.concatenate([walkers, points[np.isfinite(evaluate(posterior, points, batch).log_density)]])
        if len(walkers) >= count:
            return walkers[:count]
    raise ModelError("no points to start the sampler from: the model has no answer about the optimum")


def _perturbed(problem: InverseProblem, rng: np.random.Generator) -> InverseProblem:
    """Perturb data and priors by their own uncertainty; a flat prior counts as a normal one of about its width."""
    sigma, parameters = np.asarray(problem.sigma), problem.parameters
    noise = np.where(np.isfinite(sigma), sigma, 0.0) * problem.errors.color(rng.standard_normal(len(sigma)))
    sd = parameters.normal_sd
    shift = np.where(parameters.proper, sd, 0.0) * rng.standard_normal(len(sd))
    centres = parameters.values(parameters.theta_centre + shift)
    items = tuple(
        eqx.tree_at(
            lambda item: (item.centre, item.prior_sd, item.flat), item, tuple(map(np.asarray, (centre, s, 0.0)))
        )
        for item, centre, s in zip(parameters.items, centres, sd, strict=True)
    )
    return eqx.tree_at(lambda p: (p.measured, p.parameters.items), problem, (problem.measured + noise, items))


# -------- Moves
# Moves of walkers in addition to emcee's: in reciprocals, by a normal approximation, for several ensembles at once.

Proposal = tuple[np.ndarray, np.ndarray]
"""Proposed points (n, Q), and the logarithms of the factors (n,) that keep the moves reversible."""


class Apart(RedBlueMove):
    """Move independent ensembles together as one emcee ensemble: one batch evaluates all.

    Walker w of ensemble e has number e W + w. The halves of an ensemble, which are moved in turn, are its walkers of
    even and of odd number.
    """

    def __init__(self, moves: Sequence[RedBlueMove]):
        """Take a move for each ensemble."""
        super().__init__(randomize_split=False)
        self.moves = moves

    def setup(self, coords: np.ndarray) -> None:
        """Set up each ensemble's move."""
        for move, own in zip(self.moves, np.split(coords, len(self.moves)), strict=True):
            move.setup(own)

    def get_proposal(self, s: np.ndarray, c: Sequence[np.ndarray], random: np.random.RandomState) -> Proposal:
        """Propose new positions for one half of each ensemble, given its other half."""
        moving, waiting = (np.split(half, len(self.moves)) for half in (s, np.concatenate(c)))
        parts = [m.get_proposal(own, [w], random) for m, own, w in zip(self.moves, moving, waiting, strict=True)]
        points, factors = (np.concatenate(part) for part in zip(*parts, strict=True))
        return points, factors


class InReciprocals(RedBlueMove):
    """Apply another move in the reciprocals of positive unknowns.

    Deflections and the squares of periods are nearly linear in the compliances. So a posterior that is a thin curved
    sheet in the logarithms of stiffnesses is nearly flat in their reciprocals, and moves along differences of walkers
    stay on it.
    """

    def __init__(self, move: RedBlueMove, positive: Bool[np.ndarray, "Q"]):
        """Take the move, and which unknowns are logarithms of positive numbers."""
        super().__init__()
        self.move, self.positive = move, positive

    def setup(self, coords: np.ndarray) -> None:
        """Set up the move."""
        self.move.setup(coords)

    def get_proposal(self, s: np.ndarray, c: Sequence[np.ndarray], random: np.random.RandomState) -> Proposal:
        """Propose in the reciprocals; a proposal that is not positive is rejected."""
        q, factors = self.move.get_proposal(self._reciprocals(s), [self._reciprocals(half) for half in c], random)
        refused = (self.positive & (q <= 0)).any(1)
        theta = np.where(self.positive, -np.log(np.where(self.positive & (q > 0), q, 1.0)), q)
        theta[refused] = s[refused]
        rise = np.where(self.positive, theta - s, 0.0).sum(1)  # log Jacobian of exp(-theta)
        return theta, np.where(refused, -np.inf, factors + rise)

    def _reciprocals(self, theta: np.ndarray) -> np.ndarray:
        return np.where(self.positive, np.exp(-np.where(self.positive, theta, 0.0)), theta)


class Independent(RedBlueMove):
    """Draw from the normal approximation about an optimum, in the reciprocals of positive unknowns.

    If the data determine all unknowns well, most proposals are accepted, and draws are nearly independent.

    References:
        Tierney, "Markov chains for exploring posterior distributions", Annals of Statistics 22(4), 1994, section 2.3.3.
    """

    def __init__(
        self, centre: Float[np.ndarray, "Q"], covariance: Float[np.ndarray, "Q Q"], positive: Bool[np.ndarray, "Q"]
    ):
        """Take optimum and covariance in theta, and which unknowns are logarithms of positive numbers."""
        super().__init__()
        sign = np.where(positive, -1.0, 1.0)
        self.centre, self.positive = centre, positive
        self.root = np.linalg.cholesky(covariance * np.outer(sign, sign))

    def get_proposal(self, s: np.ndarray, c: Sequence[np.ndarray], random: np.random.RandomState) -> Proposal:
        """Propose points that depend on no walker; a point outside the positive numbers is rejected."""
        points, log_density = self.draw(random.standard_normal(s.shape))
        refused = ~np.isfinite(log_density)
        points[refused] = s[refused]
        return points, np.where(refused, -np.inf, self.log_density(s) - log_density)

    def draw(self, normal: Float[np.ndarray, "n Q"]) -> tuple[Float[np.ndarray, "n Q"], Float[np.ndarray, "n"]]:
        """Turn standard normal numbers into points; return also their log density, -inf for an invalid point."""
        off = normal @ self.root.T
        outside = (self.positive & (off <= -1)).any(1)
        points = self.centre + np.where(self.positive, -np.log1p(np.where(self.positive & (off > -1), off, 0.0)), off)
        return points, np.where(outside, -np.inf, self.log_density(points))

    def log_density(self, theta: Float[np.ndarray, "n Q"]) -> Float[np.ndarray, "n"]:
        """Return the logarithm of the density in theta, up to a constant."""
        step = theta - self.centre
        off = np.where(self.positive, np.expm1(-np.where(self.positive, step, 0.0)), step)
        return -(np.linalg.solve(self.root, off.T) ** 2).sum(0) / 2 - np.where(self.positive, step, 0.0).sum(1)


# -------- Ensembles
# Ensembles of walkers that emcee moves together, a block of steps at a time.

BLOCK = 50
"""Steps between two checkpoints."""
SPLITS = 2
"""Parts of an ensemble that emcee moves in turn."""
PARTS = 2
"""Parts of a batch that two threads evaluate at the same time."""
TRIALS = 4
"""Trial points for each walker, to test independent proposals."""
WORTH = 0.25
"""Least acceptance rate at which independent proposals are used; assumed."""
MOST = 0.8
"""Largest share of independent proposals among the moves: the other moves reach the tails; assumed."""


def batch_size(ensembles: int, walkers: int) -> int:
    """Return the number of points evaluated together."""
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
            target: the density to sample.
            optima: starting optimum of each ensemble.
            walkers: in each ensemble.
            seed: of all random numbers.
            pool: threads that evaluate parts of a batch.
        """
        self.target, self.optima, self.walkers, self.seed, self.pool = target, optima, walkers, seed, pool
        self.positive = target.parameters.positive
        proposals = {id(optimum): _independent(target, optimum) for optimum in optima}
        self.proposals = [proposals[id(optimum)] for optimum in optima]
        self.sampler: emcee.EnsembleSampler | None = None

    def begin(self) -> Walkers:
        """Return walkers distributed approximately as the posterior about each optimum.

        If the normal approximation is good, they are draws from it, resampled by their importance (Rubin, "The
        calculation of posterior distributions by data augmentation: comment", JASA 82(398), 1987); else they come from
        `initial_walkers`.
        """
        moves, *own = np.random.SeedSequence(self.seed).spawn(1 + len(self.optima))
        rngs = [np.random.default_rng(each) for each in own]
        tried = [self._tried(proposal, rng) for proposal, rng in zip(self.proposals, rngs, strict=True)]
        share = min(accepted for accepted, _ in tried)
        starts = [points for _, points in tried]
        if share < WORTH:
            batch, kept = batch_size(len(self.optima), self.walkers), ~self.target.integrated
            starts = [
                initial_walkers(self.target.posterior, optimum, self.walkers, rng, batch)[:, kept]
                for optimum, rng in zip(self.optima, rngs, strict=True)
            ]
        theta = np.concatenate(starts)
        twister = np.random.RandomState(np.random.MT19937(moves)).get_state()
        return _walkers(theta, self._densities(theta), twister, min(share, MOST) * (share >= WORTH))

    def advance(self, start: Walkers, block: int) -> tuple[Draws, Int[np.ndarray, "ensembles"], Walkers]:
        """Return the draws of one block of steps, the moves accepted, and the walkers at its end.

        Args:
            start: the walkers at its beginning.
            block: its number, the seed of the factors' random numbers.
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
        points, of_them = (x.reshape(-1, x.shape[-1]) for x in (backend.get_chain(), known))
        whole, log_density = self.target.completed(points, of_them, np.random.default_rng([self.seed, block]))
        shape = BLOCK, len(self.optima), self.walkers
        return Draws(whole.reshape(*shape, -1), log_density.reshape(shape)), accepted, end

    def _densities(self, points: Float[np.ndarray, "n Q"]) -> Float[np.ndarray, "n columns"]:
        batch = batch_size(len(self.optima), self.walkers)
        return self.target.columns(evaluate(self.target.itself, points, batch, self.pool.map))

    def _sampler(self, share: float) -> emcee.EnsembleSampler:
        def density(points: np.ndarray) -> np.ndarray:
            known = self._densities(points)
            return known if known.shape[1] > 1 else known[:, 0]

        number, unknowns = len(self.optima) * self.walkers, len(self.positive)
        # differential and stretch moves: in reciprocals, where thin posteriors are flat, and in theta
        kinds = [
            (InReciprocals(DEMove(), self.positive), 0.45),
            (InReciprocals(DEMove(gamma0=0.4), self.positive), 0.25),
            (InReciprocals(StretchMove(), self.positive), 0.1),
            (DEMove(gamma0=0.3), 0.1),
            (StretchMove(), 0.1),
        ]
        moves = [(Apart([move] * len(self.optima)), (1 - share) * part) for move, part in kinds]
        if share:
            moves.append((Apart(self.proposals), share))
        return emcee.EnsembleSampler(number, unknowns, density, vectorize=True, moves=moves)

    def _tried(self, proposal: Independent | None, rng: np.random.Generator) -> tuple[float, np.ndarray]:
        """Return the acceptance rate of independent proposals, and walkers drawn by importance."""
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


def _independent(target: Marginal | LinearMarginal, optimum: Optimum) -> Independent | None:
    """Return the normal approximation about an optimum; None if sigmas are unknown or there is none."""
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


# -------- Sample

FIRST_CHECK = 100
"""Steps before the first diagnosis; the next follows at the predicted end, or when chains are half as long again."""
LEAST_ENSEMBLES = 4
EXCLUDED = 5.0
"""Standard deviations from a prior at which data and prior exclude each other; assumed."""
JOINED = 1.05
"""R-hat over the ensembles about two optima below which they sample the same basin; assumed."""
ANEW = "explicit"
"""Subfolder for chains restarted with more nuisances sampled."""
RIVAL = 30.0
"""Optima whose cost is higher by more than this, a factor of 3e-7 in density, are ignored."""


@dataclass(frozen=True)
class Settings:
    """Settings of the sampler.

    Attributes:
        ensembles: independent ensembles about each optimum; at least four, so that R-hat is meaningful.
        walkers: in each ensemble; None for four times the number of sampled unknowns, or eight times if directions are
            undetermined or weak, as posteriors are thin and curved then.
        target_ess: bulk effective sample size at which to stop, for each unknown.
        max_steps: steps at which to stop in any case.
        seed: of all random numbers.
        threads: parts of a step evaluated at the same time, at most two; more than one only for a model that calls no
            LAPACK.
        most_draws: draws, of all walkers together, above which only every second step is kept, then every fourth, and
            so on: this bounds memory and checkpoints.
    """

    ensembles: int = 4
    walkers: int | None = None
    target_ess: float = 2000.0
    max_steps: int = 20000
    seed: int = 0
    threads: int = 1
    most_draws: int = 1_000_000


DEFAULT = Settings()


class DrawsByChain(NamedTuple):
    """Draws of a sample without burn-in, every walker a chain, in the order of the ensembles.

    Attributes:
        values: (P, chains, draws) [SI] all unknowns.
        log_density: (chains, draws) log posterior.
        ensemble: (chains,) ensemble of each chain.
        optimum: (chains,) optimum of each chain.
    """

    values: Float[np.ndarray, "P chains draws"]
    log_density: Float[np.ndarray, "chains draws"]
    ensemble: Int[np.ndarray, "chains"]
    optimum: Int[np.ndarray, "chains"]


@dataclass(frozen=True)
class Sample:
    """Draws from a posterior, and their diagnosis.

    Attributes:
        posterior: the sampled posterior.
        fit: its optima are the starts of the ensembles, and number the basins.
        settings: of the sampler.
        theta: (n, ensembles, walkers, P) all kept draws.
        log_density: (n, ensembles, walkers) log posterior.
        thin: steps from one draw to the next.
        basin: (ensembles,) optimum of each ensemble; the better one of two without a barrier between.
        started: (ensembles,) optimum about which each ensemble started.
        acceptance: (ensembles,) share of accepted moves.
        diagnosis: of the chains, basin by basin.
        marginalised: integrated nuisances, each with the move of an unknown's mean [its sd] by its nonlinearity at
            draws of the posterior.
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
        """Number of points for which the posterior is compiled."""
        return batch_size(*self.theta.shape[1:3])

    @property
    def basins(self) -> tuple[int, ...]:
        """The sampled optima."""
        return tuple(dict.fromkeys(self.basin))

    @property
    def burn_in(self) -> int:
        """Number of draws of each walker to discard."""
        return max(d.burn_in for d in self.diagnosis) // self.thin

    def draws(self, basin: int = 0) -> Float[np.ndarray, "n P"]:
        """Return the draws of theta about one optimum, without burn-in."""
        chosen = self.theta[self.burn_in :, np.array(self.basin) == basin]
        return chosen.reshape(-1, chosen.shape[-1])

    def by_chain(self) -> DrawsByChain:
        """Return the draws chain by chain, without burn-in."""
        theta, log_density = self.theta[self.burn_in :], self.log_density[self.burn_in :]
        steps, ensembles, walkers, count = theta.shape
        flat = np.moveaxis(theta, 3, 0).reshape(count, steps, -1)
        values = np.asarray(self.posterior.parameters.values(jnp.asarray(flat))).swapaxes(1, 2)
        ensemble = np.repeat(np.arange(ensembles), walkers)
        return DrawsByChain(values, log_density.reshape(steps, -1).T, ensemble, np.array(self.basin)[ensemble])


def sample(
    fit: Fit,
    posterior: Posterior,
    settings: Settings = DEFAULT,
    *,
    folder: Path | None = None,
    provenance: Mapping[str, str] | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Sample:
    """Sample a posterior until its effective sample size is reached; continue where an earlier run was stopped.

    Each relevant optimum of the fit has its own ensembles, as an ensemble does not cross between separated optima.
    Discrepancy factors are integrated out, and drawn given the rest. So are nuisances with a linear effect; their
    derivatives are checked at draws of the posterior, and with a nonlinear one the chains restart. A chain depends on
    model, data, priors, optima, walkers and seed alone: interrupted and resumed it is the same to the bit, and a higher
    target only makes it longer.

    Args:
        fit: of the posterior's problem; the ensembles start about its optima.
        posterior: the density to sample.
        settings: of the sampler.
        folder: for checkpoints; None for none.
        provenance: further conditions, by name, that must be equal to continue from a checkpoint.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: invalid settings, a parameter determined by neither data nor prior, data and prior that exclude each
            other, or checkpoints of another run.
        ModelError: the model has no solution near an optimum.
    """
    _check_bounded(fit, posterior)
    # with noise known only up to a factor, the costs are too
    reach = math.inf if posterior.noise.items else fit.best.score + RIVAL
    optima = [i for i, optimum in enumerate(fit.optima) if optimum.score < reach]
    started = [optimum for optimum in optima for _ in range(settings.ensembles)]
    names = () if posterior.noise.items or len(optima) > 1 else linear_nuisances(fit, settings.seed)
    while True:
        target = linear_marginal(posterior, fit.best, names) if names else Marginal(posterior)
        chosen = replace(settings, walkers=_walker_count(fit, target, settings))
        # inputs of a chain; the other settings only decide when it ends
        depends = {
            **({"set of nuisances integrated out": ", ".join(names)} if names else {}),
            "number of optima": len(optima),
            "number of ensembles": chosen.ensembles,
            "number of walkers": chosen.walkers,
            "bound on draws": chosen.most_draws,
            "seed": chosen.seed,
        }
        known = identity(posterior, depends)
        chains = Chains(Store(folder, {**(provenance or {}), **known}), chosen.most_draws)
        with ThreadPoolExecutor(chosen.threads) as pool:
            about = [fit.optima[optimum] for optimum in started]
            ensembles = Ensembles(target, about, chosen.walkers or 0, chosen.seed, pool)
            check_at = chains.last.check_at if chains.last else FIRST_CHECK
            for block in progress(range(chosen.max_steps // BLOCK)):
                steps = (block + 1) * BLOCK
                if steps < chains.steps:
                    continue
                if steps > chains.steps:
                    walkers = chains.last.walkers if chains.last else ensembles.begin()
                    chains.add(*ensembles.advance(walkers, block), check_at)
                if steps >= check_at:
                    each = _diagnose(chains, _joined(chains, started))
                    missing = max(diagnosis.more_steps(chosen.target_ess) for diagnosis in each)
                    if not missing:
                        break
                    check_at = steps + min(missing, steps // 2)
        drawn = _sample(fit, posterior, chosen, chains, started)
        if not names:
            return drawn
        draws = drawn.draws()
        few = draws[np.linspace(0, len(draws) - 1, TRIED).astype(int)]  # evenly spread over all
        shift = moved(fit.problem, fit.best, names, few)
        if not (shift > MOVED).any():
            return replace(drawn, marginalised=dict(zip(names, shift.tolist(), strict=True)))
        names = tuple(name for name, far in zip(names, shift, strict=True) if far <= MOVED)
        folder = folder and folder / ANEW


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
    """Merge optima whose ensembles sample the same distribution: there is no barrier between them."""
    basins, joined = list(dict.fromkeys(started)), list(started)
    for i, later in enumerate(basins):
        for earlier in basins[:i]:
            both = [earlier if b == later else b for b in joined]
            if later in joined and earlier in joined and _diagnose(chains, both, only=earlier)[0].rhat.max() < JOINED:
                joined = both
    return joined


def _diagnose(chains: Chains, basins: Sequence[int], only: int | None = None) -> tuple[Diagnosis, ...]:
    theta, basin = chains.whole().theta, np.array(basins)
    which = dict.fromkeys(basins) if only is None else [only]
    return tuple(diagnose(theta[:, basin == b], chains.thin) for b in which)


def _walker_count(fit: Fit, target: Marginal | LinearMarginal, settings: Settings) -> int:
    """Return the number of walkers; refuse invalid settings."""
    count = len(target.parameters.items)
    curved = any(direction.weak or direction.open for direction in fit.information.directions)
    walkers = settings.walkers or (8 if curved else 4) * count
    if walkers < 2 * count or walkers % SPLITS:
        expected, remedy = f"an even number, at least {2 * count} for {count} unknowns", "correct `walkers`"
        raise refusal("", f"{walkers} walkers", expected, remedy)
    expected, remedy = f"at least {LEAST_ENSEMBLES}: R-hat compares them", "correct `ensembles`"
    require(settings.ensembles >= LEAST_ENSEMBLES, "", f"{settings.ensembles} ensembles", expected, remedy)
    require(settings.max_steps >= BLOCK, "", f"{settings.max_steps} steps", f"at least {BLOCK}", "correct `max_steps`")
    return walkers


def _check_bounded(fit: Fit, posterior: Posterior) -> None:
    """Refuse data and prior that do not determine a parameter, or that exclude each other."""
    scaled = fit.problem.scaled(np.asarray(fit.jacobian))
    open_ones = np.isinf(information(scaled, fit.problem.parameters.normal_sd, fit.information.names).sd)
    names = ", ".join(np.array(fit.information.names)[open_ones])
    remedy = "give each a prior (`prior`), or fix it (`fix`)"
    require(not open_ones.any(), "", f"neither data nor a prior that bound {names}", "one of them", remedy)
    remedy = "measure what depends on them (see `ident check`), or fix fewer"
    require(fit.information.rank, "", "no measurement that depends on any of the unknowns", "at least one", remedy)
    beyond = np.abs(np.asarray(fit.problem.parameters.prior_residuals(jnp.asarray(fit.best.theta))[0]))
    if beyond.max() > EXCLUDED and not posterior.noise.items:
        worst = int(np.argmax(beyond))
        name, value = fit.information.names[worst], fit.best.values[worst]
        got = f"a prior of {name} that excludes the data: they pull it to {value:.4g}, {beyond[worst]:.1f} sd beyond"
        raise refusal("", got, "a prior that they may agree with", "widen it, or check units (`prior`)")
