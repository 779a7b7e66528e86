"""How `--change PATHS[=LOW:HIGH[:WEIGHT]]` is read."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from ident.cli.ranges import Range, read_range
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.vibrate.redesign.variable import Extents, Variable

ChangeOption = Annotated[
    list[str] | None,
    typer.Option(
        help="number that may be changed, with bounds in SI, or in multiples of the present value with an x, "
        "and a weight, how dear it is to change: joint1.k_tors, link1.mass=0.5x:2x, fingers.com.x=1.3:1.8:2; "
        "several by one common factor: a.k_tors=b.k_tors; may be repeated; default: torsional stiffness of every joint"
    ),
]
FACTORS = (0.5, 2.0)
"""Of the present value, for what is changed by a factor, unless bounds are given."""


def variables(arm: "Arm", texts: Sequence[str], extents: "Extents") -> "tuple[Variable, ...]":
    """Return what may be changed; complaints tell the option.

    Raises:
        InputError: what can't be read, no such number, or bounds that can't be.
    """
    asked = [(text, read_range(text, "--change", "WEIGHT")) for text in texts]
    if not asked:
        asked = [(name, Range((name,))) for name in (f"{joint.name}.k_tors" for joint in arm.joints)]
    found = tuple(_variable(arm, text, one, extents) for text, one in asked)
    _refuse_twice(found)
    return found


def _variable(arm: "Arm", text: str, asked: Range, extents: "Extents") -> "Variable":
    from ident.vibrate.redesign.variable import Variable, check, check_path

    try:
        if "speed" in asked.paths:
            raise InputError(Problem("", "the speed", "a number of the arm", "see ident sweep --vary speed"))
        for path in asked.paths:
            check_path(arm, path)
        low, high = _ends(arm, asked, extents)
        found = Variable(asked.paths, low, high, 1.0 if asked.third is None else asked.third)
        check(arm, found, extents)
    except InputError as error:
        raise InputError(replace(error.problems[0], where=f"--change {text}", column="")) from None
    return found


def _ends(arm: "Arm", asked: Range, extents: "Extents") -> tuple[float, float]:
    from ident.vibrate.redesign.ranges import about
    from ident.vibrate.redesign.variable import is_shifted

    path = asked.paths[0]
    present = float(arm.get(path))
    if asked.bounds is not None:
        low, high = (bound.of(present) for bound in asked.bounds)
        return low, high
    if is_shifted(path):
        return about(path, present, extents)
    return FACTORS[0] * present, FACTORS[1] * present


def _refuse_twice(found: "Sequence[Variable]") -> None:
    paths = [path for variable in found for path in variable.paths]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice:
        raise InputError(Problem("--change", f"{twice} twice", "each number once", "drop one"))
