"""The files of a design: a summary as JSON with where it comes from, and the arm file with the changed numbers."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.assess.design import DesignStudy, bound_of, same
from ident.files import replace_file
from ident.present.files.basis import motion_document, origin, values_document
from ident.present.files.document import plain
from ident.present.text.design import verdict
from ident.present.text.units import unit_of
from ident.text import one_line
from ident.vibrate.redesign.binomial import binomial_to_json
from ident.vibrate.redesign.design import Design, Place
from ident.vibrate.redesign.sensitivity import Sensitivities
from ident.vibrate.redesign.verify import Check
from ident.vibrate.response.study import DIRECTIONS

FORMAT = "ident-design/2"


def design_document(study: DesignStudy, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a design, or sensitivities alone, in numbers as plain data, all SI; undefined ones become null."""
    document = origin(FORMAT, study.basis, options) | {
        **motion_document(study.basis),
        "measure": study.evaluator.measure,
        "direction": list(DIRECTIONS),
        "draws": study.draws,
        "sensitivities": _sensitivities(study.sensitivities),
        **values_document(study.basis),
    }
    return plain(document | ({} if study.design is None else _design(study, study.design)))


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
    """Return a row for each number [SI], the strongest first: percent of amplitude per percent of it in x, y and z."""
    return [
        {"number": each.paths[i], "unit": unit_of(each.paths[i]), "present": float(each.present[i])}
        | dict(zip(DIRECTIONS, map(float, each.elasticity[i]), strict=True))
        for i in each.order
    ]


def write_arm(text: str, note: str, path: Path) -> None:
    """Write an arm file whole or not at all, with a note above it.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    whole = f"# {one_line(note)}\n{text}"
    replace_file(path, lambda file: file.write(whole.encode("utf-8")), make_folders=True)


def _sensitivities(each: Sensitivities) -> dict[str, Any]:
    band = None if each.draws is None else each.band
    rows = [
        {
            "path": each.paths[i],
            "unit": unit_of(each.paths[i]),
            "present": each.present[i],
            "elasticity": each.elasticity[i],
            "quantiles": None if band is None else {"0.05": band[0, i], "0.95": band[1, i]},
        }
        for i in each.order
    ]
    return {"amplitude": each.amplitude, "numbers": rows}


def _design(study: DesignStudy, design: Design) -> dict[str, Any]:
    required, checks = design.required, study.verification
    return {
        "limit": design.limit,
        "required": {
            "frequency": required.frequency,
            "deflection": required.deflection,
            "change_norm": required.change_norm,
        },
        "variables": [_variable(study, design, i) for i in range(len(design.evaluator.variables))],
        "present": _place(design.present),
        "best": _place(design.best),
        "optima": [_place(place) for place in design.optima],
        "starts": study.starts,
        "starts_at_the_minimum_amplitude": same(design),
        "curve": [_place(place) for place in design.curve],
        "minimum_change": None if design.minimum_change is None else _place(design.minimum_change),
        "verification": checks and {"before": _check(checks.before), "after": _check(checks.after)},
        "verdict": verdict(design),
    }


def _variable(study: DesignStudy, design: Design, i: int) -> dict[str, Any]:
    variable = design.evaluator.variables[i]
    return {
        "paths": list(variable.paths),
        "unit": unit_of(variable.paths[0]),
        "low": variable.low,
        "high": variable.high,
        "weight": variable.weight,
        "changed_by": "difference" if variable.shifted else "factor",
        "present": variable.present(study.basis.arm),
        "best": design.best.values[variable.paths[0]],
        "at_bound": bound_of(study.basis.arm, variable, float(design.best.changes[i])) or None,
    }


def _place(place: Place) -> dict[str, Any]:
    return {
        "values": place.values,
        "amplitude": place.amplitude,
        "largest": place.largest,
        "change_norm": place.change_norm,
        "frequency": place.frequency,
        "deflection": place.deflection,
        "exceedance": place.exceedance,
    }


def _check(check: Check) -> dict[str, Any]:
    drawn = None if check.exceedance is None else binomial_to_json(check.exceedance)
    return {"method": "exact", "amplitude": check.amplitude, "difference": check.difference, "fresh_draws": drawn}
