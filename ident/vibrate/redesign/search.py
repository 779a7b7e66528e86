"""The search for a change: minimum amplitude, minimum change, minimum probability of exceedance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.stats import qmc

from ident.vibrate.redesign.constraints import (
    SLACK,
    Constraint,
    Requirements,
    are_met,
    below,
    below_bound,
    constraints,
    widened,
)
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.objective import Objective, Point

APART = 0.25
"""Least distance of two starts, in units of the bounds."""
FEW = 3
"""Places from which one that keeps the requirements is searched for."""
CLOSE = 1e-7
"""Relative change of the amplitude at which an optimum counts as reached."""


@dataclass(frozen=True)
class Effort:
    """How much is computed.

    Attributes:
        screened: places at which the amplitude is computed before some are chosen as starts; a power of two.
        iterations: from a start, at most.
        iterations_with_draws: at most: each costs as many simulations as there are draws.
    """

    screened: int = 64
    iterations: int = 60
    iterations_with_draws: int = 12


@dataclass(frozen=True)
class Search:
    """The search for a change of an evaluator's variables, in coordinates u, see `Objective`.

    Attributes:
        evaluator: with the variables.
        required: what must be met.
        effort: how much is computed.
        cuts: sets of phases with which the amplitude is kept low, see `Objective`.
    """

    evaluator: Evaluator
    required: Requirements
    effort: Effort = Effort()
    cuts: tuple[Mapping[str, float], ...] = ()

    @cached_property
    def objective(self) -> Objective:
        """The functions of u."""
        return Objective.of(self.evaluator, self.cuts)

    def minimum_amplitude(self, start: Point, change_norm: float = np.inf) -> Point | None:
        """Return the place of the least largest amplitude; None where the search ends at none that is allowed.

        The largest of the parts is the least bound t above all of them: t is one more unknown.
        """
        rows, slope = self._constraints(change_norm), np.append(np.zeros_like(start), 1.0)
        x = np.append(start, self.objective.largest(start) / self.objective.present)
        widest = [below_bound(self.objective), *map(widened, rows)]
        u = self._minimize(lambda x: (x[-1], slope), x, widest, self.effort.iterations)[:-1]
        return u if are_met(rows, u) else None

    def minimum_change(self, start: Point, limit: float) -> Point | None:
        """Return the place of the least change norm that meets the limit; None where none is reached."""
        rows = self._constraints()
        within = [below(self.objective, limit), *rows]
        u = self._minimize(self.objective.squared_norm, start, within, self.effort.iterations)
        return u if are_met(rows, u) and self.objective.largest(u) < limit * (1 + 1e-3) else None

    def missed(self, u: Point) -> float:
        """Return by which share of itself a requirement is missed at most, but for `SLACK`; below zero for none."""
        return max((-float(np.min(row.value(u))) - SLACK for row in self._constraints()), default=-np.inf)

    def minimum_exceedance(self, start: Point, limit: float) -> Point:
        """Return the place of the least probability of exceeding the limit, from one of little amplitude on."""
        rows = self._constraints()
        u = self._minimize(lambda u: self.objective.log_odds(u, limit), start, rows, self.effort.iterations_with_draws)
        candidates = [start, u] if are_met(rows, u) else [start]
        return min(candidates, key=lambda u: self.objective.log_odds(u, limit)[0])

    def can_be_met(self, seed: int) -> bool:
        """Tell whether some place keeps the requirements, without a simulation: what is in vain is told at once.

        Of places all over the bounds, and from those that miss least by a search for the nearest that misses nothing.
        """
        rows, places = self._constraints(), np.vstack([0 * self.objective.scale, self.spread(seed)])
        if not rows:
            return True
        missed = self._missed(places)

        def nearest(start: Point) -> Point:
            return self._minimize(
                lambda u: (float(((u - start) ** 2).sum()), 2 * (u - start)), start, rows, self.effort.iterations
            )

        return bool((missed <= 0).any()) or any(are_met(rows, nearest(places[k])) for k in np.argsort(missed)[:FEW])

    def _missed(self, places: Float[np.ndarray, "places V"]) -> Float[np.ndarray, "places"]:
        """Return by which share of itself a requirement is missed at most; infinite where the arm collapses."""
        ends, required = self.evaluator.end_states(places * self.objective.scale), self.required
        frequency = 1 - np.asarray(ends.frequency) / required.frequency if required.frequency > 0 else 0 * places[:, 0]
        missed = np.maximum(frequency, np.asarray(ends.deflection) / required.deflection - 1)
        return np.where(np.isfinite(missed), missed, np.inf)

    def starts(self, count: int, seed: int) -> list[Point]:
        """Return the arm as it is, and those of some places that are apart and have the least amplitude."""
        scale = self.objective.scale
        chosen = [np.zeros(len(scale))]
        if count > 1:
            places = self.spread(seed)
            amplitude = self._seen.amplitudes(places * scale)[:, :, 0].max(0)
            for u in places[np.argsort(amplitude)]:
                if len(chosen) < count and all(np.abs(u - other).max() > APART for other in chosen[1:]):
                    chosen.append(u)
        return chosen

    @property
    def _seen(self) -> Evaluator:
        """The arm itself with the first set of phases that is seen, which costs less than all phases do."""
        own = self.objective.evaluator.alone
        return replace(own, arm=own.arm.replace(self.cuts[0]), unknown=()) if self.cuts else own

    def spread(self, seed: int) -> Float[np.ndarray, "places V"]:
        """Return places all over the bounds, no further than the largest change norm allows."""
        o = self.objective
        u = o.low + qmc.Sobol(len(o.scale), seed=seed).random(self.effort.screened) * (o.high - o.low)
        norm = np.sqrt((o.weight * u**2).sum(1))
        return u * np.minimum(1.0, self.required.change_norm / np.maximum(norm, 1e-12))[:, None]

    def _constraints(self, change_norm: float = np.inf) -> list[Constraint]:
        return constraints(self.objective, self.required, change_norm)

    def _minimize(
        self,
        function: Callable[[np.ndarray], tuple[float, np.ndarray]],
        start: np.ndarray,
        rows: Sequence[Constraint],
        iterations: int,
    ) -> np.ndarray:
        """Minimise within the bounds of u; a further unknown is bounded by zero from below."""
        more = len(start) - len(self.objective.scale)
        low = np.pad(self.objective.low, (0, more))
        high = np.pad(self.objective.high, (0, more), constant_values=np.inf)
        answer = minimize(
            function,
            np.clip(start, low, high),
            jac=True,
            method="SLSQP",
            bounds=list(zip(low, high, strict=True)),
            constraints=[{"type": "ineq", "fun": row.value, "jac": row.slope} for row in rows],
            options={"maxiter": iterations, "ftol": CLOSE},
        )
        return np.clip(answer.x, low, high)
