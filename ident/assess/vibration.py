"""How far the arm vibrates, and with which probability that is too far."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ident.assess.over_phases import OverPhases, at_share, over_phases
from ident.assess.phases import Unknowns
from ident.assess.task import CONFIDENT, Task
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.response import Response, peak
from ident.vibrate.response.simulate import sample_times, simulate


@dataclass(frozen=True)
class VibrationAssessment:
    """The arm at work as it is.

    Attributes:
        response: by the exact equations.
        amplitude: (3,) [m] of the arm itself, with the excitation of `at_confidence`, which the response has as well.
        draws: (3, D) [m], each with phases and kinematic errors of its own.
        keeps: probability that the limit is kept in all directions, by the draws.
        limit: [m]
        phases: the arm itself over the phases that are not known; None where all are known.
    """

    response: Response
    amplitude: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 D"]
    keeps: BinomialEstimate
    limit: float
    phases: OverPhases | None = None

    @property
    def peak(self) -> Float[np.ndarray, "3"]:
        """Largest vibration in each direction by the exact equations [m]."""
        return np.asarray(peak(self.response.vibration))

    @property
    def band(self) -> Float[np.ndarray, "2 3"]:
        """5 and 95 % quantiles over the draws [m]."""
        return np.quantile(self.draws, (0.05, 0.95), axis=1)

    @property
    def scatter(self) -> float:
        """Factor from the largest amplitude of the arm itself to the 95 % quantile of its draws."""
        return float(np.quantile(self.draws.max(0), 0.95) / self.amplitude.max())

    @property
    def accepted(self) -> bool:
        """Whether the limit is kept by the exact equations, and with confidence by the draws."""
        return self.keeps.share >= CONFIDENT and bool(self.peak.max() <= self.limit)


def at_confidence(task: Task) -> Task:
    """Return a task whose arm is excited so that it vibrates no less than with the share of phases that is asked for.

    So the arm itself stands for what nobody knows of its excitation; where all is known it stays as it is.
    """
    if not task.basis.unknown.phases:
        return task
    excitation = likely_excitation(task.over_phases(task.evaluator()), task.basis.unknown, np.zeros(0))
    return replace(task, basis=replace(task.basis, arm=task.basis.arm.replace(excitation)))


def assess_vibration(task: Task, progress: Progress = iter) -> VibrationAssessment:
    """Simulate the motion exactly, and for the draws by the fast method."""
    unknown, evaluator, nothing = task.basis.unknown, task.evaluator(), np.zeros(0)
    phases = over_phases(task.over_phases(evaluator).superposition(nothing), unknown) if unknown.phases else None
    response = exact_response(evaluator)
    amplitudes = task.evaluator(draws=task.assessment_draws).amplitudes(np.zeros((1, 0)), progress)[:, 0]
    own, draws = amplitudes[:, 0], amplitudes[:, 1:]
    keeps = binomial_estimate(draws.max(0) <= task.limit)
    return VibrationAssessment(response, own, draws, keeps, task.limit, phases)


def likely_excitation(evaluator: Evaluator, unknown: Unknowns, change: Float[np.ndarray, "V"]) -> dict[str, float]:
    """Return the excitation of an arm after a change, as `at_confidence` takes it; none where all is known.

    Args:
        evaluator: of the arm over its phases, see `Task.over_phases`.
        unknown: what is not known.
        change: of the evaluator's variables.
    """
    if not unknown.phases:
        return {}
    return at_share(evaluator.arm, evaluator.superposition(change), unknown, CONFIDENT)


def exact_response(evaluator: Evaluator) -> Response:
    """Simulate the motion of an evaluator's arm by the exact equations, to its end.

    Raises:
        KeyboardInterrupt: interrupted; `simulate` would return the part that there is.
    """
    rate, motion = evaluator.rate, evaluator.motion
    response = simulate(evaluator.arm, motion, loads=evaluator.loads, method="exact", rate=rate)
    if len(response.time) < len(sample_times(motion, rate)):
        raise KeyboardInterrupt
    return response
