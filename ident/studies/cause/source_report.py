"""The report of the sources of a moving arm, and its table; those of planned runs."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.multibody import IMBALANCE, ExcitingOrder
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, by_row, cut
from ident.report.words import MM, counted
from ident.studies.cause.trials import acting, tried_section
from ident.vibrate.unit_response import unit_of

if TYPE_CHECKING:
    from ident.studies.cause.source_plan import RunPlan
    from ident.studies.cause.source_study import SourceStudy
    from ident.vibrate.source_causes import Cause, Causes
    from ident.vibrate.source_identification import Estimate

CAUSES = {
    "imbalance": "imbalance",
    "error": "transmission error",
    "mesh": "belt mesh",
    "finger": "a flexible finger",
    "line": "a fixed frequency",
}
"""Causes of a peak in words."""
IMPLAUSIBLE = {True: 600.0, False: 50.0}
"""Largest plausible transmission error [arcsec p-p] of a drive, and eccentricity [mm] of its mass; assumed."""
LISTED = 5
"""Further runs on the first screen, at most."""


def source_sections(study: "SourceStudy") -> Report:
    """Return the report of the sources of an arm."""
    problem = study.found.problem
    what = f"{counted(len(problem.runs), 'run')}, {counted(len(problem.channels), 'trace')}"
    balanced = any(each.told and each.source.kind == IMBALANCE for each in study.found.estimates)
    following = "ident balance {result}.json" if balanced else "ident simulate {arm} --posterior {result}.json"
    return Report(
        f"Excitation of {cut(problem.arm.name, 40)} from {what}",
        source_verdict(study),
        (estimates(study),),
        tuple(source_findings(study)),
        remark=_remark(study),
        next=following if study.usable else "",
        details=tuple(_details(study)),
    )


def source_verdict(study: "SourceStudy") -> Verdict:
    """Judge by how many sources are determined, or say why the runs are unusable."""
    told, count = study.told, len(study.found.estimates)
    explained = f"they explain {_range(100 * study.found.explained)} % of the mean square of each trace"
    if study.doubtful and study.astray and not (study.moved or study.contradicting or study.poor):
        return Verdict("DOUBTFUL", "A run that was left out is not predicted. No interval is reported.", "bad")
    if study.doubtful:
        return Verdict("NOT USABLE", "The runs contradict the model or each other. No interval is reported.", "bad")
    if not study.found.settled:
        return Verdict("NOT USABLE", f"The search did not settle in {study.found.rounds} rounds.", "bad")
    if told == count:
        return Verdict("IDENTIFIED", f"All {count} sources of the drives are determined; {explained}.", "good")
    return Verdict(f"PARTLY {told} OF {count}", f"{told} of {count} sources are determined; {explained}.", "caution")


def _range(values: Iterable[float]) -> str:
    every = list(values)
    low, high = (f"{end(every):.0f}" for end in (min, max))
    return low if low == high else f"{low} to {high}"


def named(source: ExcitingOrder) -> str:
    """Name a source: `drive2 imbalance`, `drive2 error, order 2`."""
    return f"{source.drive} {f'error, order {source.order:g}' if source.of_error else IMBALANCE}"


def size_of(masses: "Mapping[str, float]", source: ExcitingOrder) -> tuple[float, str]:
    """Return the size of one source unit in the report's unit, and that unit; an eccentric mass counts as mass."""
    return (2.0, "arcsec p-p") if source.of_error else (masses[source.drive], "kg mm")


def _row(study: "SourceStudy", each: "Estimate", makes: float) -> tuple[Any, ...]:
    size, unit = size_of(study.found.problem.masses, each.source)
    name, low, high = named(each.source), *each.interval
    phase = round(float(np.degrees(each.phase[0]))) % 360 if len(each.phase) == 1 else None  # the details have several
    estimate, vibration = f"{size * each.amplitude:.4g}", MM * makes * each.amplitude
    if not study.usable:
        return name, estimate, None, None, unit, phase, vibration
    if not each.told:
        return name, "cannot be told", None, f"up to {size * high:.3g}", unit, None, MM * makes * high
    interval = f"{size * low:.4g} .. {size * high:.4g}"
    return name, estimate, 100 * each.sd / each.amplitude, interval, unit, phase, vibration


def estimates(study: "SourceStudy") -> Table:
    """Return the table of the sources."""
    heads = "Source", "estimate", "std. error [%]|.1f", "95 % interval", "unit", "phase [deg]|d", "vibration [mm]|.3f"
    pairs = zip(study.found.estimates, study.found.makes.tolist(), strict=True)
    note = "Transmission errors at the joint; phases at joint angle 0; vibration: largest peak in these runs."
    return by_head(heads, (_row(study, each, makes) for each, makes in pairs), note=note)


def source_findings(study: "SourceStudy") -> Iterator[Finding]:
    """Yield problems of the runs, the prediction of a left-out run, and undetermined sources."""
    if study.causes:
        yield cause_finding(study.causes, study.usable)
    check = "check speed, load, direction, unit and delay in the table of runs, and the sampling of the file"
    yield from too_large(study.found.estimates)
    for name, gain in study.poor.items():
        yield Finding(f"{name} does not follow the computed vibration (gain {gain:.2f})", check)
    if not study.found.settled and not study.poor:
        yield Finding("the search did not settle", check)
    for source in study.contradicting:
        yield Finding(f"{named(source)}: the runs contradict each other", "check their table, or use each run alone")
    runs = zip(study.found.problem.runs, study.found.place.clock[:, 1].tolist(), strict=True)
    clocks = {f"clock of {run.name}": rate for run, rate in runs if f"clock of {run.name}" in study.moved}
    if clocks:
        text = f"{cut(', '.join(clocks), 60)} would have to be {100 * max(clocks.values(), key=abs):+.2g} % off"
        yield Finding(text, "check the recorder's sampling rate, and the speed")
    for name, shift in study.moved.items():
        remedy = "check the load of the runs, and what the stiffnesses and damping are from"
        if name.endswith("k_tors") and shift < 0:
            remedy += "; a soft servo acts as a softer joint"
        if name not in clocks:
            remedy = "check the table of runs" if " of " in name else remedy
            yield Finding(f"{name} would have to move by {abs(shift):.1f} sigma", remedy)
    for each in study.tried():
        if each.told and not each.right:
            remedy = "check mass, radius, angle and mark; ident balance allows for it"
            yield Finding(f"{each.run}: the mass on {each.drive} acts {acting(each)}", remedy)
    if study.held:
        names = ", ".join(dict.fromkeys(each.run for each in study.held))
        shares = _range(100 * max(0.0, each.explained) for each in study.held)
        rms = max((100 * (each.ratio - 1) for each in study.held), key=abs)
        predicted = f"predicted {shares} % of the mean square, and the rms to {abs(rms):.0f} %"
        rate = next((each.rate for each in study.astray), 0.0)
        like = f"its clock or speed looks {100 * rate:+.2g} % off: " if rate else ""
        yield Finding(f"left out: {cut(names, 40)}; {predicted}", like + check if study.astray else "")
    pairs = list(zip(study.found.estimates, study.found.makes.tolist(), strict=True))
    hidden = [named(each.source) for each, _ in pairs if not each.told]
    if hidden and study.usable:
        most = max(MM * makes * each.interval[1] for each, makes in pairs if not each.told)
        speed, told = study.next_run
        every = "it" if len(hidden) == 1 else "all" if len(told) == len(hidden) else ", ".join(map(named, told))
        remedy = f"add a run at {speed:g} %, which tells {every}" if told else "add a sensor elsewhere"
        what = hidden[0] if len(hidden) == 1 else f"{len(hidden)} sources"
        yield Finding(f"{what} cannot be told: at most {most:.2g} mm{' each' * (len(hidden) > 1)}", remedy)
    if not study.known:
        remedy = "add --posterior of ident sample"
        yield Finding("before these runs the stiffnesses are taken as known to 10 % (assumed)", remedy)


def too_large(every: "Iterable[Estimate]") -> Iterator[Finding]:
    """Yield the sources larger than plausible for a drive."""
    for each in every:
        error = each.source.of_error
        size, unit = (2 * each.amplitude, "arcsec p-p") if error else (each.amplitude, "mm of eccentricity")
        if each.told and size > IMPLAUSIBLE[error]:
            text = f"{named(each.source)}: {size:.4g} {unit}, no drive has more than {IMPLAUSIBLE[error]:g}"
            yield Finding(text, "check the units of the recordings")


def _remark(study: "SourceStudy") -> str:
    worst = int(np.argmin(study.found.explained))
    left = 100 * (1 - study.found.explained[worst])
    name = study.found.problem.channels[worst].name
    return f"Largest part unexplained: {left:.1f} % of the mean square of {name}, noise included." if left < 100 else ""


def _details(study: "SourceStudy") -> Iterator[Section]:
    found = study.found
    problem, place = found.problem, found.place
    phases = [
        (named(each.source), group, np.degrees(phase) % 360, np.degrees(sd))
        for each in found.estimates
        for group, (phase, sd) in enumerate(zip(each.phase, each.phase_sd, strict=True), 1)
    ]
    meaning = (
        "Of imbalance: direction of the eccentric mass at joint angle 0, counted about the axis. Of transmission "
        "error: of its sine at joint angle 0. Runs of one group share them."
    )
    heads: tuple[str, ...] = ("Source", "group|d", "phase [deg]|.1f", "std. error [deg]|.1f")
    yield Section("Phases", (meaning, by_head(heads, phases)))
    tests = [
        (named(source), float(wide), None if np.isnan(chance) else float(chance))
        for source, wide, chance in zip(problem.sources, found.consistency, found.agreement, strict=True)
    ]
    meaning = (
        "Variance ratio: how much single seconds differ, by how much noise explains; above 1 it widens the "
        "interval. p: probability that the runs differ so much by chance."
    )
    table = by_head(("Source", "variance ratio|.2f", "p between runs|.2g"), tests)
    yield Section("Does each source explain the vibration wherever it should?", (meaning, table))
    sd = np.sqrt(np.diag(found.covariance))[: len(place.changes)]
    before = np.sqrt(np.diag(problem.prior.covariance))
    numbers = [
        (name, 100 * np.expm1(change), 100 * own, 100 * prior)
        for name, change, own, prior in zip(problem.prior.groups, place.changes, sd, before, strict=True)
    ]
    heads = "Number", "change [%]|+.2f", "std. error [%]|.2f", "before [%]|.2f"
    yield Section("Stiffness and damping", (by_head(heads, numbers),))
    errors = np.sqrt(np.diag(found.covariance))[len(place.changes) :][: place.clock.size].reshape(place.clock.shape)
    groups = zip(problem.runs, place.clock, errors, strict=True)
    clocks = [(run.name, 1e3 * offset, 1e3 * o, 1e6 * rate, 1e6 * r) for run, (offset, rate), (o, r) in groups]
    heads = "Run", "offset [ms]|.2f", "std. error [ms]|.2f", "rate [1e-6]|.0f", "std. error [1e-6]|.0f"
    yield Section("Clocks, beyond a delay that was found from the motion", (by_head(heads, clocks),))
    traces = [
        (channel.name, channel.rate, 100 * share, *np.degrees(tilt), 100 * (problem.factor(k, place) - 1))
        for k, (channel, share, tilt) in enumerate(zip(problem.channels, found.explained, place.tilt, strict=True))
    ]
    tilts = "tilt [deg]|.2f", "tilt, other way [deg]|.2f"
    heads = "Trace", "samples a second|.4g", "explained [%]|.1f", *tilts, "calibration [%]|+.2f"
    yield Section("Traces", (by_head(heads, traces),))

    if study.causes:
        yield _cause_section(study.causes)
    if study.further:
        rows = [
            (named(each.source), *(100 * float(sd[k]) / each.amplitude for sd in study.further.values()))
            for k, each in enumerate(found.estimates)
        ]
        table = by_head(("Source", *(f"{speed:g} %|.1f" for speed in study.further)), rows)
        yield Section("Std. error [%] of each amplitude with a further run, by its speed", (table,))
    if tried := study.tried():
        yield tried_section(tried)
    if study.held:
        predicted = []
        for each in study.held:
            sizes = float(np.abs(each.shown).max()), *np.quantile(each.peaks, (0.025, 0.975)).tolist()
            predicted.append((each.channel.name, 100 * each.explained, 100 * (each.ratio - 1), *sizes))
        sizes_of = "largest, measured|.4g", "2.5 %|.4g", "97.5 % of draws|.4g"
        table = by_head(("Trace", "predicted [%]|.1f", "rms [%]|+.1f", *sizes_of), predicted)
        yield Section("Runs that were left out (SI; the measured ones with their noise)", (table,))


def said(cause: "Cause") -> str:
    """Name a cause: `a fixed frequency at 9.50 Hz`, `transmission error (drive2, order 2)`."""
    if cause.source is None:
        return f"{CAUSES[cause.kind]} at {cause.frequency:.2f} Hz"
    order = f", order {cause.source.order:g}" if cause.source.of_error else ""
    return f"{CAUSES[cause.kind]} ({cause.source.drive}{order})"


def cause_finding(causes: "Causes", usable: bool) -> Finding:
    """Name the cause of a peak, or the run that would determine it; say whether the runs are in doubt."""
    first, *others = causes.causes
    at = f"peak at {causes.peak:g} Hz"
    if not causes.explained:
        what = "none of the causes tested explains it"
        return Finding(f"{at}: {what} ({100 * (1 - causes.left):.0f} % at most)", "look at the trace with ident triage")
    if causes.told:
        beside = f"; led by {said(others[0])}: {100 * max(0.0, others[0].predicted):.0f} %" if others else ""
        all_of_them = f"with lesser causes {100 * first.predicted:.0f} % of blocks left out are predicted{beside}"
        sure = "largest cause" if usable else "largest cause, if the runs are right,"
        return Finding(f"{at}: {sure} {said(first)}, {100 * first.share:.0f} % of its energy ({all_of_them})")
    rival = max(others, key=lambda cause: max(cause.evidence, cause.held_out))
    remedy = f"add a run at {causes.speed:g} %" if causes.speed else "add a sensor elsewhere, or a longer run"
    return Finding(f"{at} cannot be told: {said(first)} or {said(rival)}", remedy)


def _cause_section(causes: "Causes") -> Section:
    rows = [
        (said(each), *(100 * x for x in (each.share, each.explained, each.predicted, each.evidence, each.held_out)))
        for each in causes.causes
    ]
    shares = "own", "set explains", "set predicts", "p by evidence", "p by prediction"
    low, high = causes.band
    untested = [f"{CAUSES[kind]}: not tested, {why}." for kind, why in causes.untested.items()]
    text = (
        f"Shares [%] of the energy from {low:.3g} to {high:.3g} Hz, noise included, by a cause and by the best set of "
        "causes in which it is the largest; predicted: of blocks that were left out. p [%]: that it is the largest."
    )
    table = by_head(("Largest cause", *(f"{each}|.0f" for each in shares)), rows)
    return Section(f"What makes the peak at {causes.peak:g} Hz?", (text, *untested, table))


def source_rows(study: "SourceStudy") -> list[dict[str, Any]]:
    """Return a row for each source [SI]."""
    return [
        {name: getattr(each.source, name) for name in ("drive", "kind", "order")}
        | {"amplitude": each.amplitude * unit_of(each.source)}
        | {"sd": each.sd * unit_of(each.source) if study.usable else np.nan, "phase": each.phase[0]}
        | {"phase_sd": each.phase_sd[0] if study.usable else np.nan, "told": each.told and study.usable}
        for each in study.found.estimates
    ]


# -------- Planned runs
# What they would determine, and the next run to record (`ident plan --runs`).


def run_plan_sections(plan: "RunPlan") -> Report:
    """Return what planned runs would determine, and which further run would add most."""
    problem, count = plan.problem, len(plan.problem.sources)
    what = f"{counted(len(problem.runs), 'run')}, {counted(len(problem.channels), 'trace')}"
    told, sized = len(plan.told), plan.sized
    words = f"{told} of the {sized} sources that the arm's file has would be told"
    words += f" (noise {100 * plan.noise:g} % of each trace's peak, assumed; errors of the model come on top)."
    if told == sized:
        verdict = Verdict("SUFFICIENT", words, "good")
    else:
        verdict = Verdict(f"PARTLY {told} OF {sized}" if told else "NOT SUFFICIENT", words, "caution")
    rows = []
    for k, source in enumerate(problem.sources):
        size, unit = size_of(problem.masses, source)
        own = float(plan.amplitude[k])
        said = f"{size * own:.4g}" if own else "not given"
        answer = ("yes" if own > plan.least[k] else "no") if own else "above least told"
        rows.append((named(source), said, f"{size * plan.sd[k]:.3g}", f"{size * plan.least[k]:.3g}", unit, answer))
    note = "Least told: a 95 % interval is half of the amplitude either way. Stiffness known to 10 % before (assumed)."
    further = [
        (f"{x.speed:g} %, {x.part}", f"{x.point} {x.direction}", x.gain, ", ".join(map(named, plan.also(x))) or None)
        for x in plan.further
    ]
    heads = "Run", "sensor", "gain [nat]|.1f", "tells also"
    first, every = (by_head(heads, own, "Further runs, one sensor each") for own in (further[:LISTED], further))
    table = by_head(("Source", "in the file", "std. error", "least told", "unit", "told?"), rows, note=note)
    return Report(
        f"Planned runs of {cut(problem.arm.name, 40)}: {what} of {count} possible sources",
        verdict,
        (table, first) if further else (table,),
        next="measure them, then: ident source {runs} --arm {arm}",
        details=(Section("Further runs", (every,)),) if further else (),
    )


def run_plan_rows(plan: "RunPlan") -> list[dict[str, Any]]:
    """Return a row for each source [SI]."""
    sources, units = plan.problem.sources, np.array([unit_of(source) for source in plan.problem.sources])
    what = {name: [getattr(source, name) for source in sources] for name in ("drive", "kind", "order")}
    sizes = {"amplitude": plan.amplitude * units, "sd": plan.sd * units, "least": plan.least * units}
    return by_row(**what, **sizes, told=[source in plan.told for source in sources])
