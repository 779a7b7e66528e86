"""Tasks of a fleet in processes of this machine."""

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from ident.studies.fleet_tasks import KILLED, KILLS, T, Task
from ident.studies.fleet_worker import begin, settings


def in_processes(pending: list[T], workers: int) -> Iterator[tuple[T, str]]:
    """Do tasks in processes, and return each when it is done or given up, with why nothing was written."""
    while pending:
        running: dict[Future[str], T] = {}
        try:
            with _pool(min(workers, len(pending))) as pool:
                while pending or running:
                    while pending and len(running) < workers:
                        running[pool.submit(pending[0].do)] = pending[0]
                        del pending[0]
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        reason = future.result()
                        yield running.pop(future), reason
        except BrokenProcessPool:  # a worker was killed: which of the tasks under way it had, each alone will tell
            for task in running.values():
                yield task, _alone(task)


def _alone(task: Task) -> str:
    """Do a task in a process of its own, so that what kills it harms no other."""
    for _ in range(KILLS - 1):
        if task.file.exists():
            return ""
        try:
            with _pool(1) as pool:
                return pool.submit(task.do).result()
        except BrokenProcessPool:
            continue
    return KILLED


def _pool(workers: int) -> ProcessPoolExecutor:
    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin, initargs=(settings(),))


def _begin(settings: dict[str, dict[str, Any]]) -> None:
    """Set a worker up; it ends when the process that has started it is gone."""
    begin(settings)
    threading.Thread(target=_end_with, args=(multiprocessing.parent_process(),), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
