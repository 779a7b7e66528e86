"""A diagnosis as a value: the result of each stage, and the verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from ident.identify.fit import CampaignFit
from ident.identify.sample import CampaignSample
from ident.identify.validate import Validation, parts_of
from ident.inference.draws import quantiles
from ident.inference.scrutiny import HeldOut, held_out
from ident.studies.cause.source_study import SourceStudy
from ident.studies.cure.balance_study import Balance, Rotor
from ident.studies.cure.remedies import Remedy, Task, Verification, VibrationAssessment
from ident.vibrate.branches import Branches, branches
from ident.vibrate.resonance import Excitation, ResonanceCrossing, excitation, resonance_crossings, with_amplitudes
from ident.vibrate.sweep import Sensitivities

Verdict = Literal["accept", "warn", "reject"]
STAGES = ("stiffness", "source", "trust", "resonance", "vibration", "sensitivities", "remedies", "verification")
"""The stages in order, by the names of their stored values; "source" only with runs."""
LEAVE = "posture"
"""The parts left out in turn, to see how well the others predict them."""
TIMES, NEAR = 500, np.radians(2.0)
"""Times at which a motion is compared with the measured postures, and tolerance of a joint beyond them [rad];
assumed."""


@dataclass(frozen=True)
class Identification:
    """The identified arm, and the diagnosis of this arm.

    Attributes:
        sampled: the posterior.
        task: the diagnosis, for the arm with the medians of the posterior's draws.
    """

    sampled: CampaignSample
    task: Task

    @cached_property
    def quantiles(self) -> Float[np.ndarray, "3 P"]:
        """Quantiles of 2.5, 50 and 97.5 % of each unknown of the fit over all draws [SI]."""
        count = len(self.sampled.fitted.problem.parameters.items)
        return quantiles(self.sampled.sample)[[0, 2, 4], :count]

    @property
    def short(self) -> bool:
        """Whether the chains are shorter than they should be."""
        sample = self.sampled.sample
        return not all(each.enough(sample.settings.target_ess) for each in sample.diagnosis)


@dataclass(frozen=True)
class Excited:
    """Sources of the arm, identified from traces of its motion, and the task with this excitation.

    Attributes:
        study: sources, stiffness and damping from the runs, with the posterior of the measurements as the prior.
        task: the diagnosis, for the arm with the medians of these draws.
        balance: of the drives' rotors; None if no imbalance is determined, or no place for a mass is known.
    """

    study: SourceStudy
    task: Task
    balance: Balance | None = None

    @property
    def rotors(self) -> tuple[Rotor, ...]:
        """The rotors that can be balanced: none if masses do not help, or the one trial run does not decide."""
        if self.balance is None or not self.study.usable or not self.balance.gains:
            return ()
        return tuple(each for each in self.balance.balanced if not each.calibration.state)


@dataclass(frozen=True)
class ResonanceAssessment:
    """Natural frequencies along the motion, and the excitation of the arm.

    Attributes:
        branches: with the draws as sets; None if nothing turns.
        excitation: by the pulleys; None if nothing turns.
        crossings: places where one is near the other, the cause of most vibration first.
    """

    branches: Branches | None = None
    excitation: Excitation | None = None
    crossings: tuple[ResonanceCrossing, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """Results of the stages of a diagnosis, in their order.

    Attributes:
        identification: the stiffness of the joints, and the task.
        trust: each posture predicted from the others; empty if all measurements share one posture.
        resonance: whether a drive meets a natural frequency.
        vibration: vibration of the present arm.
        sensitivities: of the vibration to numbers of the arm.
        remedies: the remedies, the best first; empty if the vibration is accepted.
        verifications: those of the first remedies, in their order.
        excited: the sources of the arm; None without runs.
    """

    identification: Identification
    trust: tuple[HeldOut, ...]
    resonance: ResonanceAssessment
    vibration: VibrationAssessment
    sensitivities: Sensitivities
    remedies: tuple[Remedy, ...] = ()
    verifications: tuple[Verification, ...] = ()
    excited: Excited | None = None

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that were carried out: if the vibration is accepted, no remedy is searched."""
        own = stages_of(runs=self.excited is not None)
        return own if self.verifications else own[:-2]

    @property
    def in_doubt(self) -> bool:
        """Whether the fit contradicts itself, or the runs contradict the model."""
        contradicting = self.excited is not None and not self.excited.study.usable
        return bool(self.identification.sampled.fitted.doubts) or contradicting

    @property
    def task(self) -> Task:
        """The task."""
        return (self.excited or self.identification).task

    @property
    def validation(self) -> Validation:
        """Prediction of each posture from the others; without parts if all measurements share one posture."""
        return Validation(self.identification.sampled.fitted, LEAVE, self.trust)

    @property
    def beyond(self) -> Mapping[str, float]:
        """How far the motion turns joints beyond the measured postures [rad], by name."""
        measured = np.array([m.posture for m in self.identification.sampled.fitted.campaign])
        motion = self.task.basis.motion
        turned = np.asarray(motion(np.linspace(motion.breaks[0], motion.breaks[-1], TIMES))[0])
        far = np.maximum(measured.min(0) - turned.min(1), turned.max(1) - measured.max(0))
        names = (joint.name for joint in self.task.basis.arm.driven)
        return {name: float(by) for name, by in zip(names, far, strict=True) if by > NEAR}

    @property
    def advised(self) -> Remedy | None:
        """The advised remedy; None if none is needed."""
        return self.remedies[chosen(self.verifications)] if self.verifications else None

    @property
    def verified(self) -> Verification | None:
        """The verification of the advised remedy."""
        return self.verifications[chosen(self.verifications)] if self.verifications else None

    @property
    def verdict(self) -> Verdict:
        """Accept the arm as it is, warn if a remedy is needed and holds, reject if none does."""
        if self.advised is None or self.verified is None:
            return "accept"
        return "warn" if self.advised.meets_limit and self.verified.holds else "reject"


def stages_of(*, runs: bool) -> tuple[str, ...]:
    """Return the stages of a diagnosis, with or without runs."""
    return STAGES if runs else tuple(stage for stage in STAGES if stage != "source")


def assess_trust(fitted: CampaignFit) -> tuple[HeldOut, ...]:
    """Leave out each posture in turn, and predict its measurements by a fit to the others."""
    parts = parts_of(fitted.campaign, LEAVE)
    return held_out(fitted, parts) if len(parts) > 1 else ()


def assess_resonance(task: Task) -> ResonanceAssessment:
    """Follow the natural frequencies along the motion, and compare them with the excitation by the pulleys."""
    if not task.basis.arm.drives:
        return ResonanceAssessment()
    followed = branches(task.basis.arm.replace(dict(task.band_draws)), task.basis.motion, loads=task.basis.loads)
    excited = excitation(task.basis.arm, task.basis.motion)
    near = resonance_crossings(followed, excited)
    caused = with_amplitudes(near, task.basis.arm, task.basis.motion, task.basis.loads)
    return ResonanceAssessment(followed, excited, caused)


def chosen(verifications: Sequence[Verification]) -> int:
    """Return the index of the advised remedy: the one that holds, or else the first."""
    return len(verifications) - 1 if verifications[-1].holds else 0
