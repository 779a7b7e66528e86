"""What would reconcile data that contradict each other, or the model: a list that a person can act on.

Each thing that may be otherwise than arm file and campaign say is set free by itself, all unknowns fitted anew. What
then fits is ranked by how probable it is, what it leaves and what it takes together; where nothing fits by itself,
pairs are tried.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, on_soft_base, stiffness_paths
from ident.arm.fields import STIFFNESS
from ident.errors import InputError
from ident.identify.candidates import RESOLUTION, posture_grid, relative_sigma
from ident.identify.conditions import bind
from ident.identify.fit import KINDS as ASSUMED
from ident.identify.fit import Assumption, CampaignFit
from ident.identify.hypotheses import (
    LIKELY,
    NUMBER_KINDS,
    RIDGES,
    SCALES,
    AlteredModel,
    Cause,
    Finding,
    Inquiry,
    calibrated,
    inquire,
)
from ident.identify.unknowns import Unknowns
from ident.inference.information import SUSPICIOUS
from ident.inference.problem import InverseProblem
from ident.inference.scrutiny import Exchange
from ident.inference.search import looker
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.measure.load import AXES

# -------- Slips
# Slips of the pen that a campaign may hold: a payload that was on, or off, where its rows say otherwise.

MOST_STATES = 3
"""States (posture and load) of the values farthest off, each of which is asked about by itself."""


@dataclass(frozen=True)
class Slip:
    """A payload that may have been on, or off, in some rows.

    Attributes:
        payload: its name.
        on: whether it was on in rows that do not say so; else it was off in rows that do.
        rows: places of these rows.
        campaign: with these rows put right.
    """

    payload: str
    on: bool
    rows: tuple[int, ...]
    campaign: Campaign


def slips(arm: Arm, campaign: Campaign, farthest_off: Sequence[int]) -> Iterator[Slip]:
    """Yield all slips with payloads of whole kinds of rows, of all rows, and of the states of values that are far off.

    Args:
        arm: its payloads are those that may be on.
        campaign: what was measured.
        farthest_off: places of rows, those farthest off first.
    """
    rows = campaign.measurements
    kinds = {kind: [i for i, m in enumerate(rows) if m.kind == kind] for kind in dict.fromkeys(m.kind for m in rows)}
    states = list(dict.fromkeys((rows[i].posture, rows[i].load) for i in farthest_off))[:MOST_STATES]
    own = [[i for i, m in enumerate(rows) if (m.posture, m.load) == state] for state in states]
    seen = set()
    for payload in (payload.body.name for payload in arm.payloads):
        for among in (range(len(rows)), *kinds.values(), *own):
            for on in (True, False):
                moved = tuple(i for i in among if (payload in rows[i].load.payloads) != on)
                if moved and (payload, moved) not in seen:
                    seen.add((payload, moved))
                    changed = tuple(_with(m, payload, on) if i in moved else m for i, m in enumerate(rows))
                    yield Slip(payload, on, moved, replace(campaign, measurements=changed))


def _with(m: Measurement, payload: str, on: bool) -> Measurement:
    names = {*m.load.payloads, payload} if on else set(m.load.payloads) - {payload}
    load = m.load
    return replace(m, load=Load(tuple(names), load.masses, load.forces, load.moments, load.own))


# -------- Telling
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


# -------- Explanations

SLIP = 2.6
"""Standard deviations that a slip of the pen counts as, one in a hundred campaigns; assumed."""
MARGIN = 2.0
"""By how much an explanation must score below the data as they are to be listed: less is "not worth more than a bare
mention" (Kass, Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995, section 3.2)."""
SINGLE = 40
"""Numbers up to which each is searched for; of more, those with which a linear model gains most."""
ROWS = 6
"""Values farthest off, each of which may be wrong by itself."""
PAIRED, PAIRS = 8, 4
"""Numbers that are paired, those of the largest gain; and pairs that are searched for."""
TURNS = 4
"""Searches of what was put right, at most, each with labels chosen where the one before has ended."""
SOFT = ("base rocks", "base turns")


@dataclass(frozen=True)
class Change:
    """One thing that would have to be otherwise.

    Attributes:
        kind: a kind of number (`hypotheses.KINDS`), of assumption (`assumptions.KINDS`), or `value`, `exchange`, `on`
            and `off` for slips: a wrong value, two values exchanged, a payload that was on or off.
        of: the number's body, link, spring or kind of measurement; the payload; the joint.
        rows: places of the rows that a slip is about.
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
        fits: whether nothing speaks against the data any more.
        wrong_sign: whether a spring would have to soften, as none does: such a one is not listed.
        linear: whether it is an estimate along a straight line from the fit, not a fit of its own.
        said: what speaks against the labels with them.
    """

    changes: tuple[Change, ...]
    cost: float
    fits: bool
    wrong_sign: bool = False
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
        said: what speaks against the labels with nothing otherwise.
    """

    cost: float
    items: tuple[Explanation, ...]
    telling: tuple[Telling, ...]
    said: float = 0.0

    @property
    def fitting(self) -> tuple[Explanation, ...]:
        """Those that the data cannot refute, and whose springs do not soften."""
        return tuple(item for item in self.items if item.fits and not item.wrong_sign)


def explain(
    fit: CampaignFit,
    unknowns: Unknowns | None = None,
    *,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Explanations | None:
    """Rank what would reconcile a campaign that is in doubt.

    Args:
        fit: of the campaign.
        unknowns: what was unknown.
        progress: wraps the numbers of the searches, to show a bar.

    Returns:
        None where the model has no answer, or is scaled by discrepancies, which are explanations already.

    Raises:
        InputError: the campaign speaks of what the arm has not.
    """
    arm, campaign, unknowns = fit.arm, fit.campaign, unknowns or Unknowns()
    inquiry = inquire(fit.parameters, arm, campaign, unknowns, fit.choice.held)
    before = inquiry.search() if inquiry is not None else None
    if inquiry is None or before is None:
        return None
    tried = [_Tried(_exchanged(each)) for each in fit.exchanges]
    numbers, rows = _causes(inquiry), [Cause(row=i) for i in fit.farthest_off[:ROWS]]
    others = [*_slips(fit), *_soft_bases(fit)]
    searches: list[Callable[[], _Tried | None]] = [
        *(lambda cause=cause: _with_causes(inquiry, [cause], campaign, before.cost) for cause in [*numbers, *rows]),
        *(lambda other=other: _put_right(fit, other, unknowns) for other in others),
    ]
    tried += [found for i in progress(range(len(searches))) if (found := searches[i]()) is not None]
    tried += [_Tried(item) for item in _assumed(fit, inquiry, before)]
    as_it_is = before.cost + before.said
    tried = [each for each in tried if _explains(each.item, as_it_is)]
    if not any(each.item.fits and each.item.off < SUSPICIOUS for each in tried):
        pairs = _pairs(inquiry, numbers, campaign, before.cost)
        tried += [each for each in pairs if _explains(each.item, as_it_is)]
    tried.sort(key=lambda each: _rank(each.item))
    fitting = [each.told for each in tried if each.item.fits]
    leading = {place: told for place, told in enumerate(fitting, 1) if told is not None and place <= LEADING}
    items = tuple(each.item for each in tried)
    return Explanations(before.cost, items, telling(arm, campaign, leading), before.said)


@dataclass(frozen=True)
class _Tried:
    """An explanation, and where it leads."""

    item: Explanation
    told: Told | None = None


def _explains(item: Explanation, as_it_is: float) -> bool:
    """Tell whether an explanation is possible, and more probable than the data as they are."""
    return not item.wrong_sign and item.score < as_it_is - MARGIN


def _rank(item: Explanation) -> tuple[bool, float]:
    return not item.fits, item.score if item.fits else item.cost


def _causes(inquiry: Inquiry) -> list[Cause]:
    """Return what may be otherwise by itself: each number, and all springs of a direction together."""
    numbers = inquiry.effective
    causes = [Cause((number,)) for number in numbers]
    for direction in ("bending", "torsion"):
        own = tuple(n for n in numbers if n.kind == "spring" and n.of.endswith(direction))
        causes += [Cause(own)] if len(own) > 1 else []
    if len(causes) <= SINGLE:
        return causes
    return sorted(causes, key=lambda cause: -inquiry.gain([cause]))[:SINGLE]


def _with_causes(inquiry: Inquiry, causes: Sequence[Cause], campaign: Campaign, before: float) -> _Tried | None:
    """Search with causes at work; nothing where they gain nothing."""
    found = inquiry.search(causes, RIDGES if len(causes) == 1 else RIDGES[:1])
    if found is None or found.cost > before - 1.0:
        return None
    changes = tuple(_change(*each, campaign) for each in zip(causes, found.amounts, found.sd, strict=True))
    wrong = any(
        cause.numbers and not NUMBER_KINDS[cause.numbers[0].kind].signed and amount < 0
        for cause, amount in zip(causes, found.amounts, strict=True)
    )
    item = Explanation(changes, found.cost, found.fits, wrong, said=found.said)
    return _Tried(item, Told(inquiry, found))


def _change(cause: Cause, amount: float, sd: float, campaign: Campaign) -> Change:
    if cause.row >= 0:
        m = campaign.measurements[cause.row]
        off = min(abs(amount), SLIP)
        return Change("value", m.kind, (cause.row,), m.value - amount * m.sigma, sd * m.sigma, off)
    number, kind = cause.numbers[0], NUMBER_KINDS[cause.numbers[0].kind]
    of = number.of if len(cause.numbers) == 1 else number.of.split(".")[1]
    rows = tuple(i for i, m in enumerate(campaign) if m.kind == number.of) if number.kind in SCALES else ()
    off = abs(amount) / kind.plausible
    return Change(number.kind, of, rows, math.exp(amount) if kind.factor else amount, sd, off)


def _exchanged(each: Exchange) -> Explanation:
    return Explanation((Change("exchange", "", each.rows),), each.score, True)


def _slips(fit: CampaignFit) -> Iterator[tuple[Change, Arm, Campaign]]:
    for slip in slips(fit.arm, fit.campaign, fit.farthest_off):
        yield Change("on" if slip.on else "off", slip.payload, slip.rows), fit.arm, slip.campaign


def _soft_bases(fit: CampaignFit) -> Iterator[tuple[Change, Arm, Campaign]]:
    found = fit.assumptions
    if found is not None and fit.arm.base is None and any(item.kind in SOFT for item in found.items):
        yield Change("soft base"), on_soft_base(fit.arm, found.height), fit.campaign


def _put_right(fit: CampaignFit, other: tuple[Change, Arm, Campaign], unknowns: Unknowns) -> _Tried | None:
    """Fit a campaign that was put right, or an arm on a base that gives; nothing where these can't be."""
    change, arm, campaign = other
    try:
        told = _anew(fit.parameters, arm, campaign, unknowns)
        if told is None or not told.finding.fits:
            told = min(filter(None, (told, _anew({}, arm, campaign, unknowns))), key=_cost, default=None)
    except InputError:  # as that of a mode that an arm with this payload has not
        return None
    if told is None:
        return None
    found = told.finding
    if change.kind == "soft base":
        first, values = arm.joints[1].name, told.values
        stiffness = {path: float(values.get(path, arm.get(path))) for path in stiffness_paths(arm)}
        share = max(stiffness[f"{first}.{k}"] / stiffness[f"base.{k}"] for k in STIFFNESS)
        change = replace(change, off=share / ASSUMED["base rocks"].plausible)
    return _Tried(Explanation((change,), found.cost, found.fits, said=found.said), told)


def _anew(start: Mapping[str, float], arm: Arm, campaign: Campaign, unknowns: Unknowns) -> Told | None:
    """Search from a start, and again from where that ends, each time with labels that are chosen there."""
    told: Told | None = None
    for _ in range(TURNS):
        inquiry = inquire(told.values if told else start, arm, campaign, unknowns)
        found = inquiry.search() if inquiry is not None else None
        if inquiry is None or found is None:
            break
        before, told = told, Told(inquiry, found)
        if found.fits or (before is not None and before.finding.cost - found.cost < 1.0):
            return min(filter(None, (before, told)), key=_cost)
    return told


def _cost(told: Told) -> tuple[bool, float]:
    return not told.finding.fits, told.finding.cost


def _assumed(fit: CampaignFit, inquiry: Inquiry, before: Finding) -> list[Explanation]:
    """Return what the fit takes for granted and no search has set free, estimated by its score."""
    found = fit.assumptions
    if found is None:
        return []
    kept = [item for item in found.items if item.kind in ("link bends", "link twists", "servo gives")]
    return [_by_score(item, inquiry, before) for item in kept if item.test.separable and item.test.z > 1]


def _by_score(item: Assumption, inquiry: Inquiry, before: Finding) -> Explanation:
    kind, test = ASSUMED[item.kind], item.test
    amount, cost = test.z * test.sd, before.cost - test.z**2
    off = amount / kind.plausible
    fits = inquiry.chance(cost, 1) >= LIKELY
    change = Change(item.kind, item.joint, (), amount, test.sd, off)
    return Explanation((change,), cost, fits, linear=True, said=before.said)


def _pairs(inquiry: Inquiry, causes: Sequence[Cause], campaign: Campaign, before: float) -> list[_Tried]:
    """Return pairs of numbers that fit together, the best ones along a straight line."""
    first = sorted(causes, key=lambda cause: -inquiry.gain([cause]))[:PAIRED]
    pairs = [pair for pair in combinations(first, 2) if not set(pair[0].numbers) & set(pair[1].numbers)]
    best = sorted(pairs, key=lambda pair: -inquiry.gain(pair))[:PAIRS]
    found = [_with_causes(inquiry, pair, campaign, before) for pair in best]
    return [each for each in found if each is not None and each.item.fits]
