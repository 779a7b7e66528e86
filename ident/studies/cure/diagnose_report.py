"""The report of a diagnosis, the line of each finished stage, and the table."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arm.multibody import IMBALANCE, exciting_orders
from ident.inference.information import chi_squared_in_words
from ident.report.report import Finding, Part, Report, Section, Table, Verdict, by_head, short_power
from ident.report.words import (
    MM,
    arc_seconds,
    beside,
    counted,
    in_shown_unit,
    is_stiffness,
    joined,
    percent,
    rounded,
    sentence,
)
from ident.studies.basis import (
    GUESSED,
    assumed,
    basis_findings,
    gear_words,
    subject,
    transmission_finding,
    without_transmission_error,
)
from ident.studies.cause.source_report import estimates, source_findings, source_verdict
from ident.studies.cure.balance_report import needs_words
from ident.studies.cure.cures import SHARES
from ident.studies.cure.design_report import risen, sensitivity_table
from ident.studies.cure.remedies import AND, CONFIDENT, EFFORTS, FINER, MOVED, STIFFER, VERIFIED, Remedy
from ident.studies.stiffness.validate_report import scope_table
from ident.studies.stiffness.warnings import untested
from ident.studies.working.resonance_report import caused_words, crossings_table, grouped, passages_table
from ident.vibrate.variable import is_shifted

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.identify.validate import Validation
    from ident.studies.cause.source_study import SourceStudy
    from ident.studies.cure.diagnosis import Diagnosis, Identification, ResonanceAssessment
    from ident.studies.cure.remedies import Verification, VibrationAssessment
    from ident.vibrate.binomial import BinomialEstimate
    from ident.vibrate.sweep import Sensitivities

# -------- Remedy words
# Remedies as instructions.


def change_words(remedy: Remedy) -> str:
    """Write the change of a remedy as an instruction, without parts that would print as 0 % or 0 mm."""
    words = ["set the speed along the path"] if remedy.schedule else []
    if remedy.percent != remedy.percent_before:
        words += [f"run at {remedy.percent:.3g} % of full speed instead of {remedy.percent_before:.3g} %"]
    for rotor in remedy.rotors:
        mass = joined([f"{1e3 * body.mass:.3g} g at {np.degrees(body.angle):.0f} deg" for body in rotor.bodies])
        words += [f"mount {mass}, {MM * rotor.pulley.radius:.3g} mm from the axis, on {spaced(rotor.drive.name)}"]
    stiffer, moved, finest = [], [], 0.0
    for path, value in remedy.values.items():
        before = remedy.before[path]
        if is_shifted(path):
            where = f"the mass centre of {spaced(path)} by {MM * (value - before):+.0f} mm in {path[-1]}"
            moved += [where] if abs(value - before) > 0.0005 else []
        elif not is_stiffness(path):
            finest = max(finest, arc_seconds(value))
        elif abs(more := value / before - 1) > 0.005:
            stiffer.append(f"{spaced(path)} {100 * abs(more):.0f} % {'stiffer' if more > 0 else 'softer'}")
    words += [f"take drives with a transmission error of {finest:.2g} arc seconds peak to peak"] if finest else []
    words += [f"make {joined(stiffer)} in torsion"] if stiffer else []
    words += [f"move {joined(moved)}"] if moved else []
    return joined(words) or "change nothing"


def spaced(path: str) -> str:
    """Return the spoken name of a part, from a path: joint 1."""
    return re.sub(r"(?<=[a-z])(?=\d+$)", " ", path.split(".")[0])


# -------- Diagnose


def diagnose_sections(diagnosis: "Diagnosis") -> Report:
    """Return the report of a finished diagnosis; the details have a section for each stage, and the assumptions."""
    basis, verdict = diagnosis.task.basis, judged(diagnosis)
    return Report(
        f"Diagnosis of {subject(basis)}",
        verdict,
        tuple(f"{label + ':':8s} {sentence(text)}" for label, text in cause_and_remedies(diagnosis)),
        tuple(_cautions(diagnosis)),
        f"Model: {of_model(diagnosis)}.",
        _next(diagnosis, verdict),
        tuple(
            Section(title, tuple(of(diagnosis)))
            for title, of in [*map(_DETAILS.__getitem__, diagnosis.stages), ("What is assumed", _assumptions)]
        ),
    )


def _assumptions(diagnosis: "Diagnosis") -> Iterator[str]:
    origins = [origin for origin in diagnosis.task.basis.arm_file.origins.values() if origin != "derived"]
    guessed = f"{sum(origin in GUESSED for origin in origins)} of the {len(origins)} numbers in the arm file"
    yield f"{guessed} are assumed or calibrated; amplitudes are no better than these."
    yield "Links, fingers and payload are rigid; bushings are linear; belts are rigid."
    yield "The priors of the fit and the sigmas of the campaign are as given; the model itself is taken as correct."
    yield "A change leaves all other numbers as they are: a stiffer drive weighs the same, a body keeps its inertia."
    yield "Draws are simulated by the fast method, linearised about the quasi-static deflection."


def judged(diagnosis: "Diagnosis") -> Verdict:
    """Judge the arm: OK if accepted, NOT DECIDED if data or draws do not decide, else NOT OK."""
    vibration = diagnosis.vibration
    peak, limit = float(vibration.peak.max()), vibration.limit
    size = f"{beside(MM * peak, MM * limit)} mm"
    chance = f"it is kept with probability {chance_words(vibration.keeps)} (95 % interval)"
    compared = f"{size} {'is within' if peak <= limit else 'exceeds'} {limit_words(vibration)}"
    end = f"; {gears}." if (gears := gear_words(diagnosis.task.basis)) else "."
    if diagnosis.in_doubt:
        doubtful, excited = bool(diagnosis.identification.sampled.fitted.doubts), diagnosis.excited
        what = "The fit is in doubt." if doubtful or not excited else source_verdict(excited.study).reason
        reason = f"{what} All that follows is in doubt: with the fitted values {compared}; {chance}{end}"
        return Verdict("NOT DECIDED", reason, "caution")
    if vibration.accepted:
        return Verdict("OK", f"{compared}; {chance}{end}", "good")
    if peak <= limit:
        asked = f"{100 * CONFIDENT:g} % is required"
        return Verdict("NOT DECIDED", f"{compared}, but not safely: {chance}, {asked}{end}", "caution")
    return Verdict("NOT OK", f"{compared}; {chance}{end}", "bad")


def limit_words(vibration: "VibrationAssessment") -> str:
    """Write the limit, and which vibration it is for."""
    limit = f"the limit of {MM * vibration.limit:g} mm"
    return limit + " for what is left after the dwell" * (vibration.measure == "settled")


def chance_words(estimate: "BinomialEstimate") -> str:
    """Write the 95 % interval of a probability, rounded outwards: `96 to 100 %`."""
    return f"{math.floor(100 * estimate.interval[0])} to {math.ceil(100 * estimate.interval[1])} %"


def cause_and_remedies(diagnosis: "Diagnosis") -> Iterator[tuple[str, str]]:
    """Yield the main cause of the vibration and the remedies, each with its label: Cause, Remedy, or."""
    itself = "the motion itself; no drive comes near a natural frequency"
    cause = _resonant(diagnosis.resonance, diagnosis.task.basis.arm) or contribution_words(diagnosis) or itself
    yield "Cause", cause
    best, verified = diagnosis.advised, diagnosis.verified
    if best is None or verified is None:
        return
    size = beside(MM * verified.largest, MM * verified.limit)
    outcome = f"{size} mm, limit kept with probability {chance_words(verified.keeps)}"
    if not (best.meets_limit and verified.holds):
        tried, count = len(diagnosis.remedies), len(diagnosis.verifications)
        held = f"none of the {count} remedies verified holds" if count > 1 else "the one remedy verified does not hold"
        none = held if best.meets_limit else f"none of the {tried} remedies tried keeps the limit"
        yield "Remedy", f"{none}; the best: {change_words(best)}: {outcome}"
        return
    rises = "".join(f"; {each}" for each in risen(diagnosis.vibration.peak, verified.amplitude, verified.limit))
    yield "Remedy", f"{_offer(diagnosis, best)}: {outcome} (exact equations and fresh draws){rises}"
    further = diagnosis.remedies[len(diagnosis.verifications) :]
    balanced = next((each for each in diagnosis.remedies if each.kind == "balance"), None)
    if balanced is None and best.effort != EFFORTS["torsion"] and cause.startswith(IMBALANCE):
        yield "or", f"{EFFORTS['balance']}: balance that drive ({_unbalanced(diagnosis)})"
    offers = [each for each in further if each.meets_limit or each is balanced]
    others = {each.effort: each for each in reversed(offers) if each.effort != best.effort}  # the first of each
    for other in sorted(others.values(), key=offers.index):
        size = f"{beside(MM * other.largest, MM * diagnosis.task.limit)} mm"
        size += f", limit kept with probability {chance_words(other.keeps)}"
        by = "fast method and the search's own draws, not verified"
        yield "or", f"{_offer(diagnosis, other)}: {size} ({by})"


def _unbalanced(diagnosis: "Diagnosis") -> str:
    """Say why balancing was not computed."""
    if diagnosis.excited is None:
        return "not computed: give --runs, see ident source"
    for rotor in diagnosis.excited.balance.rotors if diagnosis.excited.balance else ():
        if rotor.state == "does not fit":
            return f"{needs_words(rotor)}; give --radius"
        if rotor.state in ("cannot be told", "trials contradict"):
            return f"{rotor.drive.name}: {rotor.state}; see ident balance"
    return "not computed: see ident balance"


def _has_schedule(diagnosis: "Diagnosis") -> bool:
    """Whether `ident motion` accepts the motion: a stroke of an arm with exciting drives, or a path that was tried."""
    basis = diagnosis.task.basis
    return bool(basis.arm.drives) and (not basis.log or any(each.schedule for each in diagnosis.remedies))


def _offer(diagnosis: "Diagnosis", remedy: Remedy) -> str:
    return f"{remedy.effort}: {change_words(remedy)}{_numbers(diagnosis, remedy)}"


def _resonant(resonance: "ResonanceAssessment", arm: "Arm") -> str:
    """Name the drives that meet a natural frequency and cause most vibration by that; empty if none does."""
    groups = grouped(resonance.crossings)
    if not groups:
        return ""
    first, exciting = groups[0][0], exciting_orders(arm)
    drives: dict[str, list[str]] = {}
    for crossing in groups[0]:
        at = crossing.source.drive, crossing.source.order
        kinds = ["transmission error" if e.of_error else "imbalance" for e in exciting if (e.drive, e.order) == at]
        kind = " and ".join(kinds) or f"order {crossing.source.order:g}"
        drives.setdefault(kind, []).append(spaced(crossing.source.drive))
    who = joined([f"{kind} of {joined(names)}" for kind, names in drives.items()])
    natural = f"{first.natural:.2f} Hz"
    off = f"excites {first.label} ({natural}, {percent(first.relative_distance)} off)"
    does = f"({natural}) excites {first.label}" if first.crossings else off
    return f"{who} {does}, {first.time:.1f} s into the motion: {caused_words(groups[0])} by itself"


def _numbers(diagnosis: "Diagnosis", remedy: Remedy) -> str:
    """Write the number that a remedy changes, the duration of the motion with it, and the remaining vibration."""
    words, time = [], diagnosis.task.basis.motion.arrival
    if len(remedy.values) == 1:
        ((path, value),) = remedy.values.items()
        (before, unit), (after, _) = (in_shown_unit(path, number) for number in (remedy.before[path], value))
        words.append(short_power(f"{before:.3g} to {after:.3g} {unit}"))
    if remedy.schedule or remedy.percent != remedy.percent_before:
        words.append(f"{remedy.time:.3g} s instead of {time:.3g} s")
    slower = next((each for each in diagnosis.remedies if each.kind == "speed" and each.meets_limit), None)
    if remedy.kind == "schedule" and slower:
        words.append(f"at one lower speed {slower.time:.3g} s")
    if remedy.rotors and diagnosis.excited and diagnosis.excited.balance:
        words.append(f"transmission error, {rounded(MM * diagnosis.excited.balance.errors)} mm, stays")
    return f" ({'; '.join(words)})" if words else ""


def of_model(diagnosis: "Diagnosis") -> str:
    """Say how well the model is determined, and how well it predicts unmeasured postures."""
    fit, validation = diagnosis.identification.sampled.fitted, diagnosis.validation
    fixed = f"{fit.information.fixed} of {len(fit.information.names)} combinations determined"
    far = f"; unmeasured postures predicted {scope_words(validation)}" if validation.told else ""
    told = f"; {source_line(diagnosis.excited.study)}" if diagnosis.excited else ""
    return f"{fixed} ({chi_squared_in_words(fit)}){far}{told}"


def _next(diagnosis: "Diagnosis", verdict: Verdict) -> str:
    fit = diagnosis.identification.sampled.fitted
    if fit.doubts:
        return "ident fit {campaign}"
    if diagnosis.in_doubt:
        return "ident source {runs} --arm {arm}"
    weak = fit.information.fixed < len(fit.information.names) or diagnosis.beyond or diagnosis.validation.missed
    if verdict.kind == "bad" or not (weak or verdict.kind == "good"):
        return remedy_command(diagnosis)
    return "ident plan {campaign}" if weak else ""


def remedy_command(diagnosis: "Diagnosis") -> str:
    """Return the command that carries out the remedy that holds, on the medians of the draws; else a search."""
    basis, best = diagnosis.task.basis, diagnosis.advised
    study, sets = "motion" if _has_schedule(diagnosis) else "design", dict(basis.changed)  # the former changes no part
    changed = ""
    if best and diagnosis.verdict == "warn":
        if best.rotors:
            return "ident source {runs} --arm {arm}"  # and ident balance with its result
        study, sets = "motion" if best.schedule else "simulate", sets | best.values
        changed = f" --speed {best.percent:g}" * (best.percent != basis.percent)
    changed += "".join(f" --set {path}={value:.6g}" for path, value in sets.items())
    wanted = "--settled" if diagnosis.task.measure == "settled" else "--limit"
    if study == "design" and wanted == "--settled":  # it has no such option; more is after the arrival than the dwell
        wanted = "--measure residual --limit"
    return f"ident {study} {{arm}} {wanted} {MM * diagnosis.task.limit:g} --posterior {{result}}.nc{changed}"


def _cautions(diagnosis: "Diagnosis") -> Iterator[Finding]:
    """Yield the limits of a diagnosis that the measurements do not cover, most important first."""
    basis, fit = diagnosis.task.basis, diagnosis.identification.sampled.fitted
    fixed, count = fit.information.fixed, len(fit.information.names)
    for doubt in fit.doubts:
        yield Finding(doubt.replace("; see below", "").replace("see below", "see ident fit"), "see `ident fit`")
    if not fit.doubts:
        yield from untested(fit)
    if diagnosis.excited:
        yield from _of_runs(diagnosis, diagnosis.excited.study)
    if diagnosis.validation.missed:
        named = ", ".join(part.name for part in diagnosis.validation.missed)
        yield Finding(f"the other postures do not predict {named}", "check these measurements, then the arm file")
    if diagnosis.identification.short:
        yield Finding("the sampler's chains are too short", "take intervals and probabilities as rough")
    if fixed < count:
        text = f"{fixed} of {count} combinations are determined; the prior fills the rest"
        yield Finding(text, "measure what `ident plan` proposes")
    if diagnosis.beyond:
        *others, worst = sorted(diagnosis.beyond, key=lambda name: diagnosis.beyond[name])
        who = f"{worst} {np.degrees(diagnosis.beyond[worst]):.0f} deg"
        who += f" (and {counted(len(others), 'other joint')} less)" if others else ""
        text = f"the motion turns {who} beyond all measured postures; the model is not tested there"
        yield Finding(text, "measure in a posture of the motion")
    yield from basis_findings(basis)
    drawn = {*basis.unknown.phases, *basis.unknown.errors}
    taken = [path for path in assumed(basis)[0] if path not in drawn]
    if taken:
        text = f"{counted(len(taken), 'number')} of drives, belts and stroke are assumed and not varied"
        each, remedy = diagnosis.sensitivities, "measure them"
        strongest = next((i for i in each.order if each.paths[i] in taken), None)
        if strongest is not None:
            share = each.elasticity[strongest, int(np.argmax(each.amplitude))]
            remedy = f"measure {each.paths[strongest]} first (vibration {share:+.2g} % per percent)"
        yield Finding(text, remedy)
    if without_transmission_error(basis):
        yield from transmission_finding(basis)


def _of_runs(diagnosis: "Diagnosis", study: "SourceStudy") -> Iterator[Finding]:
    yield from source_findings(study)
    known = diagnosis.identification.sampled.fitted.problem.parameters.names
    if held := [name for name in known if name not in study.found.problem.prior.groups]:
        yield Finding(f"with runs {', '.join(held)} counts as exact, at its median")
    if len(study.found.place.parts) == 1:
        remedy = "add a run after homing again, as another group"
        yield Finding("one group of runs: whether the pulleys keep their angles is not known", remedy)


# -------- Stages


@dataclass(frozen=True)
class StageReport:
    """Progress report of a finished stage.

    Attributes:
        number: of the stage, from 1.
        count: number of stages, as far as known: remedies are only searched if the vibration is not accepted.
        name: of the stage.
        result: its result, in a line.
        resumed: whether an earlier run had finished it.
    """

    number: int
    count: int
    name: str
    result: str
    resumed: bool = False

    def __str__(self) -> str:
        return f"{self.number}/{self.count} {self.name}: {self.result}{' (from an earlier run)' * self.resumed}"


def stiffness_line(identification: "Identification") -> str:
    """Say in a line how well the stiffnesses are known."""
    fit = identification.sampled.fitted
    doubt = "; IN DOUBT" if fit.doubts else ""
    return f"{fit.information.fixed} of {len(fit.information.names)} combinations determined{doubt}"


def _stiffness(diagnosis: "Diagnosis") -> Iterator[Part]:
    identified = diagnosis.identification
    fit, withheld = identified.sampled.fitted, bool(identified.sampled.withheld)
    rows = []
    for name, ends in zip(fit.problem.parameters.names, identified.quantiles.T, strict=True):
        low, median, high = (short_power(f"{in_shown_unit(name, float(end))[0]:#.4g}") for end in ends)
        interval = "not reported" if withheld else f"{low} to {high}"
        rows.append((name, median, interval, in_shown_unit(name, 1.0)[1]))
    note = "The chains are too short: the intervals are rough." if identified.short else ""
    note += " No interval is reported, as the fit is in doubt." * withheld
    yield Table("Posterior", ("number", "median", "95 % interval", "unit"), tuple(rows), note=note.strip())


def source_line(study: "SourceStudy") -> str:
    """Say in a line what the runs determine about the sources."""
    if not study.usable:
        return "the runs are NOT USABLE"
    runs = counted(len(study.found.problem.runs), "run")
    return f"{study.told} of {len(study.found.estimates)} sources of vibration determined by {runs}"


def _source(diagnosis: "Diagnosis") -> Iterator[Part]:
    assert diagnosis.excited is not None
    yield source_verdict(diagnosis.excited.study).reason
    yield estimates(diagnosis.excited.study)


def trust_line(validation: "Validation") -> str:
    """Say in a line how well postures are predicted from the others."""
    if not validation.told:
        return "no posture can be predicted from others"
    return f"{validation.covered} of {len(validation.z)} measurements within the interval predicted from other postures"


def _trust(diagnosis: "Diagnosis") -> Iterator[Part]:
    validation = diagnosis.validation
    if not validation.told:
        yield "No posture can be predicted from others: that takes two postures or more, one with enough information."
        return
    yield (
        f"Each of {len(validation.parts)} postures is predicted from the others: {validation.covered} of "
        f"{len(validation.z)} measurements lie in the 95 % interval of their prediction."
    )
    if diagnosis.beyond:
        joints = ", ".join(f"{name} {np.degrees(by):.0f} deg" for name, by in diagnosis.beyond.items())
        yield f"The motion turns {joints} beyond all measured postures."
    yield from scope_table(validation)


def scope_words(validation: "Validation") -> str:
    """Say how well each kind of measurement is predicted: `within 1.5 % in frequency`."""
    return ", ".join(f"within {percent(s.half)} in {s.kind.replace('_', ' ')}" for s in validation.scopes)


def resonance_line(resonance: "ResonanceAssessment", arm: "Arm") -> str:
    """Say in a line which drive comes nearest to a natural frequency."""
    return _resonant(resonance, arm) or "no drive comes near a natural frequency"


def _resonance(diagnosis: "Diagnosis") -> Iterator[Part]:
    resonance, changed = diagnosis.resonance, diagnosis.task.basis.changed
    yield from (f"Set from here on: {path} = {value:g}." for path, value in changed.items())
    if resonance.branches is None:
        yield "The arm file has no [[drive]]: only the motion itself excites the arm."
    elif not resonance.crossings:
        yield "No pulley comes near a natural frequency along this motion."
    else:
        groups = grouped(resonance.crossings)
        yield crossings_table(resonance.branches, groups)
        yield passages_table(resonance.branches, groups)
        yield (
            "vibration: of the end point along the mode's motion, by these pulleys alone with the worst phases. "
            "built up: over the amplitude of steady resonance. near, cross: share of the draws."
        )


def vibration_line(vibration: "VibrationAssessment") -> str:
    """Say in a line how much the arm vibrates."""
    kept = f"kept by {vibration.keeps.count} of {vibration.keeps.draws} draws"
    return f"{beside(MM * vibration.peak.max(), MM * vibration.limit)} mm, limit {MM * vibration.limit:g} mm, {kept}"


def _vibration(diagnosis: "Diagnosis") -> Iterator[Part]:
    vibration, peak = diagnosis.vibration, diagnosis.vibration.peak
    if vibration.phases is not None:
        over = vibration.phases.peaks[int(vibration.phases.worst.argmax())]
        yield (
            f"The imbalance phases are unknown: over random phases the peak is {MM * over.min():.3g} to "
            f"{MM * over.max():.3g} mm; {100 * CONFIDENT:g} % of them do not exceed the peak below."
        )
        yield sentence(contribution_words(diagnosis))
    kept = f"{vibration.keeps.count} of {vibration.keeps.draws} draws of the posterior"
    kept += " and of the phases" * (vibration.phases is not None)
    yield f"The limit is kept by {kept} (95 % interval of the probability: {chance_words(vibration.keeps)})."
    if vibration.owed_to_damping:
        share = percent(vibration.owed_to_damping)
        yield f"The uncertainty of the damping accounts for {share} of the variance of the vibration over these draws."
    rows = tuple(
        (direction, MM * at, f"{MM * low:.3f} to {MM * high:.3f}")
        for direction, at, low, high in zip(
            "xyz", peak, *np.quantile(vibration.draws, (0.05, 0.95), axis=1), strict=True
        )
    )
    note = "Displacement of the end point from its quasi-static position. Draws: by the fast method."
    if vibration.phases is not None:
        exceed = f"{100 * CONFIDENT:g} % of all phases do not exceed."
        note += f" Each draw has random phases; the exact peak has phases that {exceed}"
    yield by_head(("direction", "exact|.3f", "5 to 95 % of the draws"), rows, "Largest vibration [mm]", note)


def contribution_words(diagnosis: "Diagnosis") -> str:
    """Say what causes the vibration at the worst phases; empty if all phases are known."""
    over = diagnosis.vibration.phases
    if over is None:
        return ""
    way = int(over.worst.argmax())
    least = 0.005 * over.worst[way]
    motion, imbalance, error = (
        f"below {rounded(MM * least, 1)} mm" if part < least else f"{rounded(MM * part)} mm"
        for part in over.division[:, way]
    )
    errors = "not modelled (set to 0)" if without_transmission_error(diagnosis.task.basis) else error
    worst = beside(MM * over.worst[way], MM * diagnosis.vibration.limit)
    return (
        f"contributions to the {worst} mm at the worst phases: drive imbalance {imbalance}, motion {motion}, "
        f"transmission error {errors}"
    )


def sensitivities_line(sensitivities: "Sensitivities") -> str:
    """Say in a line which numbers matter most."""
    return f"most on {joined([sensitivities.paths[i] for i in sensitivities.order[:3]])}"


def _sensitivities(diagnosis: "Diagnosis") -> Iterator[Part]:
    sensitivities = diagnosis.sensitivities
    column = int(np.argmax(sensitivities.amplitude))
    percents = ", ".join(f"{sensitivities.elasticity[i, column]:+.2g}" for i in sensitivities.order[:3])
    yield (
        f"The vibration is largest in {'xyz'[column]}. It depends {sensitivities_line(sensitivities)}: {percents} % "
        "per percent of the number."
    )
    yield "Drive ratios and masses shift a resonance along the path; they can rarely be chosen."
    yield sensitivity_table(sensitivities)


def remedies_line(remedies: Sequence[Remedy]) -> str:
    """Say in a line how many remedies keep the limit."""
    good = sum(remedy.meets_limit for remedy in remedies)
    return f"{good} of {len(remedies)} remedies keep the limit with probability {100 * CONFIDENT:g} % or more"


def _remedies(diagnosis: "Diagnosis") -> Iterator[Part]:
    yield f"{remedies_line(diagnosis.remedies)}."
    moved = f" mass centres of the last joint's bodies moved by {100 * MOVED:g} % of their length,"
    path = (
        f" speeds along the path with an order of a pulley at {100 * SHARES[0]:g} to {100 * SHARES[-1]:g} % of the "
        "first natural frequency (`ident motion` searches the speed of each segment, and may find a quicker one),"
    )
    softer = f"from 1/{STIFFER:g} " * diagnosis.task.softer
    finer = f" transmission errors down to 1/{FINER:g}," * bool(diagnosis.task.errors)
    yield (
        f"Tried: torsional stiffness {softer}up to {STIFFER:g} times,{moved * bool(diagnosis.task.centres)}"
        f"{finer}{path * _has_schedule(diagnosis)} speeds from half to one and a half times, not above full speed. "
        "These ranges are assumed."
    )
    if any(AND in each.kind for each in diagnosis.remedies):
        yield "No remedy keeps the limit alone: the best of each effort were combined, two at a time."
    rows = []
    for rank, each in enumerate(diagnosis.remedies, 1):
        numbers = f"{100 * each.keeps.share:.3g} %", each.frequency, MM * each.deflection, each.change_norm
        rows.append((str(rank), change_words(each), each.effort, MM * each.largest, *numbers))
    effects = "vibration [mm]|.3f", "keeps limit", "first mode [Hz]|.2f", "deflection [mm]|.1f", "size [-]|.2f"
    note = (
        "Ranking: what keeps the limit first (software, screwdriver, new part, two of them; the quickest and smallest "
        "change of each), then what vibrates least. Size: change relative to the largest allowed; of time, in powers "
        "of two. First mode and deflection are side effects, the worse of both ends of the motion."
    )
    strong = tuple(i for i, remedy in enumerate(diagnosis.remedies) if remedy.meets_limit)
    yield by_head(("rank", "change", "effort", *effects), rows, "Remedies", note, strong)


def verification_line(advised: Remedy, verified: "Verification") -> str:
    """Say in a line what the advised remedy achieves."""
    size, keeps = f"{beside(MM * verified.largest, MM * verified.limit)} mm", verified.keeps
    return f"{change_words(advised)}: {size}, limit kept by {keeps.count} of {keeps.draws} fresh draws"


def _verification(diagnosis: "Diagnosis") -> Iterator[Part]:
    remedy, verified, verifications = diagnosis.advised, diagnosis.verified, diagnosis.verifications
    assert remedy is not None
    assert verified is not None
    yield (
        "The first remedy is simulated by the exact equations, and with fresh draws that had no part in choosing it; "
        f"if it does not hold, the next one, {VERIFIED} at most."
    )
    rows = []
    for tried, check in zip(diagnosis.remedies, verifications, strict=False):
        kept = f"{check.keeps.count} of {check.keeps.draws}", chance_words(check.keeps)
        limit = "kept" if check.largest <= check.limit else "NOT kept"
        rows.append((change_words(tried), f"{MM * check.largest:.3g}", limit, *kept))
    note = f"Probability: 95 % interval; {100 * CONFIDENT:g} % is required of the draws."
    if len(verifications) > 1:
        note += " All were verified with the same draws, so the draws have had a part in choosing among them."
    heads = "change", "exact [mm]", "limit", "kept by draws", "probability"
    yield by_head(heads, rows, "Verified remedies", note)
    title = "What to change" if verified.holds else "What the first of them changes"
    if remedy.schedule:
        stroke = None if diagnosis.task.basis.log else diagnosis.task.basis.arm.stroke
        columns = {"alpha [deg]|.1f": np.degrees(remedy.schedule.places)}
        columns["speed [deg/s]|.2f"] = np.degrees(remedy.schedule.speeds)
        if stroke:
            columns["of full speed [%]|.2f"] = 100 * remedy.schedule.speeds / float(stroke.speed)
        alpha = "alpha" if stroke else "alpha, the length of the path in the space of the joint angles,"
        note = f"Between these places {alpha} accelerates evenly; the arrival is after {remedy.time:.2f} s."
        yield by_head(columns, np.stack([*columns.values()], 1).tolist(), f"{title}: speed along the path", note)
    changes = []
    for path, value in remedy.values.items():
        now, unit = in_shown_unit(path, remedy.before[path])
        moved = f"{MM * (value - remedy.before[path]):+.1f} mm"
        change = moved if is_shifted(path) else f"x {value / remedy.before[path]:.3f}"
        changes.append((path, now, in_shown_unit(path, value)[0], change, unit))
    if changes:
        yield by_head(("number", "now|.4g", "after|.4g", "change", "unit"), changes, title)


_DETAILS: Mapping[str, tuple[str, Callable[["Diagnosis"], Iterator[Part]]]] = {
    "stiffness": ("How stiff are the joints?", _stiffness),
    "source": ("What excites the arm?", _source),
    "trust": ("How far can the model be trusted?", _trust),
    "resonance": ("Does a drive meet a natural frequency?", _resonance),
    "vibration": ("How much does the arm vibrate?", _vibration),
    "sensitivities": ("What matters most?", _sensitivities),
    "remedies": ("Which change keeps the limit?", _remedies),
    "verification": ("Does it hold?", _verification),
}
"""The details of each stage, with their title."""


# -------- Rows


def diagnose_rows(diagnosis: "Diagnosis") -> list[dict[str, Any]]:
    """Return a row for each remedy, the best first: its changes and their effect [SI]."""
    verified = [each.holds for each in diagnosis.verifications]
    return [
        {"rank": rank, "kind": each.kind, "effort": each.effort, "change": change_words(each)}
        | {"speed_percent": each.percent, "time": each.time, "amplitude": each.largest}
        | {"probability": each.keeps.share, "first_frequency": each.frequency, "deflection": each.deflection}
        | {"change_norm": each.change_norm, "meets_limit": each.meets_limit}
        | {"verified": verified[rank - 1] if rank <= len(verified) else None}
        for rank, each in enumerate(diagnosis.remedies, 1)
    ]
