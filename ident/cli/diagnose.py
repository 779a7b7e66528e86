"""`ident diagnose`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import moving, options, running
from ident.cli.app import app
from ident.errors import InputError

if TYPE_CHECKING:
    from ident.assess.remedies import Remedy
    from ident.assess.task import Task
    from ident.assess.vibration import VibrationAssessment
    from ident.description.file import ArmFile
    from ident.measure import Campaign
    from ident.present.html.page import Section
    from ident.vibrate.redesign.sensitivity import Sensitivities

FORMAT = "ident-diagnose/2"
ESS = 1000.0
"""Effective samples of each unknown at which sampling stops: as many as the proof has draws."""
DRAWS = 1100
"""Draws of the posterior, those of the proof among them."""
FEW = 100
"""Draws for the bands of natural frequencies."""

Found = tuple[dict[str, Any], "Section"]


@app.command("diagnose")
def diagnose_command(
    campaign: options.CampaignArgument,
    arm: options.ArmOption = None,
    limit: Annotated[float, typer.Option(help="vibration [mm] that the end must not exceed in any direction")] = 0.5,
    speed: moving.SpeedOption = None,
    profile: moving.ProfileOption = None,
    retract: moving.RetractOption = False,
    dwell: Annotated[float, typer.Option(help="time [s] that the arm is held at the end")] = 1.0,
    path: moving.PathOption = None,
    smoothing: moving.SmoothingOption = 0.0,
    load: options.LoadOption = "",
    fix: options.FixOption = None,
    tie: options.TieOption = None,
    free: options.FreeOption = None,
    prior_sd: options.PriorSdOption = 1.0,
    no_prior: options.NoPriorOption = False,
    prior: options.PriorOption = None,
    discrepancy: options.DiscrepancyOption = None,
    starts: options.StartsOption = 16,
    seed: options.SeedOption = 0,
    trust_values: options.TrustOption = False,
    restart: Annotated[bool, typer.Option("--restart", help="throw away the stages of an unfinished run")] = False,
    out: options.OutOption = Path("out"),
) -> None:
    """Find out whether an arm vibrates too far and which change cures it: from a campaign to advice, step by step.

    The paper's procedure: stiffnesses, natural frequencies along the motion, resonance, vibration against the limit,
    torsional stiffness first and mass centres second. Goes on where an earlier run of the same inputs was stopped.
    Writes CAMPAIGN.diagnose.html, which opens without a network, CAMPAIGN.diagnose.json and the posterior,
    CAMPAIGN.diagnose.nc.
    """
    asked = options.asked(locals())
    unknown = options.unknowns(asked)
    options.check_positive(limit, "--limit")
    moving.check(asked, path)
    running.start()
    from ident.identify.conditions import loads_of
    from ident.measure import Load
    from ident.store import Store
    from ident.vibrate.response.simulate import refuse_jumps

    measured, arm_file = running.read(campaign, arm)
    motion, _ = moving.motion(arm_file.arm, asked, path)
    refuse_jumps(arm_file.arm, motion)
    loads_of(arm_file.arm, Load.parse(load))
    folder = out / f"{measured.name}.diagnose.part"
    if restart:
        _discard(folder)
    fresh = not folder.exists()
    kept = Store(folder, _identity(arm_file, measured, asked, path))
    run = _Run(kept, arm_file, measured, asked, unknown, path, out)
    try:
        run.all()
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    except InputError:
        if fresh and not run.sections:
            _discard(folder)
        raise
    _discard(folder)


def _discard(folder: Path) -> None:
    from ident.store import Store

    Store.discard(folder / "chains")
    Store.discard(folder)


def _identity(arm_file: "ArmFile", measured: "Campaign", asked: Mapping[str, Any], path: Path | None) -> dict[str, str]:
    """Say what a run depends on."""
    import hashlib
    import json
    from importlib.metadata import version

    return {
        "format": FORMAT,
        "campaign": measured.sha256,
        "arm file": arm_file.sha256,
        "path": hashlib.sha256(path.read_bytes()).hexdigest() if path else "",
        "version": version("ident"),
        "options": json.dumps(asked, sort_keys=True, default=str),
    }


class _Run:
    """The stages of one diagnosis, each computed or read from where it was kept."""

    def __init__(
        self,
        kept: Any,
        arm_file: "ArmFile",
        measured: "Campaign",
        asked: dict[str, Any],
        unknown: dict[str, Any],
        path: Path | None,
        out: Path,
    ):
        self.kept, self.arm_file, self.measured, self.asked = kept, arm_file, measured, asked
        self.unknown, self.path, self.out = unknown, path, out
        self.sections: list[Section] = []
        self.facts: dict[str, Any] = {}

    def all(self) -> None:
        """Carry out what is needed, and write the page."""
        from ident.studies.background import in_background
        from ident.vibrate.redesign.sensitivity import sensitivities

        self.stage("stiffness", self._stiffness)
        task = self._task()
        trial = task.trial()
        coming = None if self.kept.read("sensitivities") else in_background(lambda: sensitivities(trial))
        self.stage("resonance", lambda: self._resonance(task))
        self.stage("vibration", lambda: self._vibration(task))
        self.stage("sensitivities", lambda: self._sensitivities(coming.result() if coming else sensitivities(trial)))
        if not self.facts["vibration"]["accepted"]:
            self.stage("remedies", lambda: self._remedies(task))
            self.stage("proof", lambda: self._proof(task))
        self._write(task)

    def stage(self, name: str, compute: Callable[[], Found]) -> None:
        """Carry out a stage, or take over what it found, and print that."""
        from ident.present.html.page import section_from_json, section_to_json

        done = self.kept.read(name)
        if done is None:
            facts, section = compute()
            self.kept.write(name, {"facts": facts, "section": section_to_json(section)})
        else:
            facts, section = done["facts"], section_from_json(done["section"])
        self.facts[name] = facts
        self.sections.append(section)
        typer.echo(f"{len(self.sections)}. {section.title}{'' if done is None else ' (as found before)'}")
        for line in section.found:
            typer.echo(f"   {line}")
        if section.onward:
            typer.echo(f"   -> {section.onward}")

    def _stiffness(self) -> Found:
        from ident.identify.sample import sample_campaign
        from ident.inference.sample import BLOCK, Settings
        from ident.present.files.document import plain, provenance
        from ident.present.files.fit import rows
        from ident.present.files.sample import inference_data, write_netcdf
        from ident.present.html.diagnose_sections import stiffness_section

        fitted = running.fit(self.arm_file.arm, self.measured, self.asked, self.unknown)
        settings = Settings(target_ess=ESS, seed=self.asked["seed"])
        sampled = sample_campaign(
            fitted,
            settings=settings,
            folder=self.kept.folder / "chains",
            provenance={"campaign": self.measured.sha256, "arm file": self.arm_file.sha256},
            progress=running.progress("blocks of steps", settings.max_steps // BLOCK),
        )
        origin = provenance(FORMAT, self.arm_file, self.measured, self.asked) | {"trust": plain(sampled.trust)}
        write_netcdf(
            inference_data(sampled.sample, sampled.posterior_predictive, rows(self.measured), origin), self._posterior
        )
        known = fitted.information
        facts = {"doubts": list(fitted.doubts), "rank": known.rank, "count": len(known.names)}
        return facts, stiffness_section(sampled)

    @property
    def _posterior(self) -> Path:
        return self.out / f"{self.measured.name}.diagnose.nc"

    def _task(self) -> "Task":
        from ident.assess.task import Task
        from ident.identify.conditions import loads_of
        from ident.identify.values import read_draws
        from ident.measure import Load

        found = read_draws(self._posterior, self.arm_file.arm, DRAWS, self.asked["seed"])
        described = self.arm_file.arm.replace(found.medians)
        motion, _ = moving.motion(described, self.asked, self.path)
        percent = moving.percent(self.asked, self.path)
        loads = loads_of(described, Load.parse(self.asked["load"]))
        extents = self.arm_file.extents
        limit = self.asked["limit"] / 1e3
        return Task(described, motion, percent, found.shuffled(self.asked["seed"]), limit, loads, extents)

    def _resonance(self, task: "Task") -> Found:
        from ident.present.html.diagnose_sections import resonance_section, undriven_section
        from ident.vibrate.modal.branches import branches
        from ident.vibrate.modal.excitation import excitation
        from ident.vibrate.modal.resonance import resonance_crossings

        if not task.arm.drives:
            return {"encounters": 0}, undriven_section()
        few = {path: values[:FEW] for path, values in task.draws.items()}
        followed = branches(task.arm.replace(few), task.motion, loads=task.loads)
        shaken = excitation(task.arm, task.motion)
        met = resonance_crossings(followed, shaken)
        return {"encounters": len(met)}, resonance_section(followed, shaken, met, task.motion.name)

    def _vibration(self, task: "Task") -> Found:
        from ident.assess.vibration import assess_vibration
        from ident.present.html.diagnose_sections import vibration_section
        from ident.vibrate.redesign.binomial import binomial_to_json

        found: VibrationAssessment = assess_vibration(task, running.progress("draws"))
        facts = {"accepted": found.accepted, "scatter": found.scatter, "keeps": binomial_to_json(found.keeps)}
        return facts | {"peak": found.peak.tolist()}, vibration_section(task, found)

    def _sensitivities(self, found: "Sensitivities") -> Found:
        from ident.present.html.diagnose_sections import sensitivity_section

        return {"paths": list(found.paths), "elasticity": found.elasticity.tolist()}, sensitivity_section(found)

    def _remedies(self, task: "Task") -> Found:
        from ident.assess.remedies import remedies, remedy_to_json
        from ident.present.html.diagnose_sections import remedies_section

        found = remedies(task, self.facts["vibration"]["scatter"], running.progress("remedies"))
        return {"remedies": [remedy_to_json(remedy) for remedy in found]}, remedies_section(task, found)

    def _found(self) -> "list[Remedy]":
        from ident.assess.remedies import remedy_from_json

        return [remedy_from_json(remedy) for remedy in self.facts["remedies"]["remedies"]]

    def _proof(self, task: "Task") -> Found:
        from ident.assess.remedies import chosen, verify_in_turn
        from ident.present.html.diagnose_sections import proof_section
        from ident.vibrate.redesign.binomial import binomial_to_json

        found = self._found()
        proofs = verify_in_turn(task, found, running.progress("fresh draws"))
        advised = chosen(proofs)
        proof = proofs[advised]
        facts = {
            "remedy": advised,
            "tried": len(proofs),
            "amplitude": proof.amplitude.tolist(),
            "keeps": binomial_to_json(proof.keeps),
            "holds": proof.holds,
        }
        return facts, proof_section(task, found, proofs)

    def _write(self, task: "Task") -> None:
        from ident.present.files.document import plain, provenance, write_json
        from ident.present.html.diagnose import diagnose_page
        from ident.present.html.page import write_page

        best = self._found()[self.facts["proof"]["remedy"]] if "proof" in self.facts else None
        head = provenance(FORMAT, self.arm_file, self.measured, self.asked)
        page = diagnose_page(task, self.arm_file, self.measured, self.sections, self.facts, best, head)
        name = self.out / f"{self.measured.name}.diagnose"
        write_json(plain(head | {"stages": self.facts}), name.with_name(f"{name.name}.json"))
        write_page(page, name.with_name(f"{name.name}.html"))
        typer.echo(f"{page.verdict.text}")
        for end in ("html", "json"):
            typer.echo(f"wrote {name}.{end}")
