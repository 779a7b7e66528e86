"""Long studies: pieces of work that are done in processes of their own, each written to a file when it is finished."""

import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

Key = tuple[Any, ...]


def read(file: Path | None, header: Mapping[str, Any]) -> dict[Key, Any]:
    """Return what an interrupted run has left, by key; a half-written last line is dropped."""
    if file is None or not file.exists():
        return {}
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    file.write_text(whole, encoding="utf-8")
    lines = [json.loads(line) for line in whole.splitlines()]
    if lines and lines[0] != header:
        sys.exit(f"{file} is of another run: {lines[0]}; this one is {header}; name another file")
    return {tuple(line["key"]): line["found"] for line in lines[1:]}


def run(
    work: Callable[..., Any], wanted: Iterable[Key], header: Mapping[str, Any], file: Path | None, processes: int
) -> dict[Key, Any]:
    """Do the work that is not in the file yet, and add each result to it.

    Args:
        work: called with each key; returns what JSON knows. A function of a module, for it runs in other processes.
        wanted: the keys.
        header: what all results in one file share, such as the seed.
        file: JSON lines to go on with, or to begin; None for none.
        processes: at a time.

    Returns:
        The results by key, in the order of the keys.
    """
    wanted, done = list(wanted), read(file, header)
    left = [key for key in wanted if key not in done]
    with (
        open(file or os.devnull, "a", encoding="utf-8") as out,
        ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool,
    ):
        if out.tell() == 0:
            print(json.dumps(header), file=out, flush=True)
        running = {pool.submit(work, *key): key for key in left}
        for future in as_completed(running):
            done[running[future]] = future.result()
            print(json.dumps({"key": running[future], "found": done[running[future]]}), file=out, flush=True)
            if sys.stderr.isatty():
                print(f"\r{len(done)} of {len(wanted)}", end="", file=sys.stderr, flush=True)
    return {key: done[key] for key in wanted}
