"""A chain that is killed over and over, and the same one left alone; `python kills.py FOLDER` samples until killed."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
from chains import linear_problem

from ident.inference.fit import fit
from ident.inference.posterior import posterior
from ident.inference.sample import BLOCK, Settings, sample

SUPPORT = Path(__file__).parent
jax.config.update("jax_enable_x64", True)  # also where no test has switched it on


def drawn(folder: Path, steps: int) -> np.ndarray:
    """Sample a linear problem with checkpoints in a folder."""
    found = fit(linear_problem()[0], starts=1)
    print("sampling", flush=True)
    settings = Settings(walkers=12, max_steps=steps, target_ess=1e12)
    return sample(found, posterior(found.problem), settings, folder=folder).theta


def killed_and_alone(folder: Path, kills: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Kill -9 a run at so many moments, start it again each time; return its draws and those of a run left alone.

    The last start, and the run left alone, are this process.
    """
    moments = random.Random(seed)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(SUPPORT), *sys.path])}

    def blocks() -> int:
        return len(list((folder / "killed").glob("draws*.item")))

    for _ in range(kills):
        line = [sys.executable, __file__, str(folder / "killed")]
        run = subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=environment)
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
    killed, alone = (drawn(folder / name, steps) for name in ("killed", "alone"))
    return killed, alone


if __name__ == "__main__":
    drawn(Path(sys.argv[1]), 1_000_000)
