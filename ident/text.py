"""What people write: files as text, words quoted safely in a message, the name that was meant."""

import difflib
import logging
import shlex
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import TypeVar

from ident.errors import InputError, one_line, refusal

K = TypeVar("K")
V = TypeVar("V")

LOG = logging.getLogger("ident")
"""Says what is read, compiled and written, where logging is switched on."""

NAME = "[A-Za-z][A-Za-z0-9_-]*"
"""A part's name: nothing that a path `link1.com.x` or a load `5 kg @ tip` could confuse."""

NAME_RULE = "letters, digits, _ and - only, a letter first"
"""The same in words, for messages."""

LONGEST_QUOTE = 40
"""Characters of a user's text that a message repeats."""

LARGEST_TEXT = 100_000_000
"""Bytes of a file that people write: a campaign, a channel table, an arm. A million rows have half of that."""

LARGEST_SAMPLES = 1_000_000_000
"""Bytes of a table of samples as text: 12 channels at 1 kHz for two hours."""

FILES_MAX = 1000
"""Files of a folder that are looked at for one that may be meant."""

LARGEST_BINARY = 4_300_000_000
"""Bytes of a file that only programs write: recordings, results. A WAV file cannot be longer."""


def quoted(text: str) -> str:
    """Quote a user's text for a message: escaped, and cut when it is long."""
    cut = text if len(text) <= LONGEST_QUOTE else text[:LONGEST_QUOTE] + "…"
    return f"'{one_line(cut)}'" if text else "nothing"


def as_word(name: str | PathLike[str]) -> str:
    """Return a name as one word of a command that is proposed: on one line, quoted for a shell, and never an option."""
    text = one_line(str(name))
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


FIRST, NEWEST = 10, 10
"""Oldest and newest readable version of all formats; the newest is written, versions before named classes."""


@contextmanager
def within(variable: ContextVar[V], value: V) -> Iterator[None]:
    """Set a variable to a value inside this context."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def study_of(form: str) -> str:
    """Return the study that writes a format: `fit` for `ident-fit/10`."""
    return form.removeprefix("ident-").partition("/")[0]


def table_lines(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines in columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{cell:{width}s}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the known name that resembles `name` most, in whatever case, or an empty string."""
    spelt = {word.lower(): word for word in known}
    near = difflib.get_close_matches(name.lower(), spelt, n=1, cutoff=0.5)
    return spelt[near[0]] if near else ""


def did_you_mean(name: str, known: Iterable[str], otherwise: str) -> str:
    """Return a remedy for an unknown name: the nearest known one, or else the other remedy."""
    near = nearest(name, known)
    return f"did you mean {near}?" if near else otherwise


def no_such(where: str, name: str, known: Collection[str], otherwise: str, column: str = "") -> InputError:
    """Return the error of an unknown name; its remedy is the nearest known one, or else the other remedy."""
    return refusal(where, quoted(name), f"one of {', '.join(known)}", did_you_mean(name, known, otherwise), column)


def which_file(path: str | PathLike[str], otherwise: str = "check the path") -> str:
    """Return a remedy for a file or folder that is not there: one of its folder with a name like it, and its ending."""
    own = Path(path)
    near = nearest(own.stem, (each.stem for each in islice(own.parent.glob(f"*{own.suffix}"), FILES_MAX)))
    return f"did you mean {one_line(str(own.with_name(near + own.suffix)))}?" if near else otherwise


def read_bytes(path: str | PathLike[str], expected: str, largest: int = LARGEST_TEXT) -> bytes:
    """Return the bytes of a regular file; a pipe or a device may have no end.

    Args:
        path: the file.
        expected: what the file should be, for messages.
        largest: bytes that it may have.

    Raises:
        InputError: there is no such file, it is no regular one, is too large, or cannot be read.
    """
    where = one_line(str(path))
    try:
        status = Path(path).stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            remedy = "save what it holds as a file, and name that"
            raise refusal(where, "a pipe, a device or a socket", f"{expected} in a regular file", remedy)
        if stat.S_ISREG(status.st_mode) and status.st_size > largest:
            got, most = f"a file of {status.st_size / 1e6:.0f} MB", f"at most {largest / 1e6:.0f} MB"
            raise refusal(where, got, f"{expected} of {most}", "name another file, or split this one")
        LOG.info("read %s, %d bytes", where, status.st_size)
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower().removeprefix("is ")
        remedy = which_file(path) if isinstance(error, FileNotFoundError) else "check the path and its permissions"
        inside = islice(Path(path).glob("*"), FILES_MAX) if isinstance(error, IsADirectoryError) else ()
        if bags := sorted(str(each) for each in inside if each.suffix in (".db3", ".mcap")):
            remedy = f"this folder is a ROS 2 bag: name {one_line(bags[0])} in it"
        raise refusal(where, reason, expected, remedy) from None


def read_text(path: str | PathLike[str], expected: str) -> str:
    """Return the text of a file that people write, see `read_bytes` and `decode`."""
    return decode(read_bytes(path, expected), one_line(str(path)))


def decode(data: bytes, file: str, *, by_instrument: bool = False) -> str:
    """Return bytes as text, with or without a byte order mark; in what people write no encoding but UTF-8 is guessed.

    Args:
        data: the bytes.
        file: its name, for messages.
        by_instrument: whether bytes that are not UTF-8 are Latin-1, in which equipment writes degrees and micro.

    Raises:
        InputError: the bytes are not UTF-8.
    """
    if b"\0" in data or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        remedy = "save the file as text in UTF-8"
        raise refusal(file, "UTF-16 or a binary file", "a text file in UTF-8", remedy)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if by_instrument:
            return data.decode("latin-1")
        before, byte = error.object[: error.start], error.object[error.start]
        line = len((before + b".").splitlines())
        got, remedy = f"the byte 0x{byte:02x}, which is no UTF-8", "save the file as UTF-8"
        raise refusal(f"{file}:{line}", got, "text in UTF-8", remedy) from None


def by_key(pairs: Iterable[tuple[K, V]]) -> dict[K, list[V]]:
    """Group values by key, in the order of the pairs."""
    groups: dict[K, list[V]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups
