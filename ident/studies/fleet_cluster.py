"""Tasks of a fleet on a cluster, by any scheduler of Dask; workers share a folder with this machine.

Nothing passes through Dask but which task is to be done: a worker reads its files and writes its file, so that whatever
is killed loses the tasks in flight alone. Dask's retries know nothing of what an input has killed, and blame what only
waited beside it; marks in the shared folder count (`fleet_worker.attempt`).
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, Queue
from typing import Any
from uuid import uuid4

from ident.errors import InputError, Problem
from ident.programs import SOURCES, circumstances, environment
from ident.studies.fleet_tasks import KILLED, KILLS, T
from ident.studies.fleet_worker import ClusterError, Place, attempt, marks_of, probe, settings
from ident.text import one_line

CONNECT, WORKERS = 10.0, 30.0
"""Time [s] in which a scheduler must answer at first, and in which a worker must be there."""
QUIET, ANSWER = 5.0, 15.0
"""Time [s] without news after which the scheduler is asked whether it is there, and in which it must answer."""


@contextmanager
def cluster(address: str, folder: Path) -> Iterator[Callable[[list[T]], Iterator[tuple[T, str]]]]:
    """Connect with a Dask scheduler whose workers do tasks, and return each when it is done or given up, with why not.

    Args:
        address: the scheduler's, as tcp://host:8786.
        folder: of the tasks.

    Raises:
        InputError: no Dask here, or no scheduler or workers there; workers of other versions, or without the folder.
        ClusterError: while tasks are done: the scheduler was lost, or a worker can't go on.
    """
    place = Place(Path.cwd(), settings(), environment(), uuid4().hex)
    with _client(address) as client:
        _check(client, place, folder)
        try:
            yield lambda pending: _collected(client, pending, place)
        finally:
            shutil.rmtree(marks_of(folder, place.run), ignore_errors=True)


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """Connect with a scheduler; what Dask logs about a lost one is said by us."""
    try:
        import dask
        from distributed import Client
    except ImportError:
        remedy = "pip install 'ident[dask]'"
        raise InputError(
            Problem("dask", "an address without the package distributed", "it installed", remedy)
        ) from None
    with dask.config.set({"logging.distributed": "critical"}):
        try:
            client = Client(address, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            got = f"no scheduler at {one_line(address)} ({one_line(str(error))[:100]})"
            remedy = "start `dask scheduler` there, or correct the address (tcp://host:8786)"
            raise InputError(Problem("dask", got, "one that answers", remedy)) from None
    try:
        yield client
    finally:
        with suppress(Exception):  # a lost scheduler can't be taken leave of
            client.close(timeout=1)


def _check(client: Any, place: Place, folder: Path) -> None:
    """Make sure that workers see the same folder, and are of the same versions.

    Raises:
        InputError: there are none, or one that does not or is not.
    """
    try:
        client.wait_for_workers(1, timeout=WORKERS)
    except TimeoutError:
        raise InputError(
            Problem("dask", "a scheduler without workers", "one at least", "start `dask worker`")
        ) from None
    folder.mkdir(parents=True, exist_ok=True)
    token = folder / f".probe-{uuid4().hex}"
    token.write_text(place.run)
    try:
        answers = client.run(probe, place, token, on_error="return")
        problems = [problem for name, each in answers.items() for problem in _wrong(name, each, folder)]
    finally:
        for path in folder.glob(f"{token.name}*"):
            path.unlink()
        with suppress(OSError):
            folder.rmdir()  # where nothing is in it yet
    if problems:
        raise InputError(problems)


def _wrong(worker: str, answer: Any, folder: Path) -> Iterator[Problem]:
    where = f"dask, worker {worker}"
    if isinstance(answer, Exception):
        got = one_line(f"{type(answer).__name__}: {answer}")
        yield Problem(where, got, "ident as it is here", "install the same versions")
        return
    own = {"ident": SOURCES, **circumstances()}
    if other := [name for name in own if own[name] != answer[name]]:
        got = f"another {', '.join(_what(name, own[name], answer[name]) for name in other)} than here"
        yield Problem(where, got, "results that are the same to the bit", "install the same versions, on like machines")
    if not answer["shared"] or not (folder / answer["shared"]).is_file():
        got = f"another folder {one_line(str(folder.absolute()))} than here, or none"
        yield Problem(
            where, got, "one that all can read and write", "give one on a shared disk (--out), inputs there too"
        )


def _what(name: str, own: Any, other: Any) -> str:
    """Return a name of circumstances, and which of jax's settings is meant."""
    if isinstance(own, dict) and isinstance(other, dict):
        return ", ".join(sorted(key for key in own.keys() | other.keys() if own.get(key) != other.get(key)))
    return {"machine": "processor", "flags": "XLA_FLAGS or EQX_ON_ERROR"}.get(name, name)


def _collected(client: Any, pending: list[T], place: Place) -> Iterator[tuple[T, str]]:
    """Hand tasks to a scheduler, and return each when it is done or given up."""
    from distributed.scheduler import KilledWorker

    news: Queue[Any] = Queue()
    tasks: dict[str, tuple[Any, T, int]] = {}

    def submit(task: T, times: int) -> None:
        if client.status != "running":
            raise _gone()
        future = client.submit(attempt, task, place, key=f"ident-{uuid4().hex}", pure=False)
        tasks[future.key] = future, task, times
        future.add_done_callback(news.put)

    for task in pending:
        submit(task, 1)
    while tasks:
        future = _next(client, news)
        _, task, times = tasks.pop(future.key)
        if task.file.is_file():
            yield task, ""
            continue
        error, reason = _answer(future)
        if isinstance(error, KilledWorker) and times < KILLS:  # it may have but waited where another one killed
            submit(task, times + 1)
        elif isinstance(error, KilledWorker):
            yield task, KILLED
        elif error is not None:
            raise error if isinstance(error, ClusterError) else ClusterError(f"{type(error).__name__}: {error}")
        else:
            yield task, reason


def _next(client: Any, news: "Queue[Any]") -> Any:
    """Return the next future that is done.

    Raises:
        ClusterError: the scheduler is gone.
    """
    while True:
        with suppress(Empty):
            future = news.get(timeout=QUIET)
            if future.status == "cancelled":
                raise _gone()
            return future
        try:
            client.sync(client.scheduler.identity, callback_timeout=ANSWER)
        except Exception:  # whichever of Dask's, of asyncio's and of the system's
            raise _gone() from None


def _answer(future: Any) -> tuple[BaseException | None, str]:
    """Return what a task has raised or said.

    Raises:
        ClusterError: the scheduler is gone.
    """
    while True:
        try:
            error = future.exception(timeout=ANSWER)
            return (error, "") if error is not None else (None, future.result(timeout=ANSWER))
        except TimeoutError:  # its worker was killed since, and it is done again
            continue
        except Exception:
            raise _gone() from None


def _gone() -> ClusterError:
    return ClusterError("the scheduler is gone; what is done is kept: with another one, the same command goes on")
