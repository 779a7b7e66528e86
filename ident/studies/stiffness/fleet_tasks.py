"""The robots of a fleet as tasks: each reads its files and writes one result file, completely or not at all.

A result depends only on inputs, options and the program, and a hash of these names its file: the file is the same
whoever computes it, and however often.
"""

import logging
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from ident.codec import read_item, value_digest, write_item
from ident.errors import IdentError, refusal
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
# Tasks of a fleet run in this process, or in the processes of a Dask cluster on this machine.
#
# A worker reads a task's files and writes its result file: a killed worker loses only its current task, and finished
# tasks are skipped.

LOGGERS = ("distributed", "distributed.client", "tornado.application", "asyncio")
"""Loggers of Dask that write tracebacks of lost connections."""
START, ANSWER = 60.0, 5.0
"""Time [s] for a worker to appear, and to wait for an answer before Ctrl-C is heard again."""
OF_JAX = ("jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
"""Settings of jax that workers take over."""
APART = {
    "distributed.nanny.environ": {},
    "distributed.nanny.pre-spawn-environ": {},
    "distributed.worker.multiprocessing-method": "spawn",
    "distributed.worker.preload": [],
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
"""Dask's settings: whatever a user has set, its workers start anew as here and serve nothing."""
SAFE_PATH = "PYTHONSAFEPATH"
"""Environment variable that makes Python ignore the current folder when it looks for modules."""


class Engine(ExitStack):
    """Run tasks here or in several processes; a context manager that keeps these until it ends.

    Args:
        workers: processes; one is this one.
    """

    def __init__(self, workers: int):
        super().__init__()
        self.workers = workers
        self.cluster: Callable[[list[Task]], Iterator[tuple[Task, str]]] | None = None

    def done(self, tasks: list[Task]) -> Iterator[tuple[Task, str]]:
        """Yield each finished task with its error, empty if none; tasks of earlier runs come first."""
        pending = []
        for task in tasks:
            if task.read() is None:
                pending.append(task)
            else:
                yield task, ""
        if self.workers == 1:
            yield from ((task, task.do()) for task in pending)
        elif pending:
            if self.cluster is None:
                self.cluster = self.enter_context(_cluster(min(self.workers, len(tasks)), pending[0].folder))
            yield from self.cluster(pending)


def outcomes(robots: list[Task], engine: Engine) -> Iterator["Robot"]:
    """Fit the robots without a fit as workers become free, and yield all, fitted ones first."""
    for task, reason in engine.done(robots):
        known = task.read()
        yield known[0] if known else task.failed(f"{task.campaign}: {reason or 'its result can not be read'}")


def drawn(robots: list[Task], under: "Under", engine: Engine) -> 'Iterator[tuple[str, "Draws | None"]]':
    """Draw robots under a population as workers become free; None for a robot that can't be drawn."""
    for task, _ in engine.done([replace(robot, under=under) for robot in robots]):
        known = task.read()
        yield task.name, known[0] if known else None


def _handed_out(client: Any, work: Callable[[Task], str], pending: Sequence[Task]) -> Iterator[tuple[Task, str]]:
    """Yield each task with its error when a worker of the client's cluster has finished it, or it is given up."""
    executor, news = client.get_executor(pure=False), Queue[Future[str]]()
    running: dict[Future[str], tuple[Task, int]] = {}

    def hand_out(task: Task, times: int) -> None:
        future = executor.submit(work, task)
        running[future] = task, times
        future.add_done_callback(news.put)

    for task in pending:
        hand_out(task, 1)
    while running:
        try:
            future = news.get(timeout=ANSWER)
        except Empty:
            continue
        task, times = running.pop(future)
        wrong = future.exception()
        if wrong is None:
            yield task, future.result()
        elif task.read() is not None:  # killed after it had written its result
            yield task, ""
        elif isinstance(wrong, IdentError):
            raise wrong
        elif not isinstance(wrong, Exception):
            raise KeyboardInterrupt
        elif times < KILLS:
            hand_out(task, times + 1)
        else:
            yield task, f"{type(wrong).__name__}: {wrong}"


def attempt(run: Path, settings: Mapping[str, Any], task: Task) -> str:
    """Do a task on a worker, unless it has killed too many of them; return why nothing was written.

    A mark in the run's folder exists while the task runs: a mark left behind means a killed worker. Dask's own count
    would not do: it also blames tasks that only waited at that worker.

    Args:
        run: a folder that the client made for this run.
        settings: of jax.
        task: to be done.

    Raises:
        InputError: the folder can't be written.
    """
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)
    try:
        marks = run / task.file.name
        marks.mkdir(parents=True, exist_ok=True)
        if len(os.listdir(marks)) >= KILLS:
            return KILLED
        mark = marks / uuid4().hex
        mark.touch()
        reason = task.do()
        mark.unlink()
        return reason
    except OSError as error:
        got, expected = f"{run.parent}, which cannot be used ({error.strerror})", "a folder to write in"
        raise refusal("workers", got, expected, "make room there, or name another (--out)") from None


@contextmanager
def _cluster(workers: int, folder: Path) -> Iterator[Callable[[list[Task]], Iterator[tuple[Task, str]]]]:
    """Start a cluster on this machine; yield the function that runs tasks.

    Args:
        workers: its processes.
        folder: where tasks write.

    Raises:
        InputError: no Dask here, or processes that do not start.
    """
    try:
        import cryptography  # noqa: F401  its certificates
        from distributed import Client
    except ImportError as error:
        got, remedy = f"{workers} processes without the package {error.name}", "pip install 'ident-arm[dask]'"
        raise refusal("workers", got, "it installed", remedy) from None
    import jax

    before = {logger: logger.level for logger in map(logging.getLogger, LOGGERS)}
    for logger in before:
        logger.setLevel(logging.CRITICAL)  # a killed worker gives one line, from us
    run, at_end = folder.absolute() / f".attempts-{uuid4().hex}", ExitStack()
    try:
        try:
            cluster = at_end.enter_context(local_cluster(workers))
            client = at_end.enter_context(Client(cluster, set_as_default=False))
            client.wait_for_workers(1, timeout=START)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            got = f"{workers} processes that do not start ({one_line(str(error))[:100]})"
            raise refusal("workers", got, "a cluster on this machine", "ask for fewer, or for none") from None
        yield partial(_handed_out, client, partial(attempt, run, {name: jax.config.values[name] for name in OF_JAX}))
    finally:
        shutil.rmtree(run, ignore_errors=True)
        with suppress(OSError):
            folder.rmdir()  # if still empty
        at_end.close()
        for logger, level in before.items():
            logger.setLevel(level)


@contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """Start a cluster of local processes, which look for no modules in the current folder.

    Anybody may have written to that folder. A temporary certificate keeps other users of the machine from connecting,
    and what Dask serves over HTTP, which no certificate protects, is off.
    """
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    own, in_main_thread = SAFE_PATH not in os.environ, threading.current_thread() is threading.main_thread()
    os.environ.setdefault(SAFE_PATH, "1")
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if in_main_thread else None  # they inherit it: Ctrl-C is ours
    try:
        with (
            TemporaryDirectory() as scratch,  # its workers look there for modules: nobody else may write into it
            dask.config.set(APART),
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0", "dashboard": False},
                worker_dashboard_address="127.0.0.1:0",
                memory_limit=0,
                local_directory=scratch,
                silence_logs=logging.CRITICAL,
                security=Security.temporary(),
            ) as cluster,
        ):
            cluster.scheduler.http_server.stop()
            if in_main_thread:
                signal.signal(signal.SIGINT, before)
            yield cluster
    finally:
        if in_main_thread:
            signal.signal(signal.SIGINT, before)
        if own:
            del os.environ[SAFE_PATH]
