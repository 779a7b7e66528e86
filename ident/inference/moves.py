"""Moves of walkers beyond emcee's own: in reciprocals, by a normal approximation, for ensembles side by side."""

from collections.abc import Sequence

import numpy as np
from emcee.moves.red_blue import RedBlueMove
from jaxtyping import Bool, Float

Proposal = tuple[np.ndarray, np.ndarray]
"""Proposed points (n, Q), and the logarithms of the factors (n,) that keep the moves reversible."""


class Apart(RedBlueMove):
    """Moves ensembles that know nothing of each other, side by side in one of emcee's: one batch evaluates all.

    Walker w of ensemble e is number e W + w, and the halves of an ensemble, which are moved in turn, are its walkers of
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
        """Propose new places for one half of each ensemble, given its other half."""
        moving, waiting = (np.split(half, len(self.moves)) for half in (s, np.concatenate(c)))
        parts = [m.get_proposal(own, [w], random) for m, own, w in zip(self.moves, moving, waiting, strict=True)]
        points, factors = (np.concatenate(part) for part in zip(*parts, strict=True))
        return points, factors


class InReciprocals(RedBlueMove):
    """Another move in the reciprocals of positive unknowns.

    Deflections and the squares of periods are nearly linear in the compliances: a posterior that is a thin curved
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
        """Propose in the reciprocals; a proposal that is not positive is one to be refused."""
        q, factors = self.move.get_proposal(self._reciprocals(s), [self._reciprocals(half) for half in c], random)
        refused = (self.positive & (q <= 0)).any(1)
        theta = np.where(self.positive, -np.log(np.where(self.positive & (q > 0), q, 1.0)), q)
        theta[refused] = s[refused]
        rise = np.where(self.positive, theta - s, 0.0).sum(1)  # the density of exp(-theta) is that of theta by it
        return theta, np.where(refused, -np.inf, factors + rise)

    def _reciprocals(self, theta: np.ndarray) -> np.ndarray:
        return np.where(self.positive, np.exp(-np.where(self.positive, theta, 0.0)), theta)


class Independent(RedBlueMove):
    """Draws from the normal approximation about an optimum, in the reciprocals of positive unknowns.

    Where data tell all unknowns well, most of its proposals are accepted, and draws are nearly independent.

    References:
        Tierney, "Markov chains for exploring posterior distributions", Annals of Statistics 22(4), 1994, section 2.3.3.
    """

    def __init__(
        self,
        centre: Float[np.ndarray, "Q"],
        covariance: Float[np.ndarray, "Q Q"],
        positive: Bool[np.ndarray, "Q"],
    ):
        """Take optimum and covariance in theta, and which unknowns are logarithms of positive numbers."""
        super().__init__()
        sign = np.where(positive, -1.0, 1.0)
        self.centre, self.positive = centre, positive
        self.root = np.linalg.cholesky(covariance * np.outer(sign, sign))

    def get_proposal(self, s: np.ndarray, c: Sequence[np.ndarray], random: np.random.RandomState) -> Proposal:
        """Propose points that depend on no walker; one outside the positive numbers is one to be refused."""
        points, log_density = self.draw(random.standard_normal(s.shape))
        refused = ~np.isfinite(log_density)
        points[refused] = s[refused]
        return points, np.where(refused, -np.inf, self.log_density(s) - log_density)

    def draw(self, normal: Float[np.ndarray, "n Q"]) -> tuple[Float[np.ndarray, "n Q"], Float[np.ndarray, "n"]]:
        """Turn standard normal numbers into points; return also their log density, -inf for one that is none."""
        off = normal @ self.root.T
        outside = (self.positive & (off <= -1)).any(1)
        points = self.centre + np.where(self.positive, -np.log1p(np.where(self.positive & (off > -1), off, 0.0)), off)
        return points, np.where(outside, -np.inf, self.log_density(points))

    def log_density(self, theta: Float[np.ndarray, "n Q"]) -> Float[np.ndarray, "n"]:
        """Return the logarithm of the density in theta, up to a constant."""
        step = theta - self.centre
        off = np.where(self.positive, np.expm1(-np.where(self.positive, step, 0.0)), step)
        return -(np.linalg.solve(self.root, off.T) ** 2).sum(0) / 2 - np.where(self.positive, step, 0.0).sum(1)
