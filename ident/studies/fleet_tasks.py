"""The robots of a fleet as tasks: each reads its files and writes one, whole or not at all; a restart skips those.

What a task writes depends on its inputs, its options and the program alone, and its file is named by a hash of these
(`key`): whoever does it, here, in a process (`fleet_pool`) or on a cluster (`fleet_cluster`), and how often, the file
is the same.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ident.codec import CodecError, decode, encode
from ident.errors import IdentError
from ident.files import replace_file
from ident.text import one_line

if TYPE_CHECKING:
    from ident.identify.fleet import Robot, SourceFile
    from ident.studies.fleet import FleetOptions

KILLS = 3
"""Workers that a robot may have killed before it is given up."""
KILLED = f"its computation was killed {KILLS} times; look at the memory, or fit it alone"
"""Why such a robot has no fit."""
Done = tuple["Task", str]
"""A task, and why it has written nothing; empty where it has."""


@dataclass(frozen=True)
class Task:
    """A robot to be fitted.

    Attributes:
        name: the robot's.
        campaign: its measurements, a CSV file.
        arm: its description, a TOML file.
        options: of its fit.
        folder: where its result goes.
    """

    name: str
    campaign: Path
    arm: Path
    options: "FleetOptions"
    folder: Path

    @property
    def file(self) -> Path:
        """Its result's file, named by all that it depends on."""
        return self.folder / f"{key(self)}.robot"


def key(task: Task) -> str:
    """Return a hash of a task's inputs and options, of the program's sources and libraries, and of the machine."""
    from ident.programs import environment  # it imports jax

    options = task.options.of_each.recorded()
    paths = [str(task.campaign), str(task.arm)]
    parts = [task.name, paths, _digest(task.campaign), _digest(task.arm), encode(options), environment()]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def read(task: Task) -> "Robot | None":
    """Return what a task has written; None where it has not, or its file is damaged."""
    from ident.identify.fleet import Robot

    try:
        robot = decode(json.loads(task.file.read_text("utf-8")))
    except (OSError, ValueError, CodecError):
        return None
    return robot if isinstance(robot, Robot) else None


def do(task: Task) -> str:
    """Fit a robot and write what its data say, or which input is wrong.

    Returns:
        What nobody has expected, such as an error of a library; of it nothing is kept, since it may not come again.

    Raises:
        InputError: the folder can't be written.
    """
    file = task.file  # before the inputs are read: had one changed since, the name would not be that of the new one
    try:
        text = json.dumps(encode(_fitted(task)))
    except Exception as error:
        got = one_line(f"{type(error).__name__}: {error}")[:300]
        return f"an error in the program or a library ({got}); fit it alone to see more, and report it"
    replace_file(file, lambda out: out.write(text.encode("utf-8")), make_folders=True)
    return ""


def _fitted(task: Task) -> "Robot":
    from ident.identify.fleet import robot_of
    from ident.studies.fit import fit

    campaign, arm = _sources(task)
    try:
        return robot_of(fit(task.arm, task.campaign, task.options).fit, task.name, campaign, arm)
    except IdentError as error:
        return _failed(task, str(error))


def _failed(task: Task, error: str) -> "Robot":
    from ident.identify.fleet import Robot

    campaign, arm = _sources(task)
    return Robot(name=task.name, campaign=campaign, arm=arm, error=error)


def _sources(task: Task) -> "tuple[SourceFile, SourceFile]":
    from ident.identify.fleet import SourceFile

    return SourceFile(str(task.campaign), _digest(task.campaign)), SourceFile(str(task.arm), _digest(task.arm))


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def outcomes(tasks: Sequence[Task], workers: int, dask: str = "") -> Iterator["Robot"]:
    """Do what is not done of the tasks, in the order of the list as workers come free, and return all robots.

    Args:
        tasks: robots.
        workers: processes; with one, all is done in this process.
        dask: address of a Dask scheduler, whose workers do it instead; empty for none.
    """
    pending = []
    for task in tasks:
        if (robot := read(task)) is not None:
            yield robot
        else:
            pending.append(task)
    for task, reason in _done(pending, workers, dask):
        yield read(task) or _failed(task, f"{task.campaign}: {reason or 'its result can not be read'}")


def _done(pending: list[Task], workers: int, dask: str) -> Iterator[Done]:
    if dask and pending:
        from ident.studies.fleet_cluster import on_cluster

        return on_cluster(pending, dask)
    if workers > 1:
        from ident.studies.fleet_pool import in_processes

        return in_processes(pending, workers)
    return ((task, do(task)) for task in pending)
