"""A design, or sensitivities, as rows, and the arm file with the changed numbers."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ident.assess.design import DesignStudy, bound_of
from ident.files import replace_file
from ident.present.text.units import unit_of
from ident.text import one_line
from ident.vibrate.redesign.design import Design
from ident.vibrate.redesign.sensitivity import Sensitivities
from ident.vibrate.response.study import DIRECTIONS


def design_rows(study: DesignStudy, design: Design) -> list[dict[str, Any]]:
    """Return a row for each number that may be changed [SI]: as it is, at best, and by the minimum change."""
    return [
        {
            "number": path,
            "unit": unit_of(path),
            "present": float(study.basis.arm.get(path)),
            "best": design.best.values[path],
            "minimum_change": math.nan if design.minimum_change is None else design.minimum_change.values[path],
            "at_bound": bound_of(study.basis.arm, variable, float(change)),
        }
        for variable, change in zip(design.evaluator.variables, design.best.changes, strict=True)
        for path in variable.paths
    ]


def sensitivity_rows(each: Sensitivities) -> list[dict[str, Any]]:
    """Return a row for each number [SI], the strongest first: percent of amplitude per percent of it in x, y and z.

    `unsure` names the directions in which its sign is another for nearby arms.
    """
    return [
        {"number": each.paths[i], "unit": unit_of(each.paths[i]), "present": float(each.present[i])}
        | dict(zip(DIRECTIONS, map(float, each.elasticity[i]), strict=True))
        | {"unsure": "".join(np.array([*DIRECTIONS])[each.unsure[i]])}
        for i in each.order
    ]


def write_arm(text: str, note: str, path: Path) -> None:
    """Write an arm file whole or not at all, with a note above it."""
    whole = f"# {one_line(note)}\n{text}"
    replace_file(path, lambda file: file.write(whole.encode("utf-8")), make_folders=True)
