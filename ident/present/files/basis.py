"""What a simulation rests on, as result files tell it: its inputs, motion and load, and numbers that were changed."""

from collections.abc import Mapping
from typing import Any

from ident.assess.basis import Basis
from ident.identify.values import Values
from ident.measure import Log, Trace
from ident.present.files.document import provenance
from ident.present.text.basis import assumed


def origin(form: str, basis: Basis, options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a simulation was made from, with what and how: the head of its result files."""
    head = provenance(form, basis.arm_file, None, options)
    files = {"fit": basis.fit, "posterior": basis.posterior, "path": basis.log}
    head["inputs"] = {"arm": head["inputs"]["arm"]} | {name: source(file) for name, file in files.items()}
    return head


def source(file: Values | Log | Trace | None) -> dict[str, str] | None:
    """Say where an input comes from."""
    return {"path": file.path, "sha256": file.sha256} if file else None


def motion_document(basis: Basis) -> dict[str, Any]:
    """Describe motion and load as plain data."""
    motion = basis.motion
    return {
        "motion": motion.name,
        "arrival": motion.arrival,
        "duration": float(motion.breaks[-1] - motion.breaks[0]),
        "load": str(basis.load),
        "point": basis.point,
    }


def values_document(basis: Basis) -> dict[str, Any]:
    """Tell which numbers were set, which are assumed, and which of the files' are none of the arm's."""
    return {
        "set": dict(basis.changed),
        "assumed": assumed(basis)[0],
        "left_out": [name for file in (basis.fit, basis.posterior) if file for name in file.left_out],
    }
