"""Searches from many starts: where data are many, first among a part of them, then among all from where that ended."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.inference.least_squares import End, solve
from ident.inference.problem import InverseProblem

SAME = 1e-3
"""Difference of theta within which two searches among a part have ended in the same optimum."""


class Searcher:
    """Searches as `least_squares.solve` does, in less time where data are many.

    A search among many data costs as much as it takes steps. Most of these are needed to come near to an optimum, which
    a part that is like the whole serves as well (`problem.Parts`); there are a few left among all. Starts that end in
    one optimum of the part end in one of the whole, which is searched once. Where the part has no answer, the search is
    among all from the beginning.

    Args:
        problem: model, data and unknowns.
        search: how to search from one start, with the best end so far, if any.
    """

    def __init__(self, problem: InverseProblem, search: Callable[[InverseProblem, Any, End | None], End] = solve):
        large = problem.in_parts()
        self.problem, self.search = problem, search
        self.part = large.problems[0] if large else None
        self.ends: list[tuple[End, End]] = []

    def __call__(self, start: Float[Any, "P"], example: End | None = None, *, near: bool = False) -> End:
        """Return where a search from a start ends.

        Args:
            start: theta.
            example: the best end so far, if any.
            near: whether the start is near an optimum already: then the search among all begins there.
        """
        if self.part is None:
            return self.search(self.problem, start, example)
        best = min((coarse for coarse, _ in self.ends), key=lambda end: end.score, default=None)
        coarse = self.search(self.part, start, best)
        for known, fine in self.ends:
            if np.abs(known.theta - coarse.theta).max() < SAME:
                return fine
        fine = self.search(self.problem, start if near or not np.isfinite(coarse.cost) else coarse.theta, example)
        self.ends.append((coarse, fine))
        return fine
