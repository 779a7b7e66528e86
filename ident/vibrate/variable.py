"""Numbers of an arm that are varied: by a factor or a difference, alone or several together."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, loss_paths
from ident.arm.fields import ALPHA, COMPONENTS, SPEED, field_of
from ident.errors import Problem, refusal, refuse
from ident.programs import AnyArray, library
from ident.text import did_you_mean

Extents = Mapping[str, Float[np.ndarray, "2 3"]]
"""Corners of the bodies whose shape is known, by name, in the axes of their joint [m]."""
ROUNDING = 1e-9
"""Distance [m] that is no distance."""


@dataclass(frozen=True)
class Paths:
    """A number of an arm, or several that go together, by one factor or one difference.

    Attributes:
        paths: the numbers; `("speed",)` for the speed of the motion.
    """

    paths: tuple[str, ...]

    @property
    def name(self) -> str:
        """The paths with = between."""
        return "=".join(self.paths)

    @property
    def is_speed(self) -> bool:
        """Whether it is the speed of the motion."""
        return self.paths == (SPEED,)

    @property
    def shifted(self) -> bool:
        """Whether it is changed by a difference, not by a factor."""
        return is_shifted(self.paths[0])


@dataclass(frozen=True)
class Variable(Paths):
    """A number that may be changed, or several by one factor or one difference.

    Where the arm's own numbers are uncertain, each draw is changed by the same factor or difference: stiffening a
    joint twofold doubles what it is, whatever it is.

    Attributes:
        low: lower bound of the first of the numbers [SI]
        high: upper bound of it [SI]
        weight: cost of changing it, against others.
    """

    low: float
    high: float
    weight: float = 1.0

    def present(self, arm: Arm) -> float:
        """Return the number as it is [SI]."""
        return float(arm.get(self.paths[0]))

    def change(self, arm: Arm, value: Float[AnyArray, "*batch"] | float) -> AnyArray:
        """Return ln(value / present) or value - present."""
        present = arm.get(self.paths[0])
        xp = library(value, present)
        value, present = xp.asarray(value), xp.asarray(present)
        return xp.asarray(value - present if self.shifted else xp.log(value / present))

    def span(self, arm: Arm) -> tuple[float, float]:
        """Return the bounds as changes, the smaller first: of a number below zero the higher bound is the smaller."""
        low, high = sorted((float(self.change(arm, self.low)), float(self.change(arm, self.high))))
        return low, high


def is_shifted(path: str) -> bool:
    """Tell whether a number is changed by a difference, not by a factor."""
    field = field_of(path)
    return field is not None and not field.logarithmic


def refuse_factor(path: str, present: float, values: Iterable[float]) -> Iterable[Problem]:
    """Yield why values are none that a number can have by a factor: zero is none, and a factor keeps the sign.

    Args:
        path: the number, or the speed.
        present: as it is [SI or %]
        values: what it shall be [SI or %]
    """
    field = field_of(path)
    if not (field.has_factor(present) if field else present > 0):
        expected = "a number that is not zero" if field and field.sign == "non-zero" else "a number above 0"
        yield Problem(path, f"{present:g} at present", expected, "it is changed by a factor: set it first (`set`)")
    elif not all(value * present > 0 for value in values):
        got, expected = " to ".join(f"{value:g}" for value in values), f"bounds {'above' if present > 0 else 'below'} 0"
        yield Problem(path, got, expected, "it is changed by a factor: correct them")


def apply(
    numbers: Mapping[str, Any], variables: Iterable[Variable], changes: Iterable[Float[AnyArray, "*batch"]]
) -> dict[str, AnyArray]:
    """Return the numbers by path after changes; `numbers` has those before, a change broadcasts with them."""
    found = {}
    for variable, change in zip(variables, changes, strict=True):
        for path in variable.paths:
            xp = library(numbers[path], change)
            number, by = xp.asarray(numbers[path]), xp.asarray(change)
            found[path] = xp.asarray(number + by if variable.shifted else number * xp.exp(by))
    return found


def check_path(arm: Arm, path: str) -> None:
    """Refuse paths that are not numbers of the arm, or that a given motion does not depend on."""
    if arm.stroke and path.split(".")[0] == arm.stroke.name:
        remedy = "sweep 'speed', the percentage; other strokes are other motions"
        raise refusal("", path, "a number of the arm itself", remedy)
    if path not in arm.paths():
        remedy = did_you_mean(path, (*arm.paths(), "speed"), "see `Arm.paths()`")
        remedy = "give it a value first (`set`)" if path in (*loss_paths(arm), ALPHA) else remedy
        raise refusal("", path, f"a number of the arm {arm.name}", remedy)


def check(arm: Arm, variable: Variable, extents: Extents | None = None) -> None:
    """Refuse bounds that can't be.

    Args:
        arm: the arm as it is.
        variable: what shall be changed.
        extents: of its bodies; a mass centre must stay within.
    """
    for path in variable.paths:
        check_path(arm, path)
    refuse([*_bounds(arm, variable)] or outside(arm, variable, extents or {}))


def _bounds(arm: Arm, variable: Variable) -> Iterable[Problem]:
    name, low, high, present = variable.name, variable.low, variable.high, variable.present(arm)
    got = f"{low:g} to {high:g}"
    if len({is_shifted(path) for path in variable.paths}) > 1:
        remedy = "coordinates are changed by a difference, others by a factor"
        yield Problem(name, "a coordinate with other numbers", "numbers of one kind", remedy)
    if not (np.isfinite([low, high]).all() and low < high):
        yield Problem(name, got, "a lower and a higher bound", "correct them")
    elif problems := [] if variable.shifted else list(refuse_factor(variable.paths[0], present, (low, high))):
        yield from (replace(problem, where=name) for problem in problems)
    elif not low <= present <= high:
        yield Problem(name, got, f"bounds about the present {present:g}", "correct them, or change it first (`set`)")
    if not 0 < variable.weight < np.inf:
        yield Problem(name, f"weight {variable.weight:g}", "a weight above 0", "correct it")


def outside(arm: Arm, variable: Variable, extents: Extents) -> Iterable[Problem]:
    """Yield what bounds take a mass centre out of its body."""
    for path in variable.paths:
        body, field, *component = path.split(".")
        if field == "com" and body in extents:
            lowest, highest = extents[body][:, COMPONENTS[component[0]][0]]
            low, high = (float(arm.get(path)) - variable.present(arm) + end for end in (variable.low, variable.high))
            if low < lowest - ROUNDING or high > highest + ROUNDING:
                got, expected = f"{low:g} to {high:g} m", f"{lowest:.4g} to {highest:.4g} m, within the body"
                yield Problem(path, got, expected, "keep the mass centre in its body")
