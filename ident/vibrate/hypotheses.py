"""Hypotheses about what makes a vibration: how sets of them are scored, and from which evidence one counts.

`triage.triage` asks what makes the strong parts of traces while nothing is identified yet, `source_causes.compared`
what makes one peak once stiffnesses and sources are. Both explain traces by sets of hypotheses that compete: least
squares leave the share u_k of the energy of trace k, which has n_k independent numbers. A set's score [nat] is

    -1/2 sum over k of n_k ln(u_k + m^2), less a price for each hypothesis,

with m the share of an amplitude to which the model of a hypothesis is right. It needs no level of noise, and what only
mends the model's errors gains little. Data whose sigmas are known are scored by chi-squared: `identify.hypotheses`.

References:
    Schwarz, "Estimating the dimension of a model", Ann. Statist. 6(2), 1978.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Num
from scipy.special import expit

COST = 4.0
"""Price of a hypothesis of a triage: odds of 50; assumed. A cause of a peak pays Schwarz's ln(n) / 2 a column."""


@dataclass(frozen=True)
class Limits:
    """From which evidence on a hypothesis counts.

    Attributes:
        misfit: share m of an amplitude to which the model of a hypothesis is right.
        seen: least share of the energy that it must explain.
        sure: least probability, against its competitors, to count as identified.
    """

    misfit: float
    seen: float
    sure: float


TRACKS = Limits(misfit=0.15, seen=0.05, sure=0.9)
"""Of a triage, whose envelopes about tracks fit any amplitude and phase: each part of a trace counts; assumed."""
PEAK = Limits(misfit=0.05, seen=0.2, sure=0.95)
"""Of the causes of a peak, whose models predict amplitude and phase: the verdict names one of them; assumed."""


def score(left: Float[np.ndarray, "C"], count: Num[np.ndarray, "C"], limits: Limits) -> float:
    """Return the score [nat] of a set before its price.

    Args:
        left: (C,) share of each trace's energy that it leaves.
        count: (C,) independent numbers of each trace.
        limits: give the misfit.
    """
    return float(-(count * np.log(left + limits.misfit**2)).sum() / 2)


def probability(own: Sequence[float], others: Sequence[float]) -> float:
    """Return the probability that one of some sets is right, and none of the others, by their scores [nat]."""
    return float(expit(np.logaddexp.reduce(own) - np.logaddexp.reduce(others)))
