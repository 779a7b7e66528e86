"""Loops of ramps: by how much an arm, its load let down, stays behind what it was on the way up.

Friction in a drive and play in a bearing make readings depend on the way by which a load was reached. What rows of one
loop read, up and back, is taken to lie half its width to either side of what springs alone would give,

    read = springs -/+ width / 2,   - while loading, + while unloading,

the width the same at all loads of the ramp. It is an unknown of its own, of which nothing is said beforehand: so rows
of both ways tell stiffnesses by their middle, and the width is told by what they differ by. Where it is not the same at
all loads, as towards the turning points of a ramp, data and model contradict each other.

References:
    The loop in the torsion of harmonic drives, and its width: Tuttle, Seering, "A nonlinear model of a harmonic drive
    gear transmission", IEEE Trans. Robot. Autom. 12 (3), 1996; makers' catalogues give it as "hysteresis loss".
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ident.inference.information import information
from ident.inference.least_squares import evaluate
from ident.inference.parameters import Parameter
from ident.inference.problem import InverseProblem
from ident.measure import Campaign, Measurement
from ident.measure.kinds import RAMPS

if TYPE_CHECKING:
    from ident.identify.conditions import Conditions
    from ident.inference.fit import Fit

PREFIX = "loop:"
"""What the names of the widths begin with; then a number from 1, and the kind of its rows."""
STEP = 1e-4
"""Size of theta: 0.1 mm, or 0.1 mrad."""


@dataclass(frozen=True)
class Ramp:
    """A ramp of loads, and how well the width of its loop is told.

    Attributes:
        name: of its width among the unknowns.
        rows: places of its rows in the campaign.
        of: one of these, which says what was read, and at which posture.
        sd: [m or rad] standard deviation of the width; infinite where the data do not tell.
    """

    name: str
    rows: tuple[int, ...]
    of: Measurement
    sd: float


@dataclass(frozen=True)
class Loop(Ramp):
    """The loop that a ramp of loads went through.

    Attributes:
        width: [m or rad] what was read while unloading, less what was read at the same load while loading.
        largest: [m or rad] the largest value that was read.
    """

    width: float
    largest: float


def loops(campaign: Campaign, fit: Fit) -> tuple[Loop, ...]:
    """Return the loops of a campaign's ramps, as a fit has found them."""
    found = _ramps(campaign, fit.problem, fit.information.sd)
    values = [[abs(campaign.measurements[i].value) for i in ramp.rows] for ramp in found]
    return tuple(
        Loop(**vars(ramp), width=fit.parameters[ramp.name], largest=max(own, default=0.0))
        for ramp, own in zip(found, values, strict=True)
    )


def ramps(campaign: Campaign, problem: InverseProblem) -> tuple[Ramp, ...]:
    """Return the ramps of a campaign, and how well its data alone would tell their widths at the starting values."""
    if not _names(campaign):
        return ()
    parameters = problem.parameters
    start = np.asarray(parameters.theta(parameters.column("start")))
    jacobian = np.asarray(jax.device_get(evaluate(problem, start)).jacobian)
    if not np.isfinite(jacobian).all():
        return _ramps(campaign, problem, np.full(len(start), np.inf))
    prior = np.where(parameters.nuisance, parameters.normal_sd, np.inf)
    known = information(problem.scaled(jacobian), prior, parameters.names, parameters.nuisance)
    return _ramps(campaign, problem, known.sd)


def _ramps(campaign: Campaign, problem: InverseProblem, sd: np.ndarray) -> tuple[Ramp, ...]:
    names, places = problem.parameters.names, loop_places(campaign)
    found = []
    for number, name in _names(campaign).items():
        rows = tuple(i for i, place in enumerate(places) if abs(place) == number)
        found.append(Ramp(name, rows, campaign.measurements[rows[0]], STEP * float(sd[names.index(name)])))
    return tuple(found)


def is_of_loop(name: str) -> bool:
    """Tell whether a parameter is the width of a loop."""
    return name.startswith(PREFIX)


def kind_of(name: str) -> str:
    """Return the kind of the rows that a loop's width is of."""
    return name.rpartition(":")[2]


def _number(name: str) -> int:
    return int(name.split(":")[1])


def without_loops(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers that are no widths of loops."""
    return {name: value for name, value in parameters.items() if not is_of_loop(name)}


def loop_places(campaign: Campaign) -> list[int]:
    """Return the number of each row's loop, from 1, negative where it was read while loading; 0 for none.

    One loop is of one kind, posture, place that was read and state of the drives; a `repeat` tells ramps apart.
    """
    numbers: dict[Hashable, int] = {}
    return [
        (-1 if m.ramp == RAMPS[0] else 1) * numbers.setdefault(_key(m), len(numbers) + 1) if m.ramp else 0
        for m in campaign
    ]


def _key(m: Measurement) -> Hashable:
    return m.kind, m.posture, m.point, m.direction, m.joint, m.setup, m.drives, m.repeat


def _names(campaign: Campaign) -> dict[int, str]:
    """Return the name of each loop's width, by its number."""
    return {abs(n): f"{PREFIX}{abs(n)}:{m.kind}" for m, n in zip(campaign, loop_places(campaign), strict=True) if n}


def loop_parameters(campaign: Campaign) -> tuple[Parameter, ...]:
    """Return the widths of the loops: nuisances of which nothing is known."""
    return tuple(Parameter((name,), False, 0.0, 0.0, np.inf, STEP, nuisance=True) for name in _names(campaign).values())


def with_loops(conditions: Conditions, parameters: Mapping[str, Any]) -> Conditions:
    """Return the conditions with what each reading lags behind, its loop as wide as these numbers say."""
    readings = conditions.readings
    if readings.loop is None:
        return conditions
    rank = max((jnp.ndim(value) for value in parameters.values()), default=0)
    own = {_number(name): jnp.asarray(value) for name, value in parameters.items() if is_of_loop(name)}
    none = jnp.zeros((1,) * rank)
    each = [own.get(number, none) for number in range(max(own, default=0) + 1)]
    widths = jnp.stack(jnp.broadcast_arrays(*(x.reshape(x.shape + (1,) * (rank - x.ndim)) for x in each)))
    side = jnp.sign(jnp.asarray(readings.loop)).reshape(-1, *(1,) * rank) / 2
    return replace(conditions, readings=replace(readings, loop=None, lag=side * widths[jnp.abs(readings.loop)]))
