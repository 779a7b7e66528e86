"""Parts of unfinished work on disk: a run that was killed at any moment goes on behind the last of them."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ident.codec import CodecError, decode, encode
from ident.errors import InputError, Problem
from ident.files import claimed, replace_file
from ident.text import one_line

IDENTITY = "run.json"
END = ".item"
TREE = "tree"
BROKEN = (OSError, ValueError, KeyError, EOFError, NotImplementedError, RuntimeError, BadZipFile, CodecError)
"""What reading a damaged item may raise."""


class Store:
    """The finished parts of one run, a file each, in a folder of its own; without a folder nothing is kept.

    An item is any value that `ident.codec` can write: an npz file of its large arrays and of the tree that holds them.
    It is written whole or not at all, and a damaged one counts as not there.
    """

    def __init__(self, folder: Path | None, identity: Mapping[str, str]):
        """Claim a folder for a run.

        Args:
            folder: where the items go; None to keep nothing.
            identity: what the run depends on, by name: all of it must be equal for the run to be gone on with.

        Raises:
            InputError: the folder holds another run, or can't be written to; what is there is untouched.
        """
        self.folder = folder
        if folder is None:
            return
        file = folder / IDENTITY
        if os.path.exists(file):
            _compare(folder, _read_identity(file), identity)
        else:
            text = json.dumps(dict(identity), indent=1, sort_keys=True)
            replace_file(file, lambda out: out.write(text.encode("utf-8")), make_folders=True)

    def read(self, name: str) -> Any:
        """Return an item; None if it is not there, or damaged."""
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / f"{name}{END}", allow_pickle=False) as parts:
                arrays = {key: parts[key] for key in parts.files}
            return decode(json.loads(arrays.pop(TREE).tobytes()), arrays)
        except BROKEN:
            return None

    def write(self, name: str, value: Any) -> None:
        """Keep an item.

        Raises:
            InputError: it can't be written; the items before are untouched.
        """
        if self.folder is None:
            return
        arrays: dict[str, Any] = {}
        tree = json.dumps(encode(value, arrays)).encode("utf-8")
        arrays[TREE] = np.frombuffer(tree, np.uint8)
        replace_file(self.folder / f"{name}{END}", lambda out: np.savez(out, **arrays))

    def remove(self, name: str) -> None:
        """Remove an item, if it is there."""
        if self.folder is not None:
            (self.folder / f"{name}{END}").unlink(missing_ok=True)

    @staticmethod
    def empty(folder: Path) -> None:
        """Remove the items of a folder in which a run has kept some; nothing else."""
        if os.path.exists(folder / IDENTITY):
            for file in [*folder.glob(f"*{END}"), *folder.glob(".ident-*.part"), folder / IDENTITY]:
                file.unlink(missing_ok=True)

    @staticmethod
    def discard(folder: Path) -> None:
        """Remove the items of a folder in which a run has kept some, and the folder if nothing else is in it.

        Raises:
            InputError: another run is at work there.
        """
        if os.path.exists(folder / IDENTITY):
            with claimed(folder):
                Store.empty(folder)


def _read_identity(file: Path) -> dict[str, str]:
    try:
        return dict(json.loads(file.read_text("utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return {}


def _compare(folder: Path, claimed: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    other = [name for name in wanted if claimed.get(name) != wanted[name]]
    if other:
        got = f"the checkpoints of a run with another {', another '.join(other)}"
        remedy = (
            "take the inputs and options of that run, or begin anew (`restart`), or choose another folder (`folder`)"
        )
        raise InputError(Problem(one_line(str(folder)), got, "those of this run", remedy))
