"""With which probability a limit is kept: of as many draws as a verdict needs, and no more."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.stats import binomtest

from ident.assess.task import CONFIDENT
from ident.errors import InputError, Problem
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.response.exact import Progress

FIRST = 19
"""Draws at the first look; with the arm itself they fill the cores evenly. At each further look twice as many."""
UNLIKELY = 0.01
"""Probability of such a count, or one as improbable, if the limit were kept with just the probability asked for."""


def is_settled(keeps: BinomialEstimate) -> bool:
    """Tell whether a count says on which side of the probability asked for the true one is.

    By the exact binomial test at each look. Up to a thousand draws a limit is so found to be kept as often as by all of
    them, to 0.3 % and whatever the true probability; of 450 draws on average where that is 98 %, of 250 where it is 99.

    References:
        Armitage, McPherson, Rowe, "Repeated significance tests on accumulating data", Journal of the Royal Statistical
        Society A 132(2), 1969.
    """
    return bool(binomtest(keeps.count, keeps.draws, CONFIDENT).pvalue < UNLIKELY)


def keeping(
    evaluator: Evaluator, change: Float[np.ndarray, "V"], limit: float, progress: Progress = iter
) -> tuple[Float[np.ndarray, "3"], BinomialEstimate]:
    """Return the amplitude [m] of the arm itself after a change, and with which probability a limit is kept.

    Draws are simulated in their order, some at first and more as long as they don't settle the verdict.

    Args:
        evaluator: with the draws.
        change: of its variables.
        limit: [m]
        progress: shows how far it is, over the looks.

    Raises:
        InputError: there are no draws.
    """
    if evaluator.size == 1:
        remedy = "take a posterior's draws: the arm alone says nothing of a probability"
        raise InputError(Problem("`evaluator`", "no draws", "at least one", remedy))
    parts, keeps = list(looks(evaluator.size - 1)), np.zeros(0, bool)
    for k in progress(range(len(parts))):
        draws = {path: values[parts[k]] for path, values in evaluator.draws.items()}
        amplitudes = replace(evaluator, draws=draws).amplitudes(change[None])[:, 0]
        keeps = np.append(keeps, amplitudes[:, 1:].max(0) <= limit)
        if is_settled(binomial_estimate(keeps)):
            break
    return amplitudes[:, 0], binomial_estimate(keeps)


def looks(count: int) -> Iterator[slice]:
    """Yield which draws come in at each look."""
    begin, end = 0, FIRST
    while begin < count:
        yield slice(begin, min(end, count))
        begin, end = end, 2 * end + 1
