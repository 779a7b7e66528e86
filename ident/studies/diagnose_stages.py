"""The stages of a diagnosis: each computes its value from those before, or takes it over from an earlier run."""

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.studies.fit import FitOptions
from ident.studies.motion import basis_of
from ident.studies.options import specs
from ident.studies.result import Progress
from ident.studies.sample import SampleOptions, sample
from ident.units import USUAL

if TYPE_CHECKING:
    from ident.assess.diagnosis import Diagnosis, Identification, ResonanceAssessment
    from ident.assess.remedies import Remedy, Verification
    from ident.assess.vibration import VibrationAssessment
    from ident.description.file import ArmFile
    from ident.inference.held_out import HeldOut
    from ident.measure import Campaign, Log
    from ident.present.text.diagnose import StageReport
    from ident.store import Store
    from ident.studies.diagnose import DiagnoseOptions
    from ident.vibrate.redesign.sensitivity import Sensitivities

OnStage = Callable[["StageReport"], None]
CHAINS = "chains"
"""Folder of the sampler's chains within that of the stages."""


@dataclass(frozen=True)
class Job:
    """What a diagnosis is made from.

    Attributes:
        arm: the arm.
        campaign: the measurements.
        options: the limit, the motion, and what is unknown of the arm.
        log: the joint path, if one is replayed.
        folder: where finished stages are kept; None for nowhere.
        progress: shows how far each stage is.
    """

    arm: "ArmFile"
    campaign: "Campaign"
    options: "DiagnoseOptions"
    log: "Log | None"
    folder: Path | None
    progress: Progress

    @property
    def identity(self) -> dict[str, str]:
        """What the stages depend on; by values, so that a file may move."""
        from importlib.metadata import version

        measurements = [replace(each, where="") for each in self.campaign.measurements]
        return {
            "campaign": _hash(measurements),
            "arm file": _hash((self.arm.arm, self.arm.origins, self.arm.extents)),
            "path": _hash((self.log.time, self.log.angles)) if self.log else "",
            "set of options": _hash(replace(self.options, units=USUAL)),
            "version of ident": version("ident"),
        }


def _hash(value: Any) -> str:
    from ident.codec import encode

    return hashlib.sha256(json.dumps(encode(value)).encode("utf-8", "surrogatepass")).hexdigest()


def discard(folder: str | Path) -> None:
    """Remove the stages that a diagnosis has kept in a folder, and the folder if nothing else is in it.

    Raises:
        InputError: another run is at work there.
    """
    from ident.files import claimed
    from ident.store import Store

    if os.path.exists(folder):
        with claimed(Path(folder)):
            Store.discard(Path(folder) / CHAINS)
            Store.empty(Path(folder))


def carry_out(job: Job, store: "Store", on_stage: OnStage) -> "Diagnosis":
    """Compute or take over each stage, store it, and report it."""
    from ident.assess.diagnosis import Diagnosis
    from ident.present.text.diagnose import stage_report

    diagnosis = Diagnosis()
    for stage, compute in STAGES.items():
        if diagnosis.needs(stage):
            value = store.read(stage)
            resumed = value is not None
            if not resumed:
                value = compute(job, diagnosis)
                store.write(stage, value)
            diagnosis = diagnosis.then(stage, value)
            on_stage(stage_report(diagnosis, stage, resumed=resumed))
    return diagnosis


def _stiffness(job: Job, diagnosis: "Diagnosis") -> "Identification":
    from ident.assess.diagnosis import Identification
    from ident.assess.task import Task
    from ident.assess.vibration import at_confidence
    from ident.identify.values import Draws

    options, effort = job.options, job.options.effort
    shared = {each.name: getattr(options, each.name) for each, _ in specs(FitOptions)}
    sampling = SampleOptions(**shared, ess=effort.ess, steps=effort.steps)
    folder = job.folder and job.folder / CHAINS
    sampled = sample(job.arm, job.campaign, sampling, folder=folder, progress=job.progress)
    draws = Draws.of_sample(sampled.sample.sample).some(job.arm.arm, effort.draws, options.seed)
    basis = basis_of(job.arm, options, path=job.log, posterior=draws.shuffled(options.seed))
    return Identification(sampled.sample, at_confidence(Task(basis, options.limit / 1e3, effort)))


def _trust(job: Job, diagnosis: "Diagnosis") -> "tuple[HeldOut, ...]":
    from ident.assess.diagnosis import assess_trust

    return assess_trust(diagnosis.identification.sampled.fitted)


def _resonance(job: Job, diagnosis: "Diagnosis") -> "ResonanceAssessment":
    from ident.assess.diagnosis import assess_resonance

    return assess_resonance(diagnosis.task)


def _vibration(job: Job, diagnosis: "Diagnosis") -> "VibrationAssessment":
    from ident.assess.vibration import assess_vibration

    return assess_vibration(diagnosis.task, job.progress("draws"))


def _sensitivities(job: Job, diagnosis: "Diagnosis") -> "Sensitivities":
    from ident.vibrate.redesign.sensitivity import sensitivities

    task = diagnosis.task
    return sensitivities(task.over_phases(task.evaluator()))


def _remedies(job: Job, diagnosis: "Diagnosis") -> "tuple[Remedy, ...]":
    from ident.assess.remedies import remedies

    return remedies(diagnosis.task, diagnosis.vibration.scatter, job.progress("remedies"))


def _verification(job: Job, diagnosis: "Diagnosis") -> "tuple[Verification, ...]":
    from ident.assess.remedies import verify_in_turn, verify_remedy

    return verify_in_turn(
        diagnosis.remedies, lambda remedy: verify_remedy(diagnosis.task, remedy, job.progress("fresh draws"))
    )


STAGES: Mapping[str, Callable[[Job, "Diagnosis"], Any]] = {
    "stiffness": _stiffness,
    "trust": _trust,
    "resonance": _resonance,
    "vibration": _vibration,
    "sensitivities": _sensitivities,
    "remedies": _remedies,
    "verification": _verification,
}
"""The stages in order, each with what computes its value from those before."""
