"""A chain that is killed over and over, and the same one left alone."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ident.inference.sample import BLOCK

SUPPORT = Path(__file__).parent
LINE = [sys.executable, str(SUPPORT / "sample_forever.py")]


def killed_and_alone(folder: Path, kills: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Kill -9 a run at so many moments, start it again each time; return its draws and those of a run left alone."""
    moments = random.Random(seed)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SUPPORT), *sys.path])}

    def blocks() -> int:
        return len(list((folder / "killed").glob("draws*.item")))

    for _ in range(kills):
        run = subprocess.Popen(
            [*LINE, str(folder / "killed"), "1000000"], stdout=subprocess.PIPE, text=True, env=environment
        )
        assert run.stdout is not None
        assert run.stdout.readline() == "sampling\n"
        wanted = blocks() + moments.randrange(3)  # none: while it starts; however busy the machine is
        while blocks() < wanted and run.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 0.3))
        run.send_signal(signal.SIGKILL)
        run.wait()
        run.stdout.close()
    assert blocks() > kills // 4, "the moments were too early to mean anything"
    steps = (blocks() + 3) * BLOCK
    for name in ("killed", "alone"):
        subprocess.run([*LINE, str(folder / name), str(steps)], check=True, env=environment, capture_output=True)
    return np.load(folder / "killed.npy"), np.load(folder / "alone.npy")
