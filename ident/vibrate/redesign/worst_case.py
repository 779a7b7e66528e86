"""A search whose result holds for the worst phases: it sees some sets of phases, and those that break its result next.

The largest amplitude over all phases is a maximum over a set without end. So the search keeps the amplitude low with
some sets of phases (cuts), at first those with which the arm as it is vibrates most. At what it finds the worst phases
follow from the superposition. Where they give more than the cuts let expect, they become a cut too, and the search goes
on from there: each is a search of its usual kind, with one simulation more for each cut.

References:
    Mutapcic and Boyd, "Cutting-set methods for robust convex optimization with pessimizing oracles", Optimization
    Methods and Software 24(3), 2009, 2.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from ident.vibrate.redesign.objective import Point
from ident.vibrate.redesign.search import Search

ROUNDS = 4
"""Further searches, with one cut more each, at most."""
CLOSE = 0.01
"""Share by which the worst phases may give more than the cuts."""
MISSED = 1e-3
"""Share by which a limit may be missed."""

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
        if largest <= search.objective.largest(u) * (1 + CLOSE):
            return search, u, True
        if left:
            search = further
            u = solve(search, u)
    return search, u, False


def minimum_change(search: Search, start: Point, limit: float) -> Settled:
    """Return the least change that keeps a limit with any phases; none where it is missed, which is not settled then.

    What its worst phases give more than the cuts the limit is tightened by, and the search goes on from there.
    """
    u, aim = search.minimum_change(start, limit), limit
    for _ in range(ROUNDS):
        if u is None or (largest := worst(search, u)[1]) <= limit * (1 + MISSED):
            return search, u, True
        aim *= limit / largest
        tighter = search.minimum_change(u, aim)
        if tighter is None:
            return search, None, False
        u = tighter
    kept = u is None or worst(search, u)[1] <= limit * (1 + MISSED)
    return search, u if kept else None, kept


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
