"""Files that are written whole or not at all."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from ident.errors import InputError, Problem
from ident.text import one_line


def replace_file(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file under another name and move it to its place when it is complete.

    Args:
        path: where the file goes; folders are made as needed.
        write: writes the contents to the binary file it is given.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    part = path.parent / f".ident-{uuid4().hex}.part"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("xb") as file:
                write(file)
            os.replace(part, path)
        finally:
            with suppress(OSError):
                part.unlink()
    except OSError as error:
        remedy = "choose another folder with --out"
        reason = (error.strerror or str(error)).lower()
        raise InputError(Problem(one_line(str(path)), reason, "a file that can be written", remedy)) from None
