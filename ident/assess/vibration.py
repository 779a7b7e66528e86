"""How far the arm vibrates, and with which probability that is too far."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.assess.task import CONFIDENT, RATE, Task
from ident.vibrate.motion.motion import Motion
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.response import Response, peak
from ident.vibrate.response.simulate import sample_times, simulate


@dataclass(frozen=True)
class VibrationAssessment:
    """The arm at work as it is.

    Attributes:
        response: by the exact equations.
        amplitude: (3,) [m] of the arm itself.
        draws: (3, D) [m]
        keeps: probability that the limit is kept in all directions.
        limit: [m]
    """

    response: Response
    amplitude: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 D"]
    keeps: BinomialEstimate
    limit: float

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


def assess_vibration(task: Task, progress: Progress = iter) -> VibrationAssessment:
    """Simulate the motion exactly, and for the draws by the fast method."""
    response = exact_response(task.basis.arm, task.basis.motion, task.basis.loads)
    amplitudes = task.evaluator(draws=task.assessment_draws).amplitudes(np.zeros((1, 0)), progress)[:, 0]
    own, draws = amplitudes[:, 0], amplitudes[:, 1:]
    return VibrationAssessment(response, own, draws, binomial_estimate(draws.max(0) <= task.limit), task.limit)


def exact_response(arm: Arm, motion: Motion, loads: Loads) -> Response:
    """Simulate a motion by the exact equations, to its end.

    Raises:
        KeyboardInterrupt: interrupted; `simulate` would return the part that there is.
    """
    response = simulate(arm, motion, loads=loads, method="exact", rate=RATE)
    if len(response.time) < len(sample_times(motion, RATE)):
        raise KeyboardInterrupt
    return response
