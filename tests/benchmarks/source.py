"""How well `ident source` finds what excites an arm: errors, coverage, what is told, and wrong tables that are noticed.

`python tests/benchmarks/source.py [--sets 100] [--seed 0] [--wrong KIND] [--mujoco] [--resume FILE]`

Each set is an arm whose stiffnesses are 1.5 % (sd) off the file's, with the file's imbalances, transmission errors of 3
arc seconds peak to peak at order 2, random phases: three runs at 7, 10 and 13 % of full speed by the exact equations, y
and z of the tip at 200 samples a second, white noise of 5 % of each trace's peak, clocks up to 20 ms and (sd) 1e-4 off.
What is known before: the stiffnesses to 1.5 %, and the arm as its file has it.

`--wrong load` measures one run under the glass without saying so, `speed` one run 5 % faster than said, `drives` an arm
whose drives 1 and 2 are swapped: how often the verdict is NOT USABLE.

`--mujoco` moves the arm by MuJoCo's equations with the bushings' own springs instead, and gives each drive errors of 1
arc second peak to peak at orders 1 and 4, too. MuJoCo's own hinges in series would make another arm: weight bends it,
the vibration differs by 0.4 % of its peak, and identified numbers by up to two standard errors. It also prints how much
CPU time the same least squares would take there by differences, at the least: that of one residual, which is one
simulation of each run, times the evaluations that the search needs. These are, in each round, one, one for each
stiffness and damping, and two for each source, whose columns are differences, too. Springs are a callback in Python.
"""

import argparse
import time

import jax

jax.config.update("jax_enable_x64", True)

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import resumable
from scipy.interpolate import make_interp_spline
from timing import commit, machine

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.fields import names_of
from ident.arm.multibody import IMBALANCE, possible_orders
from ident.arm.parts import Drive, ErrorOrder
from ident.description.file import read_arm
from ident.identify.binding import loads_of
from ident.measure import Load
from ident.studies.cause.source_study import SourceStudy
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import simulate
from ident.vibrate.source_identification import identified
from ident.vibrate.source_problem import Channel, Prior, SourceProblem
from ident.vibrate.unit_response import Run, Sensor, unit_of

ARM = Path(__file__).parents[2] / "data" / "lcd_arm" / "arm.toml"
SPEEDS = (7.0, 10.0, 13.0)
KNOWN, ERROR = 0.015, np.deg2rad(1.5 / 3600)
SENSORS = (Sensor("tip", (0.0, 1.0, 0.0)), Sensor("tip", (0.0, 0.0, 1.0)))
SPREAD = np.random.default_rng(0).standard_normal((6, 4000))
KINDS = ("", "load", "speed", "drives")
FURTHER, SMALL = (1.0, 4.0), ERROR / 3
"""Orders and amplitude [rad] of the further errors of `--mujoco`."""


@cache
def arm(further: bool = False) -> Arm:
    """Return the shipped arm; its drives may have errors at further orders."""
    known = read_arm(ARM).arm
    return replace(known, drives=tuple(map(with_errors, known.drives))) if further else known


def with_errors(drive: Drive) -> Drive:
    """Return a drive with errors at further orders."""
    numbers = {name: getattr(drive, name) for name in names_of("Drive")}
    return Drive(drive.name, drive.joint, errors=tuple(ErrorOrder(drive.name, o) for o in FURTHER), **numbers)


def truth(rng: np.random.Generator, wrong: str, further: bool = False) -> Arm:
    """Return an arm with stiffnesses, transmission errors and phases that are drawn."""
    known = arm(further)
    numbers = {path: float(known.get(path)) * np.exp(KNOWN * rng.standard_normal()) for path in stiffness_paths(known)}
    for each in possible_orders(known):
        numbers |= {each.phase: rng.uniform(-np.pi, np.pi)} | (
            {} if each.kind == IMBALANCE else {each.amplitude: ERROR if each.order == 2 else SMALL}
        )
    if wrong == "drives":
        first, second, third = known.drives
        drives = on_joint(first, "joint2"), on_joint(second, "joint1"), third
        known = replace(known, drives=drives, belts=())
    return known.replace(numbers)


def on_joint(drive: Drive, joint: str) -> Drive:
    """Return a drive on another joint."""
    return Drive(drive.name, joint, errors=drive.errors, **{name: getattr(drive, name) for name in names_of("Drive")})


def work(number: int, seed: int, wrong: str, mujoco: bool = False) -> dict[str, Any]:
    """Identify the sources of one set."""
    rng, peer = np.random.default_rng([seed, number]), np.zeros(2)
    true, runs, channels = truth(rng, wrong, mujoco), [], []
    assert true.stroke is not None
    for r, speed in enumerate(SPEEDS):
        odd = r == 1
        load = Load.parse("glass" if wrong == "load" and odd else "")
        driven = stroke(true.stroke, percent=speed * (1.05 if wrong == "speed" and odd else 1.0), dwell=2.0)
        at, moved, took = (by_mujoco if mujoco else by_exact)(true, driven, load)
        peer += took
        runs.append(Run(f"{speed:g} %", stroke(true.stroke, percent=speed, dwell=2.0), None, SENSORS))
        curve = make_interp_spline(at, moved.T, k=5)
        times = np.arange(0.2, min(float(at[-1]), float(runs[-1].motion.breaks[-1])) - 0.2, 1 / 200)
        offset, rate = rng.uniform(-0.02, 0.02), 1e-4 * rng.standard_normal()
        values = curve(times * (1 + rate) + offset)[:, 1:]
        values += 0.05 * np.abs(values).max(0) * rng.standard_normal(values.shape)
        channels += [Channel(f"{speed:g} % {'yz'[s]}", r, s, times, values[:, s]) for s in range(2)]
    known = arm(mujoco)
    paths = stiffness_paths(known)
    draws = {path: float(known.get(path)) * np.exp(KNOWN * each) for path, each in zip(paths, SPREAD, strict=True)}
    sources, prior = tuple(possible_orders(known)), Prior.of(known, draws)
    problem = SourceProblem(known, tuple(runs), (0, 0, 0), tuple(channels), sources, prior, 0.05)
    start = time.process_time()
    found = identified(problem)
    own = time.process_time() - start
    evaluations = found.rounds * (1 + len(prior.mean) + 2 * len(sources))
    study = SourceStudy(found, (), True)
    each = []
    for k, estimate in enumerate(found.estimates):
        source = estimate.source
        size, phase = float(true.get(source.amplitude)) / unit_of(source), float(true.get(source.phase))
        parts = found.place.parts[0, k] - size * np.array([np.cos(phase), np.sin(phase)])
        chi = float(parts @ np.linalg.solve(found.covariance_of(k)[0, :, 0], parts))
        turned = float(np.degrees(np.angle(np.exp(1j * (estimate.phase[0] - phase)))))
        each.append([estimate.amplitude / size - 1, estimate.sd / size, turned, chi, estimate.told])
    numbers, sd = found.numbers(), np.sqrt(np.diag(found.covariance))
    pulls = [
        float(np.log(numbers[paths[0]] / float(true.get(paths[0]))) / sd[k])
        for k, paths in enumerate(problem.prior.groups.values())
    ]
    wide = float(found.consistency.max())
    result = {"each": each, "pulls": pulls, "doubtful": study.doubtful, "settled": found.settled, "wide": wide}
    return result | (
        {"seconds": own, "peer": (peer * evaluations).tolist(), "evaluations": evaluations} if mujoco else {}
    )


def by_exact(true: Arm, driven: Motion, load: Load) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, and the vibration of the end point (3, T) by the exact equations; no peer's times."""
    response = simulate(true, driven, method="exact", loads=loads_of(true, load), rate=250.0)
    return np.asarray(response.time), np.asarray(response.measured), np.zeros(2)


def by_mujoco(true: Arm, driven: Motion, load: Load) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the same by MuJoCo with the bushings' springs, and CPU times [s]: with hinges in series, with these."""
    from balance import EVERY, STEP  # which imports this file
    from moving_engines import MujocoMoving
    from mujoco_arm import BushedTransient, MujocoTransient, rigid_path

    def table(t: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(np.asarray(part) for part in driven(t))

    loads, end, took = loads_of(true, load), float(driven.breaks[-1]) - 2 * STEP, []
    for kind in (MujocoTransient, BushedTransient):
        start = time.process_time()
        at, tip = kind(true, table, end, loads=loads).tip(STEP, EVERY)
        took.append(time.process_time() - start)
    still = true.replace({each.amplitude: 0.0 for each in possible_orders(true) if each.of_error})
    known = simulate(true, driven, loads=loads, rate=1 / (STEP * EVERY)).quasi_static
    path = rigid_path(MujocoMoving(still), table, at)
    return at, (tip - path).T - np.asarray(known)[:, : len(at)], np.array(took)


def main() -> None:
    """Print errors, coverage and verdicts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--wrong", choices=KINDS, default="")
    parser.add_argument("--mujoco", action="store_true", help="truth by MuJoCo's equations, with further errors")
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    asked = parser.parse_args()
    print(f"{machine()}, seed {asked.seed}, commit {commit()}")
    wanted = [(number, asked.seed, asked.wrong, asked.mujoco) for number in range(asked.sets)]
    about = {"seed": asked.seed, "wrong": asked.wrong, "mujoco": asked.mujoco}
    found = list(resumable.run(work, wanted, about, asked.resume, 1).values())
    lost = sum(not f["settled"] for f in found)
    print(f"NOT USABLE {sum(f['doubtful'] or not f['settled'] for f in found)} of {len(found)}, not settled {lost}")
    table = np.array([f["each"] for f in found], float)
    for k, source in enumerate(possible_orders(arm(asked.mujoco))):
        error, sd, turned, chi, told = table[:, k].T
        worst = 100 * np.quantile(np.abs(error), 0.95), np.quantile(np.abs(turned), 0.95)
        inside = np.sum(np.abs(error) < 1.96 * sd), np.sum(chi < 5.99)
        print(
            f"{source.drive} {source.kind} {source.order:g}:"
            f" 95 % of errors below {worst[0]:.2f} % and {worst[1]:.2f} deg;"
            f" sd {100 * np.median(sd):.2f} %; amplitude inside {inside[0]}, parts {inside[1]}; told {int(told.sum())}"
        )
    pulls = np.array([f["pulls"] for f in found])
    if asked.mujoco:
        own, peer = (np.array([f[name] for f in found]) for name in ("seconds", "peer"))
        hinged, sprung = np.median(peer / own[:, None], 0)
        print(
            f"{np.median(own):.0f} CPU s a set; by MuJoCo and differences {hinged:.0f} times as many with hinges in"
            f" series, {sprung:.0f} with the bushings' springs"
        )
    print("stiffness and damping in their 95 % intervals:", (np.abs(pulls) < 1.96).sum(0).tolist())


if __name__ == "__main__":
    main()
