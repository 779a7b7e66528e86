"""A diagnosis as a page: verdict, stages, inputs, assumptions, provenance."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ident.assess.remedies import Remedy
from ident.assess.task import Task
from ident.description.file import ArmFile
from ident.measure import Campaign
from ident.present.html.diagnose_sections import chance_words, change_words
from ident.present.html.page import Page, Section, Table, Verdict
from ident.present.text.units import MM
from ident.present.text.words import cut
from ident.vibrate.redesign.binomial import binomial_from_json


def diagnose_page(
    task: Task,
    arm_file: ArmFile,
    campaign: Campaign,
    sections: Sequence[Section],
    facts: Mapping[str, Any],
    best: Remedy | None,
    head: Mapping[str, Any],
) -> Page:
    """Return the page of a finished diagnosis.

    Args:
        task: what was asked.
        arm_file: the arm.
        campaign: the measurements.
        sections: the stages.
        facts: numbers of each stage, by its name.
        best: the remedy that is advised; None where none is needed.
        head: provenance, as in the result file.
    """
    return Page(
        f"Vibration of {cut(task.arm.name, 60)}",
        f"{cut(task.motion.name, 80)}; measured: {cut(campaign.path, 60)}; {head['created'][:10]}",
        _verdict(task, facts, best),
        tuple(_summary(facts)),
        tuple(sections),
        Table(
            "Inputs",
            ("what", "file", "SHA-256"),
            (("arm", arm_file.path, arm_file.sha256), ("campaign", campaign.path, campaign.sha256)),
        ),
        tuple(_assumptions(arm_file)),
        tuple(_provenance(head)),
    )


def _verdict(task: Task, facts: Mapping[str, Any], best: Remedy | None) -> Verdict:
    limit, now = f"{MM * task.limit:g} mm", f"{MM * max(facts['vibration']['peak']):.3g} mm"
    if best is None:
        kept = chance_words(binomial_from_json(facts["vibration"]["keeps"]))
        return Verdict("accept", f"The end vibrates by up to {now}; the limit of {limit} is kept by {kept}.")
    proof = facts["proof"]
    after, keeps = float(np.max(proof["amplitude"])), binomial_from_json(proof["keeps"])
    how = f"{change_words(task, best)} brings it to {MM * after:.3g} mm"
    above = max(facts["vibration"]["peak"]) > task.limit
    beyond = f"more than {limit}" if above else f"within {limit}, but not surely"
    if best.cures and proof["holds"]:
        text = f"The end vibrates by up to {now}, {beyond}. {how}; the limit is then kept by"
        return Verdict("warn", f"{text} {chance_words(keeps)}.")
    failed = "the one cure did not hold when it was tried again"
    if proof["tried"] > 1:
        failed = f"none of the {proof['tried']} cures that were tried again held"
    why = failed if best.cures else "no change tried cures it"
    text = f"The end vibrates by up to {now}, {beyond}, and {why}."
    return Verdict("reject", f"{text} {how}, within the limit for {chance_words(keeps)}.")


def _summary(facts: Mapping[str, Any]) -> Iterator[str]:
    rank, count = facts["stiffness"]["rank"], facts["stiffness"]["count"]
    if rank < count:
        filled = "the rest comes from the prior, and so do the probabilities"
        yield f"Caution: the measurements fix {rank} of {count} directions only; {filled}."
    for doubt in facts["stiffness"]["doubts"]:
        yield f"Caution: {doubt}. What follows holds only as far as the identified numbers do."


def _assumptions(arm_file: ArmFile) -> Iterator[str]:
    """Say what was taken for granted."""
    origins = [origin for origin in arm_file.origins.values() if origin != "derived"]
    guessed = sum(origin in ("assumed", "calibrated") for origin in origins)
    yield f"{guessed} of the {len(origins)} numbers in the arm file are assumed or calibrated; amplitudes hold as far."
    yield "Links, fingers and payload are rigid; bushings are linear; belts are rigid."
    yield "The priors of the fit, and the sigmas of the campaign, are as given; the model itself is taken as right."
    yield "A change leaves all other numbers as they are: a stiffer drive weighs as much, a body keeps its inertia."
    yield "Draws are simulated by the fast method, linearised about the moving, sagging arm."


def _provenance(head: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "format", str(head["format"])
    yield "created", str(head["created"])
    yield from ((name, str(version)) for name, version in head["software"].items())
    yield from (
        (f"option {name}", str(value)) for name, value in head["options"].items() if value not in (None, [], "")
    )
