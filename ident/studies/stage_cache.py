"""Stages that are finished, on disk: a run that was killed goes on behind the last one."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ident.files import replace_file
from ident.inference.checkpoints import IDENTITY, claim


class StageCache:
    """The finished stages of one run, a file each, in a folder of its own."""

    def __init__(self, folder: Path, identity: Mapping[str, str]):
        """Claim the folder for a run of this identity.

        Raises:
            InputError: the folder holds another run, or can't be written to.
        """
        self.folder = folder
        claim(folder, identity)

    def read(self, stage: str) -> dict[str, Any] | None:
        """Return what a stage has left; None if it is not finished, or its file is broken."""
        try:
            found = json.loads(self._file(stage).read_text("utf-8"))
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def write(self, stage: str, found: Mapping[str, Any]) -> None:
        """Keep what a stage has found, whole or not at all.

        Raises:
            InputError: it can't be written.
        """
        text = json.dumps(found, ensure_ascii=False)
        replace_file(self._file(stage), lambda out: out.write(text.encode("utf-8", "backslashreplace")))

    @staticmethod
    def discard(folder: Path) -> None:
        """Remove the stages in a folder, and the folder if nothing else is in it."""
        if (folder / IDENTITY).exists():
            for file in [*folder.glob("stage-*.json"), *folder.glob(".ident-*.part"), folder / IDENTITY]:
                file.unlink(missing_ok=True)
            if not any(folder.iterdir()):
                folder.rmdir()

    def _file(self, stage: str) -> Path:
        return self.folder / f"stage-{stage}.json"
