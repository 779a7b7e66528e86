"""What a problem or an arm predicts, in one program: else each operation of the model would be a program of its own."""

from typing import Any

import equinox as eqx
import numpy as np

from ident.arm.arm import Arm
from ident.identify.conditions import bind
from ident.identify.predict import predict
from ident.inference.problem import InverseProblem
from ident.measure import Campaign

_predict = eqx.filter_jit(predict)


def predicted(problem: InverseProblem, theta: Any) -> np.ndarray:
    """Return what a problem predicts at theta."""
    return np.asarray(_predicted(problem, np.asarray(theta)))


@eqx.filter_jit
def _predicted(problem: InverseProblem, theta: Any) -> Any:
    return problem.predict(theta)


def shown(arm: Arm, campaign: Campaign, parameters: dict[str, Any] | None = None) -> np.ndarray:
    """Return what a campaign's rows would be of an arm, with these numbers in place of its own."""
    numbers = {path: np.asarray(value, float) for path, value in (parameters or {}).items()}
    return np.asarray(_predict(arm, numbers, bind(arm, campaign)))
