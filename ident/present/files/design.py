"""The files of a design: a summary as JSON with where it comes from, and the arm file with the changed numbers."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ident.arm.arm import Arm
from ident.assess.design import DesignStudy, bound_of, same
from ident.description.file import update_file
from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.present.files.fit import plain, provenance
from ident.present.text.basis import assumed
from ident.present.text.design import verdict
from ident.present.text.units import unit_of
from ident.text import decode, one_line, read_bytes
from ident.vibrate.redesign.binomial import binomial_to_json
from ident.vibrate.redesign.design import Design, Place
from ident.vibrate.redesign.sensitivity import Sensitivities
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.redesign.verify import Check, Verification
from ident.vibrate.response.study import DIRECTIONS

FORMAT, SENSITIVITY_FORMAT = "ident-design/1", "ident-sensitivity/1"


def design_document(designing: DesignStudy, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a design, or sensitivities alone, in numbers as plain data, all SI; undefined ones become null."""
    motion, design = designing.trial.motion, designing.design
    head = provenance(SENSITIVITY_FORMAT if design is None else FORMAT, designing.arm_file, None, options)
    given = {"fit": designing.fit, "posterior": designing.posterior, "path": designing.log}
    head["inputs"] = {"arm": head["inputs"]["arm"]} | {
        name: {"path": file.path, "sha256": file.sha256} if file else None for name, file in given.items()
    }
    document = head | {
        "motion": motion.name,
        "arrival": motion.arrival,
        "duration": float(motion.breaks[-1] - motion.breaks[0]),
        "load": str(designing.load),
        "point": designing.point,
        "measure": designing.trial.measure,
        "direction": list(DIRECTIONS),
        "draws": designing.draws,
        "sensitivities": _sensitivities(designing.sensitivities),
        "set": dict(designing.changed or {}),
        "assumed": assumed(designing)[0],
        "left_out": [name for file in (designing.fit, designing.posterior) if file for name in file.left_out],
    }
    return plain(document | ({} if design is None else _design(designing, design)))


def revised(designing: DesignStudy, values: Mapping[str, float]) -> str:
    """Return the text of the arm file with the arm's own numbers (fitted, set) and changed ones.

    Raises:
        InputError: a number is not written in the file, or the file has changed meanwhile and is no arm any more.
    """
    path = designing.arm_file.path
    text = decode(read_bytes(path, "an arm description (TOML)"), one_line(path))
    own = {name: value for name, value in designing.own.items() if name not in values}
    fitted = {name: value for name, value in own.items() if name not in (designing.changed or {})}
    for origin, group in (("calibrated", fitted), ("assumed", designing.changed or {}), ("designed", values)):
        text = update_file(text, group, origin=origin, where=one_line(path)) if group else text  # type: ignore[arg-type]
    return text


def check_written(arm: Arm, names: Iterable[str], path: str) -> None:
    """Refuse numbers that are not written in the arm file, so that it could not be written with others.

    Raises:
        InputError: one follows from others there, as an inertia from a shape, or is left out.
    """
    text = decode(read_bytes(path, "an arm description (TOML)"), one_line(path))
    for name in names:
        try:
            update_file(text, {name: float(arm.get(name))}, origin="designed")
        except InputError:
            got, expected = "a number that is not written in the arm file", "one that is"
            raise InputError(Problem(name, got, expected, "write it there, or change what it follows from")) from None


def write_arm(text: str, note: str, path: Path) -> None:
    """Write an arm file whole or not at all, with a note above it.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    whole = f"# {one_line(note)}\n{text}"
    replace_file(path, lambda file: file.write(whole.encode("utf-8")), make_folders=True)


def _sensitivities(found: Sensitivities) -> dict[str, Any]:
    band = None if found.draws is None else found.band
    rows = [
        {
            "path": found.paths[i],
            "unit": unit_of(found.paths[i]),
            "present": found.present[i],
            "elasticity": found.elasticity[i],
            "quantiles": None if band is None else {"0.05": band[0, i], "0.95": band[1, i]},
        }
        for i in found.order
    ]
    return {"amplitude": found.amplitude, "numbers": rows}


def _design(designing: DesignStudy, design: Design) -> dict[str, Any]:
    required = design.required
    return {
        "limit": design.limit,
        "required": {
            "frequency": required.frequency,
            "deflection": required.deflection,
            "amount": required.change_norm,
        },
        "variables": [_variable(designing, design, i) for i in range(len(design.evaluator.variables))],
        "present": _place(design.present),
        "best": _place(design.best),
        "optima": [_place(place) for place in design.optima],
        "starts": designing.starts,
        "starts_at_the_quietest": same(design),
        "curve": [_place(place) for place in design.curve],
        "cheapest": _place(design.minimum_change),
        "verification": _verification(designing.verification),
        "verdict": verdict(design),
    }


def _variable(designing: DesignStudy, design: Design, i: int) -> dict[str, Any]:
    variable: Variable = design.evaluator.variables[i]
    return {
        "paths": list(variable.paths),
        "unit": unit_of(variable.paths[0]),
        "low": variable.low,
        "high": variable.high,
        "weight": variable.weight,
        "changed_by": "difference" if variable.shifted else "factor",
        "present": variable.present(designing.arm),
        "best": design.best.values[variable.paths[0]],
        "at_bound": bound_of(designing.arm, variable, float(design.best.changes[i])) or None,
    }


def _place(place: Place | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {
        "values": place.values,
        "amplitude": place.amplitude,
        "largest": place.largest,
        "amount": place.change_norm,
        "frequency": place.frequency,
        "deflection": place.deflection,
        "exceeding": place.exceedance,
    }


def _verification(found: Verification | None) -> dict[str, Any] | None:
    return None if found is None else {"before": _check(found.before), "after": _check(found.after)}


def _check(check: Check) -> dict[str, Any]:
    drawn = None if check.exceedance is None else binomial_to_json(check.exceedance)
    return {"method": "exact", "amplitude": check.amplitude, "difference": check.difference, "fresh_draws": drawn}
