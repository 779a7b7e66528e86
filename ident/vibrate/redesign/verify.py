"""A design is verified: by the exact equations, and with draws that had no part in its search."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.redesign.design import Place
from ident.vibrate.redesign.evaluator import Draws, Evaluator
from ident.vibrate.redesign.side_by_side import side_by_side
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.simulate import simulate


@dataclass(frozen=True)
class Check:
    """An arm by the exact equations, and with fresh draws.

    Attributes:
        time: (T,) [s]
        vibration: (3, T) [m]
        amplitude: (3,) [m] by the evaluator's measure.
        difference: (3,) [-] of the fast method's amplitude from it, as a share of the largest direction's.
            Where phases are not known, both are with those at which the largest direction's is worst.
        exceedance: of fresh draws, by the fast method; None without draws or limit.
    """

    time: Float[np.ndarray, "T"]
    vibration: Float[np.ndarray, "3 T"]
    amplitude: Float[np.ndarray, "3"]
    difference: Float[np.ndarray, "3"]
    exceedance: BinomialEstimate | None = None


@dataclass(frozen=True)
class Verification:
    """The arm as it is, and after a change."""

    before: Check
    after: Check


def verify(
    evaluator: Evaluator,
    place: Place,
    limit: float | None = None,
    fresh: Draws | None = None,
    progress: Progress = iter,
) -> Verification:
    """Verify a design by the exact method, and with fresh draws by the fast one; the arm as it is as well.

    Where phases are not known, each by the exact method has those with which its vibration is largest.

    Args:
        evaluator: of the design.
        place: the design.
        limit: () [m]
        fresh: draws of the same numbers as the evaluator's that had no part in the search.
        progress: shows how far it is, over batches of draws.

    Raises:
        ModelError: the arm collapses, of a draw perhaps, or the tolerance can't be met.
    """
    changes = np.stack([0 * place.changes, place.changes])
    evaluator = evaluator if evaluator.step else replace(evaluator, step=evaluator.step_for(changes))
    checks = side_by_side([partial(_exact, evaluator.alone, change) for change in changes])
    if fresh and limit is not None:
        estimates = exceedances(replace(evaluator, draws=fresh), changes, limit, progress)
        checks = [replace(check, exceedance=one) for check, one in zip(checks, estimates, strict=True)]
    return Verification(*checks)


def exceedances(
    evaluator: Evaluator, changes: Float[np.ndarray, "G V"], limit: float, progress: Progress = iter
) -> list[BinomialEstimate]:
    """Count the draws of a evaluator that exceed a limit [m] in any direction, after each of some changes."""
    above = np.asarray(evaluator.amplitudes(changes, progress)[:, :, 1:].max(0) > limit)
    return [binomial_estimate(one) for one in above]


def _exact(evaluator: Evaluator, change: Float[np.ndarray, "V"]) -> Check:
    arm = evaluator.changed_arm(change)
    if evaluator.unknown:
        first = 0 if evaluator.measure == "rms" else int(evaluator.amplitude.first)
        arm = arm.replace(evaluator.superposition(change).worst_phases(first))
    fast = replace(evaluator, arm=arm, unknown=()).amplitudes(0 * change[None])[:, 0, 0]
    response = simulate(
        arm,
        evaluator.motion,
        loads=evaluator.loads,
        method="exact",
        elastic_belts=evaluator.elastic_belts,
        rate=evaluator.rate,
        step=evaluator.step,
    )
    vibration = np.asarray(response.vibration)
    amplitude = evaluator.amplitude(vibration)
    return Check(np.asarray(response.time), vibration, amplitude, (fast - amplitude) / amplitude.max())
