"""Files that are written whole or not at all, alone and in sets, and folders that one run at a time has to itself."""

import glob
import hashlib
import itertools
import json
import os
import platform
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from uuid import uuid4

from ident.errors import InputError, refusal
from ident.text import LOG, one_line

if TYPE_CHECKING:
    import h5py


@dataclass(frozen=True)
class SourceFile:
    """Reference to an input file, or to none.

    Attributes:
        path: its path, as given.
        sha256: hexadecimal digest of its bytes; empty if it could not be read.
        notes: what was taken from a program's convention, and done to the times.
    """

    path: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()


CLAIM = "run.lock"
"""File in a folder that a run has to itself: it holds the number of its process."""
PART = f".ident-{platform.node()}-"
"""How the names of unfinished files begin; the number of the process follows."""
WRITTEN = ".ident-written"
"""File next to results with their hashes as ident wrote them: they show what somebody has changed since."""


class _Set:
    """The files of one set: they are written under other names, then all are moved to their places."""

    def __init__(self) -> None:
        self.moves: list[tuple[Path, Path]] = []
        self.spare: list[Path] = []
        self.folders: list[Path] = []
        self.done: list[tuple[Path, Path, Path | None]] = []

    def part(self, folder: Path) -> Path:
        """Return a name for a file that is removed at the end, if it is still there."""
        if all(part.parent != folder for part in self.spare):
            _remove_left(folder)
        self.spare.append(folder / f"{PART}{os.getpid()}-{uuid4().hex}.part")
        return self.spare[-1]

    def put(self) -> None:
        for source, target in self.moves:
            try:
                # one move happens or not; of several, what the first ones replace must be able to come back
                old = self._kept(target) if len(self.moves) > 1 and os.path.lexists(target) else None
                os.replace(source, target)
            except OSError as error:
                raise _not_written(target, error) from None
            LOG.info("wrote %s", one_line(str(target)))
            self.done.append((source, target, old))

    def _kept(self, path: Path) -> Path:
        old = self.part(path.parent)
        try:
            os.link(path, old, follow_symlinks=False)
        except (OSError, NotImplementedError):  # a file system or an operating system without links
            shutil.copy2(path, old, follow_symlinks=False)
        return old

    def undo(self) -> None:
        for source, target, old in reversed(self.done):
            with suppress(OSError):
                os.replace(target, source)
            if old is not None:
                with suppress(OSError):
                    os.replace(old, target)

    def clean(self, folders: bool) -> None:
        for remove in (*(path.unlink for path in self.spare), *(folder.rmdir for folder in self.folders if folders)):
            with suppress(OSError):
                remove()


_SET: ContextVar[_Set | None] = ContextVar("_SET", default=None)


@contextmanager
def together() -> Iterator[_Set]:
    """Let all files that are written within appear at the end together, or none of them.

    After an exception every file is as it was before, and folders that were made are removed. A set within a set
    is a part of it.

    Raises:
        InputError: a file can't be moved to its place.
    """
    outer = _SET.get()
    if outer is not None:
        yield outer
        return
    files, whole = _Set(), False
    token = _SET.set(files)
    try:
        yield files
        files.put()
        whole = True
    except BaseException:
        files.undo()
        raise
    finally:
        _SET.reset(token)
        files.clean(folders=not whole)


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 by `replace_file`, and make folders that are not there."""
    data = text.encode("utf-8", "backslashreplace")
    replace_file(path, lambda file: file.write(data), make_folders=True)


def replace_file(path: Path, write: Callable[[BinaryIO], object], *, make_folders: bool = False) -> None:
    """Write a file under another name and move it to its place when it, and its set, is complete and on the disk.

    Args:
        path: where the file goes.
        write: writes to the open file that it is given.
        make_folders: make the folders that are not there.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    with together() as files:
        try:
            if make_folders:
                files.folders += _missing(path.parent)
                path.parent.mkdir(parents=True, exist_ok=True)
            part = files.part(path.parent)
            with part.open("xb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
            if path.is_dir():
                raise IsADirectoryError
        except (OSError, ValueError) as error:
            raise _not_written(path, error) from None
        files.moves.append((part, path))


def remove_file(path: Path) -> None:
    """Remove a file if it is there, when its set is complete.

    Raises:
        InputError: it can't be removed.
    """
    with together() as files:
        if os.path.lexists(path):
            files.moves.append((path, files.part(path.parent)))


def _remove_left(folder: Path) -> None:
    """Remove what processes of this machine that are gone have left unfinished in a folder."""
    for part in folder.glob(".ident-*.part") if os.name == "posix" else ():
        with suppress(OSError, ValueError, OverflowError):  # another user's process is one; the number of none
            try:
                os.kill(int(part.name.removeprefix(PART).partition("-")[0]), 0)
            except ProcessLookupError:
                part.unlink()


def digest(path: Path) -> str:
    """Return a hash of a file's bytes; empty where it can't be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def keep_earlier(files: _Set, folder: Path, name: str, keep: bool | None = None) -> str:
    """Give what a set would replace in a folder a number, where it is to be kept; and note what ident writes there.

    Args:
        files: the set.
        folder: where its files go.
        name: how the names of all begin.
        keep: whether the earlier files are kept; None where one of them is not as ident wrote it.

    Returns:
        How the names of what is kept begin; empty where nothing is.
    """
    written, kept = _written(folder), ""
    places = [source if target in files.spare else target for source, target in files.moves]
    there = {path: path.relative_to(folder).as_posix() for path in places if os.path.lexists(path)}
    if there and (any(written.get(key) != digest(path) for path, key in there.items()) if keep is None else keep):
        kept = numbered(folder, name)
        moves = {path: folder / (kept + key.removeprefix(name)) for path, key in there.items()}
        for target in moves.values():
            files.folders += _missing(target.parent)
            target.parent.mkdir(parents=True, exist_ok=True)
        files.moves = [*moves.items(), *(move for move in files.moves if move[0] not in moves)]
    written |= {target.relative_to(folder).as_posix(): digest(source) for source, target in files.moves}
    replace_file(folder / WRITTEN, lambda file: file.write(json.dumps(written, indent=1).encode("utf-8")))
    return kept


def numbered(folder: Path, name: str) -> str:
    """Return how names in a folder may begin that are to be kept: behind this name a number that is free."""
    names = (f"{name}.{number}" for number in itertools.count(1))
    return next(each for each in names if not any(folder.glob(f"{glob.escape(each)}.*")))


def _written(folder: Path) -> dict[str, str]:
    """Return the hashes of what ident has written into a folder, by name; of what is still there."""
    try:
        noted = dict(json.loads((folder / WRITTEN).read_text("utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return {}
    return {name: hashed for name, hashed in noted.items() if os.path.lexists(folder / str(name))}


def _missing(folder: Path) -> list[Path]:
    """Return the folders that have to be made for this one, the innermost first."""
    return [each for each in (folder, *folder.parents) if not os.path.exists(each)]


def _not_written(path: Path, error: OSError | ValueError) -> InputError:
    remedy = "choose a folder that can be written to (--out)"
    reason = "a folder" if os.path.isdir(path) else (getattr(error, "strerror", None) or str(error)).lower()
    return refusal(one_line(str(path)), reason, "a file to write", remedy)


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
    new = _missing(folder)
    try:
        lock = _lock(folder)
    except BlockingIOError:
        got = f"a folder in which another run is at work{_process(folder)}"
        remedy = "wait until it has ended, or choose another folder (`folder`)"
        raise refusal(one_line(str(folder)), got, "one run at a time", remedy) from None
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        remedy = "choose a folder that can be written to (`folder`)"
        raise refusal(one_line(str(folder)), reason, "a folder to write to", remedy) from None
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
    except OSError as error:  # else a file system that knows no locks
        if isinstance(error, BlockingIOError):
            raise


def _process(folder: Path) -> str:
    """Say which process has a folder, if that can be read."""
    with suppress(OSError, ValueError):
        return f" (process {int((folder / CLAIM).read_text('ascii'))})"
    return ""


def leads_away(file: "h5py.File") -> tuple[str, str] | None:
    """Return what in an HDF5 file leads to another one, by its name, None for nothing; no other file is opened.

    Reading it would bring in any file of the machine that its writer has named.
    """
    import h5py

    def linked(name: bytes, link: Any) -> bytes | None:  # what it raised, h5py would turn into an error of its own
        own = link.type in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT)  # a soft one is of this file, and is not followed
        return None if own else name

    def stored(name: str, item: Any) -> tuple[str, str] | None:
        if not isinstance(item, h5py.Dataset):
            return None
        if item.id.get_create_plist().get_external_count():
            return name, "numbers stored in another file"
        virtual = item.is_virtual and any(source.file_name != "." for source in item.virtual_sources())
        return (name, "numbers of another file (a virtual dataset)") if virtual else None

    name = file.id.links.visit(linked, info=True)
    return (name.decode("utf-8", "replace"), "a link to another file") if name else file.visititems(stored)
