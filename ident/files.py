"""Files that are written whole or not at all."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from ident.errors import InputError, Problem
from ident.text import one_line


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
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise InputError(Problem(one_line(str(path)), reason, "a file to write", remedy)) from None


def replace_file(path: Path, write: Callable[[BinaryIO], object], *, make_folders: bool = False) -> None:
    """Do what `replace_path` does for what writes to an open binary file."""

    def write_to(part: Path) -> None:
        with part.open("xb") as file:
            write(file)

    replace_path(path, write_to, make_folders=make_folders)
