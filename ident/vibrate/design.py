"""Redesign: minimum amplitude, minimum change, minimum probability of exceedance, within bounds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.errors import ModelError, refusal
from ident.programs import Progress
from ident.vibrate.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.design_search import Requirements, Search, minimum_change
from ident.vibrate.evaluator import Draws, Evaluator, exact_response, side_by_side
from ident.vibrate.variable import Extents, check

STARTS = 3
"""Starts, the arm as it is among them."""
SAME = 1e-4
"""Relative difference of amplitudes treated as equal; assumed."""
ALIKE = 0.01
"""Difference of amplitudes, as a share, up to which optima are one before the worst phases are searched for;
assumed."""
SHARES = (0.125, 0.25, 0.5, 0.75)
"""Change norms on the trade-off curve, of that of the minimum amplitude."""


@dataclass(frozen=True)
class Place:
    """An arm after changes.

    Attributes:
        changes: (V,) ln(factor) or difference of each variable, see `Variable`.
        values: the changed numbers by path [SI]
        amplitude: (3,) [m]
        change_norm: () [-] how much is changed: the root of the sum of weight times the square of the change against
            the widest that is allowed; 1 for a single variable of weight 1 at its farther bound.
        frequency: () [Hz] first natural frequency, the lower of both ends of the motion.
        deflection: () [m] static deflection of the end point, the larger of both ends.
        exceedance: () [-] share of the draws above the limit in any direction; NaN without draws or limit.
    """

    changes: Float[np.ndarray, "V"]
    values: dict[str, float]
    amplitude: Float[np.ndarray, "3"]
    change_norm: float
    frequency: float
    deflection: float
    exceedance: float = np.nan

    @property
    def largest(self) -> float:
        """Largest amplitude of the three directions [m]."""
        return float(self.amplitude.max())


@dataclass(frozen=True)
class Design:
    """A redesign.

    Attributes:
        evaluator: the arm, its variables and the measure.
        required: the requirements.
        limit: () [m] required amplitude; None for the least.
        present: the present arm.
        best: the proposal: with a limit the least change that keeps it, if possible; with limit and draws the least
            probability of exceeding it; otherwise the least amplitude.
        optima: the optimum from each start, the least amplitude first.
        curve: amplitude at several change norms, ascending, each less than the one before; the present and the least
            amplitude are its ends. Between them it is least with the phases that are worst at present.
        minimum_change: least change norm that keeps the limit; None without limit, where it can't be kept, and with
            draws, as it would hold for the arm itself only.
    """

    evaluator: Evaluator
    required: Requirements
    limit: float | None
    present: Place
    best: Place
    optima: tuple[Place, ...]
    curve: tuple[Place, ...]
    minimum_change: Place | None


def design(
    evaluator: Evaluator,
    *,
    limit: float | None = None,
    required: Requirements | None = None,
    extents: Extents | None = None,
    starts: int = STARTS,
    curve: bool = True,
    seed: int = 0,
    progress: Progress = iter,
) -> Design:
    """Find the change of an evaluator's variables that minimises the amplitude.

    The largest amplitude of all directions is minimised as a minimax problem over the maxima of short windows of time,
    by sequential quadratic programming with exact slopes, from the arm as it is and from the best of a scrambled Sobol
    sequence. With draws and a limit, the probability of exceeding it is minimised from there on: its log-odds, each
    draw counted by a normal distribution function about the limit.

    Where phases are not known, amplitudes are the largest over them, see `worst_case`.

    Args:
        evaluator: with the variables, within whose bounds the design stays.
        limit: () [m] amplitude that should not be exceeded.
        required: what must be met.
        extents: of the bodies, within which mass centres stay.
        starts: number of starts, the arm as it is among them.
        curve: whether the trade-off between amplitude and change norm is wanted.
        seed: of the places at which it looks before it starts.
        progress: shows how far it is, over the problems that are solved.

    Raises:
        InputError: no variables, bounds that can't be, a limit or requirement that is not above zero.
        ModelError: no design within the bounds meets the requirements, or the arm collapses.

    References:
        Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28, 1988 (SLSQP, by SciPy).
    """
    required = required or Requirements()
    _check(evaluator, limit, required, extents)
    search = Search(evaluator, required)
    if not search.can_be_met(seed):
        raise ModelError(_why_not(search, seed))

    def begun() -> tuple[Search, list[np.ndarray]]:
        first = search.with_phases()
        return first, first.starts(starts, seed)

    jobs: list[Callable[[], Any]] = [begun, lambda: search.objective.present]  # its programs take a second to load
    (first, points), _ = side_by_side(jobs)
    ends = side_by_side([partial(first.minimum_amplitude, u) for u in points], progress)
    optima = [(_place(search, u, limit), u) for u in ends if u is not None]
    if not optima:
        raise ModelError(_why_not(search, seed))
    optima.sort(key=lambda pair: pair[0].largest)
    places, least = [place for place, _ in optima], optima[0][1]
    if first is not search and (u := search.minimum_amplitude(least)) is not None:
        better = _place(search, u, limit)
        if better.largest <= places[0].largest:
            like, least = places[0].largest * (1 + ALIKE), u
            places = [better if place.largest < like else place for place in places]
    likely = search.minimum_exceedance(least, limit) if evaluator.draws and limit else None
    norm = places[0].change_norm if curve else 0.0
    further = [partial(first.minimum_amplitude, share * least, share * norm) for share in SHARES if norm > 0]
    between = side_by_side(further)
    present = _place(search, 0 * least, limit)
    middle = [_place(search, u, limit) for u in between if u is not None]
    best = places[0] if likely is None else _place(search, likely, limit)
    shown = _efficient(present, [*middle, *places[1:]] if curve else [], places[0])
    found = Design(evaluator, required, limit, present, best, tuple(places), shown, None)
    return found if limit is None or evaluator.draws else with_minimum_change(found, limit)


def with_minimum_change(found: Design, aim: float) -> Design:
    """Return a design that proposes the least change with an amplitude of an aim [m] at most, if there is one.

    Args:
        found: its optima and its curve are where the search starts.
        aim: the limit, or less where it shall hold by more than the fast method.
    """
    search = Search(found.evaluator, found.required)
    quiet = [place for place in found.curve if place.largest <= aim and place is not found.optima[0]]
    nearest = sorted(quiet, key=lambda place: place.change_norm)[:1]
    starts = [place.changes / search.objective.scale for place in (found.optima[0], *nearest)]
    least = minimum_change(search, starts, aim)
    if least is None:
        return found
    place = _place(search, least, found.limit)
    curve = found.curve
    if len(curve) > 2:
        curve = _efficient(found.present, [*curve[1:-1], *found.optima[1:], place], found.optima[0])
    return replace(found, best=place, minimum_change=place, curve=curve)


def _efficient(present: Place, places: Sequence[Place], least: Place) -> tuple[Place, ...]:
    """Return the places of less amplitude than all of less change: a search may end at another."""
    curve = [present]
    for place in sorted(places, key=lambda place: place.change_norm):
        within = place.largest > least.largest * (1 + SAME) and place.change_norm < least.change_norm
        if within and place.largest < curve[-1].largest * (1 - SAME):
            curve.append(place)
    return (*curve, least)


def _place(search: Search, u: Float[np.ndarray, "V"], limit: float | None) -> Place:
    """Simulate a design, and its draws."""
    evaluator, changes = search.objective.evaluator, u * search.objective.scale
    amplitude = evaluator.amplitudes(changes[None])[:, 0]
    frequency, deflection = (float(part[0]) for part in evaluator.end_states(changes[None]))
    exceedance = np.nan
    if evaluator.draws and limit is not None:
        exceedance = float((amplitude[:, 1:] > limit).any(0).mean())
    norm = search.objective.change_norm(u)
    return Place(changes, evaluator.values(changes), amplitude[:, 0], norm, frequency, deflection, exceedance)


def _why_not(search: Search, seed: int) -> str:
    ends = search.evaluator.end_states(search.spread(seed) * search.objective.scale)
    return (
        "no design within the bounds meets the requirements: of those tried, the first frequency reaches "
        f"{np.nanmax(ends.frequency):.4g} Hz and the deflection {1e3 * np.nanmin(ends.deflection):.4g} mm; "
        "widen the bounds or ask for less"
    )


def _check(evaluator: Evaluator, limit: float | None, required: Requirements, extents: Extents | None) -> None:
    """Refuse questions without an answer."""
    if not evaluator.variables:
        raise refusal("", "nothing to change", "at least one variable", "name one", "variables")
    for variable in evaluator.variables:
        check(evaluator.arm, variable, extents)
    paths = [path for variable in evaluator.variables for path in variable.paths]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice:
        raise refusal("", f"{twice} twice", "each number once", "drop one", "variables")
    positive = {"limit": limit, "deflection": required.deflection, "amount": required.change_norm}
    for name, value in positive.items():
        if value is not None and not value > 0:
            raise refusal("", f"{value:g}", "a number above 0", "correct it", name)
    if not 0 <= required.frequency < np.inf:
        raise refusal("", f"{required.frequency:g} Hz", "0 or a frequency", "correct it", "frequency")


# -------- Verify
# A design is verified: by the exact equations, and with draws that had no part in its search.


@dataclass(frozen=True)
class Check:
    """An arm by the exact equations, and with fresh draws.

    Attributes:
        time: (T,) [s]
        vibration: (3, T) [m]
        amplitude: (3,) [m] by the evaluator's measure.
        difference: (3,) [-] of the fast method's amplitude from it, as a share of the largest direction's.
            Where phases are not known, both are with those at which the largest direction's is worst.
        exceedance: of fresh draws, by the fast method; None without draws or limit.
    """

    time: Float[np.ndarray, "T"]
    vibration: Float[np.ndarray, "3 T"]
    amplitude: Float[np.ndarray, "3"]
    difference: Float[np.ndarray, "3"]
    exceedance: BinomialEstimate | None = None


@dataclass(frozen=True)
class Verification:
    """The arm as it is, and after a change."""

    before: Check
    after: Check


def verify(
    evaluator: Evaluator,
    place: Place,
    limit: float | None = None,
    fresh: Draws | None = None,
    progress: Progress = iter,
) -> Verification:
    """Verify a design by the exact method, and with fresh draws by the fast one; the arm as it is as well.

    Where phases are not known, each by the exact method has those with which its vibration is largest.

    Args:
        evaluator: of the design.
        place: the design.
        limit: () [m]
        fresh: draws of the same numbers as the evaluator's that had no part in the search.
        progress: shows how far it is, over batches of draws.

    Raises:
        ModelError: the arm collapses, of a draw perhaps, or the tolerance can't be met.
    """
    changes = np.stack([0 * place.changes, place.changes])
    evaluator = evaluator if evaluator.step else replace(evaluator, step=evaluator.step_for(changes))
    checks = side_by_side([partial(_exact, evaluator.alone, change) for change in changes])
    if fresh and limit is not None:
        above = replace(evaluator, draws=fresh).amplitudes(changes, progress)[:, :, 1:].max(0) > limit
        checks = [replace(check, exceedance=binomial_estimate(one)) for check, one in zip(checks, above, strict=True)]
    return Verification(*checks)


def _exact(evaluator: Evaluator, change: Float[np.ndarray, "V"]) -> Check:
    arm = evaluator.changed_arm(change)
    if evaluator.unknown:
        first = 0 if evaluator.measure == "rms" else int(evaluator.amplitude.first)
        arm = arm.replace(evaluator.superposition(change).worst_phases(first))
    fast = replace(evaluator, arm=arm, unknown=()).amplitudes(0 * change[None])[:, 0, 0]
    response = exact_response(replace(evaluator, arm=arm))
    vibration = np.asarray(response.vibration)
    amplitude = evaluator.amplitude(vibration)
    return Check(np.asarray(response.time), vibration, amplitude, (fast - amplitude) / amplitude.max())
