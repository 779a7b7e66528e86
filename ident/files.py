"""Files that are written whole or not at all, and folders that one run at a time has to itself."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from ident.errors import InputError, Problem
from ident.text import one_line

CLAIM = "run.lock"
"""File in a folder that a run has to itself: it holds the number of its process."""


def replace_path(path: Path, write: Callable[[Path], object], *, make_folders: bool = False) -> None:
    """Write a file under another name and move it to its place when it is complete and on the disk.

    Args:
        path: where the file goes.
        write: writes the file at the path it is given.
        make_folders: make the folders that are not there.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    part = path.parent / f".ident-{uuid4().hex}.part"
    try:
        if make_folders:
            path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(part)
            with part.open("rb+") as file:
                os.fsync(file.fileno())
            os.replace(part, path)
        finally:
            with suppress(OSError):
                part.unlink()
    except (OSError, ValueError) as error:
        remedy = "choose a folder that can be written to (--out)"
        reason = "a folder" if os.path.isdir(path) else (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError(Problem(one_line(str(path)), reason, "a file to write", remedy)) from None


def replace_file(path: Path, write: Callable[[BinaryIO], object], *, make_folders: bool = False) -> None:
    """Do what `replace_path` does for what writes to an open binary file."""

    def write_to(part: Path) -> None:
        with part.open("xb") as file:
            write(file)

    replace_path(path, write_to, make_folders=make_folders)


@contextmanager
def claimed(folder: Path | None) -> Iterator[None]:
    """Have a folder to oneself within; it is made if need be, and removed at the end if nothing is in it.

    The lock is the system's, which ends with the process, however that ends: what is left of a killed run is in
    nobody's way.

    Args:
        folder: the folder; None for none.

    Raises:
        InputError: another run has it, or nothing can be written there.
    """
    if folder is None:
        yield
        return
    new = [each for each in (folder, *folder.parents) if not os.path.exists(each)]
    try:
        lock = _lock(folder)
    except BlockingIOError:
        got = f"a folder in which another run is at work{_process(folder)}"
        remedy = "wait until it has ended, or choose another folder (`folder`)"
        raise InputError(Problem(one_line(str(folder)), got, "one run at a time", remedy)) from None
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        remedy = "choose a folder that can be written to (`folder`)"
        raise InputError(Problem(one_line(str(folder)), reason, "a folder to write to", remedy)) from None
    try:
        yield
    finally:
        with suppress(OSError):
            (folder / CLAIM).unlink()
            for each in dict.fromkeys((folder, *new)):
                each.rmdir()
        os.close(lock)


def _lock(folder: Path) -> int:
    """Return the open file whose lock this run has now; who has had it before may have removed that file since."""
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            file = os.open(folder / CLAIM, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # the folder was removed just now
            continue
        try:
            _lock_file(file)
            if os.path.samestat(os.fstat(file), os.stat(folder / CLAIM)):
                os.truncate(file, 0)
                os.write(file, str(os.getpid()).encode())
                return file
        except FileNotFoundError:
            pass
        except OSError:
            os.close(file)
            raise
        os.close(file)


def _lock_file(file: int) -> None:
    """Lock an open file, where the system can.

    Raises:
        BlockingIOError: it is locked.
    """
    try:
        import fcntl
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system that knows no locks
        return


def _process(folder: Path) -> str:
    """Say which process has a folder, if that can be read."""
    try:
        number = (folder / CLAIM).read_text("ascii")
    except (OSError, ValueError):
        return ""
    return f" (process {number})" if number.isdigit() else ""
