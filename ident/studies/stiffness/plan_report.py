"""The report of a plan: batch, expected gain, assumptions; its table, and the campaign to fill in."""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.arm import ANYWHERE
from ident.files import numbered, together, write_text
from ident.identify.candidates import CLOSE, PARTS, RESOLUTION, Experiment, HammerPlan
from ident.inference.design import A_OPTIMAL, D_OPTIMAL, OPEN_SD
from ident.measure.reading import campaign_rows
from ident.measure.table import csv_text
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut, kept, without_empty_columns
from ident.report.words import counted, degrees, lowered, percent, scatter, unit_of
from ident.studies.stiffness.fit_report import why_no_interval
from ident.studies.stiffness.warnings import drive_states

if TYPE_CHECKING:
    from ident.identify.plan import CampaignPlan
    from ident.inference.parameters import Parameter

RANKED = 8
"""Postures listed."""
LISTED = 6
"""Experiments of the batch on the first screen, at most."""
LOOSE = 0.3
"""Standard deviation of ln(value) above which a parameter is known only to a factor."""
LITTLE = 0.9
"""Share of its standard deviation above which the best further experiment says little about a parameter."""
NO_SHEET = Finding("no hammer test in the batch, so there is no sheet", "plan more experiments (--count)")
SLACK = 1e-9
"""Rounding error [deg] tolerated at a limit."""
COLUMNS = 4
"""Standard deviations shown for each parameter, starting now; the last one is always shown."""


def plan_sections(plan: "CampaignPlan", hammer: Sequence[HammerPlan] = (), sheet: str | None = None) -> Report:
    """Return the report of a plan; `sheet` as in the options."""
    batch = _batch_table(plan, LISTED, gains=False) if plan.steps else "No experiment is needed."
    then = "add it, then: ident fit {campaign}" if plan.fit else "then: ident fit {result}.csv --arm {arm}"
    if any(m.note.startswith("replace ") for m in plan.campaign()):
        then = "replace rows as noted, add the rest, then: ident fit {campaign}"
    onward = "ident resonance {arm}" if plan.arm.stroke else ""
    following = "fill in {result}.csv, " + then if plan.steps else onward
    if plan.steps and plan.fit and plan.fit.doubts:
        following = "check the causes, fill in {result}.csv, add it, then: ident fit {campaign}"
    if sheet and hammer:
        following = "measure by {result}.sheet/sheet.html, then: ident modal {result}.sheet"
    campaign = plan.fit.campaign if plan.fit else None
    known = f"{counted(len(campaign), 'measurement')} of {cut(campaign.name, 30)}" if campaign else "the prior alone"
    return Report(
        f"Plan of {counted(len(plan.steps), 'experiment')} on {cut(plan.arm.name, 40)}, starting from {known}",
        _verdict(plan),
        (batch, _sd_table(plan, "Expected std. error", [0, len(plan.sd) - 1], _if_resolved(plan))),
        (*_findings(plan, hammer), *[NO_SHEET] * bool(sheet and not hammer)),
        next=following,
        details=tuple(_details(plan, hammer)),
    )


# -------- Verdict


def _verdict(plan: "CampaignPlan") -> Verdict:
    """Judge a batch: PROVISIONAL if the fit is in doubt; else by the target, or by unknowns that stay poorly known."""
    items, loose = plan.sought, _loose(plan)
    fine = len(items) - len(loose)
    reached = f"{_target(plan)} {_reached(plan)}".strip()
    if plan.fit and plan.fit.doubts:
        doubt = lowered(plan.fit.doubts[0])
        reached = lowered(_target(plan) or _reached(plan))
        words = f"The fit that it starts from is in doubt: {doubt}. If that is resolved, {reached}"
        return Verdict("PROVISIONAL", words, "bad")
    if plan.missed:
        return Verdict("TARGET MISSED", reached, "bad")
    if plan.settings.target:
        risky = bool(plan.missed_at_draws.any())
        return Verdict("TARGET AT RISK" if risky else "TARGET REACHED", reached, "caution" if risky else "good")
    if loose:
        return Verdict(f"PARTLY {fine} OF {len(items)}" if fine else "NOT SUFFICIENT", reached, "caution")
    return Verdict("SUFFICIENT", reached, "good")


def _reached(plan: "CampaignPlan") -> str:
    """Say how well the unknowns will be known after the batch."""
    items, loose, last = plan.sought, _loose(plan), plan.sd[-1]
    minutes = sum(step.cost for step in plan.steps)
    after = f"after {counted(len(plan.steps), 'experiment')} ({minutes:.0f} min)" if plan.steps else "now"
    if loose:
        fine = f"{len(items) - len(loose)} of {counted(len(items), 'unknown')}"
        return f"{fine} will have a std. error below {percent(LOOSE)} {after}."
    worst = int(np.argmax([sd if item.positive else 0.0 for item, sd in zip(items, last, strict=True)]))
    return f"Every std. error is at most {sd_in_words(items[worst], float(last[worst]))} {after}."


def _target(plan: "CampaignPlan") -> str:
    """Say whether the target is reached, at the best estimate and on the other plausible arms; empty without one."""
    if not plan.settings.target:
        return ""
    target, draws = f"{100 * math.expm1(plan.settings.target):.3g} %", len(plan.at_draws)
    if plan.missed:
        return f"The target of {target} is missed for {len(plan.missed)} of {counted(len(plan.sought), 'unknown')}."
    reached = f"The target of {target} is reached at the best estimate"
    if plan.missed_at_draws.any():
        missed = int((plan.at_draws > plan.settings.target).any(1).sum())
        return f"{reached}, but missed on {missed} of {draws} other plausible arms."
    return f"{reached} and on all {draws} other plausible arms." if draws else f"{reached}."


def _loose(plan: "CampaignPlan") -> list[int]:
    """Return the unknowns that are known only to a factor after the batch."""
    return [i for i, item in enumerate(plan.sought) if item.positive and plan.sd[-1, i] >= LOOSE]


def _findings(plan: "CampaignPlan", hammer: Sequence[HammerPlan]) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    if plan.fit:
        yield from drive_states(plan.arm, plan.fit.campaign)
    missed = [kept(f"{item.name} {n}") for item, n in zip(plan.sought, plan.missed_at_draws, strict=False) if n]
    if plan.missed or missed:
        also = f"on how many of {len(plan.at_draws)} other plausible arms: {', '.join(missed)}" if missed else ""
        best = f"at the best estimate: {', '.join(plan.missed)}" if plan.missed else ""
        where = "; ".join(filter(None, (best, also)))
        yield Finding(f"target missed {where}", "more experiments (--count), --load or --modes")
    yield from _loose_findings(plan)
    for each in hammer:
        for i, j in each.alike:
            text = f"at {degrees(each.posture)} the sensors cannot tell {each.labels[i]} from {each.labels[j]}"
            yield Finding(text, "measure at more places (--sensors)")
    yield Finding("collisions are not considered", "check each posture")
    if others := plan.fit.doubts[1:] if plan.fit else ():
        yield Finding(f"further doubts: {'; '.join(others)}")


def _loose_findings(plan: "CampaignPlan") -> Iterator[Finding]:
    """Yield the unknowns that stay known only to a factor, and what would determine each."""
    hopeless = []
    for i in _loose(plan):
        item, sd = plan.sought[i], float(plan.sd[-1, i])
        best, after = plan.best_for(i)
        if after > LITTLE * sd:
            hopeless.append(kept(f"{item.name} ({scatter(sd)})"))
            continue
        experiment = plan.experiments[best]
        where = f"{experiment_in_words(experiment)} at {degrees(experiment.posture)}"
        text = f"after the batch {item.name} is still known to a {scatter(sd)} only (std. error)"
        yield Finding(text, f"add {where}: {sd_in_words(item, after)}")
    if hopeless:
        text = f"no available experiment improves {', '.join(hopeless)} much"
        yield Finding(text, "allow other loads (--load) or more modes (--modes)")


# -------- Tables


def criterion_in_words(plan: "CampaignPlan") -> tuple[str, str]:
    """Return the aim of the experiments, and the unit of the gain."""
    if plan.criterion.lower() == D_OPTIMAL:
        return "information on all parameters (D-optimal)", "nat"
    if plan.criterion.lower() == A_OPTIMAL:
        return "mean variance of all parameters (A-optimal)", "variance"
    return f"precision of {plan.criterion}, by ln(sd)", "ln(sd)"


def experiment_in_words(experiment: Experiment) -> str:
    """Describe an experiment in a few words."""
    done = {"hammer": experiment.hammer, "2 accelerometers": experiment.labelled, "dial gauge": experiment.dial}
    parts = " + ".join(part for part, is_done in done.items() if is_done)
    return parts + (f", {experiment.load}" if experiment.load else "")


def sd_in_words(item: "Parameter", sd: float) -> str:
    """Write a standard deviation of theta: in percent or as a factor, or in the unit of a signed quantity."""
    return scatter(sd) if item.positive else f"{sd * float(item.scale):.2g} {unit_of(item.name)}"


def _batch_table(plan: "CampaignPlan", most: int, *, gains: bool = True) -> Table:
    """Return the first experiments of the batch with costs, and with gains unless `gains` is false."""
    unit = criterion_in_words(plan)[1]
    units = [*([unit] if unit != "nat" else []), "nat"] if gains else []
    rows = [
        (str(i), degrees(each.posture), experiment_in_words(each), step.cost, *(step.gain, step.nats)[2 - len(units) :])
        for i, (step, each) in enumerate(zip(plan.steps[:most], plan.batch[:most], strict=True), 1)
    ]
    note = f"and {len(plan.steps) - most} more experiments, see --details" if len(plan.steps) > most else ""
    heads = "", "posture", "experiment", "time [min]|.0f", *(f"gain [{unit}]|.3g" for unit in units)
    return by_head(heads, rows, note=note)


def _if_resolved(plan: "CampaignPlan") -> str:
    """Return the condition under which std. errors after experiments hold, if the fit is in doubt."""
    return ", if resolved" * bool(plan.fit and plan.fit.doubts)


def _sd_table(plan: "CampaignPlan", title: str, shown: Sequence[int], condition: str = "") -> Table:
    """Return the std. error of each unknown after some steps of the batch, and its range over plausible arms."""
    steps, rows = list(dict.fromkeys(shown)), []
    names = plan.fit.problem.parameters.names if plan.fit else ()
    for i, item in enumerate(plan.sought):
        draws = plan.at_draws[:, i]
        spread = _from_to([sd_in_words(item, float(sd)) for sd in (draws.min(), draws.max())]) if len(draws) else ""
        cells = [sd_in_words(item, float(plan.sd[step, i])) for step in steps]
        if plan.fit and item.name in names:  # why the starting fit has no interval of an unknown
            cells[0] = why_no_interval(plan.fit, names.index(item.name)) or cells[0]
        rows.append((cut(item.name, 38), *cells, spread))
    title += " [% or factor]" * any("factor" in cell for row in rows for cell in row[1:])
    heads = title, *(f"after {step}{condition}" if step else "now" for step in steps), "on plausible arms"
    return without_empty_columns(by_head(heads, rows))


def _from_to(ends: Sequence[str]) -> str:
    """Join the ends of a range; two factors as `factor 2.2 to 4.5`, two of one unit as `5.1 to 8 %`."""
    if ends[0] == ends[1]:
        return ends[0]
    first, last = (
        [f"{float(x):#.2g}" if re.fullmatch(r"\d(\.\d)?|0\.0*\d+", x) else x for x in e.split()] for e in ends
    )
    if first[0] == last[0] == "factor":
        return f"factor {first[1]} to {last[1]}"
    return f"{first[0]} to {' '.join(last)}" if first[1:] == last[1:] else " to ".join(ends)


def _experiments_table(plan: "CampaignPlan", title: str, chosen: Sequence[int], *, with_posture: bool = True) -> Table:
    """Return candidates for the next experiment, each with its gain and the unknown that it improves most."""
    rows = []
    for rank, i in enumerate(chosen, 1):
        each, after = plan.experiments[i], plan.sd_after(i)
        place = int(np.argmax(plan.known.sd[0] / after))
        most = f"{plan.sought[place].name} to {sd_in_words(plan.sought[place], float(after[place]))}"
        where = str(rank), degrees(each.posture) + "*" * bool(plan.measured[each.place])
        numbers = (float(plan.gain[i]), float(plan.candidates.cost[i]), float(60 * plan.per_cost[i]))
        rows.append((*where, experiment_in_words(each), *numbers, most)[0 if with_posture else 2 :])
    gain = f"gain [{criterion_in_words(plan)[1]}]|.3g"
    heads = "", "posture", "experiment", gain, "time [min]|.0f", "gain/h|.3g", "improves most"
    return by_head(heads[0 if with_posture else 2 :], rows, title)


# -------- Details


def _details(plan: "CampaignPlan", hammer: Sequence[HammerPlan]) -> Iterator[Section]:
    yield _candidates(plan)
    yield from _batch(plan)
    shown = sorted({*range(min(COLUMNS, len(plan.sd))), len(plan.sd) - 1})
    note = "A 95 % interval extends 1.96 std. errors to each side, in ln(value)."
    title = f"Expected std. errors after each experiment{_if_resolved(plan)}"
    yield Section(title, (_sd_table(plan, "unknown", shown), note))
    yield from _hammer(hammer)
    yield _assumptions(plan)


def _candidates(plan: "CampaignPlan") -> Section:
    """Return what was compared, the best next experiments, and the alternatives at the best posture."""
    different, every = len(np.unique(plan.grid.seen[plan.grid.seen >= 0])), len(plan.predictions.postures)
    measured = f" ({different} on the grid, {every - different} already measured)" if every > different else ""
    sample = ", a sample of the grid" if plan.grid.sampled else ""
    workspace = plan.arm.workspace
    line = f"on the line ({', '.join(f'{share:g}' for share in workspace.line)}), " if workspace.line else ""
    where = "listed in the arm file" if workspace.postures else f"{line}within the joint limits"
    where += f", above {workspace.lowest:g} m" if math.isfinite(workspace.lowest) else ""
    words, unit = criterion_in_words(plan)
    best = plan.ranked(RANKED)
    first = plan.experiments[best[0]]
    own = [i for i, each in enumerate(plan.experiments) if each.place == first.place]
    there = sorted(own, key=lambda i: -plan.per_cost[i])
    repeated = any(plan.measured[plan.experiments[i].place] for i in best)
    star = "* measured already, there or in an equivalent posture: a repeat averages noise, and gains less."
    compared = (
        f"{len(plan.grid.postures)} postures {where}{sample}: {every} distinct postures{measured}, "
        f"{counted(len(plan.experiments), 'candidate experiment')}. Chosen for {words}, most gain [{unit}] per "
        "minute first."
    )
    note = "improves most: the unknown whose std. error falls most, and its value afterwards."
    others = _experiments_table(plan, f"Other experiments at {degrees(first.posture)}", there, with_posture=False)
    title = "Candidates: the best next experiment at each posture"
    return Section(title, (compared, _experiments_table(plan, "", best), *[star] * repeated, note, others))


def _batch(plan: "CampaignPlan") -> Iterator[Section]:
    """Yield the gain of each value in the batch."""
    if not plan.steps:
        return
    rows = [(str(i + 1), value, nats) for i in range(len(plan.steps)) for value, nats in plan.value_gains(i)]
    note = (
        "Information that each value would give as the only one of its experiment. Fewer modes give less, but a hammer "
        "test measures them all at once."
    )
    table = by_head(("experiment", "value", "gain [nat]|.2g"), rows, note=note)
    total = sum(step.cost for step in plan.steps)
    title = f"The batch of {len(plan.steps)}, each experiment chosen after those before it: {total:.0f} min"
    yield Section(title, (_batch_table(plan, len(plan.steps)), table))


def _hammer(plans: Sequence[HammerPlan]) -> Iterator[Section]:
    """Yield the sensors and hammer points of each hammer test."""
    if not plans:
        return
    words = []
    for plan in plans:
        load = f", {cut(str(plan.load), 40)}" if plan.load else ""
        hits = f"{plan.count} hits at {'each of ' * (len(plan.hits) > 1)}{' and '.join(plan.hits)}"
        parts = [f"{degrees(plan.posture)}{load}: accelerometers at {', '.join(plan.sensors)}; {hits}."]
        i, j = plan.most_alike
        if len(plan.labels) > 1:
            parts.append(f"Most alike: {plan.labels[i]} and {plan.labels[j]}, auto-MAC {plan.auto_mac[i, j]:.2f}.")
        parts += [f"NOT DISTINGUISHED: {plan.labels[i]} and {plan.labels[j]}." for i, j in plan.alike]
        for i, j in plan.coincide:
            near = f"{plan.frequency[i]:.3g} and {plan.frequency[j]:.3g} Hz"
            parts.append(f"{plan.labels[i]} and {plan.labels[j]} overlap ({near}): hit at two places.")
        words.append(" ".join(parts))
    places = "Places are the arm's points and the pins of its joints (JOINT_pin)."
    yield Section("Hammer tests: where to measure and to hit, along the base's axes", (*words, places))


def _assumptions(plan: "CampaignPlan") -> Section:
    instruments = plan.instruments
    shares = ", ".join(f"{100 * share:.2g} % of each {kind}" for kind, share in instruments.sigma.items())
    costs = ", ".join(f"{PARTS[part]} {cost:g}" for part, cost in instruments.costs.items())
    left = f"; {plan.left_out} more were left out, as the arm has no stable equilibrium there" if plan.left_out else ""
    lines = [
        f"Sigma (--sigma): {shares}, and {1e6 * RESOLUTION:.0f} um of a dial gauge.",
        f"{100 * instruments.common:.3g} % of their variance is the same in each repeat at a posture "
        "(--common-share): a mean does not reduce it.",
        f"Time in minutes (--cost): {costs}.",
        f"A hammer test measures the {len(plan.predictions.frequency)} lowest frequencies (--modes). One nearer than "
        f"{100 * CLOSE:.0f} % to another counts only with a second accelerometer that identifies it.",
        f"Loads available (--load): {', '.join(map(str, instruments.loads))}. Joint limits "
        f"{'only are' if plan.arm.workspace == ANYWHERE else 'and workspace are'} considered.",
        f"Gains are means over the best estimate and {counted(len(plan.known.points) - 1, 'other plausible arm')} "
        f"(--draws){left}. The std. errors hold at the best estimate, by linearisation: other optima are not "
        "considered.",
    ]
    if plan.known.nuisance:
        lines.append(f"Not exactly known, and allowed for: {', '.join(plan.known.nuisance)}.")
    if not plan.parameters.proper.all():
        lines.append(f"Where an unknown has no prior, a factor of {math.exp(OPEN_SD):.0f} is taken as its std. error.")
    return Section("Assumptions", tuple(lines))


# -------- Files
# A plan as rows, and as a campaign with empty values to fill in.


def write_form(plan: "CampaignPlan", path: Path) -> None:
    """Write the batch as a campaign with empty values and the expected values in the notes.

    A form that is already filled in is renamed with a number.
    """
    campaign = plan.campaign()
    columns, table = campaign_rows(campaign, relative_sigma=True)
    comments = ["Made by `ident plan`. Fill in `value`; `expected` in the notes is a prediction, not a measurement."]
    if not any(experiment.labelled for experiment in plan.batch):
        comments += ["Rows without mode are matched in ascending order within one posture and load: "]
        comments[-1] += "enter them all, or fill in `mode`."
    names = list(dict.fromkeys([*columns, "note"]))
    if "mode" not in names:
        names.insert(names.index("value"), "mode")
    for row, m in zip(table, campaign, strict=True):
        note = "; ".join(filter(None, (f"expected {float(row['value']):.4g} {row['unit']}", row.get("note"))))
        sigma = f"{float(row['relative_sigma']):.4g}"
        row |= {**angle_cells(plan, m.posture), "value": "", "note": note, "relative_sigma": sigma}
    text = csv_text(names, table, comments)
    with together() as files:
        if _is_filled(path):
            files.moves.append((path, path.with_name(numbered(path.parent, path.stem) + path.suffix)))
        write_text(path, text)


def plan_rows(plan: "CampaignPlan") -> list[dict[str, Any]]:
    """Return a row for each experiment of the batch: posture [deg], load, kind of test, cost [min], gain, nat."""
    return [
        {"step": number}
        | {f"{joint.name} [deg]": math.degrees(q) for joint, q in zip(plan.arm.driven, each.posture, strict=True)}
        | {"load": str(each.load), "hammer": each.hammer, "labelled": each.labelled, "dial_gauge": each.dial}
        | {"minutes": step.cost, "gain": step.gain, "nats": step.nats}
        for number, (step, each) in enumerate(zip(plan.steps, plan.batch, strict=True), 1)
    ]


def angle_cells(plan: "CampaignPlan", posture: tuple[float, ...]) -> dict[str, str]:
    """Return angles to 0.001 deg, by column; exactly if measured before, or if rounding would exceed a limit."""
    cells, measured = {}, set(plan.fit.campaign.postures) if plan.fit else set()
    for number, (joint, angle) in enumerate(zip(plan.arm.driven, posture, strict=True), 1):
        low, high = (math.degrees(limit) + slack for limit, slack in zip(joint.limits, (-SLACK, SLACK), strict=True))
        near = round(math.degrees(angle), 3)
        exact = posture in measured or not low <= near <= high
        cells[f"q{number} [deg]"] = f"{math.degrees(angle) if exact else near:.10g}"
    return cells


def _is_filled(path: Path) -> bool:
    try:
        lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
    except (OSError, UnicodeDecodeError):
        return False
    return any((row.get("value") or "").strip() for row in csv.DictReader(lines))
