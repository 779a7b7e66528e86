"""The robots of a fleet as tasks: each reads its files and writes one, whole or not at all; a restart skips those.

What a task writes depends on its inputs, its options and the program alone, and its file is named by a hash of these
(`key`): whoever does it, and how often, the file is the same.
"""

import hashlib
import json
import multiprocessing
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.codec import CodecError, decode, encode
from ident.errors import IdentError
from ident.files import replace_file
from ident.programs import environment

if TYPE_CHECKING:
    from ident.identify.fleet import Robot
    from ident.studies.fleet import FleetOptions

KILLS = 3
"""Workers that a robot may have killed before it is given up."""


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
    options = {name: value for name, value in task.options.recorded().items() if name != "workers"}
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


def do(task: Task) -> None:
    """Fit a robot and write what its data say, or why they say nothing."""
    file = task.file  # before the inputs are read: had one changed since, the name would not be that of the new one
    text = json.dumps(encode(_fitted(task)))
    replace_file(file, lambda out: out.write(text.encode("utf-8")), make_folders=True)


def _fitted(task: Task) -> "Robot":
    from ident.identify.fleet import Robot, SourceFile, robot_of
    from ident.studies.fit import fit

    campaign = SourceFile(str(task.campaign), _digest(task.campaign))
    arm = SourceFile(str(task.arm), _digest(task.arm))
    try:
        return robot_of(fit(task.arm, task.campaign, task.options).fit, task.name, campaign, arm)
    except IdentError as error:
        return Robot(name=task.name, campaign=campaign, arm=arm, error=str(error))


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def outcomes(tasks: Sequence[Task], workers: int) -> Iterator["Robot"]:
    """Do what is not done of the tasks, in the order of the list as workers come free, and return all robots.

    Args:
        tasks: robots.
        workers: processes; with one, all is done in this process.
    """
    pending = []
    for task in tasks:
        if (robot := read(task)) is not None:
            yield robot
        else:
            pending.append(task)
    done = map(_alone_here, pending) if workers == 1 else _pooled(pending, workers)
    for task in done:
        yield read(task) or _given_up(task)


def _alone_here(task: Task) -> Task:
    do(task)
    return task


def _pooled(pending: list[Task], workers: int) -> Iterator[Task]:
    """Do tasks in processes, and return each when it is done or given up."""
    while pending:
        running: dict[Future[None], Task] = {}
        try:
            with _pool(min(workers, len(pending))) as pool:
                while pending or running:
                    while pending and len(running) < workers:
                        running[pool.submit(do, pending[0])] = pending[0]
                        del pending[0]
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        future.result()
                        yield running.pop(future)
        except BrokenProcessPool:  # a worker was killed: which of the tasks under way it had, each alone will tell
            for task in running.values():
                yield _alone(task)


def _alone(task: Task) -> Task:
    """Do a task in a process of its own, so that what kills it harms no other."""
    for _ in range(KILLS - 1):
        if task.file.exists():
            break
        try:
            with _pool(1) as pool:
                pool.submit(do, task).result()
        except BrokenProcessPool:
            continue
    return task


def _given_up(task: Task) -> "Robot":
    from ident.identify.fleet import Robot, SourceFile

    campaign, arm = (SourceFile(str(path), _digest(path)) for path in (task.campaign, task.arm))
    error = f"{task.campaign}: its computation was killed {KILLS} times; look at the memory, or fit it alone"
    return Robot(name=task.name, campaign=campaign, arm=arm, error=error)


def _pool(workers: int) -> ProcessPoolExecutor:
    import jax

    settings = {name: jax.config.values[name] for name in SETTINGS}
    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin, initargs=(settings,))


SETTINGS = ("jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
"""What workers take over of jax's."""


def _begin(settings: dict[str, Any]) -> None:
    """Set a worker up; it ends when the process that has started it is gone."""
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)
    threading.Thread(target=_end_with, args=(multiprocessing.parent_process(),), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
