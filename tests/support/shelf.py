"""Commands that tests of several files need run once for all of them, also where these run in several processes."""

import fcntl
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from shutil import copyfile

OUT = Path("out")
Answer = tuple[int, str, str]
"""Exit code, output and error text."""


class Shelf:
    """What commands have printed and written into `out`, by their words.

    They need shipped files alone, or what another command on the shelf has written.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def run(self, words: Sequence[str], run: Callable[..., Answer], *more: str) -> Answer:
        """Run a command with some more words unless it has been run; else put its files in their places."""
        with self._only_one(words) as kept:
            if not (kept / "answer.json").exists():
                return _kept(kept, words, run, more)
            code, out, err, paths = json.loads((kept / "answer.json").read_text("utf-8"))
            for i, path in enumerate(paths):
                Path(path).parent.mkdir(parents=True, exist_ok=True)
                copyfile(kept / str(i), path)
            return code, out, err

    def put(self, words: Sequence[str], run: Callable[..., Answer]) -> Answer:
        """Run a command, whether or not it has been run, and keep what it did."""
        with self._only_one(words) as kept:
            return _kept(kept, words, run, ())

    @contextmanager
    def _only_one(self, words: Sequence[str]) -> Iterator[Path]:
        """Let no other process run it meanwhile; a lock ends with the process that has it."""
        kept = self.folder / sha256("\n".join(words).encode()).hexdigest()[:16]
        kept.mkdir(parents=True, exist_ok=True)
        with (kept / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield kept


def _kept(kept: Path, words: Sequence[str], run: Callable[..., Answer], more: Sequence[str]) -> Answer:
    before = _written()
    answer = run(*words[1:], *more)
    paths = [path for path, when in _written().items() if before.get(path) != when]
    for i, path in enumerate(paths):
        copyfile(path, kept / str(i))
    (kept / "answer.json").write_text(json.dumps([*answer, [str(path) for path in paths]]), "utf-8")
    return answer


def _written() -> dict[Path, int]:
    """When each file there was written."""
    return {path: path.stat().st_mtime_ns for path in OUT.rglob("*") if path.is_file()}
