"""`ident modal --watch` for half an hour: how soon its lines come, and whether its memory grows.

`python tests/benchmarks/watch.py [--minutes 30]`: files of the shipped hammer test come in halves, are renamed and
removed, over and over. Prints each minute the memory of the process, and at the end the longest times from a whole file
to its hits and to its modes.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Thread

import psutil

FOLDER = Path(__file__).parents[2] / "data" / "lcd_arm" / "hammer"
STATE = "alpha60"
ROUND = 20.0
"""Seconds from one time that a file comes to the next."""


def listen(process: subprocess.Popen[str], said: list[tuple[float, str]]) -> None:
    """Note each line with its time."""
    assert process.stdout
    for line in process.stdout:
        said.append((time.monotonic(), line))


def play(folder: Path, name: str) -> float:
    """Write a file in halves, rename it and back, remove it; return when it was whole."""
    data, path, other = (FOLDER / name).read_bytes(), folder / name, folder / "other.unv"
    begin = time.monotonic()
    with path.open("wb") as file:
        file.write(data[: len(data) // 2])
        file.flush()
        time.sleep(1.5)
        file.write(data[len(data) // 2 :])
    whole = time.monotonic()
    time.sleep(ROUND / 2)
    path.rename(other)
    time.sleep(1.0)
    other.rename(path)
    time.sleep(max(begin + ROUND - time.monotonic(), 0))
    path.unlink()
    return whole


def main() -> None:
    """Watch, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    minutes = parser.parse_args().minutes
    folder, said, whole = Path(tempfile.mkdtemp()), list[tuple[float, str]](), list[float]()
    shutil.copy(FOLDER / "arm.toml", folder)
    head, *rows = (line for line in (FOLDER / "channels.csv").read_text().splitlines() if not line.startswith("#"))
    rows = [f"{row},1000" for row in rows if row.startswith(STATE)]
    (folder / "channels.csv").write_text("\n".join([f"{head},taps", *rows]))
    command = [sys.executable, "-m", "ident", "modal", str(folder), "--watch"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    Thread(target=listen, args=(process, said), daemon=True).start()
    while not said:
        time.sleep(0.1)
    begin, minute = time.monotonic(), 0
    while time.monotonic() - begin < 60 * minutes:
        whole.append(play(folder, f"{STATE}_{'zy'[len(whole) % 2]}.unv"))
        if time.monotonic() - begin >= 60 * minute:
            size = psutil.Process(process.pid).memory_info().rss / 1e6
            print(f"{(time.monotonic() - begin) / 60:.1f} min: {size:.1f} MB, {len(whole)} files", flush=True)
            minute += 1
    process.kill()
    for words in (": hits at ", "modes at "):
        first = [next(at for at, line in said if at > since and words in line) - since for since in whole]
        print(f"{words.strip(': ')}: {max(first):.1f} s after the file was whole at most, of {len(first)}")
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
