"""Which measurement would tell explanations apart: what each of them predicts, and how surely."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.identify.alternatives import AlteredModel, calibrated
from ident.identify.conditions import bind
from ident.identify.experiments import RESOLUTION, relative_sigma
from ident.identify.inquiry import Finding, Inquiry
from ident.identify.posture_grid import posture_grid
from ident.inference.least_squares import looker
from ident.inference.problem import InverseProblem
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.measure.load import AXES

LEADING = 4
"""Explanations that are to be told apart, at most."""
POSTURES, LOADS = 8, 8
SHOWN = 3
"""Postures and loads that are asked about, and measurements that are named, at most."""
APART = 2.0
"""Distance [sd] of two predictions below which a measurement tells nothing."""
ENOUGH = 4.0
"""Distance [sd] beyond which more is no better."""


@dataclass(frozen=True)
class Told:
    """An explanation that may be asked what it predicts.

    Attributes:
        inquiry: in which it was found.
        finding: where.
    """

    inquiry: Inquiry
    finding: Finding

    @property
    def values(self) -> dict[str, float]:
        """The unknowns and what is otherwise, by path [SI]."""
        parameters = self.inquiry.problem.parameters
        values = parameters.by_path(np.asarray(parameters.values(self.finding.theta)))
        return {path: float(x) for path, x in values.items()}


@dataclass(frozen=True)
class Telling:
    """A measurement, and what each leading explanation predicts of it.

    Attributes:
        measurement: its value is the middle one of the predictions, its sigma what such an instrument has.
        numbers: of the explanations that are told apart.
        predicted: [SI] by each of them; NaN where one has no answer.
        sd: of these, by data and priors.
        apart: [sd] of the two that it tells apart best, sigma included.
        place: of a frequency, its place from the lowest, from 1.
    """

    measurement: Measurement
    numbers: tuple[int, ...]
    predicted: tuple[float, ...]
    sd: tuple[float, ...]
    apart: float
    place: float = 0.0


def telling(arm: Arm, campaign: Campaign, leading: Mapping[int, Told]) -> tuple[Telling, ...]:
    """Return what to measure to tell explanations apart, the most telling first; none where nothing would.

    Candidates are the two lowest frequencies and the deflection of the arm's last point along -z, at postures that may
    be held, under own weight, each payload, and what was hung on it in the campaign.

    Args:
        arm: as its file has it.
        campaign: how well it is measured.
        leading: the explanations by their numbers.
    """
    if len(leading) < 2 or not arm.points:
        return ()
    candidates = _candidates(arm, campaign)
    if not candidates:
        return ()
    found = [_predicted(each, candidates) for each in leading.values()]
    values, sds = (np.array([each[i] for each in found]) for i in (0, 1))
    answered = np.isfinite(values).sum(0) > 1
    candidates = [m for m, told in zip(candidates, answered, strict=True) if told]
    if not candidates:
        return ()
    values, sds = values[:, answered], sds[:, answered]
    middle = np.nanmedian(values, 0)
    sigma = _sigma(campaign, candidates, middle)
    pairs = combinations(range(len(leading)), 2)
    each = [np.abs(values[i] - values[j]) / np.sqrt(sds[i] ** 2 + sds[j] ** 2 + sigma**2) for i, j in pairs]
    chosen = []
    for best, apart in _best(np.nan_to_num(each)):
        m = replace(candidates[best], value=float(middle[best]), sigma=float(sigma[best]))
        predicted, sd = (tuple(map(float, x[:, best])) for x in (values, sds))
        place = candidates[best].value if m.kind == "frequency" else 0.0
        chosen.append(Telling(m, tuple(leading), predicted, sd, apart, place))
    return tuple(chosen)


def _sigma(
    campaign: Campaign, candidates: Sequence[Measurement], values: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Return the standard deviations with which candidates would be measured."""
    shares = relative_sigma(campaign)
    least = np.array([0.0 if m.kind == "frequency" else RESOLUTION for m in candidates])
    return np.hypot(np.array([shares[m.kind] for m in candidates]) * np.abs(values), least)


def _best(apart: Float[np.ndarray, "pairs n"]) -> Iterator[tuple[int, float]]:
    """Yield the places of measurements that tell pairs apart, each of those that are left, and how far at best [sd]."""
    left = np.ones(len(apart), bool)
    for _ in range(SHOWN):
        best = int(np.argmax(np.minimum(apart[left], ENOUGH).sum(0)))
        far = float(apart[left][:, best].max(initial=0.0))
        if far < APART:
            return
        yield best, far
        left &= apart[:, best] < APART


def _candidates(arm: Arm, campaign: Campaign) -> list[Measurement]:
    try:
        grid, _ = posture_grid(arm)
    except InputError:  # no posture may be held: the campaign's own are all that is left
        grid = np.zeros((0, len(arm.driven)))
    spaced = grid[np.unique(np.linspace(0, len(grid) - 1, POSTURES).astype(int))] if len(grid) else grid
    postures = dict.fromkeys([*(m.posture for m in campaign), *(tuple(map(float, row)) for row in spaced)])
    own = dict.fromkeys(m.load for m in campaign if not (m.load.forces or m.load.moments or m.load.own))
    loads = dict.fromkeys([OWN_WEIGHT, *(Load((payload.body.name,)) for payload in arm.payloads), *own])
    return [
        row
        for posture in list(postures)[:POSTURES]
        for load in list(loads)[:LOADS]
        for row in (
            Measurement(kind="frequency", posture=posture, value=1.0, sigma=1.0, load=load),
            Measurement(kind="frequency", posture=posture, value=2.0, sigma=1.0, load=load),
            Measurement(
                kind="deflection",
                posture=posture,
                value=1.0,
                sigma=1.0,
                load=load,
                point=arm.points[-1].name,
                direction=AXES["-z"],
            ),
        )
    ]


def _predicted(told: Told, candidates: Sequence[Measurement]) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return what an explanation predicts, and the standard deviation of that."""
    inquiry, model = told.inquiry, told.inquiry.problem.model
    assert isinstance(model, AlteredModel)
    count = len(candidates)
    problem = InverseProblem(
        replace(model, conditions=bind(model.arm, Campaign(measurements=tuple(candidates))), frames=None),
        np.ones(count),
        np.full(count, np.inf),
        inquiry.problem.parameters,
        tuple(m.kind for m in candidates),
    )
    theta = told.finding.theta
    predicted, jacobian, _ = looker(problem)(theta, None)
    predicted, jacobian = calibrated(inquiry.numbers, theta, problem.kinds, predicted, jacobian)
    variance = np.einsum("ip,pq,iq->i", jacobian, told.finding.covariance, jacobian)
    return predicted, np.sqrt(np.maximum(variance, 0.0))
