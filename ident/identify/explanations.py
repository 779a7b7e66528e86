"""Explanations for data that contradict each other, or the model: a list to act on.

Each input of arm file and campaign that may be wrong is freed by itself, and all unknowns are fitted again. Those that
fit are ranked by probability: remaining cost plus implausibility. If no single one fits, pairs are tried.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, on_soft_base, stiffness_or_stiffest, stiffness_paths
from ident.arm.fields import STIFFNESS
from ident.errors import InputError
from ident.identify.conditions import bind
from ident.identify.fit import CampaignFit
from ident.identify.hypotheses import (
    CHANCE,
    KINDS,
    MARGIN,
    RIDGES,
    RIGID,
    SCALES,
    SLIP,
    SOFT,
    Hypotheses,
    Perturbation,
    Perturbed,
    hypotheses_of,
)
from ident.identify.instruments import RESOLUTION, posture_grid, relative_sigma
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, without_damping
from ident.inference.information import SUSPICIOUS
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.measure.load import AXES
from ident.programs import Progress

# -------- Discriminating measurements
# Measurements that would discriminate between explanations: prediction of each, with its uncertainty.

LEADING = 4
"""Most explanations to discriminate between."""
POSTURES, LOADS = 8, 8
SHOWN = 3
"""Most postures and loads to examine, and measurements to report."""
APART = 2.0
"""Distance [sd] of two predictions below which a measurement does not discriminate."""
ENOUGH = 4.0
"""Distance [sd] beyond which more is no improvement."""


@dataclass(frozen=True)
class Telling:
    """A discriminating measurement, with the prediction of each leading explanation.

    Attributes:
        measurement: its value is the middle one of the predictions, its sigma that of such an instrument.
        numbers: of the explanations to discriminate between.
        predicted: [SI] by each of them; NaN for one without a solution.
        sd: of these, by data and priors.
        apart: [sd] largest distance of two predictions, sigma included.
        place: order number of a frequency, from 1 for the lowest.
    """

    measurement: Measurement
    numbers: tuple[int, ...]
    predicted: tuple[float, ...]
    sd: tuple[float, ...]
    apart: float
    place: float = 0.0


def discriminating_measurements(arm: Arm, campaign: Campaign, leading: Mapping[int, Perturbed]) -> tuple[Telling, ...]:
    """Return the measurements that discriminate between explanations, the best first; none if no measurement does.

    Candidates are the two lowest frequencies and the deflection of the arm's last point along -z, at all holdable
    postures, under own weight, each payload, and the load cases of the campaign.

    Args:
        arm: as in its file.
        campaign: for the sigmas of its instruments.
        leading: the explanations by their numbers.
    """
    if len(leading) < 2 or not arm.points:
        return ()
    candidates = Campaign(measurements=tuple(_candidates(arm, campaign)))
    conditions = bind(arm, candidates)
    values, sds = map(np.array, zip(*(each.predict(candidates, conditions) for each in leading.values()), strict=True))
    answered = np.flatnonzero(np.isfinite(values).sum(0) > 1)
    rows, values, sds = [candidates.measurements[i] for i in answered], values[:, answered], sds[:, answered]
    if not rows:
        return ()
    middle, shares = np.nanmedian(values, 0), relative_sigma(campaign)
    least = np.array([0.0 if m.kind == "frequency" else RESOLUTION for m in rows])
    sigma = np.hypot(np.array([shares[m.kind] for m in rows]) * np.abs(middle), least)
    pairs = combinations(range(len(leading)), 2)
    apart = [np.abs(values[i] - values[j]) / np.sqrt(sds[i] ** 2 + sds[j] ** 2 + sigma**2) for i, j in pairs]
    chosen = []
    for best, farthest in _best(np.nan_to_num(apart)):
        m = replace(rows[best], value=float(middle[best]), sigma=float(sigma[best]))
        predicted, sd = (tuple(map(float, x[:, best])) for x in (values, sds))
        place = rows[best].value if m.kind == "frequency" else 0.0
        chosen.append(Telling(m, tuple(leading), predicted, sd, farthest, place))
    return tuple(chosen)


def _best(apart: Float[np.ndarray, "pairs n"]) -> Iterator[tuple[int, float]]:
    """Yield measurements that separate pairs not yet separated: index, and largest distance of a pair [sd]."""
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
    except InputError:  # no posture can be held: only the campaign's own remain
        grid = np.zeros((0, len(arm.driven)))
    spaced = grid[np.unique(np.linspace(0, len(grid) - 1, POSTURES).astype(int))] if len(grid) else grid
    postures = dict.fromkeys([*(m.posture for m in campaign), *(tuple(map(float, row)) for row in spaced)])
    own = dict.fromkeys(m.load for m in campaign if not (m.load.forces or m.load.moments or m.load.own))
    loads = dict.fromkeys([OWN_WEIGHT, *(Load((payload.body.name,)) for payload in arm.payloads), *own])
    rows = []
    for posture, load in product(list(postures)[:POSTURES], list(loads)[:LOADS]):
        lowest = Measurement(kind="frequency", posture=posture, value=1.0, sigma=1.0, load=load)
        drop = replace(lowest, kind="deflection", unit="", point=arm.points[-1].name, direction=AXES["-z"])
        rows += [lowest, replace(lowest, value=2.0), drop]
    return rows


# -------- Explanations

MOST_STATES = 3
"""Most states (posture and load) of the worst outliers to examine, each by itself."""
SINGLE = 40
"""Most numbers to search one by one; of more, those with the largest gain in the linear model."""
ROWS = 6
"""Number of worst outliers to examine as single wrong values."""
PAIRED, PAIRS = 8, 4
"""Numbers to pair, those of the largest gain; and pairs to search."""
TURNS = 4
"""Most searches of a corrected campaign, each with labels matched at the end of the one before."""


@dataclass(frozen=True)
class Change:
    """One change of arm or campaign that an explanation requires.

    Attributes:
        kind: one of `hypotheses.KINDS`, `soft base` for two of them together, or an entry error: `value` (a wrong one),
            `exchange` (two swapped values), `on` and `off` (of a payload).
        of: the number's body, link, spring or kind of measurement; the payload; the joint.
        rows: indices of the rows of an entry error.
        amount: required size: a factor, a share or, for a value, the correct reading [SI]; NaN for none.
        sd: of ln(factor), or of the share, by data and priors.
        off: [sd] implausibility of the amount.
    """

    kind: str
    of: str = ""
    rows: tuple[int, ...] = ()
    amount: float = math.nan
    sd: float = math.nan
    off: float = SLIP


@dataclass(frozen=True)
class Explanation:
    """Changes made together, and how far they reconcile the data.

    Attributes:
        changes: of arm or campaign.
        cost: remaining sum of squares of data and priors.
        fits: whether no contradiction of the data remains.
        linear: whether it is a linear estimate from the fit, not a fit of its own.
        said: the label cost with them.
    """

    changes: tuple[Change, ...]
    cost: float
    fits: bool
    linear: bool = False
    said: float = 0.0

    @property
    def off(self) -> float:
        """Implausibility [sd]."""
        return math.hypot(*(change.off for change in self.changes))

    @property
    def score(self) -> float:
        """Remaining cost, with changes and labels: minus twice the logarithm of the probability."""
        return self.cost + self.said + self.off**2


@dataclass(frozen=True)
class Explanations:
    """Possible errors of a campaign, or of the arm.

    Attributes:
        cost: sum of squares of data and priors without any change.
        items: those that fit, the most probable first; then the others by remaining cost. All score at least `MARGIN`
            below the data as they are.
        telling: measurements that discriminate between the leading ones.
        said: the label cost without any change.
    """

    cost: float
    items: tuple[Explanation, ...]
    telling: tuple[Telling, ...]
    said: float = 0.0

    @property
    def fitting(self) -> tuple[Explanation, ...]:
        """The explanations that fit the data."""
        return tuple(item for item in self.items if item.fits)


def explain(fit: CampaignFit, unknowns: Unknowns | None = None, *, progress: Progress = iter) -> Explanations | None:
    """Rank the explanations of a campaign whose fit has objections.

    Args:
        fit: of the campaign.
        unknowns: of the fit.
        progress: wraps the numbers of the searches, to show a bar.

    Returns:
        None if the model has no solution, or is scaled by discrepancies, which are explanations already.
    """
    arm, campaign, unknowns = fit.posed.arm, fit.campaign, (unknowns or Unknowns()).with_prior
    unknowns = without_damping(unknowns.named(arm)) if fit.damping else unknowns
    hypotheses = hypotheses_of(fit.posed.with_unknowns(unknowns), fit.parameters, fit.choice.held)
    before = hypotheses.search()[0] if hypotheses is not None else None
    if hypotheses is None or before is None:
        return None
    numbers, rows = _single(hypotheses), [Perturbation(row=i) for i in fit.farthest_off[:ROWS]]
    corrections, single = list(_corrections(fit)), [[each] for each in [*numbers, *rows]]
    bar = iter(progress(range(len(single) + len(corrections))))
    ends = hypotheses.search(single, RIDGES, partial(next, bar))
    tried: list[_Tried] = [
        *((Explanation((Change("exchange", "", each.rows),), each.score, True), None) for each in fit.exchanges),
        *_perturbed(campaign, before.cost, single, ends),
        *filter(None, (_corrected(hypotheses, fit, each, unknowns) for each, _ in zip(corrections, bar, strict=True))),
        *((item, None) for item in _assumed(fit, hypotheses, before)),
    ]
    limit = before.cost + before.label_cost - MARGIN  # a higher score explains nothing
    tried = [each for each in tried if each[0].score < limit]
    if not any(item.fits and item.off < SUSPICIOUS for item, _ in tried):
        # pairs that fit together, of the best numbers in the linear model
        first = sorted(numbers, key=lambda perturbation: -hypotheses.gain([perturbation]))[:PAIRED]
        pairs = [pair for pair in combinations(first, 2) if not set(pair[0].numbers) & set(pair[1].numbers)]
        best = sorted(pairs, key=lambda pair: -hypotheses.gain(pair))[:PAIRS]
        paired = _perturbed(campaign, before.cost, best, hypotheses.search(best, RIDGES[:1]))
        tried += [each for each in paired if each[0].fits and each[0].score < limit]
    tried.sort(key=lambda each: (not each[0].fits, each[0].score if each[0].fits else each[0].cost))
    fitting = enumerate((perturbed for item, perturbed in tried if item.fits), 1)
    leading = {place: perturbed for place, perturbed in fitting if perturbed is not None and place <= LEADING}
    items, telling = tuple(item for item, _ in tried), discriminating_measurements(arm, campaign, leading)
    return Explanations(before.cost, items, telling, before.label_cost)


_Tried = tuple[Explanation, Perturbed | None]
"""An explanation, and its optimum; none without a search."""


def _single(hypotheses: Hypotheses) -> list[Perturbation]:
    """Return the single perturbations: each number, and all springs of a direction together."""
    numbers = hypotheses.effective
    single = [Perturbation((number,)) for number in numbers]
    for direction in ("bending", "torsion"):
        own = tuple(n for n in numbers if n.kind == "spring" and n.of.endswith(direction))
        single += [Perturbation(own)] if len(own) > 1 else []
    if len(single) <= SINGLE:
        return single
    return sorted(single, key=lambda each: -hypotheses.gain([each]))[:SINGLE]


def _perturbed(
    campaign: Campaign, before: float, sets: Sequence[Sequence[Perturbation]], ends: Sequence[Perturbed | None]
) -> Iterator[_Tried]:
    """Yield the explanations by sets of perturbations, except those without gain or with a softening spring."""
    for perturbations, end in zip(sets, ends, strict=True):
        if end is not None and end.cost <= before - 1.0:
            each = zip(perturbations, end.amounts, end.sd, strict=True)
            changes = tuple(_change(*one, campaign) for one in each)
            signed = (change.amount for change in changes if change.kind in KINDS and KINDS[change.kind].positive)
            if not min(signed, default=0.0) < 0:
                yield Explanation(changes, end.cost, end.fits, said=end.label_cost), end


def _change(perturbation: Perturbation, amount: float, sd: float, campaign: Campaign) -> Change:
    if perturbation.row >= 0:
        m = campaign.measurements[perturbation.row]
        off = min(abs(amount), SLIP)
        return Change("value", m.kind, (perturbation.row,), m.value - amount * m.sigma, sd * m.sigma, off)
    number, kind = perturbation.numbers[0], KINDS[perturbation.numbers[0].kind]
    of = number.of if len(perturbation.numbers) == 1 else number.of.split(".")[1]
    rows = tuple(i for i, m in enumerate(campaign) if m.kind == number.of) if number.kind in SCALES else ()
    off = abs(amount) / kind.plausible
    return Change(number.kind, of, rows, math.exp(amount) if kind.factor else amount, sd, off)


def _corrections(fit: CampaignFit) -> Iterator[tuple[Change, Arm, Campaign]]:
    """Yield the campaign corrected for possible entry errors, and the arm on a compliant base.

    Entry errors are payloads on, or off, contrary to the rows: in all rows, in whole kinds of rows, and in the states
    of the worst outliers.
    """
    rows = fit.campaign.measurements
    kinds = {kind: [i for i, m in enumerate(rows) if m.kind == kind] for kind in dict.fromkeys(m.kind for m in rows)}
    states = list(dict.fromkeys((rows[i].posture, rows[i].load) for i in fit.farthest_off))[:MOST_STATES]
    own = [[i for i, m in enumerate(rows) if (m.posture, m.load) == state] for state in states]
    seen = set()
    for payload in (payload.body.name for payload in fit.arm.payloads):
        for among in (range(len(rows)), *kinds.values(), *own):
            for on in (True, False):
                wrong = tuple(i for i in among if (payload in rows[i].load.payloads) != on)
                if wrong and (payload, wrong) not in seen:
                    seen.add((payload, wrong))
                    right = list(rows)
                    for i in wrong:
                        names = {*rows[i].load.payloads} ^ {payload}
                        right[i] = replace(rows[i], load=replace(rows[i].load, payloads=tuple(names)))
                    change = Change("on" if on else "off", payload, wrong)
                    yield change, fit.posed.arm, replace(fit.campaign, measurements=tuple(right))
    granted = fit.assumptions
    if granted is not None and fit.arm.base is None and any(item.kind in SOFT for item in granted.items):
        yield Change("soft base"), on_soft_base(fit.posed.arm, granted.height), fit.campaign


def _corrected(
    hypotheses: Hypotheses, fit: CampaignFit, correction: tuple[Change, Arm, Campaign], unknowns: Unknowns
) -> _Tried | None:
    """Fit a corrected campaign, or an arm on a compliant base; None if that is impossible."""
    change, arm, campaign = correction
    try:
        posed = pose(arm, campaign, unknowns)
    except InputError:  # e.g. a mode that an arm with this payload does not have
        return None
    end: Perturbed | None = None
    for start in (fit.parameters, {}):
        corrected = hypotheses_of(posed, start, altered=False)
        if corrected is not None and (end is None or not end.fits):
            end = min(filter(None, (end, _rematched(corrected))), key=_by_cost, default=None)
    if end is None:
        return None
    if change.kind == "soft base":
        based = arm.replace({path: end.values[path] for path in stiffness_paths(arm) if path in end.values})
        first, base = based.joints[1], based.joints[0]
        share = max(float(stiffness_or_stiffest(based, first, k)) / float(getattr(base, k)) for k in STIFFNESS)
        change = replace(change, off=share / KINDS["base rocks"].plausible)
    else:  # the arm is the same, so that one program predicts further measurements
        end = end.among(hypotheses)
    return Explanation((change,), end.cost, end.fits, said=end.label_cost), end


def _rematched(hypotheses: Hypotheses) -> Perturbed | None:
    """Search repeatedly, each time from the last end with labels matched there."""
    end: Perturbed | None = None
    for _ in range(TURNS):
        (found,) = hypotheses.search()
        if found is None:
            break
        before, end = end, found
        if found.fits or (before is not None and before.cost - found.cost < 1.0):
            return min(filter(None, (before, end)), key=_by_cost)
        hypotheses = hypotheses.at(found.theta)
    return end


def _by_cost(end: Perturbed) -> tuple[bool, float]:
    return not end.fits, end.cost


def _assumed(fit: CampaignFit, hypotheses: Hypotheses, before: Perturbed) -> Iterator[Explanation]:
    """Yield assumptions of the fit that no search frees, estimated by its score test."""
    for item in fit.assumptions.items if fit.assumptions else ():
        test = item.test
        if item.kind in RIGID and test.separable and test.z > 1:
            amount, cost = test.z * test.sd, before.cost - test.z**2
            change = Change(item.kind, item.joint, (), amount, test.sd, amount / KINDS[item.kind].plausible)
            fits = hypotheses.chance(cost, 1) >= CHANCE
            yield Explanation((change,), cost, fits, linear=True, said=before.label_cost)
