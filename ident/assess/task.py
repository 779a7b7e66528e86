"""What a diagnosis is asked: an arm, a motion, a limit, and what of the arm is uncertain."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.variable import Extents, Variable

STIFFER = 2.0
"""Factor by which a torsional stiffness may be raised or lowered; our assumption of what another drive can be."""
MOVED = 0.2
"""Share of a body's length by which its mass centre may be moved either way; our assumption."""
CONFIDENT = 0.95
"""Probability of keeping the limit that is asked for."""
SEEN = 100
"""Draws by which vibration and remedies are judged; all others are kept for the proof."""


@dataclass(frozen=True)
class Task:
    """A diagnosis of an arm whose numbers are known as well as the draws say.

    Attributes:
        arm: with the medians of the draws.
        motion: what the motors are told, at `percent` of full speed.
        percent: [%]
        draws: of the identified numbers, by path.
        limit: [m] largest vibration, in any direction, that is accepted.
        loads: the load case.
        extents: of the bodies whose shape is known.
        rate: samples a second.
    """

    arm: Arm
    motion: Motion
    percent: float
    draws: Mapping[str, Float[np.ndarray, "D"]]
    limit: float
    loads: Loads | None = None
    extents: Extents = field(default_factory=dict)
    rate: float = 250.0

    @property
    def seen(self) -> dict[str, Float[np.ndarray, "D"]]:
        """The draws by which vibration and remedies are judged."""
        return {path: values[:SEEN] for path, values in self.draws.items()}

    @property
    def unseen(self) -> dict[str, Float[np.ndarray, "D"]]:
        """The draws that nothing was judged or optimised by."""
        return {path: values[SEEN:] for path, values in self.draws.items()}

    @cached_property
    def torsion(self) -> tuple[Variable, ...]:
        """The torsional stiffnesses."""
        present = {f"{joint.name}.k_tors": float(joint.k_tors) for joint in self.arm.joints}
        soft = {path: k for path, k in present.items() if 0 < k < np.inf}
        return tuple(Variable((path,), k / STIFFER, k * STIFFER) for path, k in soft.items())

    @cached_property
    def centres(self) -> tuple[Variable, ...]:
        """The mass centres of the last joint's bodies along the arm, as far as their shapes are known."""
        found = []
        for body in self.arm.joints[-1].link:
            if body.name in self.extents:
                low, high = self.extents[body.name][:, 0]
                present, reach = float(body.com[0]), MOVED * (high - low)
                bounds = max(low, present - reach), min(high, present + reach)
                found += [Variable((f"{body.name}.com.x",), *bounds)] if bounds[0] < present < bounds[1] else []
        return tuple(found)

    @cached_property
    def step(self) -> float:
        """Time step [s] for the stiffest arm that is tried; one for all, so that they share their programs."""
        tried = Evaluator(self.arm, self.motion, (*self.torsion, *self.centres), loads=self.loads)
        return tried.step_for(tried.bounds)

    def trial(self, *variables: Variable, draws: Mapping[str, np.ndarray] | None = None) -> Evaluator:
        """Return what is simulated again and again; all of a task are one program."""
        return Evaluator(
            self.arm,
            self.motion,
            variables,
            draws=draws or {},
            loads=self.loads,
            rate=self.rate,
            step=self.step,
        )
