"""Search for a redesign: objective, constraints, and the search from several starts.

With unknown phases, the amplitude is the largest over them: at each moment the sum of each phase's largest part, with
slopes like any other amplitude, at the cost of two simulations per phase (`simulate`, "Superposition"). A first search
uses the worst phases of the present arm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
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
from ident.programs import AnyArray, jit
from ident.vibrate.evaluator import Evaluator, ends, worst_state
from ident.vibrate.variable import Variable, apply

# -------- Objective
# Objective and constraints of a design: functions of scaled changes, with exact slopes.

BLUR = 0.05
"""Width in ln(amplitude) over which a draw passes from below the limit to above it, so that there is a slope;
assumed."""
CACHED = 64
"""Cached results: an optimiser evaluates the same point several times."""

Point = Float[np.ndarray, "V"]
Function = Callable[[Point], tuple[float, Point]]


@dataclass(frozen=True)
class Objective:
    """Functions of u: changes in units of the widest that is allowed.

    Attributes:
        evaluator: with a step that suits all of the bounds.
        scale: (V,) the widest change of each variable.
        low: (V,) lower bounds of u.
        high: (V,) upper bounds of u.
    """

    evaluator: Evaluator
    scale: Point
    low: Point
    high: Point

    @classmethod
    def of(cls, evaluator: Evaluator) -> "Objective":
        """Scale an evaluator's variables."""
        low, high = evaluator.bounds
        scale = np.maximum(np.abs(low), np.abs(high))
        evaluator = evaluator if evaluator.step else replace(evaluator, step=evaluator.step_for(evaluator.bounds))
        return cls(evaluator, scale, low / scale, high / scale)

    @cached_property
    def weight(self) -> Point:
        """Cost of changing each variable."""
        return np.array([variable.weight for variable in self.evaluator.variables])

    @cached_property
    def present(self) -> float:
        """Largest amplitude as it is [m]."""
        return self.largest(np.zeros(len(self.scale)))

    def squared_norm(self, u: Point) -> tuple[float, Point]:
        """Return the square of the change norm, and its slopes."""
        return float((self.weight * u**2).sum()), 2 * self.weight * u

    def change_norm(self, u: Point) -> float:
        """Return the change norm [-], see `design.Place`."""
        return float(np.sqrt(self.squared_norm(u)[0]))

    def largest(self, u: Point) -> float:
        """Return the largest amplitude of the arm itself [m]."""
        return float(self.parts(u)[0].max())

    def parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        """Return the parts [m] whose maximum is the largest amplitude, and their slopes."""
        return self._remembered(Objective._parts, u.tobytes())

    def end_state(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        """Return first frequency [Hz] and deflection [m], and their slopes."""
        return self._remembered(Objective._end_state, u.tobytes())

    def log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        """Return the blurred log-odds that a draw exceeds the limit, and their slopes."""
        return self._remembered(Objective._log_odds, u.tobytes(), limit)

    @cached_property
    def _remembered(self) -> Callable[..., Any]:
        """Cached evaluation at a point; parallel searches may share it."""
        return lru_cache(CACHED)(lambda compute, u, *more: compute(self, np.frombuffer(u), *more))

    def _parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        values, slopes = self.evaluator.slopes(u * self.scale)
        return values.ravel(), slopes.reshape((len(u), -1)).T * self.scale

    def _end_state(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        e = self.evaluator
        values, slopes = _end_state_slopes(e.arm, e.variables, ends(e.motion), e.loads, u * self.scale)
        return np.asarray(values), np.asarray(slopes) * self.scale

    def _log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        values, slopes = self.evaluator.slopes_of_draws(u * self.scale)
        draws = values.shape[2]
        parts, slopes = values.reshape((-1, draws)), slopes.reshape((len(u), -1, draws))
        worst = parts.argmax(0), np.arange(draws)
        z = np.log(parts[worst] / limit) / BLUR
        dz = slopes[:, *worst] / parts[worst] / BLUR * self.scale[:, None]
        above, below = logsumexp(log_ndtr(z)), logsumexp(log_ndtr(-z))
        density = -(z**2) / 2 - np.log(2 * np.pi) / 2
        return float(above - below), (dz * (np.exp(density - above) + np.exp(density - below))).sum(1)


@jit
def _end_state_slopes(
    arm: Arm,
    variables: tuple[Variable, ...],
    posture: Float[AnyArray, "driven 2"],
    loads: Loads | None,
    changes: Float[AnyArray, "V"],
) -> tuple[Float[Array, "2"], Float[Array, "2 V"]]:
    """Return first frequency and deflection after changes, and their slopes."""

    def end_state(changes: Array) -> Array:
        return jnp.stack(worst_state(arm.replace(apply(arm.numbers(), variables, list(changes))), posture, loads))

    changes = jnp.asarray(changes)
    return end_state(changes), jax.jacfwd(end_state)(changes)


# -------- Constraints
# What a design must meet: least first frequency, largest deflection, largest change.

SLACK = 1e-6
"""Relative tolerance on a requirement."""


@dataclass(frozen=True)
class Requirements:
    """What a design must meet.

    Attributes:
        frequency: () [Hz] that the first natural frequency must reach at both ends of the motion; 0 for none.
        deflection: () [m] that the static deflection must not exceed at either end; infinite for none.
        change_norm: () [-] largest change norm, see `design.Place`; infinite for none.
    """

    frequency: float = 0.0
    deflection: float = np.inf
    change_norm: float = np.inf


class Constraint(NamedTuple):
    """A function of u that must not be negative, (J,), and its slopes (J, V)."""

    value: Callable[[Point], Any]
    slope: Callable[[Point], np.ndarray]


def constraints(objective: Objective, required: Requirements, change_norm: float = np.inf) -> list[Constraint]:
    """Return the requirements, and a largest change norm, as constraints, each relative to its bound."""
    rows, norm, state = list[Constraint](), objective.squared_norm, objective.end_state
    if np.isfinite(most := min(change_norm, required.change_norm)):
        rows.append(Constraint(lambda u: 1 - norm(u)[0] / most**2, lambda u: -norm(u)[1] / most**2))
    if (f := required.frequency) > 0:
        rows.append(Constraint(lambda u: state(u)[0][0] / f - 1, lambda u: state(u)[1][0] / f))
    if np.isfinite(d := required.deflection):
        rows.append(Constraint(lambda u: 1 - state(u)[0][1] / d, lambda u: -state(u)[1][1] / d))
    return rows


def below_bound(objective: Objective) -> Constraint:
    """Return the constraint that no amplitude exceeds one more unknown, in units of the present amplitude."""
    unit = objective.present
    return Constraint(
        lambda x: x[-1] - objective.parts(x[:-1])[0] / unit,
        lambda x: np.pad(-objective.parts(x[:-1])[1] / unit, ((0, 0), (0, 1)), constant_values=1.0),
    )


def widened(row: Constraint) -> Constraint:
    """Return the constraint with one more unknown that does not matter to it."""
    return Constraint(lambda x: row.value(x[:-1]), lambda x: np.append(row.slope(x[:-1]), 0.0))


def are_met(rows: list[Constraint], u: Point) -> bool:
    """Tell whether all constraints are met."""
    return all(np.min(row.value(u)) >= -SLACK for row in rows)


# -------- Search
# The search for a change: minimum amplitude, minimum change, minimum probability of exceedance.

APART = 0.25
"""Least distance of two starts, in units of the bounds."""
FEW = 3
"""Starts of the search for a point that meets the requirements."""
CLOSE = 1e-7
"""Relative change of the amplitude at which an optimum counts as reached."""
CLOSE_ENOUGH = 1e-5
"""Change of the squared change norm at which the least change counts as reached: agrees with 1e-7 to five digits on
the shipped arm, in two thirds of the simulations."""
ITERATIONS_WITH_DRAWS = 12
"""Iterations at most where each costs as many simulations as there are draws."""


@dataclass(frozen=True)
class Search:
    """The search for a change of an evaluator's variables, in coordinates u, see `Objective`.

    Attributes:
        evaluator: with the variables.
        required: what must be met.
        screened: places at which the amplitude is computed before some are chosen as starts; a power of two.
        iterations: from a start, at most.
    """

    evaluator: Evaluator
    required: Requirements
    screened: int = 64
    iterations: int = 60

    @cached_property
    def objective(self) -> Objective:
        """The functions of u."""
        return Objective.of(self.evaluator)

    def with_phases(self) -> "Search":
        """Return the search with the worst phases of the present arm."""
        own = self.objective.evaluator
        if not own.unknown:
            return self
        phases = own.superposition(0 * self.objective.scale).worst_phases(int(own.amplitude.first))
        return replace(self, evaluator=replace(own, arm=own.arm.replace(phases), unknown=()))

    def minimum_amplitude(self, start: Point, change_norm: float = np.inf) -> Point | None:
        """Return the point that minimises the largest amplitude; None if the search ends at an infeasible point.

        The largest of the parts is the least bound t above all of them: t is one more unknown.
        """
        rows = constraints(self.objective, self.required, change_norm)
        slope = np.append(np.zeros_like(start), 1.0)
        x = np.append(start, self.objective.largest(start) / self.objective.present)
        widest = [below_bound(self.objective), *map(widened, rows)]
        u = self._minimize(lambda x: (x[-1], slope), x, widest)[:-1]
        return u if are_met(rows, u) else None

    def minimum_change(self, start: Point, limit: float) -> Point | None:
        """Return the place of the least change norm that meets the limit; None where none is reached."""
        rows, parts = constraints(self.objective, self.required), self.objective.parts
        within = [Constraint(lambda u: 1 - parts(u)[0] / limit, lambda u: -parts(u)[1] / limit), *rows]
        u = self._minimize(self.objective.squared_norm, start, within, close=CLOSE_ENOUGH)
        return u if are_met(rows, u) and self.objective.largest(u) < limit * (1 + 1e-3) else None

    def minimum_exceedance(self, start: Point, limit: float) -> Point:
        """Return the place of the least probability of exceeding the limit, from one of little amplitude on."""
        rows = constraints(self.objective, self.required)
        u = self._minimize(lambda u: self.objective.log_odds(u, limit), start, rows, ITERATIONS_WITH_DRAWS)
        candidates = [start, u] if are_met(rows, u) else [start]
        return min(candidates, key=lambda u: self.objective.log_odds(u, limit)[0])

    def can_be_met(self, seed: int) -> bool:
        """Whether some point meets the requirements, without a simulation, to stop a futile search early.

        Checks points all over the bounds, then searches for a feasible point from those with the smallest violation.
        """
        rows = constraints(self.objective, self.required)
        places = np.vstack([0 * self.objective.scale, self.spread(seed)])
        if not rows:
            return True
        missed = self._missed(places)

        def nearest(start: Point) -> Point:
            return self._minimize(lambda u: (float(((u - start) ** 2).sum()), 2 * (u - start)), start, rows)

        return bool((missed <= 0).any()) or any(are_met(rows, nearest(places[k])) for k in np.argsort(missed)[:FEW])

    def _missed(self, places: Float[np.ndarray, "places V"]) -> Float[np.ndarray, "places"]:
        """Return the largest relative violation of a requirement; infinite where the arm collapses."""
        ends, required = self.evaluator.end_states(places * self.objective.scale), self.required
        frequency = 1 - np.asarray(ends.frequency) / required.frequency if required.frequency > 0 else 0 * places[:, 0]
        missed = np.maximum(frequency, np.asarray(ends.deflection) / required.deflection - 1)
        return np.where(np.isfinite(missed), missed, np.inf)

    def starts(self, count: int, seed: int) -> list[Point]:
        """Return the present arm, and the quietest of well-separated trial points."""
        scale = self.objective.scale
        chosen = [np.zeros(len(scale))]
        if count > 1:
            places = self.spread(seed)
            amplitude = self.objective.evaluator.alone.amplitudes(places * scale)[:, :, 0].max(0)
            for u in places[np.argsort(amplitude)]:
                if len(chosen) < count and all(np.abs(u - other).max() > APART for other in chosen[1:]):
                    chosen.append(u)
        return chosen

    def spread(self, seed: int) -> Float[np.ndarray, "places V"]:
        """Return places all over the bounds, no further than the largest change norm allows."""
        o = self.objective
        u = o.low + qmc.Sobol(len(o.scale), seed=seed).random(self.screened) * (o.high - o.low)
        norm = np.sqrt((o.weight * u**2).sum(1))
        return u * np.minimum(1.0, self.required.change_norm / np.maximum(norm, 1e-12))[:, None]

    def _minimize(
        self, function: Function, start: Point, rows: Sequence[Constraint], iterations: int = 0, close: float = CLOSE
    ) -> Point:
        """Minimise within the bounds of u; a further unknown is bounded by zero from below."""
        more = len(start) - len(self.objective.scale)
        low = np.pad(self.objective.low, (0, more))
        high = np.pad(self.objective.high, (0, more), constant_values=np.inf)
        held = [{"type": "ineq", "fun": row.value, "jac": row.slope} for row in rows]
        how: Any = {"method": "SLSQP", "options": {"maxiter": iterations or self.iterations, "ftol": close}}
        bounds, start = list(zip(low, high, strict=True)), np.clip(start, low, high)
        answer = minimize(function, start, jac=True, bounds=bounds, constraints=held, **how)
        return np.clip(answer.x, low, high)


# -------- Least change

MARGIN = 1e-3
"""Relative margin of the least change to its limit: the error of the fast method is mostly smaller."""


def minimum_change(search: Search, starts: Sequence[Point], limit: float) -> Point | None:
    """Return the least change that keeps a limit; None where the first start does not keep it.

    Args:
        search: for it.
        starts: of least amplitude; the first one of all.
        limit: [m], tightened by `MARGIN` so that it holds for the exact equations, and as printed.
    """
    objective, wanted, still = search.objective, limit * (1 - MARGIN), np.zeros_like(starts[0])
    if objective.largest(still) <= limit:
        return still
    if objective.largest(starts[0]) > wanted:
        return None
    found = [u for start in starts if (u := search.minimum_change(start, wanted)) is not None]
    return min([*found, starts[0]], key=objective.change_norm)
