"""What a fit predicts of data that it has not seen: groups of values, left out in turn, by the others."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ident.inference.descent import ended
from ident.inference.fit import Fit
from ident.inference.information import information
from ident.inference.least_squares import look, solve
from ident.inference.problem import InverseProblem


@dataclass(frozen=True)
class HeldOut:
    """A group of values, predicted by a fit to all others.

    Attributes:
        name: of the group.
        places: (n,) of its values among all.
        measured: (n,) [SI]
        predicted: (n,) [SI]
        covariance: (n, n) [SI^2] of measured less predicted: noise of the group, and what the others leave open; NaN
            where they leave the prediction open.
        ended: whether the fit to the others has ended in an optimum.
    """

    name: str
    places: Int[np.ndarray, "n"]
    measured: Float[np.ndarray, "n"]
    predicted: Float[np.ndarray, "n"]
    covariance: Float[np.ndarray, "n n"]
    ended: bool

    @property
    def off(self) -> Float[np.ndarray, "n"]:
        """Measured less predicted [SI]."""
        return self.measured - self.predicted

    @property
    def sd(self) -> Float[np.ndarray, "n"]:
        """Standard deviation [SI] of what is measured about what is predicted."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> bool:
        """Whether the others tell what to expect."""
        return self.ended and bool(np.isfinite(self.covariance).all())

    @property
    def p_value(self) -> float:
        """Chance of values so far from the prediction, all of the group together; NaN where nothing is predicted."""
        from scipy.special import chdtrc

        if not self.told:
            return np.nan
        return float(chdtrc(len(self.off), self.off @ np.linalg.solve(self.covariance, self.off)))


def held_out(
    fit: Fit, groups: Mapping[str, Sequence[int]], progress: Callable[[Iterable[int]], Iterable[int]] = iter
) -> tuple[HeldOut, ...]:
    """Leave out each group of values, fit the others again, and predict the group.

    What a value belongs to, such as which mode a label means, is taken from the fit to all: it is not what is tested.

    Args:
        fit: a fit to all.
        groups: places of the values by the group's name.
        progress: wraps the numbers of the groups, to show a bar.
    """
    named = list(groups.items())
    return tuple(_held_out(fit, named[k][0], np.asarray(named[k][1], int)) for k in progress(range(len(named))))


def _held_out(fit: Fit, name: str, places: Int[np.ndarray, "n"]) -> HeldOut:
    sigma = np.asarray(fit.problem.sigma).copy()
    noise = sigma[places]
    sigma[_with_groups(fit.problem, places)] = np.inf
    problem = fit.problem.with_sigma(sigma)
    starts = [fit.best.theta, *(rival.theta for rival in fit.rivals)]
    ends = [ended(problem, solve(problem, theta, fit.end)) for theta in starts]
    end, how = min(ends, key=lambda each: (not np.isfinite(each[0].cost), not each[1].converged, each[0].score))
    held = fit.choice.held
    there = look(problem, end.theta, held.likened() if held is not None else None)
    kept, slope = np.isfinite(sigma), np.asarray(there.jacobian)
    unknown = problem.parameters
    known = information(problem.scaled(slope)[kept], unknown.normal_sd, unknown.names)
    with np.errstate(invalid="ignore"):
        open_part = slope[places] @ known.covariance @ slope[places].T
    measured = np.asarray(problem.measured)[places]
    covariance = open_part + np.outer(noise, noise) * fit.problem.correlations(places)
    return HeldOut(name, places, measured, np.asarray(there.predicted)[places], covariance, how.converged)


def _with_groups(problem: InverseProblem, places: Int[np.ndarray, "n"]) -> Int[np.ndarray, "m"]:
    """Return places and all others whose errors are correlated with theirs, which would tell of them."""
    if problem.correlation is None:
        return places
    groups = problem.correlation.groups
    return np.union1d(places, np.flatnonzero(np.isin(groups, groups[places]) & (groups >= 0)))
