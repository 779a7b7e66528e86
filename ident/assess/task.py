"""What a diagnosis is asked: an arm in motion, a limit, and what of the arm is uncertain."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ident.assess.basis import Basis
from ident.assess.effort import DiagnosisEffort
from ident.vibrate.redesign.evaluator import Draws, Evaluator
from ident.vibrate.redesign.variable import Variable

STIFFER = 2.0
"""Factor by which a torsional stiffness may be raised or lowered; our assumption of what another drive can be."""
MOVED = 0.2
"""Share of a body's length by which its mass centre may be moved either way; our assumption."""
CONFIDENT = 0.95
"""Probability of keeping the limit that is asked for."""
RATE = 250.0
"""Samples a second."""


@dataclass(frozen=True)
class Task:
    """A diagnosis of an arm whose numbers are known as well as the draws say.

    Attributes:
        basis: the arm with the medians of the draws, its motion and its load; its draws in random order.
        limit: [m] largest vibration, in any direction, that is accepted.
        effort: how much is computed.
    """

    basis: Basis
    limit: float
    effort: DiagnosisEffort = field(default_factory=DiagnosisEffort)

    @property
    def assessment_draws(self) -> Draws:
        """The draws by which vibration and remedies are assessed."""
        return self._first(self.effort.assessment_draws)

    @property
    def band_draws(self) -> Draws:
        """The draws for the bands of natural frequencies."""
        return self._first(self.effort.band_draws)

    @property
    def fresh_draws(self) -> Draws:
        """The draws that nothing was assessed or optimised by."""
        return {path: values[self.effort.assessment_draws :] for path, values in self.basis.draws.items()}

    @cached_property
    def torsion(self) -> tuple[Variable, ...]:
        """The torsional stiffnesses."""
        present = {f"{joint.name}.k_tors": float(joint.k_tors) for joint in self.basis.arm.joints}
        soft = {path: k for path, k in present.items() if 0 < k < np.inf}
        return tuple(Variable((path,), k / STIFFER, k * STIFFER) for path, k in soft.items())

    @cached_property
    def centres(self) -> tuple[Variable, ...]:
        """The mass centres of the last joint's bodies along the arm, as far as their shapes are known."""
        extents, centres = self.basis.arm_file.extents, []
        for body in self.basis.arm.joints[-1].link:
            if body.name in extents:
                low, high = extents[body.name][:, 0]
                present, reach = float(body.com[0]), MOVED * (high - low)
                bounds = max(low, present - reach), min(high, present + reach)
                centres += [Variable((f"{body.name}.com.x",), *bounds)] if bounds[0] < present < bounds[1] else []
        return tuple(centres)

    @cached_property
    def step(self) -> float:
        """Time step [s] for the stiffest arm that is tried; one for all, so that they share their programs."""
        stiffest = Evaluator(self.basis.arm, self.basis.motion, (*self.torsion, *self.centres), loads=self.basis.loads)
        return stiffest.step_for(stiffest.bounds)

    def evaluator(self, *variables: Variable, draws: Draws | None = None) -> Evaluator:
        """Return what is simulated again and again; all of a task are one program."""
        return Evaluator(
            self.basis.arm,
            self.basis.motion,
            variables,
            draws=draws or {},
            loads=self.basis.loads,
            rate=RATE,
            step=self.step,
        )

    def over_phases(self, evaluator: Evaluator) -> Evaluator:
        """Return the same over all phases that are not known, with the highest kinematic errors that may be."""
        unknown = self.basis.unknown
        return replace(evaluator, arm=evaluator.arm.replace(unknown.highest), unknown=unknown.phases)

    def _first(self, count: int) -> Draws:
        return {path: values[:count] for path, values in self.basis.draws.items()}
