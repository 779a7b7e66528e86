"""What data can tell, before any solving: a verdict for each parameter of any model."""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Bool, Float

from ident.inference.information import OPEN_ABOVE, Information, clear_of, information
from ident.inference.least_squares import End, evaluate
from ident.inference.leverage import Leverage, leverage_of
from ident.inference.other_solutions import OtherSolutions, other_solutions
from ident.inference.parameters import Parameter
from ident.inference.problem import InverseProblem

Verdict = Literal["identifiable", "weak", "open", "not seen", "unknown"]
POINTS = 8
"""Points tried beside the starting values."""
POINTS_SPREAD = 0.4
"""Their standard deviation in theta, where the prior is not narrower: a factor of 1.5 for a stiffness."""
INVISIBLE = 1e-6
"""Columns of the Jacobian below this share of the largest one are rounding."""


@dataclass(frozen=True)
class Check:
    """What the data can tell about the parameters, if the truth is near the starting values.

    Attributes:
        problem: what was checked.
        verdicts: (Q,) of the unknowns of interest, see `check`.
        information: what the data alone tell at the starting values; None where the model has no answer there.
        leverage: the part of each measurement in it; None likewise.
        missing: (D,) which values the model has no answer for, or no derivative of, at the starting values.
        data_sd: (points, Q) standard deviation in theta by the data alone, the starting values first.
        supported: (points, Q) whether each parameter is identifiable there.
        tried: number of points tried, the starting values among them; those without an answer are not in `data_sd`.
        others: other values that give the same data; None where some direction is open, so that there are always some.
    """

    problem: InverseProblem
    verdicts: tuple[Verdict, ...]
    information: Information | None
    leverage: Leverage | None
    missing: Bool[np.ndarray, "D"]
    data_sd: Float[np.ndarray, "points Q"]
    supported: Bool[np.ndarray, "points Q"]
    tried: int
    others: OtherSolutions | None = None

    @property
    def items(self) -> tuple[Parameter, ...]:
        """The unknowns of interest."""
        return tuple(item for item in self.problem.parameters.items if not item.nuisance)

    @property
    def answered(self) -> int:
        """Number of points at which the model has an answer."""
        return len(self.data_sd)

    @property
    def blind(self) -> bool:
        """Whether no parameter is seen at all."""
        return all(verdict == "not seen" for verdict in self.verdicts)


def check(problem: InverseProblem, *, points: int = POINTS, spread: float = POINTS_SPREAD, seed: int = 0) -> Check:
    """Tell from predictions and their Jacobian what the data determine; nothing is fitted, no measured value used.

    The Jacobian at one point may mislead: a derivative may vanish there by symmetry, or two modes trade places nearby.
    So it is evaluated at several, and the verdict holds for all of them, as the truth may be any:

    - `identifiable`: at every point the data alone give theta a standard deviation below `information.WEAK_ABOVE`;
    - `not seen`: at no point does any value depend on it;
    - `unknown`: the model has no answer at the starting values, or at most of the points;
    - `open`: at no point do the data alone bound it, or only beyond `information.OPEN_ABOVE`, as in a fit: they see it
      together with others, or next to nothing of it;
    - `weak`: else. The data see it too little, or not at every point.

    What is not exactly known beside them scatters the data, and so makes them tell less.

    That is local: whether values far away give the same data is looked for, from several starts, in `others`.

    Args:
        problem: model, data and unknowns; priors only narrow the points down.
        points: number of points beside the starting values.
        spread: standard deviation in theta of the points about the starting values, at most.
        seed: of the points.
    """
    parameters = problem.parameters
    start = np.asarray(parameters.theta(parameters.column("start")))
    width = np.minimum(parameters.normal_sd, spread)
    noise = np.random.default_rng(seed).standard_normal((points, len(start))) * width
    ends = [jax.device_get(evaluate(problem, theta)) for theta in (start, *(start + noise))]
    evaluated = [_scaled_jacobian(problem, end) for end in ends]
    answers = [J for J, missing in evaluated if not missing.any()]
    own = ~parameters.nuisance
    names = tuple(name for name, counts in zip(parameters.names, own, strict=True) if counts)
    known = [information(J, np.full(len(names), np.inf), names) for J in answers]
    here, missing = evaluated[0]
    blank = bool(missing.any())
    sd = np.array([each.data_sd for each in known]).reshape(-1, len(names))
    supported = np.array([each.supported for each in known], bool).reshape(-1, len(names))
    unknown = blank or 2 * len(answers) < len(evaluated)
    groups = None if problem.correlation is None else problem.correlation.groups
    closed = not blank and not any(direction.open for direction in known[0].directions)
    return Check(
        problem,
        tuple("unknown" for _ in names) if unknown else _verdicts(np.array(answers), supported, sd),
        None if blank else known[0],
        None if blank else leverage_of(here, names, groups),
        missing,
        sd,
        supported,
        len(evaluated),
        other_solutions(problem, ends[0], seed=seed) if closed else None,
    )


def _scaled_jacobian(problem: InverseProblem, end: End) -> tuple[np.ndarray, np.ndarray]:
    """Return d(predicted / sigma)/d(theta) of the unknowns of interest, and which fitted values have no answer."""
    sigma = np.asarray(problem.sigma)
    J, fitted = np.asarray(end.jacobian), np.isfinite(sigma)
    missing = fitted & ~(np.isfinite(np.asarray(end.predicted)) & np.isfinite(J).all(1))
    scaled, parameters = problem.scaled(np.where(fitted[:, None], J, 0.0)), problem.parameters
    if missing.any() or not parameters.nuisance.any():
        return scaled[:, ~parameters.nuisance], missing
    return clear_of(scaled, parameters.normal_sd, parameters.nuisance), missing


def _verdicts(
    jacobians: Float[np.ndarray, "points D P"],
    supported: Bool[np.ndarray, "points P"],
    sd: Float[np.ndarray, "points P"],
) -> tuple[Verdict, ...]:
    size = np.linalg.norm(jacobians, axis=1)
    seen = (size > INVISIBLE * size.max(1, keepdims=True)).any(0)
    words = np.where(seen, np.where((sd < OPEN_ABOVE).any(0), "weak", "open"), "not seen")
    return tuple(np.where(np.all(supported, axis=0), "identifiable", words).tolist())
