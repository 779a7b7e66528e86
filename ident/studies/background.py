"""What is computed in the background, before its turn."""

from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar

T = TypeVar("T")


def in_background(compute: Callable[[], T]) -> Future[T]:
    """Compute in the background: while one program is compiled, the other cores would have nothing to do.

    The thread is a daemon, so that an interrupted command does not wait for it.
    """
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(compute())
        except BaseException as error:  # handed to whoever asks for the result
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future
