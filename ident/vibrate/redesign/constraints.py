"""What a design must meet: least first frequency, largest deflection, largest change."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ident.vibrate.redesign.objective import Objective, Point

SLACK = 1e-6
"""By how much a requirement may be missed, of its size."""


@dataclass(frozen=True)
class Requirements:
    """What a design must meet.

    Attributes:
        frequency: () [Hz] that the first natural frequency must reach at both ends of the motion; 0 for none.
        deflection: () [m] that the static deflection must not exceed at either end; infinite for none.
        change_norm: () [-] largest change norm, see `design.Place`; infinite for none.
    """

    frequency: float = 0.0
    deflection: float = np.inf
    change_norm: float = np.inf


class Constraint(NamedTuple):
    """A function of u that must not be negative, (J,), and its slopes (J, V)."""

    value: Callable[[Point], Any]
    slope: Callable[[Point], np.ndarray]


def constraints(objective: Objective, required: Requirements, change_norm: float = np.inf) -> list[Constraint]:
    """Return the requirements, and a largest change norm, as constraints, each relative to its bound."""
    rows = []
    if np.isfinite(most := min(change_norm, required.change_norm)):
        rows.append(
            Constraint(
                lambda u: 1 - objective.squared_norm(u)[0] / most**2, lambda u: -objective.squared_norm(u)[1] / most**2
            )
        )
    if (f := required.frequency) > 0:
        rows.append(
            Constraint(lambda u: objective.end_state(u)[0][0] / f - 1, lambda u: objective.end_state(u)[1][0] / f)
        )
    if np.isfinite(d := required.deflection):
        rows.append(
            Constraint(lambda u: 1 - objective.end_state(u)[0][1] / d, lambda u: -objective.end_state(u)[1][1] / d)
        )
    return rows


def below(objective: Objective, limit: float) -> Constraint:
    """Return the constraint that no amplitude of the arm itself exceeds a limit [m]."""
    return Constraint(lambda u: 1 - objective.parts(u)[0] / limit, lambda u: -objective.parts(u)[1] / limit)


def below_bound(objective: Objective) -> Constraint:
    """Return the constraint that no amplitude exceeds one more unknown, in units of the present amplitude."""
    unit = objective.present
    return Constraint(
        lambda x: x[-1] - objective.parts(x[:-1])[0] / unit,
        lambda x: np.pad(-objective.parts(x[:-1])[1] / unit, ((0, 0), (0, 1)), constant_values=1.0),
    )


def widened(row: Constraint) -> Constraint:
    """Return the constraint with one more unknown that does not matter to it."""
    return Constraint(lambda x: row.value(x[:-1]), lambda x: np.append(row.slope(x[:-1]), 0.0))


def are_met(rows: list[Constraint], u: Point) -> bool:
    """Tell whether all constraints are met."""
    return all(np.min(row.value(u)) >= -SLACK for row in rows)
