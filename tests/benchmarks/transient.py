"""A stroke at 10 % of full speed, simulated by ident and by MuJoCo in one run.

    python tests/benchmarks/transient.py [--quick]

MuJoCo integrates by RK4 with the largest step that is as close to its own converged solution as ident's fast path is
to the exact equations; each of its runs is a single call, with no Python between the steps. Its hinged bushings differ
from the exact ones by more than that whatever the step (`mujoco_arm.py`), which is not held against it.
"""

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import jax
import numpy as np
from arms import lcd_arm
from mujoco_arm import MujocoTransient
from sizes import column
from timing import least, machine, timed

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.parts import Drive, Stroke
from ident.programs import cores
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.response import peak
from ident.vibrate.simulate import simulate

STEPS = (2.5e-3, 2e-3, 1.25e-3, 1e-3, 5e-4)
"""Steps that MuJoCo may take [s]."""
FINE = 1e-4
"""Step of its converged solution [s]."""
RATE = 200.0
"""Samples a second."""


def seconds_of_stroke(arm: Arm, seconds: float = 10.0) -> Motion:
    """Return the first seconds of the stroke at 10 %, held at its end where it is shorter."""
    motion = stroke(arm.stroke, percent=10.0)
    end = float(motion.breaks[-1])
    if end <= seconds:
        return motion.dwell(seconds - end)
    pieces = int(np.searchsorted(motion.breaks, seconds))
    return Motion(motion.name, np.append(motion.breaks[:pieces], seconds), motion.coefficients[:, :pieces])


def error(x: Any, reference: Any) -> float:
    """Return the largest deviation as a share of the largest peak of the reference."""
    x, reference = np.asarray(x), np.asarray(reference)
    return float(np.abs(x - reference).max() / np.abs(reference).max())


def draws(arm: Arm, count: int) -> Arm:
    """Return an arm of random stiffnesses, 10 % about its own."""
    rng = np.random.default_rng(0)
    return arm.replace({p: float(arm.get(p)) * np.exp(0.1 * rng.normal(size=count)) for p in stiffness_paths(arm)})


def ours(arm: Arm, motion: Motion, repeat: int, method: str = "fast") -> float:
    """Return the least time [s] of a simulation."""
    return timed(lambda: simulate(arm, motion, method=method, rate=RATE).vibration, repeat)[0] / 1e6


def mujoco(arm: Arm, motion: Motion, wanted: float, repeat: int) -> tuple[float, float, float]:
    """Return step [s], error and least time [s] of MuJoCo's run at the largest step whose error is as wanted."""
    peer = MujocoTransient(arm, lambda t: tuple(np.asarray(part) for part in motion(t)), 10.0)
    sparse = round(1 / RATE / FINE)
    converged = peer.run(FINE, every=sparse).displacement
    moving = converged - converged[:, :1]
    for step in STEPS:
        every = 1 / RATE / step
        if every != round(every):
            continue
        found = peer.run(step, every=round(every)).displacement
        if np.isfinite(found).all() and np.abs(found - converged).max() < wanted * np.abs(moving).max():
            break
    apart = float(np.abs(found - converged).max() / np.abs(moving).max())
    return step, apart, timed(lambda: peer.run(step, every=round(every)).displacement, repeat)[0] / 1e6


def mujoco_on_all_cores(arm: Arm, motion: Motion, step: float, repeat: int) -> float:
    """Return the least time [s] of a run of MuJoCo's where one runs on each core."""
    peers = [
        MujocoTransient(arm, lambda t: tuple(np.asarray(part) for part in motion(t)), 10.0) for _ in range(cores())
    ]
    with ThreadPoolExecutor(cores()) as pool:

        def once() -> None:
            list(pool.map(lambda peer: peer.run(step, every=round(1 / RATE / step)), peers))

        once()
        return least(once, repeat)[0] / cores()


def shaken_column(joints: int) -> Arm:
    """Return an arm of equal joints, each with a drive."""
    arm = column(joints)
    return Arm(
        arm.name,
        arm.joints,
        arm.points,
        drives=tuple(Drive(f"d{j}", f"j{j}", ratio=100.0, rotor_inertia=1e-3) for j in range(joints)),
        stroke=Stroke([1.0] * joints, folded=0.5, unfolded=0.0, speed=2.0, acceleration=10.0, jerk=100.0),
    )


def table(quick: bool) -> None:
    """Print how the cost grows with duration, joints and sets."""
    arm, repeat = lcd_arm(), 3 if quick else 10
    print("\nCost of the fast path, ms (least time; compiled before)")
    for seconds in (10, 20, 40):
        time = ours(arm, seconds_of_stroke(arm, seconds), repeat)
        print(f"  {seconds:3d} s of the paper's arm    {1e3 * time:9.1f}")
    for sets in (1, 8) if quick else (1, 8, 64):
        time = ours(draws(arm, sets), seconds_of_stroke(arm), 3)
        print(f"  10 s, {sets:3d} sets             {1e3 * time:9.1f}   {1e3 * time / sets:8.1f} a set")
    for joints in (1, 3) if quick else (1, 2, 3, 4, 6):
        other = shaken_column(joints)
        print(f"  10 s, {joints} joints              {1e3 * ours(other, seconds_of_stroke(other), repeat):9.1f}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer repetitions and sizes")
    quick = parser.parse_args().quick
    jax.config.update("jax_enable_x64", True)
    print(machine())
    arm, repeat = lcd_arm(), 5 if quick else 20
    motion = seconds_of_stroke(arm)
    exact = simulate(arm, motion, method="exact", rate=RATE).vibration
    apart = error(simulate(arm, motion, rate=RATE).vibration, exact)
    step, theirs_apart, theirs = mujoco(arm, motion, apart, repeat)
    single = ours(arm, motion, repeat)
    many = 16 if quick else 64
    sets, all_cores = draws(arm, many), mujoco_on_all_cores(arm, motion, step, repeat)
    ours(sets, motion, 1)
    batch, cpu = (x / many for x in least(lambda: simulate(sets, motion, rate=RATE).vibration, 3))
    print(f"peak {np.round(1e3 * np.asarray(peak(exact)), 4)} mm; the fast path errs by {apart:.1e} of the largest")
    print(f"MuJoCo, RK4, step {1e3 * step:g} ms, errs by {theirs_apart:.1e}: {1e3 * theirs:.1f} ms for 10 s")
    print(f"ident, one run: {1e3 * single:.1f} ms, {theirs / single:.1f} times as fast")
    print(f"ident, exact equations, steps halved: {1e3 * ours(arm, motion, repeat, 'exact'):.1f} ms")
    print(f"MuJoCo, {cores()} runs at once: {1e3 * all_cores:.1f} ms a run")
    print(f"ident, {many} sets of stiffnesses: {1e3 * batch:.1f} ms a set, {all_cores / batch:.1f} times as fast")
    print(f"by CPU time: {1e3 * cpu:.1f} ms a set, {theirs / cpu:.1f} times as fast")
    if not quick:
        print(f"ident, 200 draws: {ours(draws(arm, 200), motion, 1):.1f} s")
    table(quick)
    print(machine())


if __name__ == "__main__":
    main()
