"""Weights of the nodes of a time interval for the steps within it, in chunks of which there are few numbers."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ident.jit import AnyArray
from ident.vibrate.response.few_sizes import ladder
from ident.vibrate.response.time_intervals import MOST_STEPS, NODE_PLACES, NODES, weights

STAGES = 3
"""Stages of a step; the order is twice as high."""
GAUSS = (np.polynomial.legendre.leggauss(STAGES)[0] + 1) / 2
"""The stages within a step, from 0 to 1."""
STEPS = 24
"""Steps that are computed together: few are slower each, of many more are beyond the last of an interval."""
MOST_CHUNKS = -(-MOST_STEPS // STEPS)
"""Chunks of steps of an interval."""


class StepWeights(NamedTuple):
    """Weights of an interval's nodes for its start, its edges, steps about nodes, and each of its steps, in chunks.

    Attributes:
        steps: () number S of steps of an interval.
        about_nodes: (STAGES, m, m) for the stages of steps about the nodes.
        within: (chunks, STEPS) the steps' numbers.
        middles: (chunks, m, STEPS) for the middles of the steps.
        in_steps: (chunks, STEPS STAGES) places of the stages, in steps.
        stages: (chunks, 3, m, STEPS STAGES) for the stages: value, slope, curvature.
    """

    steps: Int[AnyArray, ""]
    about_nodes: Float[AnyArray, "stages m m"]
    within: Int[AnyArray, "chunks steps"]
    middles: Float[AnyArray, "chunks m steps"]
    in_steps: Float[AnyArray, "chunks places"]
    stages: Float[AnyArray, "chunks 3 m places"]


@lru_cache
def step_weights(S: int) -> StepWeights:
    """Return the weights for intervals of S steps, filled up to one of few numbers of chunks."""
    within = np.arange(ladder(-(-S // STEPS), MOST_CHUNKS) * STEPS).reshape((-1, STEPS))
    at = np.minimum(within, S - 1)
    in_steps = (at[..., None] + GAUSS).reshape((len(at), -1))
    return StepWeights(
        steps=np.asarray(S),
        about_nodes=np.stack([weights(NODE_PLACES + (stage - 0.5) / S)[0] for stage in GAUSS]),
        within=within,
        middles=np.moveaxis(weights((at.ravel() + 0.5) / S)[0].reshape((NODES, *at.shape)), 1, 0),
        in_steps=in_steps,
        stages=np.moveaxis(np.stack(weights(in_steps.ravel() / S)).reshape((3, NODES, *in_steps.shape)), 2, 0),
    )
