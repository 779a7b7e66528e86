"""The robots of a fleet as tasks: each reads its files and writes one result file, completely or not at all.

A result depends only on inputs, options and the program, and a hash of these names its file: the file is the same
whoever computes it, and however often.
"""

import os
import shutil
import signal
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ident.codec import read_item, value_digest, write_item
from ident.errors import IdentError, refusal, require
from ident.files import digest
from ident.text import one_line
from ident.units import USUAL

if TYPE_CHECKING:
    from ident.identify.fleet import Robot, SourceFile
    from ident.inference.population import Draws, Under
    from ident.studies.stiffness.fleet import FleetOptions

KILLS = 3
"""Killed workers after which a robot is given up."""
KILLED = f"its computation was killed {KILLS} times; look at the memory, or fit it alone"
"""Error message of such a robot."""


@dataclass(frozen=True)
class Task:
    """Fit a robot by itself, or draw it under a population; the result goes to a file of its own.

    Attributes:
        name: name of the robot.
        campaign: its measurements, a CSV file.
        arm: its description, a TOML file.
        options: options of its fit.
        folder: folder of the results.
        under: the population; None to fit the robot by itself.
    """

    name: str
    campaign: Path
    arm: Path
    options: "FleetOptions"
    folder: Path
    under: "Under | None" = None

    @property
    def file(self) -> Path:
        """Result file: a hash of inputs and options, of program sources and libraries, and of the machine.

        For draws also of the population.
        """
        from ident.programs import environment

        options = {**self.options.of_each.recorded(), "units": USUAL}
        options = {name: dict(sorted(x.items())) if isinstance(x, dict) else x for name, x in options.items()}
        files = [(str(path), digest(path)) for path in (self.campaign, self.arm)]
        key = value_digest([self.name, files, options, environment(), self.under])[:32]
        return self.folder / f"{key}.{'draws' if self.under else 'robot'}"

    def read(self) -> tuple[Any] | None:
        """Return the stored result in a tuple; None without one, or if the file is damaged."""
        results = read_item(self.file)
        return results if isinstance(results, tuple) else None

    def do(self) -> str:
        """Compute the task and write its result.

        Returns:
            Text of an unexpected error, such as one of a library; it is not stored, since it may not happen again.

        Raises:
            InputError: the folder can't be written.
        """
        file = self.file  # before the inputs are read: if one changed in between, the name would not belong to it
        try:
            results = (self.drawn(self.under) if self.under else self.fitted(),)
        except Exception as error:
            got = one_line(f"{type(error).__name__}: {error}")[:300]
            return f"an error in the program or a library ({got}); fit it alone to see more, and report it"
        write_item(file, results, make_folders=True)
        return ""

    def fitted(self) -> "Robot":
        """Fit the robot, or return it with its input error."""
        from ident.identify.fleet import robot_of
        from ident.studies.stiffness.fit import fit

        sources = self.sources
        try:
            return robot_of(fit(self.arm, self.campaign, self.options).fit, self.name, *sources)
        except IdentError as error:
            return self.failed(str(error))

    def drawn(self, under: "Under") -> "Draws | None":
        """Draw the robot; None where that fails."""
        from ident.identify.fleet import draws_under
        from ident.measure import read_campaign
        from ident.studies.shared import as_file

        arm = as_file(self.arm, self.options.soft_base).arm
        seed = int(value_digest([self.name, self.options.seed])[:8], 16)
        return draws_under(arm, read_campaign(self.campaign), self.options.unknowns, under, seed)

    @property
    def sources(self) -> "tuple[SourceFile, SourceFile]":
        """Campaign and arm as they are now."""
        from ident.identify.fleet import SourceFile

        return SourceFile(str(self.campaign), digest(self.campaign)), SourceFile(str(self.arm), digest(self.arm))

    def failed(self, error: str) -> "Robot":
        """Return the robot without a fit."""
        from ident.identify.fleet import Robot

        campaign, arm = self.sources
        return Robot(name=self.name, campaign=campaign, arm=arm, error=error)


# -------- Fleet engine
# Tasks of a fleet run in this process, or in several: a worker reads a task's files and writes its result file, so that
# a killed worker loses only its current task, and finished tasks are skipped.

OF_JAX = ("jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
"""Settings of jax that workers take over."""
SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that makes Python ignore the current folder when it looks for modules."""


def outcomes(robots: list[Task], workers: int) -> Iterator["Robot"]:
    """Fit the robots without a fit in so many processes, and yield all, fitted ones first."""
    for task, reason in done(robots, workers):
        known = task.read()
        yield known[0] if known else task.failed(f"{task.campaign}: {reason or 'its result can not be read'}")


def drawn(robots: list[Task], under: "Under", workers: int) -> 'Iterator[tuple[str, "Draws | None"]]':
    """Draw robots under a population in so many processes; None for a robot that can't be drawn."""
    for task, _ in done([replace(robot, under=under) for robot in robots], workers):
        known = task.read()
        yield task.name, known[0] if known else None


def done(tasks: list[Task], workers: int) -> Iterator[tuple[Task, str]]:
    """Yield each finished task with its error, empty if none; tasks of earlier runs come first."""
    pending = []
    for task in tasks:
        if task.read() is None:
            pending.append(task)
        else:
            yield task, ""
    if workers == 1:
        yield from ((task, task.do()) for task in pending)
    elif pending:
        run = (folder := pending[0].folder).absolute() / f".attempts-{uuid4().hex}"
        try:
            run.mkdir(parents=True)
            yield from _in_processes(pending, workers, run)
        except OSError as error:
            got, expected = str(error.strerror), "a folder to write in, and processes"
            remedy = "make room there, name another (--out), or ask for fewer (`workers`)"
            raise refusal(one_line(str(folder)), got, expected, remedy) from None
        finally:
            shutil.rmtree(run, ignore_errors=True)
            with suppress(OSError):
                folder.rmdir()  # if still empty


def _in_processes(pending: list[Task], workers: int, run: Path) -> Iterator[tuple[Task, str]]:
    """Yield each task with its error when a worker has finished it, or it is given up.

    A mark in the run's folder exists while a task runs: one left behind means a killed worker. That ends all workers;
    new ones go on, and marked tasks come last, each by itself, so that no task is given up for what another one did.
    """
    import jax

    settings = {name: jax.config.values[name] for name in OF_JAX}
    left, idle = {task.file.name: task for task in pending}, 0
    while True:
        marks = Counter(mark.partition("-")[0] for mark in os.listdir(run))
        for name in [name for name, task in left.items() if marks[name] >= KILLS or task.read() is not None]:
            task = left.pop(name)
            yield task, "" if task.read() is not None else KILLED
        some = [name for name in left if not marks[name]] or [*left][:1]
        if not some:
            return
        before = len(left), marks
        others = {*active_children()}
        with _inherited():
            pool = ProcessPoolExecutor(min(workers, len(some)), get_context("spawn"), _begin, (settings,))
            running = {pool.submit(_attempt, run, name, left[name]): name for name in some}
            own = {*active_children()} - others
        try:
            for future in as_completed(running):
                reason = future.result()
                yield left.pop(running[future]), reason
        except BrokenProcessPool:
            now = len(left), Counter(mark.partition("-")[0] for mark in os.listdir(run))
            idle = idle + 1 if now == before else 0
            got, remedy = f"{workers} processes that do not start", "ask for one; a script needs `if __name__ ...`"
            require(idle < KILLS, "workers", got, "processes on this machine", remedy)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in own:
                worker.terminate()


def _attempt(run: Path, name: str, task: Task) -> str:
    mark = run / f"{name}-{uuid4().hex}"
    mark.touch()
    reason = task.do()
    mark.unlink()
    return reason


def _begin(settings: Mapping[str, Any]) -> None:
    """Give a worker the settings of jax; it ends with the command, however that ends."""
    import jax

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name, value in settings.items():
        jax.config.update(name, value)
    threading.Thread(target=_end_with, args=(parent_process(),), daemon=True).start()


def _end_with(command: Any) -> None:
    command.join()
    os._exit(1)


@contextmanager
def _inherited() -> Iterator[None]:
    """Let workers that start here ignore Ctrl-C, which is for the command, and look for modules not in this folder.

    Anybody may have written to the current folder.
    """
    own, in_main_thread = SAFE_PATH not in os.environ, threading.current_thread() is threading.main_thread()
    os.environ.setdefault(SAFE_PATH, "1")
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main_thread else None
    try:
        yield
    finally:
        if in_main_thread:
            signal.signal(signal.SIGINT, before)
        if own:
            del os.environ[SAFE_PATH]
