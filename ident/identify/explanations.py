"""What would reconcile data that contradict each other, or the model: a list that a person can act on.

Each thing that may be otherwise than arm file and campaign say is set free by itself, all unknowns fitted again. What
then fits is ranked by how probable it is, what it leaves and what it takes together; where nothing fits by itself,
pairs are tried.
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
# Which measurement would tell explanations apart: what each of them predicts, and how surely.

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


def discriminating_measurements(arm: Arm, campaign: Campaign, leading: Mapping[int, Perturbed]) -> tuple[Telling, ...]:
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
    rows = []
    for posture, load in product(list(postures)[:POSTURES], list(loads)[:LOADS]):
        lowest = Measurement(kind="frequency", posture=posture, value=1.0, sigma=1.0, load=load)
        drop = replace(lowest, kind="deflection", unit="", point=arm.points[-1].name, direction=AXES["-z"])
        rows += [lowest, replace(lowest, value=2.0), drop]
    return rows


# -------- Explanations

MOST_STATES = 3
"""States (posture and load) of the values farthest off, each of which is asked about by itself."""
SINGLE = 40
"""Numbers up to which each is searched for; of more, those with which a linear model gains most."""
ROWS = 6
"""Values farthest off, each of which may be wrong by itself."""
PAIRED, PAIRS = 8, 4
"""Numbers that are paired, those of the largest gain; and pairs that are searched for."""
TURNS = 4
"""Searches of what was put right, at most, each with labels chosen where the one before has ended."""


@dataclass(frozen=True)
class Change:
    """One thing that would have to be otherwise.

    Attributes:
        kind: one of `hypotheses.KINDS`, `soft base` for two of them together, or of an entry error `value` (a wrong
            one), `exchange` (two values), `on` and `off` (of a payload).
        of: the number's body, link, spring or kind of measurement; the payload; the joint.
        rows: places of the rows that an entry error is about.
        amount: what it would have to be: a factor, a share or, of a value, what it should read [SI]; NaN for none.
        sd: of ln(factor), or of the share, by data and priors.
        off: [sd] by how much that is more than plausible.
    """

    kind: str
    of: str = ""
    rows: tuple[int, ...] = ()
    amount: float = math.nan
    sd: float = math.nan
    off: float = SLIP


@dataclass(frozen=True)
class Explanation:
    """Changes that together would reconcile the data, or would not.

    Attributes:
        changes: them.
        cost: sum of squares of data and priors that is left.
        fits: whether no contradiction of the data is left.
        linear: whether it is an estimate along a straight line from the fit, not a fit of its own.
        said: the cost of the labels with them.
    """

    changes: tuple[Change, ...]
    cost: float
    fits: bool
    linear: bool = False
    said: float = 0.0

    @property
    def off(self) -> float:
        """By how much it is more than plausible [sd]."""
        return math.hypot(*(change.off for change in self.changes))

    @property
    def score(self) -> float:
        """What is left of the sum of squares, with changes and labels: minus twice the logarithm of the probability."""
        return self.cost + self.said + self.off**2


@dataclass(frozen=True)
class Explanations:
    """What may be wrong with a campaign, or with the arm.

    Attributes:
        cost: sum of squares of data and priors with nothing otherwise.
        items: those that fit, the most probable first; then the others by what they leave. All score less than the data
            as they are, by `MARGIN` at least.
        telling: what to measure to tell the leading ones apart.
        said: the cost of the labels with nothing otherwise.
    """

    cost: float
    items: tuple[Explanation, ...]
    telling: tuple[Telling, ...]
    said: float = 0.0

    @property
    def fitting(self) -> tuple[Explanation, ...]:
        """Those that the data cannot refute."""
        return tuple(item for item in self.items if item.fits)


def explain(fit: CampaignFit, unknowns: Unknowns | None = None, *, progress: Progress = iter) -> Explanations | None:
    """Rank what would reconcile a campaign that is in doubt.

    Args:
        fit: of the campaign.
        unknowns: what was unknown.
        progress: wraps the numbers of the searches, to show a bar.

    Returns:
        None where the model has no answer, or is scaled by discrepancies, which are explanations already.
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
    limit = before.cost + before.label_cost - MARGIN  # what scores no less explains nothing
    tried = [each for each in tried if each[0].score < limit]
    if not any(item.fits and item.off < SUSPICIOUS for item, _ in tried):
        # pairs that fit together, of the best ones along a straight line
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
"""An explanation, and the optimum that it leads to; none where no search was made for it."""


def _single(hypotheses: Hypotheses) -> list[Perturbation]:
    """Return what may be otherwise by itself: each number, and all springs of a direction together."""
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
    """Yield what sets of perturbations explain; not those that gain nothing, or by which a spring would soften."""
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
    """Yield the campaign without entry errors that it may hold, and the arm on a base that gives.

    Entry errors are payloads that were on, or off, in rows that say otherwise: in all rows, in whole kinds of rows, and
    in the states of the values farthest off.
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
    """Fit a corrected campaign, or an arm on a base that gives; nothing where these can't be."""
    change, arm, campaign = correction
    try:
        posed = pose(arm, campaign, unknowns)
    except InputError:  # as that of a mode that an arm with this payload has not
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
    else:  # the arm is the same, and so is the program that predicts what else it would show
        end = end.among(hypotheses)
    return Explanation((change,), end.cost, end.fits, said=end.label_cost), end


def _rematched(hypotheses: Hypotheses) -> Perturbed | None:
    """Search from a start, and again from where that ends, each time with labels that are matched there."""
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
    """Yield assumptions of the fit that no search has set free, estimated by its score."""
    for item in fit.assumptions.items if fit.assumptions else ():
        test = item.test
        if item.kind in RIGID and test.separable and test.z > 1:
            amount, cost = test.z * test.sd, before.cost - test.z**2
            change = Change(item.kind, item.joint, (), amount, test.sd, amount / KINDS[item.kind].plausible)
            fits = hypotheses.chance(cost, 1) >= CHANCE
            yield Explanation((change,), cost, fits, linear=True, said=before.label_cost)
