"""A sweep as it is reported: all that the report, the files and the figures have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.assess.basis import Basis
from ident.description.file import ArmFile
from ident.identify.values import Values
from ident.measure import Load, Log
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.sweep import Sweep


@dataclass(frozen=True)
class SweepStudy:
    """What was swept, of what, and what came out.

    Attributes:
        arm_file: the arm as its file has it.
        trial: the arm as it was simulated, its motion and draws.
        load: the load case.
        sweeps: one for each parameter, or a single one of two.
        limit: [m] that the amplitude should not exceed; None for none.
        log: the joint path, if one was replayed.
        fit: values of a fit that the arm has taken over.
        posterior: draws of a posterior.
        changed: numbers that the user has set, by path.
    """

    arm_file: ArmFile
    trial: Evaluator
    load: Load
    sweeps: tuple[Sweep, ...]
    limit: float | None = None
    log: Log | None = None
    fit: Values | None = None
    posterior: Values | None = None
    changed: Mapping[str, float] | None = None

    @property
    def arm(self) -> Arm:
        """The arm as it was simulated."""
        return self.trial.arm

    @cached_property
    def basis(self) -> Basis:
        """What was simulated, and what that rests on."""
        return Basis(
            self.arm_file,
            self.arm,
            self.motion,
            np.nan,
            self.load,
            self.log,
            self.fit,
            self.posterior,
            self.changed or {},
        )

    @property
    def motion(self) -> Motion:
        """What the motors are told."""
        return self.trial.motion

    @property
    def measure(self) -> str:
        """Of the vibration."""
        return self.trial.measure

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.arm.points[-1].name

    @property
    def present(self) -> Float[np.ndarray, "3"]:
        """Amplitudes of the arm as it is [m]."""
        return self.sweeps[0].present

    @property
    def draws(self) -> int:
        """Number of draws."""
        return self.trial.size - 1
