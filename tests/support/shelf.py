"""Commands that tests of several files need run once for all of them, also where these run in several processes."""

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from shutil import copyfile
from tempfile import mkdtemp

OUT = Path("out")
Answer = tuple[int, str, str]
"""Exit code, output and error text."""


class Shelf:
    """What commands have printed and written into `out`, by their words.

    They need shipped files alone, or what another command on the shelf has written, and write into `out` alone. Two
    processes that need one at the same time both run it, and one of both answers is kept.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def run(self, words: Sequence[str], run: Callable[..., Answer], *more: str) -> Answer:
        """Run a command with some more words unless it has been run; else put its files in their places."""
        kept = self._place(words, more)
        if not kept.exists():
            return self.put(words, run, *more)
        code, out, err, paths = json.loads((kept / "answer.json").read_text("utf-8"))
        for i, path in enumerate(paths):
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            copyfile(kept / str(i), path)
        return code, out, err

    def put(self, words: Sequence[str], run: Callable[..., Answer], *more: str) -> Answer:
        """Run a command, whether or not it has been run, and keep what it did."""
        before = _written()
        answer = run(*words[1:], *more)
        paths = [path for path, when in _written().items() if before.get(path) != when]
        part = Path(mkdtemp(dir=self.folder))
        for i, path in enumerate(paths):
            copyfile(path, part / str(i))
        (part / "answer.json").write_text(json.dumps([*answer, [str(path) for path in paths]]), "utf-8")
        with suppress(OSError):  # another process has put one there
            part.rename(self._place(words, more))
        return answer

    def _place(self, words: Sequence[str], more: Sequence[str]) -> Path:
        return self.folder / sha256("\n".join([*words, *more]).encode()).hexdigest()[:16]


def _written() -> dict[Path, int]:
    """When each file there was written."""
    return {path: path.stat().st_mtime_ns for path in OUT.rglob("*") if path.is_file()}
