"""Find out whether an arm vibrates too much, and which change meets the limit: from a campaign to advice."""

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

from ident.errors import InputError, Problem, refusal
from ident.studies.cause.source import MOST_DRAWS, SourceOptions
from ident.studies.cure.balance import BalanceOptions, pulley_of
from ident.studies.cure.effort import DiagnosisEffort
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import LIMIT, HeldMotionOptions, basis_of
from ident.studies.options import option, specs
from ident.studies.reading import EACH
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.shared import with_numbers
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.sample import SampleOptions, sample
from ident.units import USUAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.codec import Store
    from ident.description.file import ArmFile
    from ident.identify.fit import CampaignFit
    from ident.identify.values import Values
    from ident.measure import Campaign, Log
    from ident.measure.runs import Runs
    from ident.studies.cause.source_study import SourceStudy
    from ident.studies.cure.balance_study import Balance
    from ident.studies.cure.diagnose_report import StageReport
    from ident.studies.cure.diagnosis import Diagnosis, Excited, Identification, Verdict
    from ident.studies.cure.remedies import Remedy, Task, Verification, VibrationAssessment


# -------- Diagnose stages
# The stages of a diagnosis, in the order of `carry_out`.

V = TypeVar("V")
"""Value of a stage."""
OnStage = Callable[["StageReport"], None]
CHAINS = "chains"
"""Folder of the sampler's chains, in the folder of the stages."""


@dataclass(frozen=True)
class Job:
    """Input of a diagnosis.

    Attributes:
        arm: the arm.
        campaign: the measurements.
        options: the limit, the motion, and the unknowns of the arm.
        log: the joint path, if one is replayed.
        runs: traces of the moving arm, if there are any.
        folder: stores finished stages; None to store nothing.
        progress: shows the progress of each stage.
    """

    arm: "ArmFile"
    campaign: "Campaign"
    options: "DiagnoseOptions"
    log: "Log | None"
    runs: "Runs | None"
    folder: Path | None
    progress: Progress

    @property
    def identity(self) -> dict[str, str]:
        """What the stages depend on; by values, so that files may be moved."""
        from importlib.metadata import version

        from ident.codec import value_digest

        measurements, log, runs = [replace(each, where="") for each in self.campaign.measurements], self.log, self.runs
        return {
            "campaign": value_digest(measurements),
            "arm file": value_digest((self.arm.arm, self.arm.origins, self.arm.extents)),
            "path": value_digest((log.time, log.angles)) if log else "",
            "runs": value_digest([runs.sha256, *(each.sha256 for each in runs.files.values())]) if runs else "",
            "set of options": value_digest(replace(self.options, units=USUAL)),
            "version of ident": version("ident-arm"),
        }


def discard_stages(folder: str | Path) -> None:
    """Remove the stored stages of a diagnosis from a folder, and the folder if nothing else is in it.

    Raises:
        InputError: another run is at work there.
    """
    from ident.codec import Store
    from ident.files import claimed

    if os.path.exists(folder):
        with claimed(Path(folder)):
            Store.discard(Path(folder) / CHAINS)
            Store.empty(Path(folder))


def carry_out(job: Job, store: "Store", on_stage: OnStage) -> "Diagnosis":
    """Carry out the stages in order; compute each from those before, or load it from an earlier run, and store it."""
    from ident.identify.validate import Validation
    from ident.studies.cure.cures import cures
    from ident.studies.cure.diagnose_report import (
        StageReport,
        remedies_line,
        resonance_line,
        sensitivities_line,
        source_line,
        stiffness_line,
        trust_line,
        verification_line,
        vibration_line,
    )
    from ident.studies.cure.diagnosis import LEAVE, Diagnosis, assess_resonance, assess_trust, chosen, stages_of
    from ident.studies.cure.remedies import assess_vibration, verify_in_turn, verify_remedy
    from ident.vibrate.sweep import sensitivities

    stages = stages_of(runs=job.runs is not None)

    def stage(
        name: str,
        compute: Callable[[], V],
        line: Callable[[V], str],
        count: Callable[[V], int] = lambda value: len(stages),
    ) -> V:
        kept: V | None = store.read(name)
        value = compute() if kept is None else kept
        if kept is None:
            store.write(name, value)
        on_stage(StageReport(stages.index(name) + 1, count(value), name, line(value), kept is not None))
        return value

    def needed(vibration: "VibrationAssessment") -> int:
        return len(stages[:-2] if vibration.accepted else stages)

    def verify(remedy: "Remedy") -> "Verification":
        return verify_remedy(task, remedy, job.progress("fresh draws"))

    def advised_line(verifications: "tuple[Verification, ...]") -> str:
        place = chosen(verifications)
        return verification_line(ranked[place], verifications[place])

    identified, runs = stage("stiffness", lambda: _identified(job), stiffness_line), job.runs
    excited: Excited | None = None
    if runs:
        excited = stage("source", lambda: _excited(job, runs, identified), lambda found: source_line(found.study))
    task, fitted = (excited or identified).task, identified.sampled.fitted
    trust = stage("trust", lambda: assess_trust(fitted), lambda parts: trust_line(Validation(fitted, LEAVE, parts)))
    resonance = stage("resonance", lambda: assess_resonance(task), lambda found: resonance_line(found, task.basis.arm))
    vibration = stage("vibration", lambda: assess_vibration(task, job.progress("draws")), vibration_line, needed)
    slopes = stage(
        "sensitivities",
        lambda: sensitivities(task.over_phases(task.evaluator())),
        sensitivities_line,
        lambda slopes: needed(vibration),
    )
    if vibration.accepted:
        return Diagnosis(identified, trust, resonance, vibration, slopes, excited=excited)
    rotors = excited.rotors if excited else ()
    ranked = stage("remedies", lambda: cures(task, vibration.scatter, rotors, job.progress("remedies")), remedies_line)
    verified = stage("verification", lambda: verify_in_turn(ranked, verify), advised_line)
    return Diagnosis(identified, trust, resonance, vibration, slopes, ranked, verified, excited)


def _identified(job: Job) -> "Identification":
    from ident.identify.values import Draws
    from ident.studies.cure.diagnosis import Identification

    options, effort = job.options, job.options.effort
    shared = {each.name: getattr(options, each.name) for each, _ in specs(FitOptions)}
    sampling = SampleOptions(**shared, ess=effort.ess, steps=effort.steps)
    folder = job.folder and job.folder / CHAINS
    sampled = sample(job.arm, job.campaign, sampling, folder=folder, progress=job.progress)
    draws = Draws.of_sample(sampled.sample).some(job.arm.arm, effort.draws, options.seed)
    return Identification(sampled.sample, _task(job, draws.shuffled(options.seed)))


def _excited(job: Job, runs: "Runs", identified: "Identification") -> "Excited":
    """Identify the sources of the arm from its runs; undetermined numbers stay at the posterior's median."""
    import numpy as np

    from ident.arm.multibody import possible_orders
    from ident.identify.values import Draws
    from ident.studies.cause.source_study import studied
    from ident.studies.cure.diagnosis import Excited

    options, count = job.options, job.options.effort.draws
    known = Draws.of_sample(identified.sampled).some(job.arm.arm, MOST_DRAWS)
    arm = with_numbers(job.arm.arm, known, options.set)
    progress = job.progress("search for what excites the arm")
    study = studied(arm, runs, known.without(options.set), offset=SourceOptions().offset, progress=progress)
    middle = {path: np.full(count, value) for path, value in known.medians.items()}
    drawn = {**middle, **study.found.draws(count, options.seed)}
    balance = _balanced(job, study, drawn)
    if len(study.found.place.parts) > 1:  # each group has phases of its own, and so will the next motion
        phases = {each.phase for each in possible_orders(arm)}
        drawn = {path: values for path, values in drawn.items() if path not in phases}
    return Excited(study, _task(job, _values(job, drawn)), balance)


def _balanced(job: Job, study: "SourceStudy", drawn: "Mapping[str, Any]") -> "Balance | None":
    """Balance the drives' rotors, with masses at the default places of `ident balance`."""
    from ident.arm.multibody import IMBALANCE
    from ident.studies.cure.balance_study import balanced, rotor_of

    basis = basis_of(job.arm, job.options, path=job.log, posterior=_values(job, drawn))
    middle = study.found.numbers()
    drives = {drive.name: drive for drive in basis.arm.drives}
    found = [each for each in study.found.estimates if each.source.kind == IMBALANCE]
    if not study.usable or not any(each.told for each in found):
        return None
    try:
        where = BalanceOptions(radius=job.options.radius)
        pulleys = {name: pulley_of(drive, basis.arm, where) for name, drive in drives.items()}
    except InputError:  # no radius is known
        return None
    phases = {each.source.drive: (each.phase, each.phase_sd) for each in found}
    tried = study.tried(job.options.effort.draws, job.options.seed)
    rotors = []
    for each in found:
        row, name = {"told": each.told, "sd": each.sd, "amplitude": each.amplitude}, each.source.drive
        rotors.append(rotor_of(basis, drives[name], pulleys[name], middle, row, phases, tried))
    return balanced(basis, rotors, tried, middle)


def _values(job: Job, drawn: "Mapping[str, Any]") -> "Values":
    from ident.identify.values import Values

    return Values.of_arm({(path,): values for path, values in drawn.items()}, job.arm.arm)


def _task(job: Job, draws: "Values") -> "Task":
    from ident.studies.cure.remedies import Task, at_confidence

    basis = basis_of(job.arm, job.options, path=job.log, posterior=draws)
    options, measure = job.options, "settled" if job.options.settled else "peak"
    basis = basis.with_unknown_damping(0) if options.settled else basis
    limit = (options.settled or options.limit or LIMIT) / 1e3
    return at_confidence(Task(basis, limit, options.effort, options.softer, measure))


# -------- Diagnose


class DiagnoseOptions(FitOptions, HeldMotionOptions):
    """Options of `ident.diagnose`: the limit, the motion, and the unknowns of the arm.

    Attributes:
        effort: amount of computation; no flag of the command.
        force: without effect here, as no fit is taken over; no flag of the command.
    """

    refuses: ClassVar[tuple[str, ...]] = ("robust", "no_explain")

    limit: float | None = option(None, "vibration [mm] never to exceed in any direction; default 0.5", above=0.0)
    settled: float | None = option(None, "instead: vibration [mm] to stay below after the dwell", above=0.0)
    dwell: float = option(1.0, "time [s] that the arm is held at the end", low=0.0, high=3600.0)
    softer: bool = option(False, "a remedy may also make joints softer")
    radius: dict[str, float] = option(
        {},
        "with --runs: radius [mm] at which balancing masses can sit, as drive2=90; default: the largest pulley's",
        **EACH,
    )
    effort: DiagnosisEffort = field(default_factory=DiagnosisEffort)
    force: bool = False

    @property
    def hold(self) -> float:
        """The dwell [s], and the time after it in which the end must have settled."""
        from ident.vibrate.simulate import AFTERWARDS

        return self.dwell + (AFTERWARDS if self.settled else 0.0)

    def problems(self) -> list[Problem]:
        """Refuse two limits."""
        both = Problem("settled", "it with limit", "one of them", "diagnose once for each")
        return [*super().problems(), *([both] if self.settled and self.limit else [])]

    def recorded(self) -> dict[str, Any]:
        """Return the options as result files record them, with the effort."""
        return {**super().recorded(), "effort": asdict(self.effort)}

    @classmethod
    def restored(cls, recorded: Mapping[str, Any]) -> Self:
        """Return options from the record of a result file, see `Options.restored`."""
        effort: dict[str, Any] = {name: value for name, value in recorded["effort"].items() if name != "speeds"}
        others = {name: value for name, value in recorded.items() if name != "effort"}
        speeds = tuple(recorded["effort"]["speeds"])
        return replace(super().restored(others), effort=DiagnosisEffort(**effort, speeds=speeds))


class DiagnoseResult(Result):
    """A diagnosis of an arm.

    The table has a row for each remedy, the best first [SI]; none if none is needed.

    Attributes:
        diagnosis: the value of each stage, and the resulting verdict.
        options: the options of the call.
        runs: the traces of the moving arm, if any.
        verdict: `accept` the arm as it is, `warn` if a remedy is needed and holds, `reject` if none does.
        advised: the advised remedy; None if none is needed.
        short: whether the posterior's chains are too short.
        doubtful: whether the underlying fit or the result of the runs is in doubt.
        fitted: the underlying fit.
    """

    diagnosis: "Diagnosis"
    options: DiagnoseOptions = field(default_factory=DiagnoseOptions)
    runs: "Runs | None" = None

    subject = "fitted.campaign.name"
    made_from = ("diagnosis.task.basis.arm_file as arm", "fitted.campaign", "diagnosis.task.basis.log as path", "runs")
    summarised = ("verdict", "advice")

    verdict: ClassVar["Verdict"] = alias("diagnosis.verdict")
    advised: ClassVar["Remedy | None"] = alias("diagnosis.advised")
    short: ClassVar[bool] = alias("diagnosis.identification.short")
    doubtful: ClassVar[bool] = alias("diagnosis.in_doubt")
    fitted: ClassVar["CampaignFit"] = alias("diagnosis.identification.sampled.fitted")

    @property
    def advice(self) -> str:
        """The advised remedy, in words; empty if none is needed."""
        from ident.studies.cure.diagnose_report import change_words

        return change_words(self.advised) if self.advised else ""

    def _figures(self) -> "dict[str, Figure]":
        """Return the figures, by stage."""
        from ident.studies.cure.diagnose_figure import diagnose_figures

        return diagnose_figures(self.diagnosis)

    def save_figures(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the figure of the vibration as PNG, and return its path; a page has those of all stages."""
        from ident.report.document import save

        path = Path(folder) / f"{self.name}.png"
        save(self.figures()["vibration"], path)
        return (path,)

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.report.document import plain, write_netcdf
        from ident.studies.stiffness.sample_files import groups_of, inference_data

        posterior = self._beside(path, ".nc")
        sampled = self.diagnosis.identification.sampled
        write_netcdf(posterior, groups_of(inference_data(sampled, {**head, "trust": plain(sampled.trust)})))
        return *super()._write(path, head), posterior


@study
def diagnose(
    arm: "ArmFile",
    campaign: "Campaign",
    options: DiagnoseOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    runs: "Runs | str | Path | None" = None,
    folder: str | Path | None = None,
    restart: bool = False,
    progress: Progress = silent,
    on_stage: OnStage = lambda report: None,
) -> DiagnoseResult:
    """Diagnose an arm, step by step: posterior, resonance, vibration, sensitivities, remedies and their verification.

    Remedies by effort: the speed, along the path or overall; then balancing, if runs are given, and mass centres; then
    torsional stiffness; if none is enough, pairs of them.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        options: the limit, the motion, and the unknowns of the arm.
        path: a joint path to follow instead of the stroke: a log, or its file.
        runs: traces of the moving arm, or the file of their table, see `ident source`; they determine its sources.
        folder: stores finished stages, so that a call with the same inputs resumes after the last of them;
            `discard_stages` removes it. None to store nothing.
        restart: discard the stored stages.
        progress: shows the progress of each stage.
        on_stage: called for each stage that is finished or loaded.

    Raises:
        InputError: inputs or options that do not match; a folder with the stages of other inputs, or with another run
        at
            work.
        ModelError: the model has no solution: no optimum, or an arm that collapses.
    """
    from ident.codec import Store
    from ident.files import claimed
    from ident.identify.binding import loads_of
    from ident.studies.cause.run_problem import as_runs, posed, with_notes
    from ident.vibrate.simulate import refuse_jumps

    folder = None if folder is None else Path(folder)
    runs = None if runs is None else as_runs(runs, options.columns)
    basis = basis_of(arm, options, path=path)
    refuse_jumps(basis.arm, basis.motion)  # refuse before the posterior is sampled
    loads_of(basis.arm, basis.load)
    if options.radius and runs is None:
        raise refusal("radius", "it without runs", "traces that tell the imbalances", "give `runs`, or drop it")
    BalanceOptions(radius=options.radius).check_drives([drive.name for drive in basis.arm.drives])
    if runs is not None:
        posed(basis.arm, runs, offset=SourceOptions().offset)
    job = Job(arm, campaign, options, path, runs, folder, progress)
    if restart and folder is not None:
        discard_stages(folder)
    fresh = folder is not None and not os.path.exists(folder)
    with claimed(folder):
        store = Store(folder, job.identity)
        try:
            noted = runs and with_notes(basis.arm, runs)
            return DiagnoseResult(carry_out(job, store, on_stage), options, noted)
        except InputError:
            if fresh and folder is not None and store.read("stiffness") is None:
                Store.discard(folder / CHAINS)
                Store.empty(folder)
            elif runs and store.read("source") is None:  # the runs are at fault: with other runs it resumes
                store.depends_on({name: value for name, value in job.identity.items() if name != "runs"})
            raise


def part_folder(folder: Path, campaign: "Campaign") -> Path:
    """Return the folder for the stages of an unfinished diagnosis whose files go into `folder`."""
    return folder / f"{campaign.name}.diagnose.part"
