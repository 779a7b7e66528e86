"""How far the arm vibrates, and with which probability that is too far."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.assess.task import CONFIDENT, Task
from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.response import peak
from ident.vibrate.response.study import SimulatedMotion, simulate_motion


@dataclass(frozen=True)
class VibrationAssessment:
    """The arm at work as it is.

    Attributes:
        simulated: by the exact equations.
        amplitude: (3,) [m] of the arm itself.
        draws: (3, D) [m]
        keeps: probability that the limit is kept in all directions.
        scatter: factor from the largest amplitude of the arm itself to the 95 % quantile of its draws.
        peak: (3,) [m] by the exact equations.
        accepted: whether the limit is kept by the exact equations, and with confidence by the draws.
    """

    simulated: SimulatedMotion
    amplitude: Float[np.ndarray, "3"]
    draws: Float[np.ndarray, "3 D"]
    keeps: BinomialEstimate
    scatter: float
    peak: Float[np.ndarray, "3"]
    accepted: bool


def assess_vibration(task: Task, progress: Progress = iter) -> VibrationAssessment:
    """Simulate the motion exactly, and for the draws by the fast method."""
    done = simulate_motion(task.arm, task.motion, loads=task.loads, method="exact", rate=task.rate)
    whole = task.trial(draws=task.seen).amplitudes(np.zeros((1, 0)), progress)[:, 0]
    largest = whole[:, 1:].max(0)
    scatter = float(np.quantile(largest, 0.95) / whole[:, 0].max())
    exact, keeps = np.asarray(peak(done.response.vibration)), binomial_estimate(largest <= task.limit)
    accepted = keeps.share >= CONFIDENT and bool(exact.max() <= task.limit)
    return VibrationAssessment(done, whole[:, 0], whole[:, 1:], keeps, scatter, exact, accepted)
