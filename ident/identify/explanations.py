"""What would reconcile data that contradict each other, or the model: a list that a person can act on.

Each thing that may be otherwise than arm file and campaign say is set free by itself, all unknowns fitted anew. What
then fits is ranked by how probable it is, what it leaves and what it takes together; where nothing fits by itself,
pairs are tried.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.base import on_soft_base
from ident.arm.fields import STIFFNESS
from ident.errors import InputError
from ident.identify.alternatives import NUMBER_KINDS, SCALES
from ident.identify.assumptions import KINDS as ASSUMED
from ident.identify.assumptions import Assumption
from ident.identify.fit import CampaignFit
from ident.identify.inquiry import LIKELY, RIDGES, Cause, Finding, Inquiry, inquire
from ident.identify.slips import slips
from ident.identify.telling import LEADING, Telling, Told, telling
from ident.identify.unknowns import Unknowns
from ident.inference.exchange import Exchange
from ident.inference.verdicts import SUSPICIOUS
from ident.measure import Campaign

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
        kind: a kind of number (`alternatives.KINDS`), of assumption (`assumptions.KINDS`), or `value`, `exchange`, `on`
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
