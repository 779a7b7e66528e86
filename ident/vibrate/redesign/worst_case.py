"""A search whose result holds for the worst phases: it sees some sets of phases, and those that break its result next.

The largest amplitude over all phases is a maximum over a set without end. So the search keeps the amplitude low with
some sets of phases (cuts), at first those with which the arm as it is vibrates most. At what it finds the worst phases
follow from the superposition. Where they give more than the cuts let expect, they become a cut too, and the search goes
on from there: each is a search of its usual kind, with one simulation more for each cut.

References:
    Mutapcic and Boyd, "Cutting-set methods for robust convex optimization with pessimizing oracles", Optimization
    Methods and Software 24(3), 2009, 2.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from ident.vibrate.redesign.objective import Point
from ident.vibrate.redesign.search import Search

ROUNDS = 4
"""Further searches, with one cut more each, at most."""
PHASES_CLOSE = 0.01
"""Share by which the worst phases may give more than the cuts."""
LONGER = 12
"""Further searches for the least change: one that stops too early says that it is no answer."""
GAP = 3e-3
"""Share by which a change that keeps the limit with any phases may be larger than one that need not."""
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
        u: Point | None = start
        aim = wanted
        for left in reversed(range(LONGER + 1)):
            u = search.minimum_change(start if u is None else u, aim)
            if u is None:
                break
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
