"""The whole run of the paper's arm at 10 % of its speed, against MuJoCo's equations integrated by SciPy: minutes.

    python tests/benchmarks/whole_run.py

prints for both methods how far the displacement of the end point is from theirs, in each direction.
"""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import jax
import numpy as np
from arms import lcd_arm
from moving_engines import MujocoMoving
from mujoco_arm import equilibrium
from oracles import QuickMujoco, command_at, follow, table_of

from ident.vibrate.motion import stroke
from ident.vibrate.response import Response, peak
from ident.vibrate.simulate import simulate

PERCENT, DWELL, RTOL = 10.0, 1.0, 1e-7


def report(name: str, response: Response, theirs: np.ndarray) -> None:
    """Print the largest difference and that of the peaks, in each direction, as parts of the peak of vibration."""
    T, highest = theirs.shape[1], np.asarray(peak(response.vibration))
    traces = np.abs(np.asarray(response.displacement)[:, :T] - theirs).max(1) / highest
    peaks = np.abs(theirs - np.asarray(response.quasi_static)[:, :T]).max(1) / highest - 1
    of_largest = traces * highest / highest.max()
    print(f"{name}: X, Y, Z off by {traces} of their peaks, {of_largest} of the largest peak; peaks by {peaks}")


def main() -> None:
    """Compare from ident's state of rest, and from MuJoCo's equilibrium, which feels the weight of turning masses."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    jax.config.update("jax_enable_x64", True)
    arm = lcd_arm()
    motion = stroke(arm.stroke, percent=PERCENT, dwell=DWELL)
    runs = {method: simulate(arm, motion, method=method) for method in ("fast", "exact")}
    print(f"peaks of vibration: {peak(runs['exact'].vibration)} m")
    engine, table, times = QuickMujoco(arm), table_of(motion), np.asarray(runs["exact"].time)
    rest = np.asarray(runs["exact"].y[:, 0])
    hanging = equilibrium(MujocoMoving(arm), command_at(table, times[0]))
    for start, phi in (("ident's rest", rest), ("MuJoCo's equilibrium", hanging)):
        began = time.perf_counter()
        theirs, _ = follow(engine, table, np.concatenate([phi, np.zeros_like(phi)]), times, RTOL)
        print(f"from {start}: {time.perf_counter() - began:.0f} s")
        for method, response in runs.items():
            report(method, response, theirs)


if __name__ == "__main__":
    main()
