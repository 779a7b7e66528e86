"""What a simulation rests on: the arm with the values that it has taken over, its motion and its load."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.losses import refuse_losses
from ident.assess.phases import Unknowns
from ident.description.file import ArmFile
from ident.identify.loads import loads_of
from ident.identify.values import Values
from ident.measure import OWN_WEIGHT, Load, Log
from ident.vibrate.motion.motion import Motion


@dataclass(frozen=True)
class Basis:
    """An arm that carries out a motion, and where its numbers come from.

    Attributes:
        arm_file: the arm as its file has it.
        arm: the arm as it is simulated: with fitted values, or medians of the draws, and what was set.
        motion: commanded joint angles.
        percent: [%] of full speed, or of a path's own.
        load: the load case.
        log: the joint path, if one is replayed.
        fit: values of a fit that the arm has taken over.
        posterior: draws of a posterior.
        changed: numbers that were set, by path [SI].
        name: what files are called: arm, motion, percent.
        unknown: what nobody knows of the excitation, which is drawn with the posterior.

    Raises:
        InputError: the arm has loss factors, of which motion in time knows nothing.
    """

    arm_file: ArmFile
    arm: Arm
    motion: Motion
    percent: float
    load: Load = OWN_WEIGHT
    log: Log | None = None
    fit: Values | None = None
    posterior: Values | None = None
    changed: Mapping[str, float] = field(default_factory=dict)
    name: str = ""
    unknown: Unknowns = field(default_factory=Unknowns)

    def __post_init__(self) -> None:
        refuse_losses(self.arm)

    @cached_property
    def loads(self) -> Loads:
        """The load case as the mechanics take it."""
        return loads_of(self.arm, self.load)

    @cached_property
    def draws(self) -> Mapping[str, Float[np.ndarray, "D"]]:
        """Draws [SI] of the numbers that were not set and the unknown excitation, by path; none without a posterior."""
        return self.drawn(self.posterior)

    def drawn(self, posterior: Values | None, seed: int = 0) -> Mapping[str, Float[np.ndarray, "D"]]:
        """Return draws of a posterior for the numbers that were not set, and as many of the unknown excitation."""
        values = posterior.without(self.changed) if posterior else {}
        count = len(next(iter(values.values()))) if values else 0
        return values | self.unknown.draws(count, seed) if values else {}

    @property
    def sources(self) -> dict[str, Any]:
        """What came from files, each with `path` and `sha256`, by name; None for what was not given."""
        return {"arm": self.arm_file, "fit": self.fit, "posterior": self.posterior, "path": self.log}

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.arm.points[-1].name
