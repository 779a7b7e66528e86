"""The search for a change: amplitudes, what must be kept and their exact slopes, and the problems made of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp
from scipy.stats import qmc

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.jit import jit
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.end_states import end_states
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.variable import Variable, apply

APART = 0.25
"""Least distance of two starts, in units of the bounds."""

FEW = 12
"""Iterations with all draws, at most: each costs as many simulations as there are draws."""
CLOSE = 1e-7
"""Relative change of the amplitude at which an optimum counts as found."""
BLUR = 0.05
"""Width in ln(amplitude) over which a draw passes from below the limit to above it, so that there is a slope."""
SLACK = 1e-6
"""By how much a requirement may be missed, of its size."""
KEPT = 16
"""Results that are kept: an optimiser asks for the same several times."""

Point = Float[np.ndarray, "V"]


@dataclass(frozen=True)
class Requirements:
    """What a design must keep.

    Attributes:
        frequency: () [Hz] that the first natural frequency must reach at both ends of the motion; 0 for none.
        deflection: () [m] that the static deflection must not exceed at either end; infinite for none.
        amount: () [-] largest amount of change, see `design.Place`; infinite for none.
    """

    frequency: float = 0.0
    deflection: float = np.inf
    amount: float = np.inf


class Row(NamedTuple):
    """A function of u that must not be negative, (J,), and its slopes (J, V)."""

    value: Callable[[Point], Any]
    slope: Callable[[Point], np.ndarray]


def _widened(row: Row) -> Row:
    """Return the row with one more unknown that does not matter to it."""
    return Row(lambda x: row.value(x[:-1]), lambda x: np.append(row.slope(x[:-1]), 0.0))


@dataclass(frozen=True)
class Search:
    """A design in coordinates u: changes in units of the widest that is allowed.

    Attributes:
        trial: with a step that suits all of the bounds.
        required: what must be kept.
        scale: (V,) the widest change of each variable.
        low: (V,) lower bounds of u.
        high: (V,) upper bounds of u.
        screened: places at which the amplitude is computed before some are chosen as starts; a power of two.
        iterations: from a start, at most.
    """

    trial: Evaluator
    required: Requirements
    scale: Point
    low: Point
    high: Point
    screened: int = 64
    iterations: int = 60

    @classmethod
    def of(cls, trial: Evaluator, required: Requirements) -> "Search":
        """Scale a trial's variables."""
        low, high = trial.bounds
        scale = np.maximum(np.abs(low), np.abs(high))
        trial = trial if trial.step else replace(trial, step=trial.step_for(trial.bounds))
        return cls(trial, required, scale, low / scale, high / scale)

    @cached_property
    def weight(self) -> Point:
        """How dear each variable is."""
        return np.array([variable.weight for variable in self.trial.variables])

    @cached_property
    def present(self) -> float:
        """Largest amplitude as it is [m]."""
        return self.largest(np.zeros(len(self.scale)))

    def square(self, u: Point) -> float:
        """Return the square of the amount of change."""
        return float((self.weight * u**2).sum())

    def largest(self, u: Point) -> float:
        """Return the largest amplitude of the arm itself [m]."""
        return float(self.parts(u)[0].max())

    def parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        """Return the parts of which that is the largest [m], and their slopes."""

        def parts() -> tuple[np.ndarray, np.ndarray]:
            values, slopes = self.trial.alone.slopes(u * self.scale)
            return values.ravel(), slopes.reshape((len(u), -1)).T * self.scale

        return self._once("parts", u, parts)

    def stands(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        """Return first frequency [Hz] and deflection [m], and their slopes."""

        def stands() -> tuple[np.ndarray, np.ndarray]:
            t = self.trial
            pair = _standing_slopes(t.arm, t.variables, t.motion, t.loads, jnp.asarray(u * self.scale))
            return np.asarray(pair[0]), np.asarray(pair[1]) * self.scale

        return self._once("stands", u, stands)

    def log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        """Return the blurred log-odds that a draw exceeds the limit, and their slopes."""

        def odds() -> tuple[float, np.ndarray]:
            values, slopes = self.trial.slopes(u * self.scale, slice(1, None))
            draws = values.shape[2]
            parts, slopes = values.reshape((-1, draws)), slopes.reshape((len(u), -1, draws))
            worst = parts.argmax(0), np.arange(draws)
            z = np.log(parts[worst] / limit) / BLUR
            dz = slopes[:, *worst] / parts[worst] / BLUR * self.scale[:, None]
            above, below = logsumexp(log_ndtr(z)), logsumexp(log_ndtr(-z))
            density = -(z**2) / 2 - np.log(2 * np.pi) / 2
            return float(above - below), (dz * (np.exp(density - above) + np.exp(density - below))).sum(1)

        return self._once(f"odds {limit}", u, odds)

    def quietest(self, begin: Point, amount: float = np.inf) -> Point | None:
        """Return the place of the least largest amplitude; None where the search ends at none that is allowed.

        The largest of the parts is the least bound t above all of them: t is one more unknown.
        """
        unit, last = self.present, np.append(np.zeros_like(begin), 1.0)
        below = Row(
            lambda x: x[-1] - self.parts(x[:-1])[0] / unit,
            lambda x: np.pad(-self.parts(x[:-1])[1] / unit, ((0, 0), (0, 1)), constant_values=1.0),
        )
        kept = [_widened(row) for row in self._kept(amount)]
        x = self._minimize(
            lambda x: (x[-1], last),
            np.append(begin, self.largest(begin) / unit),
            [below, *kept],
            np.inf,
            self.iterations,
        )
        return self._allowed(x[:-1], amount)

    def cheapest(self, begin: Point, limit: float) -> Point | None:
        """Return the place of the least amount of change that keeps the limit; None where none is found."""
        keeps = Row(lambda u: 1 - self.parts(u)[0] / limit, lambda u: -self.parts(u)[1] / limit)
        u = self._minimize(
            lambda u: (self.square(u), 2 * self.weight * u), begin, [keeps, *self._kept()], np.inf, self.iterations
        )
        found = self._allowed(u)
        return found if found is not None and self.largest(found) < limit * (1 + 1e-3) else None

    def likeliest(self, begin: Point, limit: float) -> Point:
        """Return the place of the least probability of exceeding the limit, from a quiet one on."""
        found = self._allowed(self._minimize(lambda u: self.log_odds(u, limit), begin, self._kept(), np.inf, FEW))
        candidates = [begin] if found is None else [begin, found]
        return min(candidates, key=lambda u: self.log_odds(u, limit)[0])

    def begin_at(self, count: int, seed: int) -> list[Point]:
        """Return the arm as it is, and the quietest of some places that are apart."""
        chosen = [np.zeros(len(self.scale))]
        if count > 1:
            places = self.spread(seed)
            amplitude = self.trial.alone.amplitudes(places * self.scale)[:, :, 0].max(0)
            for u in places[np.argsort(amplitude)]:
                if len(chosen) < count and all(np.abs(u - other).max() > APART for other in chosen[1:]):
                    chosen.append(u)
        return chosen

    def spread(self, seed: int) -> Float[np.ndarray, "places V"]:
        """Return places all over the bounds, no further than the amount of change allows."""
        u = self.low + qmc.Sobol(len(self.scale), seed=seed).random(self.screened) * (self.high - self.low)
        size = np.sqrt((self.weight * u**2).sum(1))
        return u * np.minimum(1.0, self.required.amount / np.maximum(size, 1e-12))[:, None]

    def _kept(self, amount: float = np.inf) -> list[Row]:
        """Return the requirements, and a largest amount of change."""
        wanted, rows = self.required, []
        if np.isfinite(most := min(amount, wanted.amount)):
            rows.append(
                Row(lambda u: 1 - self.square(u) / most**2, lambda u: -2 * self.weight * u / most**2),
            )
        if (f := wanted.frequency) > 0:
            rows.append(Row(lambda u: self.stands(u)[0][0] / f - 1, lambda u: self.stands(u)[1][0] / f))
        if np.isfinite(d := wanted.deflection):
            rows.append(Row(lambda u: 1 - self.stands(u)[0][1] / d, lambda u: -self.stands(u)[1][1] / d))
        return rows

    def _minimize(
        self,
        function: Callable[[np.ndarray], tuple[float, np.ndarray]],
        start: np.ndarray,
        rows: Sequence[Row],
        beyond: float,
        iterations: int,
    ) -> np.ndarray:
        """Minimise within the bounds of u; a further unknown is bounded by zero and `beyond`."""
        more = len(start) - len(self.scale)
        low, high = np.pad(self.low, (0, more)), np.pad(self.high, (0, more), constant_values=beyond)
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

    def _allowed(self, u: Point, amount: float = np.inf) -> Point | None:
        """Return a place if it meets the requirements."""
        return u if all(np.min(row.value(u)) >= -SLACK for row in self._kept(amount)) else None

    def _once(self, what: str, u: Point, compute: Callable[[], Any]) -> Any:
        key = what, u.tobytes()
        if key not in self._results:
            if len(self._results) >= KEPT:
                del self._results[next(iter(self._results))]
            self._results[key] = compute()
        return self._results[key]

    @cached_property
    def _results(self) -> dict[tuple[str, bytes], Any]:
        return {}


@jit
def _standing_slopes(
    arm: Arm, variables: tuple[Variable, ...], motion: Motion, loads: Loads | None, changes: Float[Array, "V"]
) -> tuple[Float[Array, "2"], Float[Array, "2 V"]]:
    """Return first frequency and deflection after changes, and their slopes."""

    def stands(changes: Array) -> Array:
        return jnp.stack(end_states(arm.replace(apply(arm.numbers(), variables, list(changes))), motion, loads))

    return stands(changes), jax.jacfwd(stands)(changes)
