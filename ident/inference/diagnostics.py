"""What chains say of themselves: autocorrelation time, effective sample size, R-hat."""

import math
from dataclasses import dataclass

import emcee.autocorr
import numpy as np
from jaxtyping import Float

BURN_IN = 5
"""Autocorrelation times that are left out at the start."""
LONG_ENOUGH = 50
"""Autocorrelation times below which emcee's estimate of that time is not to be trusted."""
ENDLESS = 1e9
"""Steps that no run takes: what is beyond is as good as for ever."""
MIXED = 1.01
"""R-hat above which the ensembles have not found the same distribution (Vehtari et al. 2021)."""


@dataclass(frozen=True)
class Diagnosis:
    """How far the ensembles about one optimum are to be trusted.

    Attributes:
        steps: steps taken.
        burn_in: steps left out at the start.
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
        """Whether the chains are long enough for their autocorrelation time to be known."""
        return bool(self.steps - self.burn_in >= LONG_ENOUGH * self.tau.max())

    def enough(self, target: float) -> bool:
        """Tell whether the target effective sample size is reached by chains that can be trusted."""
        return self.mixed and self.long_enough and bool(self.bulk.min() >= target)

    def more_steps(self, target: float) -> int:
        """Estimate how many steps more are needed."""
        counted = self.steps - self.burn_in
        needed = max(
            LONG_ENOUGH * self.tau.max(), counted * target / self.bulk.min(), 0.0 if self.mixed else 2.0 * counted
        )
        return max(0, math.ceil(min(needed - counted, ENDLESS)))


def diagnose(theta: Float[np.ndarray, "n ensembles walkers P"], apart: int = 1) -> Diagnosis:
    """Diagnose ensembles that should have found the same distribution.

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
    with np.errstate(invalid="ignore"):  # a walker that never moved has no autocorrelation: as long as the chain
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
