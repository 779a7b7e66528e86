"""A first arm and campaign: files with example numbers, ready to run and to fill in."""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import placed, refusal, require
from ident.files import together, write_text
from ident.text import did_you_mean, one_line, quoted

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.robot import Robot

KINDS = ("scara", "six-axis")
"""Arms with a template."""
ARM, CAMPAIGN = "arm.toml", "campaign.csv"
FREQUENCY = 25.0
"""Frequency [Hz] at which each joint of a described robot alone would vibrate with its guessed bending stiffness."""
RATIO = 0.01
"""Damping ratio of all modes assumed for a described robot."""
LEAST = 0.02
"""Least guess of a stiffness, as a share of the first joint's: a wrist's load says little about its drive."""
HEAD = """Made by ident from {robot}. Lengths, masses and inertias are those of that file. STIFFNESSES AND DAMPING ARE
GUESSED, such that each joint alone would vibrate at {frequency:g} Hz. Replace them by catalogue values: k_bend is
across the axis (bearing and casting), k_tors about it (drive). A picture of what stands here: ident show arm.toml

In the zero posture all frames are parallel to the base's. Vectors start at the joint's own bushing."""
"""Comment above the arm that is made of a robot description."""


@dataclass(frozen=True)
class New:
    """The written files.

    Attributes:
        folder: folder of the files.
        paths: files of the arm and the campaign.
        notes: differences between the arm and its robot description.
    """

    folder: Path
    paths: tuple[Path, Path]
    notes: tuple[str, ...] = ()


def new(kind: str, folder: str | Path) -> New:
    """Write an arm of a kind and a campaign on it, both with example numbers, into a new folder.

    Args:
        kind: one of `KINDS`.
        folder: a new or empty folder.

    Raises:
        InputError: no such kind, or a folder that already has files or can't be written.
    """
    remedy = did_you_mean(kind, KINDS, "or give a robot description, --robot robot.urdf")
    require(kind in KINDS, "", quoted(kind), f"one of {', '.join(KINDS)}", remedy, "kind")
    source = files("ident.description") / "templates"
    texts = [(source / f"{kind}{end}").read_text(encoding="utf-8") for end in (".toml", ".csv")]
    return _write(Path(folder), texts[0], texts[1])


def new_from_robot(robot: str | Path, folder: str | Path, tip: str | None = None) -> New:
    """Write the arm of a URDF or MJCF file with guessed stiffnesses, and a simulated campaign on it, into a new folder.

    Args:
        robot: the file.
        folder: a new or empty folder.
        tip: the link, body or site at the end of the arm; by default the end of the chain.

    Raises:
        InputError: a robot description of no serial arm, or a folder that already has files or can't be written.
    """
    from ident.arm.fields import STIFFNESS
    from ident.arm.plausibility import oddities
    from ident.description.file import parse_arm, read_robot
    from ident.description.rewriting import arm_text
    from ident.measure.reading import campaign_text
    from ident.studies.look.example import example

    check_new(Path(folder))
    described = read_robot(robot, tip)
    unit = described.arm(described.bushings((1.0, 1.0), (0.0, 0.0)))
    arm = described.arm(described.bushings(guessed_stiffness(unit), (0.0, 0.0)))
    name = one_line(Path(robot).name)
    head = HEAD.format(robot=name, frequency=FREQUENCY) + "\n".join(["\n" * bool(described.notes), *described.notes])
    text = arm_text(arm, origin="derived", guessed=STIFFNESS, note=f"from {name}", head=head, ratio=RATIO)
    with placed(described.where):  # line numbers refer to a file that is not written
        written = parse_arm(text, described.where)
    made = example(written)
    made_files = _write(Path(folder), text, campaign_text(made.campaign, header_comments=made.comments))
    odd = (f"{name}: {each}" for each in oddities(written))
    return replace(made_files, notes=(*described.notes, *odd, *_gripper(described)))


def _gripper(robot: "Robot") -> Iterator[str]:
    """Yield the note on a last joint named like a gripper's."""
    last, before = robot.pins[-1], robot.pins[-2:][0]
    if re.search("grip|jaw|finger|claw", last.name.lower()):
        tip = f"; if it is a gripper's, name what the arm ends with: --tip {before.carrier.partition(' ')[2]}"
        yield f"{robot.where}, joint {last.name}: counts as a driven joint of the arm{tip}"


def guessed_stiffness(arm: "Arm") -> Mapping[str, tuple[float, float]]:
    """Return bending and torsional stiffness [N m/rad] by joint; with them each joint alone has the same frequency."""
    from ident.arm.sizes import carried

    inertia = [beyond.inertia for beyond in carried(arm)]
    k = [(2 * pi * FREQUENCY) ** 2 * max(each, LEAST * inertia[0]) for each in inertia]
    return {
        joint.name: (float(f"{bend:.2g}"), float(f"{bend / 2:.2g}")) for joint, bend in zip(arm.joints, k, strict=True)
    }


def check_new(folder: Path) -> None:
    """Refuse a folder that is not empty, or no folder.

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
            write_text(path, text)
    return New(folder, paths)
