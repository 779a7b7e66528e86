"""An arm by itself: its picture, the plausibility checks of its numbers, and its names."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import degrees, isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.files import together, write_text
from ident.report.report import Report
from ident.studies import STUDIES, options_of
from ident.studies.following import next_command
from ident.studies.options import Options, flag_of, specs
from ident.studies.result import Reported, alias
from ident.studies.shared import as_file, check_posture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.studies.look.arm_names import ArmNames
    from ident.studies.look.arm_view import ArmView


@dataclass(frozen=True, repr=False, eq=False)
class ArmPicture(Reported):
    """An arm in words and as a picture: plausibility checks, masses, reach, first modes, every number with its origin.

    Attributes:
        view: the arm in place, with its first modes and plausibility checks.
        notes: differences between the arm and its robot description.
    """

    view: "ArmView"

    notes: ClassVar[tuple[str, ...]] = alias("view.arm_file.notes")

    @property
    def name(self) -> str:
        """Name of the picture file, without the ending."""
        return f"{self.view.arm_file.name}.show"

    @property
    def oddities(self) -> tuple[str, ...]:
        """Implausible numbers, a line for each."""
        return tuple(map(str, self.view.oddities))

    def sections(self) -> Report:
        """Return the report of `ident show`."""
        from ident.studies.look.show_report import show_sections

        report = show_sections(self.view)
        return replace(report, next=next_command(report.next, {"arm": self.view.arm_file}, Options(), self.name))

    def document(self) -> dict[str, Any]:
        """Return for programs the implausible numbers, masses [kg], reach [m] and natural frequencies [Hz]."""
        analysis = self.view.analysis
        modes = zip(analysis.labels, analysis.modes.frequency, strict=True) if analysis else ()
        return {
            "format": "ident-show/1",
            "arm": self.view.arm.name,
            "path": self.view.arm_file.path,
            "sha256": self.view.arm_file.sha256,
            "posture": [round(degrees(angle), 9) for angle in self.view.posture],
            "mass": self.view.mass,
            "reach": self.view.reach,
            "modes": [{"mode": str(label), "frequency": float(frequency)} for label, frequency in modes],
            "failure": self.view.failure,
            "oddities": [asdict(each) for each in self.view.oddities],
            **self.sections().judged,
            **({"notes": list(self.view.arm_file.notes)} if self.view.arm_file.notes else {}),
        }

    def figures(self) -> "dict[str, Figure]":
        """Return the picture: from the side and from above to scale, with the first modes."""
        from ident.studies.look.show_figure import show_figure

        return {"": show_figure(self.view)}

    def save_figures(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the picture as PNG, and its first modes as animated SVG, into a folder, and return their paths.

        Raises:
            InputError: the folder or the file can't be written.
        """
        from ident.report.document import save

        path = Path(folder) / f"{self.name}.png"
        with together():
            save(self.figures()[""], path)
            if not self.view.analysis:
                return (path,)
            write_text(modes := Path(folder) / f"{self.name}.modes.svg", self.moving_modes())
        return path, modes

    def moving_modes(self) -> str:
        """Return the first modes as an animated SVG document, of an arm that has modes."""
        from ident.studies.look.moving_modes import moving_modes

        return moving_modes(self.view)


def show(arm: "Arm | ArmFile | str | Path", posture: Sequence[float] | None = None) -> ArmPicture:
    """Draw an arm, and report implausible numbers.

    Args:
        arm: the arm, or its file.
        posture: joint angles [deg]; by default all zero, or the nearest posture within limits and workspace.

    Raises:
        InputError: the arm's file is wrong, or the posture has a wrong number of angles.
    """
    from ident.studies.look.arm_view import arm_view

    arm_file = as_file(arm)
    if posture is None:
        return ArmPicture(arm_view(arm_file))
    check_posture(posture, arm_file.arm)
    return ArmPicture(arm_view(arm_file, tuple(map(radians, posture))))


@dataclass(frozen=True, repr=False, eq=False)
class NamesResult(Reported):
    """The names of an arm.

    Attributes:
        names: with the present value of each number.
    """

    names: "ArmNames"

    def sections(self) -> Report:
        """Return the names: in short, and with units, values and limits in the details."""
        from ident.studies.look.show_report import names_sections

        units = {kind: "-" if unit == "1" else unit for kind, unit in kinds().items()}
        return names_sections(self.names, units, choices(), columns())

    def document(self) -> dict[str, Any]:
        """Return the same for programs."""
        arm = self.names.arm_file.arm
        return {
            "format": "ident-names/1",
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
    """List every name of an arm that other commands accept.

    Args:
        arm: the arm, or its file.

    Raises:
        InputError: the arm's file is wrong.
    """
    from ident.studies.look.arm_names import arm_names

    return NamesResult(arm_names(as_file(arm)))


def kinds() -> Mapping[str, str]:
    """Return the SI unit of each kind of measurement."""
    from ident.measure import KINDS
    from ident.units import QUANTITIES

    return {kind: QUANTITIES[quantity].si for kind, quantity in KINDS.items()}


def columns() -> Mapping[str, tuple[str, ...]]:
    """Return the allowed words of campaign columns."""
    from ident.measure import DEFINITIONS, DRIVE_STATES
    from ident.measure.kinds import RAMPS

    return {"of": DEFINITIONS, "drives": DRIVE_STATES, "ramp": RAMPS}


def choices() -> Mapping[str, tuple[str, ...]]:
    """Return the allowed words of command options, by command and flag."""
    found: dict[str, tuple[str, ...]] = {}
    for study in (*STUDIES, "explore"):
        kind: type[Options] = options_of(study)
        known = [(each, spec) for each, spec in specs(kind) if each.name not in kind.refuses]
        found |= {f"{study} {flag_of(each)}": spec.choices for each, spec in known if spec.choices}
    return found
