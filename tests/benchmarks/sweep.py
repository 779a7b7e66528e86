"""The 63 simulations of the paper's Figure 9, by ident and by MuJoCo in one run.

    python tests/benchmarks/sweep.py [--quick]

Torsional stiffness of three joints, 21 values each, a stroke at 10 % of 10 s (`transient.py`). MuJoCo integrates each
with its own stiffness, at the largest step that is as close to its own converged solution as ident's sweep is to the
exact equations. Of MuJoCo only the integration is timed, one call a run, and not how a model is made; ident's time is
that of the whole sweep, compiled before.
"""

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import jax
import numpy as np
from arms import lcd_arm
from mujoco_arm import MujocoTransient
from swept import axis
from timing import least, machine
from transient import RATE, error, mujoco, seconds_of_stroke

from ident.arm.arm import Arm
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import Motion
from ident.vibrate.simulate import simulate
from ident.vibrate.sweep import Axis, Sweep, sweeps


def figure_nine(arm: Arm, count: int) -> list[Axis]:
    """Return the torsional stiffnesses of all joints, 0.4 to 2.5 times as they are."""
    paths = [f"{joint.name}.k_tors" for joint in arm.joints]
    return [axis(arm, [path], float(arm.get(path)) * np.geomspace(0.4, 2.5, count), 10.0) for path in paths]


def ours(trial: Evaluator, axes: list[Axis], repeat: int) -> tuple[float, float, tuple[Sweep, ...]]:
    """Return the least time and the least CPU time [s] of all sweeps, and what they find."""
    found = sweeps(trial, axes)
    return *least(lambda: sweeps(trial, axes), repeat), found


def theirs(arm: Arm, motion: Motion, axes: list[Axis], step: float, repeat: int) -> tuple[float, np.ndarray]:
    """Return the sum of the least times [s] of MuJoCo's runs, and its peaks (3, runs) [m] about the start."""
    every, total, peaks = round(1 / RATE / step), 0.0, []
    for one in axes:
        for value in one.values:
            changed = arm.replace({one.paths[0]: np.asarray(value)})
            peer = MujocoTransient(changed, lambda t: tuple(np.asarray(part) for part in motion(t)), 10.0)
            moved = peer.run(step, every=every).displacement
            total += least(partial(peer.run, step, every=every), repeat)[0]
            peaks.append(np.abs(moved - moved[:, :1]).max(1))
    return total, np.stack(peaks, 1)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer values and repetitions")
    quick = parser.parse_args().quick
    jax.config.update("jax_enable_x64", True)
    print(machine())
    arm, repeat = lcd_arm(), 1 if quick else 3
    motion, axes = seconds_of_stroke(arm), figure_nine(arm, 3 if quick else 21)
    runs = sum(len(one.values) for one in axes)
    variables = tuple(one.variable for one in axes)
    trial = Evaluator(arm, motion, variables, rate=RATE)
    changes = [
        np.log(one.values / one.present)[:, None] * way for one, way in zip(axes, np.eye(len(axes)), strict=True)
    ]
    step = trial.step_for(np.concatenate(changes))
    exact = simulate(arm, motion, method="exact", rate=RATE).vibration
    apart = error(simulate(arm, motion, rate=RATE, step=step).vibration, exact)
    single = mujoco(arm, motion, apart, repeat)
    mine, cpu, found = ours(replace(trial, step=step), axes, repeat)
    other, peaks = theirs(arm, motion, axes, single[0], repeat)
    print(f"ident errs by {apart:.1e} of the largest; MuJoCo, RK4, step {1e3 * single[0]:g} ms, by {single[1]:.1e}")
    print(f"MuJoCo, {runs} runs of 10 s, each with its own stiffness: {other:.2f} s, {1e3 * other / runs:.1f} ms a run")
    print(f"ident, the sweep: {mine:.2f} s, {1e3 * mine / runs:.1f} ms a run, {other / mine:.1f} times as fast")
    print(f"by CPU time: {1e3 * cpu / runs:.1f} ms a run, {other / cpu:.1f} times as fast")
    whole = np.concatenate([one.amplitude for one in found], 1)
    print(f"largest Y: ident {1e3 * whole[1].max():.3f} mm, MuJoCo, from its start, {1e3 * peaks[1].max():.3f} mm")
    print(machine())


if __name__ == "__main__":
    main()
