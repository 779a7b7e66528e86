"""How a redesign is searched: objective, constraints, and the phases with which the arm vibrates most.

The largest amplitude over all phases is a maximum over a set without end. So the search keeps the amplitude low with
some sets of phases (cuts), at first those with which the arm as it is vibrates most. At what it finds the worst phases
follow from the superposition. Where they give more than the cuts let expect, they become a cut too, and the search goes
on from there: each is a search of its usual kind, with one simulation more for each cut.

References:
    Mutapcic and Boyd, "Cutting-set methods for robust convex optimization with pessimizing oracles", Optimization
    Methods and Software 24(3), 2009, 2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import brentq, minimize
from scipy.special import log_ndtr, logsumexp
from scipy.stats import qmc

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.programs import AnyArray, jit
from ident.vibrate.evaluator import (
    Evaluator,
    Variable,
    apply,
    ends,
    worst_state,
)

# -------- Objective
# What a design minimises and keeps within limits: functions of scaled changes, with exact slopes.

BLUR = 0.05
"""Width in ln(amplitude) over which a draw passes from below the limit to above it, so that there is a slope;
assumed."""
CACHED = 64
"""Results that are remembered: an optimiser asks for the same several times."""

Point = Float[np.ndarray, "V"]


@dataclass(frozen=True)
class Objective:
    """Functions of u: changes in units of the widest that is allowed.

    Attributes:
        evaluator: with a step that suits all of the bounds.
        scale: (V,) the widest change of each variable.
        low: (V,) lower bounds of u.
        high: (V,) upper bounds of u.
        cuts: sets of phases, each by path: the amplitude is the largest with any; without, with those of the arm.
    """

    evaluator: Evaluator
    scale: Point
    low: Point
    high: Point
    cuts: tuple[Mapping[str, float], ...] = ()

    @classmethod
    def of(cls, evaluator: Evaluator, cuts: tuple[Mapping[str, float], ...] = ()) -> "Objective":
        """Scale an evaluator's variables."""
        low, high = evaluator.bounds
        scale = np.maximum(np.abs(low), np.abs(high))
        evaluator = evaluator if evaluator.step else replace(evaluator, step=evaluator.step_for(evaluator.bounds))
        return cls(evaluator, scale, low / scale, high / scale, cuts)

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
        """Return the parts of which that is the largest [m], and their slopes."""
        return self._remembered(Objective._parts, u.tobytes())

    def end_state(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        """Return first frequency [Hz] and deflection [m], and their slopes."""
        return self._remembered(Objective._end_state, u.tobytes())

    def log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        """Return the blurred log-odds that a draw exceeds the limit, and their slopes."""
        return self._remembered(Objective._log_odds, u.tobytes(), limit)

    @cached_property
    def _remembered(self) -> Callable[..., Any]:
        """Computes something at a place, or remembers it; searches side by side may share it."""
        return lru_cache(CACHED)(lambda compute, u, *more: compute(self, np.frombuffer(u), *more))

    def _parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        values, slopes = self.evaluator.slopes(u * self.scale, self.cuts or ({},))
        worst = values.argmax(2)[..., None]  # of each window: more rows than windows would slow the optimiser down
        values, slopes = np.take_along_axis(values, worst, 2), np.take_along_axis(slopes, worst[None], 3)
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
"""By how much a requirement may be missed, of its size."""


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
    rows = []
    if np.isfinite(most := min(change_norm, required.change_norm)):
        rows.append(
            Constraint(
                lambda u: 1 - objective.squared_norm(u)[0] / most**2, lambda u: -objective.squared_norm(u)[1] / most**2
            )
        )
    if (f := required.frequency) > 0:
        rows.append(
            Constraint(lambda u: objective.end_state(u)[0][0] / f - 1, lambda u: objective.end_state(u)[1][0] / f)
        )
    if np.isfinite(d := required.deflection):
        rows.append(
            Constraint(lambda u: 1 - objective.end_state(u)[0][1] / d, lambda u: -objective.end_state(u)[1][1] / d)
        )
    return rows


def below(objective: Objective, limit: float) -> Constraint:
    """Return the constraint that no amplitude of the arm itself exceeds a limit [m]."""
    return Constraint(lambda u: 1 - objective.parts(u)[0] / limit, lambda u: -objective.parts(u)[1] / limit)


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
"""Places from which one that keeps the requirements is searched for."""
CLOSE = 1e-7
"""Relative change of the amplitude at which an optimum counts as reached."""
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
        cuts: sets of phases with which the amplitude is kept low, see `Objective`.
    """

    evaluator: Evaluator
    required: Requirements
    screened: int = 64
    iterations: int = 60
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
        u = self._minimize(lambda x: (x[-1], slope), x, widest)[:-1]
        return u if are_met(rows, u) else None

    def minimum_change(self, start: Point, limit: float) -> Point | None:
        """Return the place of the least change norm that meets the limit; None where none is reached."""
        rows = self._constraints()
        within = [below(self.objective, limit), *rows]
        u = self._minimize(self.objective.squared_norm, start, within)
        return u if are_met(rows, u) and self.objective.largest(u) < limit * (1 + 1e-3) else None

    def missed(self, u: Point) -> float:
        """Return by which share of itself a requirement is missed at most, but for `SLACK`; below zero for none."""
        return max((-float(np.min(row.value(u))) - SLACK for row in self._constraints()), default=-np.inf)

    def minimum_exceedance(self, start: Point, limit: float) -> Point:
        """Return the place of the least probability of exceeding the limit, from one of little amplitude on."""
        rows = self._constraints()
        u = self._minimize(lambda u: self.objective.log_odds(u, limit), start, rows, ITERATIONS_WITH_DRAWS)
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
            return self._minimize(lambda u: (float(((u - start) ** 2).sum()), 2 * (u - start)), start, rows)

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
        u = o.low + qmc.Sobol(len(o.scale), seed=seed).random(self.screened) * (o.high - o.low)
        norm = np.sqrt((o.weight * u**2).sum(1))
        return u * np.minimum(1.0, self.required.change_norm / np.maximum(norm, 1e-12))[:, None]

    def _constraints(self, change_norm: float = np.inf) -> list[Constraint]:
        return constraints(self.objective, self.required, change_norm)

    def _minimize(
        self,
        function: Callable[[np.ndarray], tuple[float, np.ndarray]],
        start: np.ndarray,
        rows: Sequence[Constraint],
        iterations: int | None = None,
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
            options={"maxiter": iterations or self.iterations, "ftol": CLOSE},
        )
        return np.clip(answer.x, low, high)


# -------- Worst case
# Cuts: sets of phases that a search sees, until the worst phases of what it finds give no more.

ROUNDS = 4
"""Further searches, with one cut more each, at most."""
PHASES_CLOSE = 0.01
"""Share by which the worst phases may give more than the cuts; assumed."""
LONGER = 12
"""Further searches for the least change: one that stops too early says that it is no answer; assumed."""
GAP = 3e-3
"""Share by which a change that keeps the limit with any phases may be larger than one that need not; assumed."""
MARGIN = 1e-3
"""Share by which the least change keeps a limit better than asked for: the fast method differs less, mostly."""

Oracle = Callable[[Search, Point], tuple[Search, float]]
"""Returns a search that sees the worst phases of a place as well, and the amplitude with them [m]."""
Settled = tuple[Search, Point | None, bool]
"""A search with its cuts, what it has found, and whether the worst phases give no more than the cuts."""


def settled(
    search: Search,
    solve: Callable[[Search, Point], Point | None],
    u: Point | None,
    oracle: Oracle | None = None,
) -> Settled:
    """Go on from what a search has found, with its worst phases as a cut, until they make no difference.

    Args:
        search: with the cuts to begin with.
        solve: a problem, from a start on.
        u: what the search has found; None for nothing.
        oracle: knows what phases are worst; `worst` when None.
    """
    oracle = oracle or worst
    for left in reversed(range(ROUNDS + 1)):
        if u is None:
            return search, None, True
        further, largest = oracle(search, u)
        if largest <= search.objective.largest(u) * (1 + PHASES_CLOSE):
            return search, u, True
        if left:
            search = further
            u = solve(search, u)
    return search, u, False


def minimum_change(search: Search, starts: Sequence[Point], limit: float) -> Settled:
    """Return the least change that keeps a limit with any phases; none where the first start does not keep it.

    The worst phases of what a search finds become a cut, and it goes on. A search that sees some phases only finds too
    little change, if any; moved toward the first start until all phases keep the limit, it is one that does. The search
    is settled where the two are the same size but for `GAP`.

    Args:
        search: with the cuts to begin with.
        starts: of least amplitude; the first one of all.
        limit: [m], kept by `MARGIN` more than asked for: it shall hold by the exact equations, and as it is printed.
    """
    wanted, still = limit * (1 - MARGIN), np.zeros_like(starts[0])
    if worst_amplitude(search, still) <= limit:
        return search, still, True
    if worst_amplitude(search, starts[0]) > wanted:
        return search, None, True
    size, best, closed = search.objective.change_norm, starts[0], list[bool]()
    for start in starts:
        at, aim = start, wanted
        for left in reversed(range(LONGER + 1)):
            u = search.minimum_change(at, aim)
            if u is None and at is not start:  # a new cut forbids that place, and SLSQP may lose its way from there
                u = search.minimum_change(start, aim)
            if u is None:
                break
            at = u
            best = min(best, _moved(search, u, starts[0], wanted), key=size)
            is_closed = size(best) <= size(u) * (1 + GAP) and (aim > wanted * (1 - PHASES_CLOSE) or not search.cuts)
            if is_closed or not left:
                closed.append(is_closed)
                break
            search, _ = worst(search, u)
            # The worst phases give a little more than a simulation with them, of second order; an RMS is a mean of all.
            aim = wanted * min(1.0, search.objective.largest(u) / worst_amplitude(search, u))
    return search, best, bool(closed) and all(closed)


def _moved(search: Search, u: Point, least: Point, limit: float) -> Point:
    """Return the place nearest to u on the way to that of least amplitude at which all phases keep a limit."""

    def missed(share: float) -> float:
        there = u + share * (least - u)
        return max(worst_amplitude(search, there) / limit - 1, search.missed(there))

    if missed(0.0) <= 0:
        return u
    share = float(brentq(missed, 0.0, 1.0, xtol=1e-4))
    while missed(share) > 0:  # the root is one to within its tolerance
        share = min(share + 2e-4, 1.0)
    return np.asarray(u + share * (least - u))


def worst_amplitude(search: Search, u: Point) -> float:
    """Return the largest amplitude of the arm itself with any phases [m]."""
    evaluator = search.objective.evaluator.alone
    return float(evaluator.amplitudes((u * search.objective.scale)[None]).max())


def worst(search: Search, u: Point) -> tuple[Search, float]:
    """Return a search that sees the worst phases of a place as well, and the amplitude with them [m]."""
    evaluator = search.objective.evaluator
    if not evaluator.unknown or evaluator.measure == "rms":
        return search, 0.0
    first = int(evaluator.amplitude.first)
    whole = evaluator.superposition(u * search.objective.scale)
    phases = whole.worst_phases(first)
    return with_cut(search, phases), float(whole.envelope[:, first:].max())


def with_cut(search: Search, numbers: Mapping[str, float]) -> Search:
    """Return a search that sees one more set of phases, by path [rad]."""
    return replace(search, cuts=(*search.cuts, numbers))
