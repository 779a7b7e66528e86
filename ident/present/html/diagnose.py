"""A diagnosis as a page: verdict, stages, inputs, assumptions, provenance."""

import shlex
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ident.assess.diagnose import Diagnosis
from ident.assess.remedies import CONFIDENT
from ident.assess.show import ArmView
from ident.description.file import ArmFile
from ident.measure import Campaign, Log
from ident.present.figures.diagnose import SENSITIVITIES, diagnose_figures
from ident.present.figures.show import show_figure
from ident.present.html.explore.page import script_hash
from ident.present.html.page import READABLE, Frame, Page, Picture, Section, Table, Verdict, moving_modes, picture
from ident.present.text.design import UNSURE, unsure_words
from ident.present.text.diagnose import cautions, change_words, stage_report, verdict_words
from ident.present.text.resonance import caused_words, grouped, sources_words
from ident.present.text.show import sums
from ident.present.text.words import MM, cut, in_shown_unit, is_stiffness, percent

# -------- Arm section
# The arm itself as a section of a page: drawn to scale, and what looks odd about its numbers.

ALT = "The arm from the side and from above, with its bodies, mass centres, joints and points."
CAPTION = (
    "To scale. Boxes are the bodies' shapes, or, dashed, boxes of the same inertia; the area of a black dot is in "
    "proportion to the mass."
)
MODES_ALT = "The first modes of the arm, swinging about the arm at rest."
MODES_CAPTION = "The first modes, over the arm at rest (grey): all at one pace, far too slow; a mode has no amplitude."


def arm_section(view: ArmView, title: str) -> Section:
    """Return masses and reach of an arm, what looks odd, and its picture."""
    odd = [f"Looks odd: {each}." for each in view.oddities] or ["None of its numbers looks odd."]
    failure = [f"No modes: {view.failure}."] if view.failure else []
    drawn = [picture(show_figure(view, modes=False), ALT, CAPTION)]
    if view.analysis:
        still, moving = moving_modes(view, still=True), moving_modes(view)
        drawn.append(Picture(still, MODES_ALT, MODES_CAPTION, READABLE, moving))
    return Section(title, (f"{sums(view)}.", *failure, *odd), pictures=tuple(drawn))


def explorer_section(page: str, command: str) -> Section:
    """Return the explorer of an arm, within the report, and the command that makes it by itself."""
    words = (
        "Stiffnesses, payload, speed and place are changed with sliders; the Campbell diagram, the modes, the static"
    )
    frame = Frame(
        page,
        script_hash(),
        "The arm with sliders: modes, Campbell diagram, static deflection and steady response",
        "The explorer. It computes in the browser, with the exact mechanics, and asks for nothing.",
    )
    return Section(
        "The arm, to be changed by hand", (f"{words} deflection and the steady response follow.", command), frame=frame
    )


# -------- Diagnose sections
# The stages of a diagnosis as sections of its page: what each says, with tables and figures.


def diagnose_sections(diagnosis: Diagnosis) -> Iterator[Section]:
    """Yield a section for each finished stage."""
    figures = diagnose_figures(diagnosis)
    for stage in diagnosis.stages:
        report = stage_report(diagnosis, stage)
        table = _TABLES[stage](diagnosis)
        drawn = [picture(figures[stage], *_captions(diagnosis, stage))] if stage in figures else []
        yield Section(report.title, report.findings, report.onward, (table,) if table.rows else (), tuple(drawn))


def _stiffness(diagnosis: Diagnosis) -> Table:
    sampled = diagnosis.identification.sampled
    names, doubted = sampled.fitted.problem.parameters.names, bool(sampled.withheld)
    rows = tuple(
        (
            name,
            f"{in_shown_unit(name, float(median))[0]:#.4g}",
            "withheld" if doubted else " to ".join(f"{in_shown_unit(name, float(x))[0]:#.4g}" for x in (low, high)),
            in_shown_unit(name, 1.0)[1],
        )
        for name, (low, median, high) in zip(names, diagnosis.identification.quantiles.T, strict=True)
    )
    head = ("number", "median", "95 % interval", "unit")
    short = diagnosis.identification.short
    note = "The chains are shorter than they should be: the intervals are rough." if short else ""
    note += " No interval is quoted, as the fit is in doubt." * doubted
    return Table("Identified numbers, from the posterior", head, rows, note)


def _trust(diagnosis: Diagnosis) -> Table:
    validation, head = diagnosis.validation, ("kind", "trusted within", "seen", "expected", "measurements")
    rows = tuple(
        (s.kind.replace("_", " "), percent(s.half), percent(s.seen), percent(s.expected), str(s.count))
        for s in validation.scopes
    )
    note = (
        "Half of the interval that holds 95 % of measurements like these, relative to the value. Seen: by what the "
        "postures left out are off; expected: by the model's own standard deviations; the larger one counts."
    )
    return Table("Where it was not measured, by postures left out", head, rows, note)


def _resonance(diagnosis: Diagnosis) -> Table:
    rows = tuple(
        (
            str(number),
            sources_words([crossing.source for crossing in group]),
            str(group[0].label),
            f"{group[0].start:.2f} to {group[0].end:.2f}",
            f"{group[0].natural:.2f}",
            "crosses" if group[0].crossings else f"{100 * group[0].relative_distance:.1f} % off",
            caused_words(group),
            f"{group[0].magnification:.1f}",
            f"{100 * group[0].probability:.0f} %",
        )
        for number, group in enumerate(grouped(diagnosis.resonance.crossings), 1)
    )
    head = (
        "no.",
        "excited by",
        "mode",
        "time [s]",
        "at [Hz]",
        "closest",
        "vibration caused",
        "build-up [-]",
        "probability",
    )
    note = (
        "Vibration caused: of the end point along the mode's motion, by these pulleys alone with the worst phases. "
        "Build-up: amplitude of the mode over its static response to the same force, estimated."
    )
    return Table("Near-resonance, by the vibration caused", head, rows, note)


def _vibration(diagnosis: Diagnosis) -> Table:
    vibration = diagnosis.vibration
    rows = tuple(
        (direction, f"{MM * peak:.3f}", f"{MM * low:.3f} to {MM * high:.3f}")
        for direction, peak, low, high in zip("xyz", vibration.peak, *vibration.band, strict=True)
    )
    note = "Vibration: displacement of the end point from its quasi-static position. Draws by the fast method."
    if vibration.phases is not None:
        note += (
            " Phases of the turning masses are not known: each draw has its own, and the exact ones have phases whose"
            f" vibration {100 * CONFIDENT:g} % of all phases do not exceed."
        )
    return Table("Largest vibration [mm]", ("direction", "exact", "5 to 95 % of the draws"), rows, note)


def _sensitivities(diagnosis: Diagnosis) -> Table:
    sensitivities = diagnosis.sensitivities
    rows = tuple(
        (
            sensitivities.paths[i],
            f"{sensitivities.present[i]:.4g}",
            *(
                f"{value:+.2f}" + f" {UNSURE}" * bool(unsure)
                for value, unsure in zip(sensitivities.elasticity[i], sensitivities.unsure[i], strict=True)
            ),
        )
        for i in sensitivities.order[:SENSITIVITIES]
    )
    head = ("number", "now [SI]", "x [% per %]", "y [% per %]", "z [% per %]")
    note = "At the present design, by exact derivatives: small changes only."
    note += f" {UNSURE}: {unsure_words()}." if sensitivities.unsure[sensitivities.order[:SENSITIVITIES]].any() else ""
    return Table("Sensitivities, the strongest first", head, rows, note)


def _remedies(diagnosis: Diagnosis) -> Table:
    rows = tuple(
        (
            str(rank),
            change_words(remedy),
            f"{MM * remedy.largest:.3f}",
            f"{100 * remedy.keeps.share:.3g} %",
            f"{remedy.frequency:.2f}",
            f"{MM * remedy.deflection:.1f}",
            f"{remedy.change_norm:.2f}",
        )
        for rank, remedy in enumerate(diagnosis.remedies, 1)
    )
    head = ("rank", "change", "vibration [mm]", "keeps limit", "first mode [Hz]", "deflection [mm]", "change norm [-]")
    note = (
        "Best first: what meets the limit, torsion before mass centres before speed, each with the least change; then "
        "what helps. Change norm: change against the widest allowed; of speed, in powers of two. Deflection and first "
        "mode are side effects, the worse of both ends of the motion."
    )
    strong = tuple(i for i, remedy in enumerate(diagnosis.remedies) if remedy.meets_limit)
    return Table("Remedies", head, rows, note, strong)


def _verification(diagnosis: Diagnosis) -> Table:
    remedy, verified = diagnosis.advised, diagnosis.verified
    assert remedy is not None
    assert verified is not None
    rows = tuple(
        (
            path,
            *(f"{in_shown_unit(path, number)[0]:.4g}" for number in (remedy.before[path], value)),
            _change(path, remedy.before[path], value),
            in_shown_unit(path, 1.0)[1],
        )
        for path, value in remedy.values.items()
    )
    title = "What to change" if verified.holds else "What the first of them changes"
    return Table(title, ("number", "now", "after", "change", "unit"), rows)


def _change(path: str, before: float, after: float) -> str:
    return f"x {after / before:.3f}" if is_stiffness(path) else f"{MM * (after - before):+.1f} mm"


_TABLES: Mapping[str, Callable[[Diagnosis], Table]] = {
    "stiffness": _stiffness,
    "trust": _trust,
    "resonance": _resonance,
    "vibration": _vibration,
    "sensitivities": _sensitivities,
    "remedies": _remedies,
    "verification": _verification,
}


def _captions(diagnosis: Diagnosis, stage: str) -> tuple[str, str]:
    """Return what can be seen in the figure of a stage, for whoever can't see it, and how to read it."""
    limit = f"{MM * diagnosis.task.limit:g} mm"
    direction = "xyz"[int(np.argmax(diagnosis.sensitivities.amplitude))]
    return {
        "stiffness": (
            "Each identified number with its interval, relative to its median",
            "95 % interval of each number, relative to its median: the narrower, the surer.",
        ),
        "trust": (
            "What each posture is off its prediction by the others, and the quantiles of all of them",
            "Left: what each posture is off its prediction by the others. Right: all of these, in standard deviations, "
            "against the normal distribution's quantiles.",
        ),
        "resonance": (
            "Natural frequencies and pulley frequencies over time, intervals of near-resonance shaded",
            "Campbell diagram along the motion: natural frequencies (bands: 5 to 95 % of the posterior) and the "
            "frequencies at which the pulleys turn.",
        ),
        "vibration": (
            "Vibration of the end point in x, y and z over time, with the limit",
            f"Vibration of the end point; dashed: limit of {limit}.",
        ),
        "sensitivities": (
            "Bars of the sensitivity of the largest vibration to each number",
            f"Percent of the vibration in {direction} for one percent of each number. White: {unsure_words()}.",
        ),
        "remedies": (
            "Largest vibration after each remedy, with the limit",
            f"Expected largest vibration after each remedy; dashed: limit of {limit}. Filled: meets the limit.",
        ),
    }[stage]


# -------- Diagnose


def diagnose_page(diagnosis: Diagnosis, head: Mapping[str, Any], view: ArmView, explorer: str) -> Page:
    """Return the page of a finished diagnosis.

    Args:
        diagnosis: all of its stages.
        head: provenance, as in the result file.
        view: the arm with the identified numbers, as it is drawn.
        explorer: a page on which that arm is changed by hand.
    """
    basis, campaign = diagnosis.task.basis, diagnosis.identification.sampled.fitted.campaign
    inputs: dict[str, ArmFile | Campaign | Log] = {"arm": basis.arm_file, "campaign": campaign}
    inputs |= {"path": basis.log} if basis.log else {}
    return Page(
        f"Vibration of {cut(basis.arm.name, 60)}",
        f"{cut(basis.motion.name, 80)}; measured: {cut(campaign.path, 60)}; {head['created'][:10]}",
        Verdict(diagnosis.verdict, verdict_words(diagnosis)),
        tuple(cautions(diagnosis)),
        (
            *diagnose_sections(diagnosis),
            arm_section(view, "The arm with the identified numbers"),
            explorer_section(explorer, _by_hand(diagnosis, head["options"])),
        ),
        Table("Inputs", ("what", "file", "SHA-256"), tuple((w, file.path, file.sha256) for w, file in inputs.items())),
        tuple(_assumptions(basis.arm_file)),
        tuple(_provenance(head)),
    )


def _by_hand(diagnosis: Diagnosis, options: Mapping[str, Any]) -> str:
    """Name the command that makes the explorer by itself."""
    arm, campaign = diagnosis.task.basis.arm_file, diagnosis.identification.sampled.fitted.campaign
    words = ["ident", "explore", arm.path or "arm.toml", f"--posterior={campaign.name}.diagnose.nc"]
    words += [f"--campaign={campaign.path}"] if campaign.path else []
    words += [f"--{name.replace('_', '-')}={options[name]}" for name in ("soft_base", "load") if options[name]]
    words += [f"--set={path}={value}" for path, value in options["set"].items()]
    return f"The same page by itself, whose address keeps what is on it: {shlex.join(words)}"


def _assumptions(arm_file: ArmFile) -> Iterator[str]:
    """Say what was taken for granted."""
    origins = [origin for origin in arm_file.origins.values() if origin != "derived"]
    guessed = sum(origin in ("assumed", "calibrated") for origin in origins)
    bearing = "the amplitudes hold as far as these do"
    yield f"{guessed} of the {len(origins)} numbers in the arm file are assumed or calibrated; {bearing}."
    yield "Links, fingers and payload are rigid; bushings are linear; belts are rigid."
    yield "The priors of the fit, and the sigmas of the campaign, are as given; the model itself is taken as right."
    yield "A change leaves all other numbers as they are: a stiffer drive weighs as much, a body keeps its inertia."
    yield "Draws are simulated by the fast method, linearised about the quasi-static deflection."


def _provenance(head: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "format", str(head["format"])
    yield "created", str(head["created"])
    yield from ((name, str(version)) for name, version in head["software"].items())
    yield from (
        (f"option {name}", str(value)) for name, value in head["options"].items() if value not in (None, [], {}, "")
    )
