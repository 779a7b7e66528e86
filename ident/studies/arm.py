"""An arm by itself: a first one with an example campaign, its picture, and the names that it knows."""

import importlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from math import degrees, isfinite, pi, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import placed, refusal
from ident.files import replace_file, together
from ident.present.report import Report
from ident.studies import STUDIES
from ident.studies.options import Options, flag_of, specs
from ident.studies.result import Reported, alias
from ident.studies.shared import as_file, check_posture
from ident.text import did_you_mean, one_line, quoted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.assess.show import ArmNames, ArmView
    from ident.description.file import ArmFile
    from ident.description.robot import Robot


# -------- New
# A first arm and campaign: files with example numbers, ready to run and to be filled in.

KINDS = ("scara", "six-axis")
"""Arms that there are templates of."""
ARM, CAMPAIGN = "arm.toml", "campaign.csv"
FREQUENCY = 25.0
"""Frequency [Hz] at which each joint of a described robot alone would vibrate by its guessed bending stiffness."""
RATIO = 0.01
"""Damping ratio of all modes that is assumed of a described robot."""
LEAST = 0.02
"""Least guess of a stiffness, as a share of the first joint's: what a wrist carries says little about its drive."""
HEAD = """Made by ident from {robot}. Lengths, masses and inertias are those of that file. STIFFNESSES AND DAMPING ARE
GUESSED, such that each joint alone would vibrate at {frequency:g} Hz. Replace them by catalogue values: k_bend is
across the axis (bearing and casting), k_tors about it (drive). A picture of what stands here: ident show arm.toml

In the zero posture all frames are parallel to the base's. Vectors start at the joint's own bushing."""
"""Comment above the arm that is made of a robot description."""


@dataclass(frozen=True)
class New:
    """What was written.

    Attributes:
        folder: where.
        paths: the arm's file and the campaign's.
        notes: where the arm is not what its robot description says.
    """

    folder: Path
    paths: tuple[Path, Path]
    notes: tuple[str, ...] = ()


def new(kind: str, folder: str | Path) -> New:
    """Write an arm of a kind and a campaign on it, both of example numbers, into a new folder.

    Args:
        kind: one of `KINDS`.
        folder: a folder that is new or empty.

    Raises:
        InputError: no such kind, or a folder that has files already or can't be written.
    """
    if kind not in KINDS:
        remedy = did_you_mean(kind, KINDS, "or give a robot description, --robot robot.urdf")
        raise refusal("", quoted(kind), f"one of {', '.join(KINDS)}", remedy, "kind")
    source = files("ident.description") / "templates"
    texts = [(source / f"{kind}{end}").read_text(encoding="utf-8") for end in (".toml", ".csv")]
    return _write(Path(folder), texts[0], texts[1])


def new_from_robot(robot: str | Path, folder: str | Path, tip: str | None = None) -> New:
    """Write the arm of a URDF or MJCF file with guessed stiffnesses, and a simulated campaign on it, into a new folder.

    Args:
        robot: the file.
        folder: a folder that is new or empty.
        tip: the link, body or site that the arm ends with; by default the end of the chain.

    Raises:
        InputError: a robot description of no serial arm, or a folder that has files already or can't be written.
    """
    from ident.arm.fields import STIFFNESS
    from ident.arm.plausibility import oddities
    from ident.assess.show import example
    from ident.description.file import parse_arm, read_robot
    from ident.description.rewriting import arm_text
    from ident.measure.reading import campaign_text

    check_new(Path(folder))
    described = read_robot(robot, tip)
    unit = described.arm(described.bushings((1.0, 1.0), (0.0, 0.0)))
    arm = described.arm(described.bushings(guessed_stiffness(unit), (0.0, 0.0)))
    name = one_line(Path(robot).name)
    head = HEAD.format(robot=name, frequency=FREQUENCY) + "\n".join(["\n" * bool(described.notes), *described.notes])
    text = arm_text(arm, origin="derived", guessed=STIFFNESS, note=f"from {name}", head=head, ratio=RATIO)
    with placed(described.where):  # the lines are those of a file that is not written
        written = parse_arm(text, described.where)
    made = example(written)
    made_files = _write(Path(folder), text, campaign_text(made.campaign, header_comments=made.comments))
    odd = (f"{name}: {each}" for each in oddities(written))
    return replace(made_files, notes=(*described.notes, *odd, *_gripper(described)))


def _gripper(robot: "Robot") -> Iterator[str]:
    """Yield the note on a last joint that is called like a gripper's."""
    last, before = robot.pins[-1], robot.pins[-2:][0]
    if re.search("grip|jaw|finger|claw", last.name.lower()):
        tip = f"; if it is a gripper's, name what the arm ends with: --tip {before.carrier.partition(' ')[2]}"
        yield f"{robot.where}, joint {last.name}: counts as a driven joint of the arm{tip}"


def guessed_stiffness(arm: "Arm") -> Mapping[str, tuple[float, float]]:
    """Return bending and torsional stiffness [N m/rad] by joint, with which each joint alone would vibrate alike."""
    from ident.arm.plausibility import carried

    inertia = [beyond.inertia for beyond in carried(arm)]
    k = [(2 * pi * FREQUENCY) ** 2 * max(each, LEAST * inertia[0]) for each in inertia]
    return {
        joint.name: (float(f"{bend:.2g}"), float(f"{bend / 2:.2g}")) for joint, bend in zip(arm.joints, k, strict=True)
    }


def check_new(folder: Path) -> None:
    """Refuse a folder that has something in it, or is none.

    Raises:
        InputError: it is a file, or not empty.
    """
    if not os.path.exists(folder):
        return
    got = "a folder that has files in it" if folder.is_dir() else "a file"
    if not folder.is_dir() or any(folder.iterdir()):
        raise refusal(one_line(str(folder)), got, "a new or empty folder", "choose another name")


def _write(folder: Path, arm: str, campaign: str) -> New:
    check_new(folder)
    paths = (folder / ARM, folder / CAMPAIGN)
    with together():
        for path, text in zip(paths, (arm, campaign), strict=True):
            data = text.encode("utf-8")
            replace_file(path, lambda file, data=data: file.write(data), make_folders=True)  # type: ignore[misc]
    return New(folder, paths)


# -------- Show
# An arm drawn, with what looks odd: a wrong arm file is the commonest cause of a wrong stiffness; and its names.


@dataclass(frozen=True, repr=False, eq=False)
class ArmPicture(Reported):
    """An arm in words and as a picture: what looks odd, masses and reach, first modes, every number with its origin.

    Attributes:
        view: the arm in place, with its first modes and what looks odd.
        notes: where the arm is not what its robot description says.
    """

    view: "ArmView"

    notes: ClassVar[tuple[str, ...]] = alias("view.arm_file.notes")

    def __repr__(self) -> str:
        return f"<ident ArmPicture {self.name}: print it for the report>"

    @property
    def name(self) -> str:
        """What its picture is called, without the end."""
        return f"{self.view.arm_file.name}.show"

    @property
    def oddities(self) -> tuple[str, ...]:
        """What looks odd, a line for each number."""
        return tuple(map(str, self.view.oddities))

    def sections(self) -> Report:
        """Return all that `ident show` says of the arm."""
        from ident.present.show import show_sections

        return show_sections(self.view)

    def document(self) -> dict[str, Any]:
        """Return for programs what looks odd, masses [kg], reach [m] and natural frequencies [Hz]."""
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
        from ident.present.figures.show import show_figure

        return {"": show_figure(self.view)}

    def save_figures(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the picture as PNG, and its first modes as SVG that moves, into a folder, and return their paths.

        Raises:
            InputError: the folder or the file can't be written.
        """
        from ident.present.files.document import save

        path = Path(folder) / f"{self.name}.png"
        with together():
            save(self.figures()[""], path)
            if not self.view.analysis:
                return (path,)
            text, modes = self.moving_modes().encode("utf-8"), Path(folder) / f"{self.name}.modes.svg"
            replace_file(modes, lambda file: file.write(text), make_folders=True)
        return path, modes

    def moving_modes(self) -> str:
        """Return the first modes as an SVG document that moves, of an arm that has modes."""
        from ident.present.html.page import moving_modes

        return moving_modes(self.view)


def show(arm: "Arm | ArmFile | str | Path", posture: Sequence[float] | None = None) -> ArmPicture:
    """Draw an arm, and say what looks odd about its numbers.

    Args:
        arm: the arm, or its file.
        posture: joint angles [deg]; by default all zero, or as near to that as limits and workspace allow.

    Raises:
        InputError: the arm's file is wrong, or the posture has another number of angles.
    """
    from ident.assess.show import arm_view

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
        """Return the names: in short, and with all that is known of them in the details."""
        from ident.present.show import names_sections

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
    """List every name that other commands take of an arm.

    Args:
        arm: the arm, or its file.

    Raises:
        InputError: the arm's file is wrong.
    """
    from ident.assess.show import arm_names

    return NamesResult(arm_names(as_file(arm)))


def kinds() -> Mapping[str, str]:
    """Return the SI unit of each kind of measurement."""
    from ident.measure import KINDS
    from ident.units import QUANTITIES

    return {kind: QUANTITIES[quantity].si for kind, quantity in KINDS.items()}


def columns() -> Mapping[str, tuple[str, ...]]:
    """Return the words that columns of a campaign have to choose from."""
    from ident.measure import DEFINITIONS, DRIVE_STATES
    from ident.measure.load import RAMPS

    return {"of": DEFINITIONS, "drives": DRIVE_STATES, "ramp": RAMPS}


def choices() -> Mapping[str, tuple[str, ...]]:
    """Return the words that options of commands have to choose from, by command and flag."""
    found: dict[str, tuple[str, ...]] = {}
    for study in (*STUDIES, "explore"):
        kind: type[Options] = getattr(importlib.import_module(f"ident.studies.{study}"), f"{study.capitalize()}Options")
        known = [(each, spec) for each, spec in specs(kind) if each.name not in kind.refuses]
        found |= {f"{study} {flag_of(each)}": spec.choices for each, spec in known if spec.choices}
    return found
