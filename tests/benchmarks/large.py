"""What a fit of many rows costs, in how many postures: `large.py [ROWSxPOSTURES ...] [--contradict]`.

Each campaign is fitted from the shell twice, in processes of their own; the second time is the one in which nothing is
compiled. Values are those of the shipped arm with noise; postures are multiples of (1, -2, 1). With `--contradict`
deflections are 30 % too large, so that explanations are searched for.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from shell import DATA
from timing import commit, machine

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium
from ident.arm.modes import labels_of_shares, modes, torsion_share, vertical_share
from ident.description.file import read_arm
from ident.measure import Campaign, Measurement, write_campaign

SIZES = ((20, 4), (1000, 4), (5000, 4), (1000, 1000), (5000, 5000))
MODES = 4
SIGMA = {"frequency": 0.005, "deflection": 0.02}


def campaign(arm: Arm, rows: int, postures: int) -> Campaign:
    """Return so many rows, in turn from each posture, and in turn the lowest modes and the deflection."""
    alpha = np.linspace(0.0, 80.0, postures) if postures > 1 else np.zeros(1)
    q = np.deg2rad(np.stack([alpha, -2 * alpha, alpha]))
    hertz, torsion, vertical, down = (np.asarray(x) for x in _exact(arm, jnp.asarray(q)))
    noise, measured = np.random.default_rng(rows + postures).standard_normal(rows), []
    for i, z in enumerate(noise.tolist()):
        state, which = i % postures, (i // postures if postures < rows else i) % (MODES + 1)
        kind = "frequency" if which < MODES else "deflection"
        value = float(hertz[which, state] if which < MODES else down[state]) * (1 + SIGMA[kind] * z)
        names = labels_of_shares(torsion[:, state], vertical[:, state])
        more = {"mode": str(names[which])} if which < MODES else {"point": "tip"}
        at = tuple(q[:, state].tolist())
        measured.append(Measurement(kind=kind, posture=at, value=value, sigma=SIGMA[kind] * value, **more))
    return Campaign(measurements=tuple(measured))


@jax.jit
def _exact(arm: Arm, q: jax.Array) -> tuple[jax.Array, ...]:
    chain = at_posture(arm, q)
    found = modes(chain, MODES)
    return found.frequency, torsion_share(found), vertical_share(found), -deflection(chain, equilibrium(chain))[2, -1]


def fitted(path: Path) -> tuple[float, float, float]:
    """Return the time [s], the time of all cores [s] and the largest memory [MB] of one fit from the shell."""
    start, arm = time.perf_counter(), str(DATA / "arm.toml")
    command = [sys.executable, "-m", "ident", "fit", str(path), "--arm", arm, "--out", str(path.parent / "out")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"the fit of {path.name} failed")
    return time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def contradicting(right: Campaign) -> Campaign:
    """Return a campaign whose deflections were read 30 % too large."""
    wrong = (replace(m, value=1.3 * m.value, sigma=1.3 * m.sigma) if m.kind == "deflection" else m for m in right)
    return Campaign(measurements=tuple(wrong))


def main() -> None:
    """Print the table of times and memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sizes", nargs="*", help="ROWSxPOSTURES")
    parser.add_argument("--contradict", action="store_true", help="deflections 30 %% too large")
    asked = parser.parse_args()
    sizes, arm = [tuple(map(int, each.split("x"))) for each in asked.sizes] or SIZES, read_arm(DATA / "arm.toml").arm
    print(f"{machine()}; {commit()}\n{'rows':>7s} {'postures':>9s} {'time':>8s} {'of all cores':>13s} {'memory':>8s}")
    with tempfile.TemporaryDirectory() as folder:
        for rows, postures in sizes:
            path = Path(folder) / f"c{rows}x{postures}.csv"
            right = campaign(arm, rows, postures)
            write_campaign(contradicting(right) if asked.contradict else right, path, relative_sigma=True)
            fitted(path)
            wall, cores, memory = fitted(path)
            print(f"{rows:7d} {postures:9d} {wall:6.1f} s {cores:11.1f} s {memory:5.0f} MB", flush=True)


if __name__ == "__main__":
    main()
