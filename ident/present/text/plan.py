"""The printed plan: the best next experiments, the batch with what the intervals will become, and what was assumed."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ident.arm.arm import ANYWHERE
from ident.identify.candidates import CLOSE, PARTS, RESOLUTION, Experiment, HammerPlan
from ident.identify.plan import CampaignPlan
from ident.inference.design import A_OPTIMAL, D_OPTIMAL, OPEN_SD
from ident.inference.parameters import Parameter
from ident.present.text.words import cut, degrees, drive_states, kept, paragraphs, scatter, unit_of

RANKED = 8
"""Postures that are listed."""
LOOSE = 0.3
"""Standard deviation of ln(value) from which a parameter is known to a factor only."""
LITTLE = 0.9
"""Share of its standard deviation above which the best further experiment tells little of a parameter."""
COLUMNS = 4
"""Standard deviations that are shown of each parameter, from now on; the last one always is."""


def plan_report(plan: CampaignPlan, hammer: Sequence[HammerPlan] = ()) -> str:
    """Return the report of a plan."""
    before, after = [_heading, _ranking, _ways, _batch, _intervals], [_assumptions]
    return paragraphs([*(each(plan) for each in before), _hammer(hammer), *(each(plan) for each in after)])


def criterion_in_words(plan: CampaignPlan) -> tuple[str, str]:
    """Return what experiments are chosen for, and the unit of the gain."""
    if plan.criterion.lower() == D_OPTIMAL:
        return "information on all parameters (D-optimal)", "nat"
    if plan.criterion.lower() == A_OPTIMAL:
        return "mean variance of all parameters (A-optimal)", "variance"
    return f"precision of {plan.criterion}, by ln(sd)", "ln(sd)"


def experiment_in_words(experiment: Experiment) -> str:
    """Say in a few words what is done in an experiment."""
    parts = (
        ["hammer"] * experiment.hammer + ["2 accelerometers"] * experiment.labelled + ["dial gauge"] * experiment.dial
    )
    return " + ".join(parts) + (f", {experiment.load}" if experiment.load else "")


def sd_in_words(item: Parameter, sd: float) -> str:
    """Write a standard deviation of theta: in percent or as a factor, or in the unit of a quantity of either sign."""
    if not item.positive:
        return f"{sd * float(item.scale):.2g} {unit_of(item.name)}"
    return scatter(sd)


def _heading(plan: CampaignPlan) -> Iterator[str]:
    known = f"{len(plan.fit.campaign)} measurements of {plan.fit.campaign.name}" if plan.fit else "the prior alone"
    yield f"Plan of measurements on {plan.arm.name}, from {known}"
    sample = ", a sample" if plan.grid.sampled else ""
    yield f"  {len(plan.grid.postures)} postures {_where(plan)}{sample};"
    different = len(np.unique(plan.grid.seen[plan.grid.seen >= 0]))
    before = len(plan.predictions.postures) - different
    beside = f" and {before} measured beside them" if before else ""
    yield f"  {different} of them{beside} show different things, {len(plan.experiments)} experiments"
    words, unit = criterion_in_words(plan)
    yield f"  chosen for {words}, most gain [{unit}] per minute first"
    if plan.fit:
        yield from drive_states(plan.arm, plan.fit.campaign)
    for doubt in plan.fit.doubts if plan.fit else ():
        yield f"  WARNING: {doubt.replace(' (see below)', '')}"
    if plan.fit and plan.fit.doubts:
        yield "  So the plan starts from a fit that is in doubt: see `ident fit` first."


def _where(plan: CampaignPlan) -> str:
    """Say which postures were compared."""
    workspace = plan.arm.workspace
    if workspace.postures:
        where = "that the arm file lists"
    elif workspace.line is not None:
        where = f"on the line ({', '.join(f'{share:g}' for share in workspace.line)}), within the joint limits"
    else:
        where = "within the joint limits"
    return where + (f", above {workspace.lowest:g} m" if math.isfinite(workspace.lowest) else "")


def _ranking(plan: CampaignPlan) -> Iterator[str]:
    best = plan.ranked(RANKED)
    yield _head("The best next experiments, one for each posture", plan)
    yield from (f"  {rank:2d}  {_row(plan, i)}" for rank, i in enumerate(best, 1))
    if any(plan.measured[plan.experiments[i].place] for i in best):
        yield "  * measured before, there or where the arm shows the same: a repeat averages noise, and gains less"
    yield "  improves most: the parameter whose standard deviation falls most, and what it will be"


def _heeded(plan: CampaignPlan) -> str:
    """Say what nobody has looked at."""
    if plan.arm.workspace == ANYWHERE:
        return "Only joint limits are heeded: check for collisions"
    return "Limits and workspace are heeded: check for collisions"


def _ways(plan: CampaignPlan) -> Iterator[str]:
    first = plan.experiments[plan.ranked(1)[0]]
    yield _head(f"What else could be done at {degrees(first.posture)}", plan)
    there = [i for i, experiment in enumerate(plan.experiments) if experiment.place == first.place]
    yield from (f"      {_row(plan, i, where='')}" for i in sorted(there, key=lambda i: -plan.per_cost[i]))


def _head(title: str, plan: CampaignPlan) -> str:
    return f"{title:48s}{'gain':>8s}{'cost':>7s}{'gain/h':>7s}  improves most"


def _row(plan: CampaignPlan, i: int, where: str | None = None) -> str:
    experiment = plan.experiments[i]
    where = (
        f"{degrees(experiment.posture)}{'*' if plan.measured[experiment.place] else ''}  " if where is None else where
    )
    what = where + experiment_in_words(experiment)
    numbers = f"{plan.gain[i]:8.3g}{plan.candidates.cost[i]:3.0f} min{60 * plan.per_cost[i]:7.3g}"
    return f"{what:42s}{numbers}  {_most(plan, plan.known.sd[0], plan.sd_after(i))}"


def _most(plan: CampaignPlan, before: np.ndarray, after: np.ndarray) -> str:
    place = int(np.argmax(before / after))
    item = plan.sought[place]
    return f"{item.name} to {sd_in_words(item, after[place])}"


def _batch(plan: CampaignPlan) -> Iterator[str]:
    total, unit = sum(step.cost for step in plan.steps), criterion_in_words(plan)[1]
    yield f"The batch of {len(plan.steps)}, each experiment chosen after those before it: {total:.0f} min"
    for number, (step, experiment) in enumerate(zip(plan.steps, plan.batch, strict=True), 1):
        gain = "" if unit == "nat" else f"{step.gain:.3g} {unit}, "
        what = f"{degrees(experiment.posture)}  {experiment_in_words(experiment)}"
        yield f"  {number:2d}  {what}: {gain}{step.nats:.3g} nat for {step.cost:.0f} min"
        values = plan.value_gains(number - 1)
        yield "      " + ", ".join(kept(f"{name} ({nats:.2g})") for name, nats in values)
    if plan.steps:
        yield "  In brackets: nat that each value would give as the only one of its experiment. Fewer modes"
        yield "  tell less, but a hammer test gives them all at once."


def _intervals(plan: CampaignPlan) -> Iterator[str]:
    items = plan.sought
    width = max(18, *(len(cut(item.name, 38)) for item in items))
    shown = sorted({*range(min(COLUMNS, len(plan.sd))), len(plan.sd) - 1})
    steps = "".join(f"{f'after {i}' if i else 'now':>11s}" for i in shown)
    yield f"{'What the sd will be':{width + 2}s}{steps}   then, at other draws"
    last = plan.at_draws
    for place, item in enumerate(items):
        row = "".join(f"{sd_in_words(item, float(sd)):>11s}" for sd in plan.sd[shown, place])
        ends = (last[:, place].min(), last[:, place].max()) if len(last) else ()
        spread = _from_to([sd_in_words(item, float(sd)) for sd in ends])
        yield f"  {cut(item.name, 38):{width}s}{row}   {spread}".rstrip()
    yield from _target(plan)
    yield from _loose(plan)
    yield "  A 95 % interval reaches 1.96 sd to each side, in ln(value)."


def _target(plan: CampaignPlan) -> Iterator[str]:
    """Say whether the target is reached, at the best estimate and at the other draws."""
    if not plan.settings.target:
        return
    target = f"{100 * math.expm1(plan.settings.target):.3g} %"
    if plan.missed:
        yield f"  The target of {target} is MISSED for {', '.join(plan.missed)}: ask for a larger batch"
        yield "  (--count), other loads (--load) or more modes (--modes)"
    else:
        yield f"  The target of {target} is reached at the best estimate"
    draws, missed = len(plan.at_draws), plan.missed_at_draws
    if missed.any():
        worst = plan.at_draws.max(0)
        cells = [
            f"{item.name} at {missed[place]} of {draws} (up to {sd_in_words(item, float(worst[place]))})"
            for place, item in enumerate(plan.sought)
            if missed[place]
        ]
        yield f"  At other draws of what is not known it is MISSED: {', '.join(map(kept, cells))}"
    elif draws:
        yield f"  It is reached at each of {draws} other draws of what is not known, too"


def _loose(plan: CampaignPlan) -> Iterator[str]:
    """Say which parameters the batch leaves known to a factor only, and what would tell more of each."""
    for place, item in enumerate(plan.sought):
        sd = float(plan.sd[-1, place])
        if not item.positive or sd < LOOSE:
            continue
        best, after = plan.best_for(place)
        experiment = plan.experiments[best]
        where = f"{experiment_in_words(experiment)} at {degrees(experiment.posture)}"
        better = f"next, {where} makes it {sd_in_words(item, after)}"
        if after > LITTLE * sd:
            better = "no experiment offered here tells much of it: other loads (--load) or more modes (--modes)"
        yield f"  After the batch {item.name} is still known to a {scatter(sd)} only (1 sd); {better}"


def _from_to(ends: Sequence[str]) -> str:
    """Join the ends of a span; two factors as `factor 2.2 to 4.5`, two of one unit as `5.1 to 8 %`."""
    if not ends:
        return ""
    first, last = (end.split() for end in ends)
    if first[0] == last[0] == "factor":
        return kept(f"factor {first[1]} to {last[1]}")
    return kept(f"{first[0]} to {' '.join(last)}" if first[1:] == last[1:] else " to ".join(ends))


def _hammer(plans: Sequence[HammerPlan]) -> Iterator[str]:
    """Yield where to measure and to hit in each hammer test."""
    if plans:
        yield "Hammer tests: where to measure and to hit, along the base's axes"
    for plan in plans:
        yield f"  {degrees(plan.posture)}{f', {cut(str(plan.load), 40)}' if plan.load else ''}"
        yield f"    accelerometers: {', '.join(plan.sensors)}"
        each = "each of " * (len(plan.hits) > 1)
        yield f"    {plan.count} hits at {each}{' and '.join(plan.hits)}"
        i, j = plan.most_alike
        if len(plan.labels) > 1:
            yield f"    most alike: {plan.labels[i]} and {plan.labels[j]}, auto-MAC {plan.auto_mac[i, j]:.2f}"
        for i, j in plan.alike:
            yield f"    NOT TOLD APART: {plan.labels[i]} and {plan.labels[j]}; measure at more places (--sensors)"
        for i, j in plan.coincide:
            near = f"{plan.frequency[i]:.3g} and {plan.frequency[j]:.3g} Hz"
            yield f"    {plan.labels[i]} and {plan.labels[j]} overlap ({near}): two places to hit are needed"
    if plans:
        yield "  places are the arm's points and the pins of its joints, which go by the joint's name"


def _assumptions(plan: CampaignPlan) -> Iterator[str]:
    instruments = plan.instruments
    yield "Assumed"
    shares = ", ".join(f"{100 * share:.2g} % of each {kind}" for kind, share in instruments.sigma.items())
    yield f"  sd {shares}, and {1e6 * RESOLUTION:.0f} um of a dial gauge (--sigma)"
    common = f"{100 * instruments.common:.3g} % of their variance is common to a posture"
    yield f"  {common}: a repeat there does not average it (--common-share)"
    costs = ", ".join(f"{PARTS[part]} {cost:g}" for part, cost in instruments.costs.items())
    yield f"  minutes (--cost): {costs}"
    yield f"  a hammer test gives the {len(plan.predictions.frequency)} lowest frequencies (--modes); one nearer than"
    yield f"  {100 * CLOSE:.0f} % to another counts only with a second accelerometer that tells which it is"
    loads = ", ".join(str(load) for load in instruments.loads)
    yield f"  loads at hand: {loads} (--load). {_heeded(plan)}"
    draws = len(plan.known.points) - 1
    out = f"; {plan.left_out} more were left out, as the arm would not stand" if plan.left_out else ""
    yield f"  gains are means over the best estimate and {draws} draws about it{out} (--draws); the standard"
    yield "  deviations hold at the best estimate, linearized there: they say nothing of other optima"
    if plan.known.nuisance:
        yield f"  not exactly known, and allowed for: {', '.join(plan.known.nuisance)}"
    if not plan.parameters.proper.all():
        yield f"  where a parameter has no prior, a factor of {math.exp(OPEN_SD):.0f} is taken for one sd"
