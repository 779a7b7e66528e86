"""A first arm and campaign: files with example numbers, ready to run and to be filled in."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import InputError, Problem
from ident.files import replace_file, together
from ident.text import did_you_mean, one_line, quoted

if TYPE_CHECKING:
    from ident.arm.arm import Arm

KINDS = ("scara", "six-axis")
"""Arms that there are templates of."""
ARM, CAMPAIGN = "arm.toml", "campaign.csv"
FREQUENCY = 25.0
"""Frequency [Hz] at which each joint of a described robot alone would vibrate by its guessed bending stiffness."""
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
        raise InputError(Problem("", quoted(kind), f"one of {', '.join(KINDS)}", remedy, "kind"))
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
    from ident.assess.example import example
    from ident.description.file import parse_arm
    from ident.description.robot_file import read_robot
    from ident.description.writing import arm_text
    from ident.measure.writing import campaign_text

    check_new(Path(folder))
    described = read_robot(robot, tip)
    unit = described.arm(described.bushings((1.0, 1.0), (0.0, 0.0)))
    arm = described.arm(described.bushings(guessed_stiffness(unit), (0.0002, 0.0002)))
    name = one_line(Path(robot).name)
    head = HEAD.format(robot=name, frequency=FREQUENCY) + "\n".join(["\n" * bool(described.notes), *described.notes])
    guessed = ("k_bend", "k_tors", "tau_bend", "tau_tors")
    text = arm_text(arm, origin="derived", guessed=guessed, note=f"from {name}", head=head)
    try:
        written = parse_arm(text, described.where)
    except InputError as error:  # the lines are those of a file that is not written
        where = described.where
        raise InputError(replace(p, where=where) for p in error.problems) from None
    made = example(written)
    made_files = _write(Path(folder), text, campaign_text(made.campaign, header_comments=made.comments))
    return replace(made_files, notes=described.notes)


def guessed_stiffness(arm: "Arm") -> Mapping[str, tuple[float, float]]:
    """Return bending and torsional stiffness [N m/rad] by joint, with which each joint alone would vibrate alike."""
    from math import pi

    from ident.arm.oddity_geometry import carried

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
        raise InputError(Problem(one_line(str(folder)), got, "a new or empty folder", "choose another name"))


def _write(folder: Path, arm: str, campaign: str) -> New:
    check_new(folder)
    paths = (folder / ARM, folder / CAMPAIGN)
    with together():
        for path, text in zip(paths, (arm, campaign), strict=True):
            data = text.encode("utf-8")
            replace_file(path, lambda file, data=data: file.write(data), make_folders=True)  # type: ignore[misc]
    return New(folder, paths)
