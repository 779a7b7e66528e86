"""A diagnosis as a page: verdict, stages, the arm, inputs, assumptions, provenance."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ident.report.page import Frame, Page, Section, picture, provenance
from ident.report.report import Report, Table, cut
from ident.report.words import MM, sentence
from ident.studies.cure.design_report import unsure_words
from ident.studies.cure.diagnose_figure import diagnose_figures
from ident.studies.cure.diagnose_report import cause_and_remedies, diagnose_sections, judged, of_model
from ident.studies.look.arm_page import arm_section
from ident.studies.look.explore_page import script_hash
from ident.text import as_word

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.measure import Campaign, Log
    from ident.measure.runs import Runs
    from ident.studies.cure.diagnosis import Diagnosis
    from ident.studies.look.arm_view import ArmView


def explorer_section(page: str, command: str) -> Section:
    """Return the explorer of an arm, within the report, and the command that makes it as a separate page."""
    words = (
        "Sliders change stiffnesses, payload, speed and posture; Campbell diagram, modes, static deflection and steady "
        "response follow."
    )
    frame = Frame(
        page,
        script_hash(),
        "The arm with sliders: modes, Campbell diagram, static deflection and steady response",
        "The explorer. It computes in the browser, with the exact mechanics, and loads nothing.",
    )
    return Section("The arm, to be changed by hand", (words, command), frame=frame)


def diagnose_page(
    diagnosis: "Diagnosis", head: Mapping[str, Any], view: "ArmView", explorer: str, runs: "Runs | None" = None
) -> Page:
    """Return the page of a finished diagnosis.

    Args:
        diagnosis: all of its stages.
        head: provenance, as in the result file.
        view: the drawing of the arm with the identified numbers.
        explorer: a page to change that arm by hand.
        runs: traces of the moving arm, if any.
    """
    basis, campaign = diagnosis.task.basis, diagnosis.identification.sampled.fitted.campaign
    inputs: dict[str, ArmFile | Campaign | Log | Runs] = {"arm": basis.arm_file, "campaign": campaign}
    inputs |= {"path": basis.log} if basis.log else {}
    inputs |= {"runs": runs} if runs else {}
    report = diagnose_sections(diagnosis)
    summary = [(label, sentence(text)) for label, text in cause_and_remedies(diagnosis)]
    summary += [("Caution", f"{sentence(each.text)} {sentence(each.remedy)}") for each in report.findings]
    return Page(
        f"Vibration of {cut(basis.arm.name, 60)}",
        f"{cut(basis.motion.name, 80)}; measured: {cut(campaign.path, 60)}; {head['created'][:10]}",
        judged(diagnosis),
        (*summary, ("Model", sentence(of_model(diagnosis)))),
        (
            *_stages(diagnosis, report),
            arm_section(view, "The arm with the identified numbers"),
            explorer_section(explorer, _by_hand(diagnosis, head["options"])),
        ),
        Table("Inputs", ("what", "file", "SHA-256"), tuple((w, file.path, file.sha256) for w, file in inputs.items())),
        tuple(_assumptions(basis.arm_file)),
        provenance(head),
    )


def _stages(diagnosis: "Diagnosis", report: Report) -> Iterator[Section]:
    """Yield a section for each stage: its details from the report, and its figure."""
    figures = diagnose_figures(diagnosis)
    for stage, section in zip(diagnosis.stages, report.details, strict=True):
        drawn = (picture(figures[stage], *_captions(diagnosis, stage)),) if stage in figures else ()
        yield Section(section.title, section.parts, drawn)


def _captions(diagnosis: "Diagnosis", stage: str) -> tuple[str, str]:
    """Return the alternative text of a stage's figure, and its caption."""
    limit = f"{MM * diagnosis.task.limit:g} mm"
    return {
        "stiffness": (
            "Each identified number with its interval, relative to its median",
            "95 % interval of each number, relative to its median.",
        ),
        "trust": (
            "Error of each posture's prediction from the others, and the quantiles of all of them",
            "Left: error of each posture's prediction from the others. Right: all of these, in standard deviations, "
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
            "Bars of the sensitivity of the vibration in x, y and z to each number",
            f"Percent of the vibration for one percent of each number. White: {unsure_words()}.",
        ),
        "remedies": (
            "Largest vibration after each remedy, with the limit",
            f"Expected largest vibration after each remedy; dashed: limit of {limit}. Filled: meets the limit.",
        ),
    }[stage]


def _by_hand(diagnosis: "Diagnosis", options: Mapping[str, Any]) -> str:
    """Name the command that makes the explorer as a separate page."""
    arm, campaign = diagnosis.task.basis.arm_file, diagnosis.identification.sampled.fitted.campaign
    given = {"posterior": f"{campaign.name}.diagnose.nc", "campaign": campaign.path}
    given |= {name.replace("_", "-"): options[name] for name in ("soft_base", "load")}
    words = [f"--{name}={as_word(value)}" for name, value in given.items() if value]
    words += [f"--set={as_word(f'{path}={value}')}" for path, value in options["set"].items()]
    command = " ".join(["ident explore", as_word(arm.path or "arm.toml"), *words])
    return f"The explorer as a page of its own, whose address keeps its settings: {command}"


def _assumptions(arm_file: "ArmFile") -> Iterator[str]:
    """Yield the assumptions."""
    origins = [origin for origin in arm_file.origins.values() if origin != "derived"]
    guessed = sum(origin in ("assumed", "calibrated") for origin in origins)
    bearing = "amplitudes are no better than these"
    yield f"{guessed} of the {len(origins)} numbers in the arm file are assumed or calibrated; {bearing}."
    yield "Links, fingers and payload are rigid; bushings are linear; belts are rigid."
    yield "The priors of the fit and the sigmas of the campaign are as given; the model itself is taken as correct."
    yield "A change leaves all other numbers as they are: a stiffer drive weighs the same, a body keeps its inertia."
    yield "Draws are simulated by the fast method, linearised about the quasi-static deflection."
