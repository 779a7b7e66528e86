"""List every name that other commands take of an arm: numbers, joints, points, loads, modes, words of options."""

import importlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.studies import STUDIES
from ident.studies.options import Options, flag_of, specs
from ident.studies.shared import as_file

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.assess.arm_names import ArmNames
    from ident.description.file import ArmFile


@dataclass(frozen=True, repr=False, eq=False)
class NamesResult:
    """The names of an arm.

    Attributes:
        names: with the present value of each number.
    """

    names: "ArmNames"

    def __str__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return the text that `ident list` prints."""
        from ident.present.text.names import names_report

        units = {kind: "-" if unit == "1" else unit for kind, unit in kinds().items()}
        return names_report(self.names, units, choices(), columns())

    def document(self) -> dict[str, Any]:
        """Return the same for programs."""
        arm = self.names.arm_file.arm
        return {
            "format": "ident-list/1",
            "arm": arm.name,
            "numbers": [asdict(each) for each in self.names.numbers],
            "joints": [
                {"name": j.name, "driven": j.driven, "limits": [x if isfinite(x) else None for x in j.limits]}
                for j in arm.joints
            ],
            "points": [point.name for point in arm.points],
            "loads": [payload.body.name for payload in arm.payloads],
            "modes": [{"mode": label, "frequency": frequency} for label, frequency in self.names.modes],
            "kinds": kinds(),
            "choices": {flag: list(words) for flag, words in choices().items()},
            "columns": {column: list(words) for column, words in columns().items()},
        }


def names(arm: "Arm | ArmFile | str | Path") -> NamesResult:
    """List every name that other commands take of an arm.

    Args:
        arm: the arm, or its file.

    Raises:
        InputError: the arm's file is wrong.
    """
    from ident.assess.arm_names import arm_names

    return NamesResult(arm_names(as_file(arm)))


def kinds() -> Mapping[str, str]:
    """Return the SI unit of each kind of measurement."""
    from ident.measure import KINDS
    from ident.units import QUANTITIES

    return {kind: QUANTITIES[quantity].si for kind, quantity in KINDS.items()}


def columns() -> Mapping[str, tuple[str, ...]]:
    """Return the words that columns of a campaign have to choose from."""
    from ident.measure import DEFINITIONS, DRIVE_STATES

    return {"of": DEFINITIONS, "drives": DRIVE_STATES}


def choices() -> Mapping[str, tuple[str, ...]]:
    """Return the words that options of commands have to choose from, by command and flag."""
    found: dict[str, tuple[str, ...]] = {}
    for study in (*STUDIES, "explore"):
        kind: type[Options] = getattr(importlib.import_module(f"ident.studies.{study}"), f"{study.capitalize()}Options")
        known = [(each, spec) for each, spec in specs(kind) if each.name not in kind.refuses]
        found |= {f"{study} {flag_of(each)}": spec.choices for each, spec in known if spec.choices}
    return found
