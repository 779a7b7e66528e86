"""A diagnosis in words: what each stage says and why it goes on, and the verdict."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.assess.diagnose import Diagnosis
from ident.assess.remedies import CONFIDENT, MOVED, STIFFER, VERIFIED, Remedy, Verification
from ident.identify.compare import Validation
from ident.present.text.basis import UNDRIVEN, assumed
from ident.present.text.design import unsure_words
from ident.present.text.resonance import caused_words, grouped, sources_words
from ident.present.text.words import MM, beside, cut, folded, is_stiffness, percent, rounded
from ident.vibrate.evaluator import BinomialEstimate
from ident.vibrate.resonance import ResonanceCrossing

# -------- Remedy words
# A remedy in words: something to do.

SMALL = 0.005
"""Relative change of a stiffness that is not worth a word."""
SMALL_MOVE = 0.0005
"""Change of a mass centre [m] that is not worth a word."""


def change_words(remedy: Remedy) -> str:
    """Say what a remedy changes, as something to do."""
    if remedy.kind == "speed":
        return f"run at {remedy.percent:.3g} % of full speed instead of {remedy.percent_before:.3g} %"
    stiffer, moved = list(_stiffer(remedy)), list(_moved(remedy))
    words = [f"make {joined(stiffer)} in torsion"] if stiffer else []
    words += [f"move {joined(moved)}"] if moved else []
    return joined(words) or "change nothing"


def _stiffer(remedy: Remedy) -> Iterator[str]:
    """Say how each stiffness changes, by more than is worth a word."""
    for path, value in remedy.values.items():
        more = value / remedy.before[path] - 1
        if is_stiffness(path) and abs(more) > SMALL:
            yield f"{spaced(path)} {100 * abs(more):.0f} % {'stiffer' if more > 0 else 'softer'}"


def _moved(remedy: Remedy) -> Iterator[str]:
    """Say how far each mass centre moves, if that is worth a word."""
    for path, value in remedy.values.items():
        further = value - remedy.before[path]
        if not is_stiffness(path) and abs(further) > SMALL_MOVE:
            yield f"the mass centre of {spaced(path)} by {MM * further:+.0f} mm in {path[-1]}"


def spaced(path: str) -> str:
    """Return the name of a part, by a path, as one says it: joint 1."""
    return re.sub(r"(?<=[a-z])(?=\d+$)", " ", path.split(".")[0])


def joined(words: Sequence[str]) -> str:
    """Return words as a list: a, b and c."""
    return " and ".join([*([", ".join(words[:-1])] if words[1:] else []), *words[-1:]])


# -------- Diagnose

LITTLE = 0.005
"""Share of a vibration that is next to nothing."""


@dataclass(frozen=True)
class StageReport:
    """What a stage says.

    Attributes:
        number: of the stage, from 1.
        title: what it asks.
        findings: what it has come to, a sentence or two each.
        onward: why the next stage follows; may be empty.
        resumed: whether an earlier run had finished it.
    """

    number: int
    title: str
    findings: tuple[str, ...]
    onward: str = ""
    resumed: bool = False

    def __str__(self) -> str:
        head = f"{self.number}. {self.title}{' (as found before)' if self.resumed else ''}"
        arrow = [f"   -> {self.onward}"] if self.onward else []
        return "\n".join(map(folded, [head, *(f"   {line}" for line in self.findings), *arrow]))


def stage_report(diagnosis: Diagnosis, stage: str, *, resumed: bool = False) -> StageReport:
    """Return what a finished stage of a diagnosis says."""
    title, words = _WORDS[stage]
    findings, onward = words(diagnosis)
    return StageReport(list(diagnosis.stages).index(stage) + 1, title, tuple(findings), onward, resumed)


def diagnose_report(diagnosis: Diagnosis) -> str:
    """Return what all stages say, and the verdict."""
    stages = (str(stage_report(diagnosis, stage)) for stage in diagnosis.stages)
    return "\n".join([*stages, folded(verdict_words(diagnosis))])


def verdict_words(diagnosis: Diagnosis) -> str:
    """Say what a finished diagnosis comes to."""
    vibration, best, verified = diagnosis.vibration, diagnosis.advised, diagnosis.verified
    limit, peak = f"{MM * vibration.limit:g} mm", float(vibration.peak.max())
    now, made = f"The end vibrates by up to {beside(MM * peak, MM * vibration.limit)} mm", division_words(diagnosis)
    if best is None or verified is None:
        return f"{now}; the limit of {limit} is kept by {_share(diagnosis, vibration.keeps)}.{made}"
    beyond = f"more than {limit}" if peak > vibration.limit else f"within {limit}, but not surely"
    words = change_words(best)
    change = f"{words[0].upper()}{words[1:]}: that brings it to {beside(MM * verified.largest, MM * verified.limit)} mm"
    share = _share(diagnosis, verified.keeps)
    if diagnosis.verdict == "warn":
        return f"{now}, {beyond}.{made} {change}; the limit is then kept by {share}."
    why = _failure(best, len(diagnosis.verifications))
    return f"{now}, {beyond}, and {why}.{made} {change}, within the limit for {share}."


def _share(diagnosis: Diagnosis, estimate: BinomialEstimate) -> str:
    """Say a probability, and what it leaves out: numbers of the drives that nobody has measured."""
    basis = diagnosis.task.basis
    drawn = {*basis.unknown.phases, *basis.unknown.errors}
    taken = [path for path in assumed(basis)[0] if path not in drawn]
    without = f", with {len(taken)} assumed numbers of drives, belts and stroke taken as they are" if taken else ""
    return binomial_words(estimate, bool(basis.unknown.phases)) + without


def division_words(diagnosis: Diagnosis) -> str:
    """Say what makes the vibration at the worst phases; nothing where all phases are known."""
    over = diagnosis.vibration.phases
    if over is None:
        return ""
    way = int(over.worst.argmax())
    least = LITTLE * over.worst[way]
    motion, imbalance, error = (
        "next to nothing" if part < least else f"{rounded(MM * part)} mm" for part in over.division[:, way]
    )
    none = all(float(drive.error) == 0 for drive in diagnosis.task.basis.arm.drives)
    errors = "kinematic error nothing, as none is assumed" if none else f"kinematic error {error}"
    worst = beside(MM * over.worst[way], MM * diagnosis.vibration.limit)
    return (
        f" Of {worst} mm with the worst phases of the turning masses the motion itself makes {motion}, "
        f"imbalance {imbalance} and {errors}."
    )


def _failure(best: Remedy, verified: int) -> str:
    if not best.meets_limit:
        return "no change tried meets the limit"
    return f"none of the {verified} remedies verified held" if verified > 1 else "the one remedy verified did not hold"


def cautions(diagnosis: Diagnosis) -> Iterator[str]:
    """Say how far a diagnosis holds where the measurements do not bear it."""
    sampled = diagnosis.identification.sampled
    rank, count = sampled.fitted.information.fixed, len(sampled.fitted.information.names)
    if rank < count:
        filled = "the rest comes from the prior, and so do the probabilities"
        yield f"Caution: the measurements fix {rank} of {count} directions only; {filled}."
    if diagnosis.validation.missed:
        named = ", ".join(part.name for part in diagnosis.validation.missed)
        yield f"Caution: the other postures do not predict {named}: the model, or a measurement, is wrong."
    if diagnosis.beyond:
        yield f"Caution: the motion turns {beyond_words(diagnosis)}, where the model is not tested."
    for doubt in sampled.fitted.doubts:
        doubt = doubt.replace("see below", "see ident fit")
        yield f"Caution: {doubt}. What follows holds only as far as the identified numbers do."


def _stiffness(diagnosis: Diagnosis) -> tuple[list[str], str]:
    fit = diagnosis.identification.sampled.fitted
    rank, count = fit.information.fixed, len(fit.information.names)
    findings = [
        f"{len(fit.campaign)} measurements fix {rank} of {count} directions of the unknowns; "
        f"chi-squared {fit.chi_squared:.3g} on {fit.degrees_of_freedom} degrees of freedom."
    ]
    findings += [f"Warning: {doubt.replace('see below', 'see ident fit')}." for doubt in fit.doubts]
    if rank < count:
        findings.append("The other directions are filled by the prior: what follows holds as far as that does.")
    return findings, "How far to trust the model in postures that were not measured is asked of those that were."


def _trust(diagnosis: Diagnosis) -> tuple[list[str], str]:
    validation, onward = diagnosis.validation, "With these numbers the natural frequencies along the motion follow."
    if not validation.told:
        return [
            "Nothing is left out and predicted: that takes two postures or more, of which one tells enough."
        ], onward
    findings = [
        f"Each of {len(validation.parts)} postures left out and predicted by the others: {validation.covered} of "
        f"{len(validation.z)} measurements lie in the 95 % interval of their prediction.",
        f"Where it was not measured the model may be trusted {scope_words(validation)}.",
    ]
    if validation.missed:
        findings.append(f"Warning: too far from the prediction: {', '.join(part.name for part in validation.missed)}.")
    if diagnosis.beyond:
        findings.append(f"Warning: the motion turns {beyond_words(diagnosis)}.")
    return findings, onward


def beyond_words(diagnosis: Diagnosis) -> str:
    """Say how far a motion leaves the measured postures: `joint1 62 deg beyond all postures that were measured`."""
    joints = (f"{name} {np.degrees(by):.0f} deg" for name, by in diagnosis.beyond.items())
    return f"{', '.join(joints)} beyond all postures that were measured"


def scope_words(validation: Validation) -> str:
    """Say how well each kind of measurement is predicted: `within 1.5 % in frequency`."""
    return ", ".join(f"within {percent(s.half)} in {s.kind.replace('_', ' ')}" for s in validation.scopes)


def _resonance(diagnosis: Diagnosis) -> tuple[list[str], str]:
    resonance, changed = diagnosis.resonance, diagnosis.task.basis.changed
    changes = [f"Set from here on: {path} = {value:g}." for path, value in changed.items()]
    if resonance.branches is None:
        return [*changes, UNDRIVEN], "How far the arm vibrates by its motion alone is simulated."
    near = [_near(group) for group in grouped(resonance.crossings)[:4]]
    near = near or ["No pulley comes near a natural frequency along this motion."]
    onward = "How far all of it together moves the end point is simulated."
    return [*changes, *near], onward


def _near(group: Sequence[ResonanceCrossing]) -> str:
    first = group[0]
    plural = "" if len(group) > 1 else "s"
    how = f"cross{plural and 'es'}" if first.crossings else f"come{plural} near"
    who = sources_words([crossing.source for crossing in group])
    return (
        f"{cut(who, 40)} {how} {first.label} ({first.natural:.2f} Hz) between {first.start:.2f} and {first.end:.2f} s, "
        f"which by itself makes {caused_words(group)}."
    )


def _vibration(diagnosis: Diagnosis) -> tuple[list[str], str]:
    vibration = diagnosis.vibration
    peak = vibration.peak
    findings = [
        f"By the exact equations the end point vibrates by up to {MM * peak.max():.3g} mm "
        f"({'xyz'[int(peak.argmax())]}); the limit is {MM * vibration.limit:g} mm.",
        *_over_phases(diagnosis),
        f"The limit is kept by {binomial_words(vibration.keeps, vibration.phases is not None)}.",
    ]
    if vibration.accepted:
        return (
            findings,
            "The vibration is small: nothing needs to be changed. What it depends on follows, to keep it so.",
        )
    return findings, "That is too much, or too likely to be. Which numbers of the arm matter most?"


def _over_phases(diagnosis: Diagnosis) -> Iterator[str]:
    """Say how far the vibration depends on phases that nobody knows, and what makes it."""
    vibration = diagnosis.vibration
    if vibration.phases is None:
        return
    over, way = vibration.phases, int(vibration.phases.worst.argmax())
    low, high = (MM * size for size in (over.peaks[way].min(), over.peaks[way].max()))
    yield (
        f"Nobody knows the phases of the turning masses: over draws of them it is {low:.3g} to {high:.3g} mm, and with "
        f"{100 * CONFIDENT:g} % of them no more than was said.{division_words(diagnosis)}"
    )


def _sensitivities(diagnosis: Diagnosis) -> tuple[list[str], str]:
    sensitivities = diagnosis.sensitivities
    column = int(np.argmax(sensitivities.amplitude))
    order = sensitivities.order[:3]
    *most, last = (sensitivities.paths[i] for i in order)
    percents = ", ".join(f"{sensitivities.elasticity[i, column]:+.2g}" for i in order)
    findings = [
        f"The largest vibration is that in {'xyz'[column]}. It depends most on {', '.join(most)} and {last}: by "
        f"{percents} % for each percent.",
        "Drive ratios and masses move a resonance along the path; they are rarely free to choose.",
    ]
    unsure = [sensitivities.paths[i] for i in order if sensitivities.unsure[i, column]]
    if unsure:
        findings.append(f"That of {' and '.join(unsure)} {unsure_words()}.")
    return (
        findings,
        "Where something must be changed: torsional stiffness first, mass centres second; or speed.",
    )


def _remedies(diagnosis: Diagnosis) -> tuple[list[str], str]:
    task, count = diagnosis.task, len(diagnosis.remedies)
    good = sum(remedy.meets_limit for remedy in diagnosis.remedies)
    moved = f" mass centres of the last joint's bodies by {100 * MOVED:g} % of their length," if task.centres else ""
    findings = [
        f"{good} of {count} remedies keep the limit with a probability of {100 * CONFIDENT:g} % or more."
        if good
        else f"None of the {count} remedies that were tried keeps the limit with {100 * CONFIDENT:g} %.",
        f"Tried: torsional stiffness from 1/{STIFFER:g} to {STIFFER:g} times,{moved} speeds from half to one and a "
        "half times, not above full speed. These ranges are assumed.",
    ]
    onward = "The first of them is simulated by the exact equations, and with draws that it was not chosen by."
    if good > 1:
        onward += f" If it does not hold, so is the next, {VERIFIED} at most."
    return findings, onward


def _verification(diagnosis: Diagnosis) -> tuple[list[str], str]:
    pairs = zip(diagnosis.remedies, diagnosis.verifications, strict=False)
    phases = diagnosis.vibration.phases is not None
    findings = [line for remedy, verified in pairs for line in _verified(remedy, verified, phases)]
    if len(diagnosis.verifications) > 1:
        findings.append("All were tried with the same draws, which thereby chose among them.")
    return findings, ""


def _verified(remedy: Remedy, verified: Verification, phases: bool) -> Iterator[str]:
    keeps = "keeps" if verified.largest <= verified.limit else "does NOT keep"
    yield f"{change_words(remedy)}: {MM * verified.largest:.3g} mm by the exact equations, which {keeps} the limit."
    wanted = "" if verified.keeps.share >= CONFIDENT else f"; {100 * CONFIDENT:g} % are asked for"
    share = binomial_words(verified.keeps, phases)
    yield f"With draws that it was not chosen by, the limit is kept by {share}{wanted}."


def binomial_words(estimate: BinomialEstimate, phases: bool = False) -> str:
    """Say how many draws keep a limit, with the interval of the probability, and whether phases are drawn as well."""
    low, high = math.floor(100 * estimate.interval[0]), math.ceil(100 * estimate.interval[1])
    kept = f"{estimate.count} of {estimate.draws} draws of the posterior{' and of the phases' * phases}"
    return f"{kept} (95 % interval of the probability {low} to {high} %)"


_WORDS: Mapping[str, tuple[str, Callable[[Diagnosis], tuple[list[str], str]]]] = {
    "stiffness": ("How stiff are the joints?", _stiffness),
    "trust": ("How far may the model be trusted?", _trust),
    "resonance": ("Does the drive meet a natural frequency?", _resonance),
    "vibration": ("How far does the arm vibrate?", _vibration),
    "sensitivities": ("What matters most?", _sensitivities),
    "remedies": ("Which change meets the limit?", _remedies),
    "verification": ("Does it hold?", _verification),
}
"""The title of each stage, and what says its findings and why the next one follows."""
