"""A diagnosis as a page: verdict, stages, inputs, assumptions, provenance."""

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from ident.assess.arm_view import ArmView
from ident.assess.diagnosis import Diagnosis
from ident.description.file import ArmFile
from ident.measure import Campaign, Log
from ident.present.html.arm_section import arm_section, explorer_section
from ident.present.html.diagnose_sections import diagnose_sections
from ident.present.html.page import Page, Table, Verdict
from ident.present.text.diagnose import cautions, verdict_words
from ident.present.text.words import cut


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
