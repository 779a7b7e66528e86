"""What a problem predicts, in one program: else each operation of the model would be a program of its own."""

from typing import Any

import equinox as eqx
import numpy as np

from ident.inference.problem import InverseProblem


def predicted(problem: InverseProblem, theta: Any) -> np.ndarray:
    """Return what a problem predicts at theta."""
    return np.asarray(_predicted(problem, np.asarray(theta)))


@eqx.filter_jit
def _predicted(problem: InverseProblem, theta: Any) -> Any:
    return problem.predict(theta)
