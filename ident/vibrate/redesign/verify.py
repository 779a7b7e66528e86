"""A design is tried again: by the exact equations, and with draws that had no part in its search."""

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.vibrate.redesign.binomial import BinomialEstimate, binomial_estimate
from ident.vibrate.redesign.design import Place
from ident.vibrate.redesign.evaluator import Draws, Evaluator
from ident.vibrate.response.exact import Progress
from ident.vibrate.response.simulate import simulate


@dataclass(frozen=True)
class Check:
    """An arm by the exact equations, and with fresh draws.

    Attributes:
        time: (T,) [s]
        vibration: (3, T) [m]
        amplitude: (3,) [m] by the trial's measure.
        difference: (3,) [-] of the fast method's amplitude from it, as a share of the largest direction's.
        exceeding: of fresh draws, by the fast method; None without draws or limit.
    """

    time: Float[np.ndarray, "T"]
    vibration: Float[np.ndarray, "3 T"]
    amplitude: Float[np.ndarray, "3"]
    difference: Float[np.ndarray, "3"]
    exceeding: BinomialEstimate | None = None


@dataclass(frozen=True)
class Verification:
    """The arm as it is, and after a change."""

    before: Check
    after: Check


def verify(
    trial: Evaluator,
    place: Place,
    limit: float | None = None,
    fresh: Draws | None = None,
    progress: Progress = iter,
) -> Verification:
    """Try a design by the exact method, and with fresh draws by the fast one; the arm as it is as well.

    Args:
        trial: of the design.
        place: the design.
        limit: () [m]
        fresh: draws of the same numbers as the trial's that had no part in the search.
        progress: shows how far it is, over batches of draws.

    Raises:
        ModelError: the arm collapses, of a draw perhaps, or the tolerance can't be met.
    """
    changes = np.stack([0 * place.changes, place.changes])
    trial = trial if trial.step else replace(trial, step=trial.step_for(changes))
    alone = replace(trial, draws={}, also=(*trial.also, *trial.draws))
    fast = alone.amplitudes(changes)[:, :, 0].T
    checks = [_exact(alone, change, own) for change, own in zip(changes, fast, strict=True)]
    if fresh and limit is not None:
        found = exceeding(replace(trial, draws=fresh), changes, limit, progress)
        checks = [replace(check, exceeding=one) for check, one in zip(checks, found, strict=True)]
    return Verification(*checks)


def exceeding(
    trial: Evaluator, changes: Float[np.ndarray, "G V"], limit: float, progress: Progress = iter
) -> list[BinomialEstimate]:
    """Count the draws of a trial that exceed a limit [m] in any direction, after each of some changes."""
    above = np.asarray(trial.amplitudes(changes, progress)[:, :, 1:].max(0) > limit)
    return [binomial_estimate(one) for one in above]


def _exact(trial: Evaluator, change: Float[np.ndarray, "V"], fast: Float[np.ndarray, "3"]) -> Check:
    arm = trial.arm.replace({path: jnp.asarray(value) for path, value in trial.values(change).items()})
    how: dict[str, Any] = {
        "loads": trial.loads,
        "elastic_belts": trial.elastic_belts,
        "rate": trial.rate,
        "step": trial.step,
    }
    response = simulate(arm, trial.motion, method="exact", **how)
    vibration = np.asarray(response.vibration)
    amplitude = np.asarray(trial.amplitude(response.vibration))
    return Check(np.asarray(response.time), vibration, amplitude, (fast - amplitude) / amplitude.max())
