"""Chains on disk as they grow: one file a block, each written whole or not at all."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, Int, UInt

from ident.errors import InputError, Problem
from ident.files import replace_file
from ident.text import one_line

IDENTITY = "run.json"


@dataclass(frozen=True)
class Block:
    """A stretch of all chains, and the random generators' states at its end; the walkers' places are its last draws.

    Attributes:
        theta: (steps, ensembles, walkers, P) draws.
        log_density: (steps, ensembles, walkers) log posterior.
        accepted: (1, ensembles) accepted moves.
        keys: (ensembles, 624) states of the Mersenne twisters.
        positions: (ensembles, 2) their places, and whether a normal deviate is in store.
        deviates: (ensembles,) that deviate.
    """

    theta: Float[np.ndarray, "steps ensembles walkers P"]
    log_density: Float[np.ndarray, "steps ensembles walkers"]
    accepted: Int[np.ndarray, "1 ensembles"]
    keys: UInt[np.ndarray, "ensembles 624"]
    positions: Int[np.ndarray, "ensembles 2"]
    deviates: Float[np.ndarray, "ensembles"]


class Checkpoints:
    """The blocks of one run in a folder of its own.

    A run killed at any moment leaves whole blocks only, and goes on from the last one.
    """

    def __init__(self, folder: Path | None, identity: Mapping[str, str]):
        """Claim the folder for a run of this identity; None to keep nothing.

        Raises:
            InputError: the folder holds another run, or can't be written to.
        """
        self.folder = folder
        if folder is not None:
            claim(folder, identity)

    def read(self) -> list[Block]:
        """Return the blocks that are there, in order, up to the first that is missing or broken."""
        blocks: list[Block] = []
        while self.folder and (file := self._file(len(blocks))).exists():
            try:
                with np.load(file, allow_pickle=False) as kept:
                    blocks.append(Block(**{f.name: kept[f.name] for f in fields(Block)}))
            except (OSError, ValueError, KeyError, EOFError, BadZipFile):
                break
        return blocks

    def write(self, number: int, block: Block) -> None:
        """Keep a block.

        Raises:
            InputError: it can't be written; the blocks before are untouched.
        """
        if self.folder:
            arrays = {f.name: getattr(block, f.name) for f in fields(Block)}
            replace_file(self._file(number), lambda out: np.savez(out, **arrays))

    @staticmethod
    def discard(folder: Path) -> None:
        """Remove the checkpoints in a folder, and the folder if nothing else is in it."""
        if (folder / IDENTITY).exists():
            for file in [*folder.glob("block*.npz"), *folder.glob(".ident-*.part"), folder / IDENTITY]:
                file.unlink(missing_ok=True)
            if not any(folder.iterdir()):
                folder.rmdir()

    def _file(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"block{number:05d}.npz"


def claim(folder: Path, identity: Mapping[str, str]) -> None:
    """Claim a folder for the unfinished run of an identity.

    Raises:
        InputError: the folder holds another run, or can't be written to.
    """
    file = folder / IDENTITY
    if file.exists():
        _compare(folder, _read_identity(file), identity)
    else:
        text = json.dumps(dict(identity), indent=1, sort_keys=True)
        replace_file(file, lambda out: out.write(text.encode("utf-8")), make_folders=True)


def _read_identity(file: Path) -> dict[str, str]:
    try:
        return dict(json.loads(file.read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return {}


def _compare(folder: Path, found: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    other = [name for name in wanted if found.get(name) != wanted[name]]
    if other:
        got = f"the checkpoints of a run with another {', another '.join(other)}"
        remedy = "take the inputs and options of that run, or begin anew (--restart), or choose another folder (--out)"
        raise InputError(Problem(one_line(str(folder)), got, "those of this run", remedy))
