"""The programs that a command used first the last time, loaded by a thread while this time's files are read.

Which they were says a list beside them (`ident.programs`). It is a guess: a program is used where what asks for it has
its key, and whatever is missing or wrong in the list costs nothing but the time that it would have saved.
"""

import json
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

from ident.errors import IdentError
from ident.files import replace_file

MOST = 6
"""Programs that are loaded so: not those of later stages, which would take memory meanwhile."""


class Early:
    """The programs that the one command of a process uses, in the order of their use, and those of the last time."""

    def __init__(self) -> None:
        self.list: Path | None = None
        self.before, self.used = list[str](), list[str]()
        self.coming: dict[str, Future[Any]] = {}
        self.lock, self.pool = Lock(), ThreadPoolExecutor(1, "early")

    def begin(self, path: Path, load: Callable[[Path], Any]) -> None:
        """Load what a list says, one program after another; only once.

        Args:
            path: the list.
            load: loads a program of the same folder, given its path.
        """
        if self.list is not None:
            return
        self.list = path
        with suppress(OSError, ValueError, TypeError):
            self.before = [Path(name).name for name in json.loads(path.read_bytes())][:MOST]
        with self.lock:
            self.coming = {name: self.pool.submit(load, path.with_name(name)) for name in self.before}

    def take(self, name: str) -> Any:
        """Return a program that is loaded, or is just being loaded; None where there is none, or it waits its turn."""
        with self.lock:
            if self.list is not None and name not in self.used and len(self.used) < MOST:
                self.used.append(name)
            coming = self.coming.pop(name, None)
        if coming is None or coming.cancel():
            return None
        with suppress(Exception):  # whatever a file from elsewhere may do
            return coming.result()
        return None

    def end(self) -> None:
        """Load no more, and keep the list for the next time where it is another one."""
        path, self.coming = self.list, {}
        self.pool.shutdown(wait=False, cancel_futures=True)
        if path and self.used != self.before:
            with suppress(IdentError):  # a full disk, say
                replace_file(path, lambda file: file.write(json.dumps(self.used).encode()))
        self.before = self.used


EARLY = Early()
"""Those of this process."""
