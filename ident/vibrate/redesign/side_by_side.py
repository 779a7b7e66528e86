"""Jobs that do not depend on each other, on a thread a core."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ident.jit import cores
from ident.vibrate.response.exact import Progress

T = TypeVar("T")


def side_by_side(jobs: Sequence[Callable[[], T]], progress: Progress = iter) -> list[T]:
    """Return what the jobs return, in their order; after an interrupt none begins any more.

    Args:
        jobs: the longest first.
        progress: shows how far it is, over the jobs.
    """
    pool = ThreadPoolExecutor(cores())
    try:
        pending = [pool.submit(job) for job in jobs]
        return [pending[k].result() for k in progress(range(len(jobs)))]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
