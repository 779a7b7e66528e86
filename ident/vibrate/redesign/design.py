"""Which change makes an arm quiet: least amplitude or probability of too much, within bounds, at a cost of change."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.errors import InputError, ModelError, Problem
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.search import Requirements, Search
from ident.vibrate.redesign.variable import Extents, check
from ident.vibrate.response.exact import Progress

STARTS = 3
"""Starts, the arm as it is among them."""
SAME = 1e-4
"""Difference of amplitudes, as a share, that is none."""
SHARES = (0.125, 0.25, 0.5, 0.75)
"""Amounts of change on the trade-off curve, of that of the best design."""


@dataclass(frozen=True)
class Place:
    """An arm after changes.

    Attributes:
        changes: (V,) ln(factor) or difference of each variable, see `Variable`.
        values: the changed numbers by path [SI]
        amplitude: (3,) [m]
        amount: () [-] how much is changed: the root of the sum of weight times the square of the change against the
            widest that is allowed; 1 for a single variable of weight 1 at its farther bound.
        frequency: () [Hz] first natural frequency, the lower of both ends of the motion.
        deflection: () [m] static deflection of the end point, the larger of both ends.
        exceeding: () [-] share of the trial's draws above the limit in any direction; NaN without draws or limit.
    """

    changes: Float[np.ndarray, "V"]
    values: dict[str, float]
    amplitude: Float[np.ndarray, "3"]
    amount: float
    frequency: float
    deflection: float
    exceeding: float = np.nan

    @property
    def largest(self) -> float:
        """Largest amplitude of the three directions [m]."""
        return float(self.amplitude.max())


@dataclass(frozen=True)
class Design:
    """A redesign.

    Attributes:
        trial: what was changed and simulated.
        required: what had to be kept.
        limit: () [m] wanted amplitude; None for the least.
        present: the arm as it is.
        best: least amplitude; with draws and a limit, least probability of exceeding it.
        optima: what each start has led to, the quietest first.
        curve: least amplitude at several amounts of change, ascending, each place quieter than the one before; the
            present and the quietest are its ends.
        cheapest: least amount of change that keeps the limit; None without limit, or where it can't be kept.
    """

    trial: Evaluator
    required: Requirements
    limit: float | None
    present: Place
    best: Place
    optima: tuple[Place, ...]
    curve: tuple[Place, ...]
    cheapest: Place | None


def design(
    trial: Evaluator,
    *,
    limit: float | None = None,
    required: Requirements | None = None,
    extents: Extents | None = None,
    starts: int = STARTS,
    curve: bool = True,
    seed: int = 0,
    progress: Progress = iter,
) -> Design:
    """Find the change of a trial's variables that makes the arm quietest.

    The largest amplitude of all directions is minimised as a minimax problem over the maxima of short windows of time,
    by sequential quadratic programming with exact slopes, from the arm as it is and from the best of a scrambled Sobol
    sequence. With draws and a limit, the probability of exceeding it is minimised from there on: its log-odds, each
    draw counted by a normal distribution function about the limit.

    Args:
        trial: with the variables, within whose bounds the design stays.
        limit: () [m] amplitude that should not be exceeded.
        required: what must be kept.
        extents: of the bodies, within which mass centres stay.
        starts: number of starts, the arm as it is among them.
        curve: whether the trade-off between amplitude and amount of change is wanted.
        seed: of the places at which it looks before it starts.
        progress: shows how far it is, over the problems that are solved.

    Raises:
        InputError: no variables, bounds that can't be, a limit or requirement that is not above zero.
        ModelError: no design within the bounds meets the requirements, or the arm collapses.

    References:
        Kraft, "A software package for sequential quadratic programming", DFVLR-FB 88-28, 1988 (SLSQP, by SciPy).
    """
    required = required or Requirements()
    _check(trial, limit, required, extents)
    search = Search.of(trial, required)
    begins = search.begin_at(starts, seed)
    ends = [search.quietest(begins[k]) for k in progress(range(len(begins)))]
    found = sorted((end for end in ends if end is not None), key=search.largest)
    if not found:
        raise ModelError(_why_not(search, seed))
    quietest = found[0]
    best = search.likeliest(quietest, limit) if trial.draws and limit else quietest
    cheapest = search.cheapest(quietest, limit) if limit else None
    amount = np.sqrt(search.square(quietest))
    between = [search.quietest(share * quietest, share * amount) for share in SHARES if curve and amount > 0]
    present, optima = _place(search, 0 * best, limit), tuple(_place(search, u, limit) for u in found)
    middle = [_place(search, u, limit) for u in between if u is not None]
    least_change = None if cheapest is None else _place(search, cheapest, limit)
    return Design(
        trial,
        required,
        limit,
        present,
        _place(search, best, limit),
        optima,
        _efficient(
            present, [*middle, *optima[1:], *([] if least_change is None else [least_change])], optima[0], curve
        ),
        least_change,
    )


def _efficient(present: Place, found: Sequence[Place], quietest: Place, curve: bool) -> tuple[Place, ...]:
    """Return the places that are quieter than all of less change: a search may end at a louder one."""
    kept = [present]
    for place in sorted(found, key=lambda place: place.amount) if curve else ():
        louder_than_end = place.largest > quietest.largest * (1 + SAME) and place.amount < quietest.amount
        if place.largest < kept[-1].largest * (1 - SAME) and louder_than_end:
            kept.append(place)
    return (*kept, quietest)


def _place(search: Search, u: Float[np.ndarray, "V"], limit: float | None) -> Place:
    """Simulate a design, and its draws."""
    trial, changes = search.trial, u * search.scale
    amplitude = trial.amplitudes(changes[None])[:, 0]
    (frequency, deflection), _ = search.stands(u)
    exceeding = np.nan
    if trial.draws and limit is not None:
        exceeding = float((amplitude[:, 1:] > limit).any(0).mean())
    amount = float(np.sqrt(search.square(u)))
    return Place(
        changes, trial.values(changes), amplitude[:, 0], amount, float(frequency), float(deflection), exceeding
    )


def _why_not(search: Search, seed: int) -> str:
    standing = search.trial.end_states(search.spread(seed) * search.scale)
    return (
        "no design within the bounds meets the requirements: of those tried, the first frequency reaches "
        f"{np.nanmax(standing.frequency):.4g} Hz and the deflection {1e3 * np.nanmin(standing.deflection):.4g} mm; "
        "widen the bounds or ask for less"
    )


def _check(trial: Evaluator, limit: float | None, required: Requirements, extents: Extents | None) -> None:
    """Refuse what can't be asked."""
    if not trial.variables:
        raise InputError(Problem("", "nothing to change", "at least one variable", "name one", "variables"))
    for variable in trial.variables:
        check(trial.arm, variable, extents)
    paths = [path for variable in trial.variables for path in variable.paths]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice:
        raise InputError(Problem("", f"{twice} twice", "each number once", "drop one", "variables"))
    asked = {"limit": limit, "deflection": required.deflection, "amount": required.amount}
    for name, value in asked.items():
        if value is not None and not value > 0:
            raise InputError(Problem("", f"{value:g}", "a number above 0", "correct it", name))
    if not 0 <= required.frequency < np.inf:
        raise InputError(Problem("", f"{required.frequency:g} Hz", "0 or a frequency", "correct it", "frequency"))
