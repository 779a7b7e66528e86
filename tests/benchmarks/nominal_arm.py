"""What the paper says of its arm in motion, for assumptions that it does not state: which of them make all of it true?

    python tests/benchmarks/nominal_arm.py [--arm FILE] [--file RESULTS.jsonl] [--processes 2]

Assumed are the gear ratio, the angle of the folded arm, the profile of the speed, the eccentricity of each drive and
its phase. The rest follows: the senses of the ratios from the belts (N, 1 - N, N at radii 2 : 1 and 1 : 2), full speed
from pulleys that reach 4 and 8 Hz at 10 %. The vibration is linear in the eccentricities, so one simulation without and
two for each drive give it for all eccentricities and phases. An interrupted run goes on with `--file`.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import jax
import numpy as np
import resumable
from arms import DATA

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import modes
from ident.arm.parts import Stroke
from ident.description.file import read_arm
from ident.vibrate.fast import vibrations
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import fast_method, sample_times

RATIOS, FOLDED = (100, 120, 140, 160, 180, 200), (80, 120, 130, 136, 142, 148)
COARSE = (80, 120, 142)
NOMINAL = (160, 142, "cycloid", 1, 4.0, 1.0)
"""Ratio, folded angle [deg], profile, sense of drives 1 and 3, Hz that these reach at 10 %, factor of all damping."""
RAMPS = {"cycloid": None, "s-curve 1/2": 1 / 2, "s-curve 1/3": 1 / 3, "s-curve 1/5": 1 / 5}
"""Profiles; of an s-curve, the part of the stroke in which it speeds up, and in which it slows down."""
SLOWER_OR_FASTER = (3.75, 4.25)
"""What pulleys 1 and 3 may reach instead of 4 Hz, so that they and twice as much round to 4 and 8."""
DAMPING = (0.07, 0.75, 1.25)
"""Factors of all damping: 0.2 % and 0.02 % read as damping ratios, and the ends of their rounding."""
TEACHING, FULL, RATE, STAGE = 10.0, 100.0, 200.0, 4.0
"""Speeds [%], samples a second, and when the glass is stacked at full speed [s]."""
PATTERNS = {"equal": (1, 1, 1), "4 : 4 : 1": (1, 1, 0.25), "1 : 2 : 1": (0.5, 1, 0.5), "only drive 2": (0, 1, 0)}
SIZES, PHASES, SEED = (2e-3, 4e-3), 64, 15
"""Mass times eccentricity of drive 2 [kg m]; draws of the phases, the first of which is zero."""
TRENDS = {"joint1.k_tors": -1, "joint2.k_tors": 1, "joint3.k_tors": 1, "bracket.com.x": -1, "fingers.com.x": -1}
"""Sign of the change of the largest amplitude with each number, Figures 9 and 10."""
FACTOR, SHIFT = 1.25, {"bracket.com.x": 0.0435, "fingers.com.x": 0.18}
"""How far about its present value each is changed: a factor, or a shift [m]."""
NEAR = 0.05
"""Distance of a pulley from a natural frequency, relative to it, that counts as close."""
MOST, SETTLED = (0.5, 1.5), (0.05, 0.15)
"""What counts as the 1 mm at most and the 0.1 mm after 4 s of Figure 8 [mm]: our reading, as NEAR is."""
HEADING = "".join(f"{name:>12}" for name in ("ratio", "folded", "profile", "sense", "Hz", "damping"))
STATEMENTS = ("only pulley 2 close", "over by 4 s", "1 mm at most", "0.1 mm at 4 s", "5 trends")


def assumed(arm: Arm, ratio: float, sense: int, damping: float) -> Arm:
    """Return the arm with drives that its belts can turn."""
    ratios = (ratio + 1, -ratio, ratio + 1) if sense > 0 else (-ratio, ratio + 1, -ratio)
    damped = {f"{j.name}.{tau}": damping * getattr(j, tau) for j in arm.joints for tau in ("tau_bend", "tau_tors")}
    return arm.replace(damped | {f"drive{j}.ratio": value for j, value in enumerate(ratios, 1)})


def motion(ratio: float, folded: float, profile: str, lowest: float, *, percent: float, dwell: float) -> Motion:
    """Return the stroke on which pulleys 1 and 3 reach `lowest` [Hz] at 10 %, and pulley 2 twice as much."""
    distance, speed, ramp = np.radians(folded), 2 * np.pi * lowest / ratio / (TEACHING / FULL), RAMPS[profile]
    rise = np.inf if ramp is None else ramp * distance / speed / (1 - ramp)
    limits = {"speed": speed, "acceleration": 2.01 * speed / rise, "jerk": 4.01 * speed / rise**2}
    if ramp is None:
        limits = {"speed": speed, "acceleration": 1e3, "jerk": 1e6}
    path = Stroke([1, -2, 1], folded=distance, unfolded=0.0, **limits)
    return stroke(path, percent=percent, profile="cycloid" if ramp is None else "s-curve", dwell=dwell)


def basis(arm: Arm, move: Motion, changes: Sequence[dict[str, float]]) -> np.ndarray:
    """Return the vibration [m] of each changed arm, (3, T, changes, 7): without and for 1 kg m at 0 and 90 degrees."""
    names = [drive.name for drive in arm.drives]
    size = SIZES[-1] / float(arm.drives[0].eccentric_mass)
    rows = []
    for change in changes:
        still = {f"{name}.eccentricity": 0.0 for name in names} | {f"{name}.phase": 0.0 for name in names}
        rows.append(change | still)
        turned = product(names, (0.0, np.pi / 2))
        rows += [change | still | {f"{name}.eccentricity": size, f"{name}.phase": phase} for name, phase in turned]
    numbers = {
        path: np.array([row.get(path, float(arm.get(path))) for row in rows])
        for path in rows[-1] | dict.fromkeys(TRENDS)
    }
    found = np.asarray(vibrations(arm, numbers, fast_method(arm, move, None, False, RATE, None)))[..., 0, :]
    found = found.reshape(*found.shape[:2], len(changes), 7).copy()
    found[..., 1:] = (found[..., 1:] - found[..., :1]) / SIZES[-1]
    return found


def superposed(parts: np.ndarray, imbalance: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Return the vibration [m] (3, T, changes) with imbalances [kg m] (3,) at phases [rad] (3,)."""
    amounts = np.stack([imbalance * np.cos(phases), imbalance * np.sin(phases)], 1).ravel()
    return parts[..., 0] + parts[..., 1:] @ amounts


def changes_of(arm: Arm) -> list[dict[str, float]]:
    """Return no change, then each number of the trends a little lower and a little higher."""
    changes: list[dict[str, float]] = [{}]
    for path in TRENDS:
        present = float(arm.get(path))
        both = (present - SHIFT[path], present + SHIFT[path]) if path in SHIFT else (present / FACTOR, present * FACTOR)
        changes += [{path: value} for value in both]
    return changes


@cache
def lowest_frequencies(arm_path: str, folded: float) -> tuple[np.ndarray, np.ndarray]:
    """Return angles [rad] along the stroke and the three lowest natural frequencies there [Hz]."""
    arm, alpha = read_arm(arm_path).arm, np.linspace(0, np.radians(folded), 60)
    one = jax.jit(lambda a: modes(at_posture(arm, a * np.array([1.0, -2.0, 1.0])), 3).frequency)
    return alpha, np.stack([np.asarray(one(a)) for a in alpha], 1)


def closeness(arm_path: str, arm: Arm, move: Motion, folded: float) -> list[list[float]]:
    """Return the least distance of each pulley from the two lowest natural frequencies, relative to these (3, 2)."""
    alpha, frequencies = lowest_frequencies(arm_path, folded)
    q, qd, _ = (np.asarray(part) for part in move(sample_times(move, RATE)))
    turning = [abs(float(d.ratio)) * np.abs(qd[j]) / (2 * np.pi) for j, d in enumerate(arm.drives)]
    natural = [np.interp(q[0], alpha, f) for f in frequencies[:2]]
    return [[float(np.abs(t / f - 1).min()) for f in natural] for t in turning]


def draws() -> np.ndarray:
    """Return phases of the three drives [rad], all zero first."""
    phases = np.random.default_rng(SEED).uniform(-np.pi, np.pi, (PHASES, 3))
    phases[0] = 0.0
    return phases


def measured(
    arm_path: str, ratio: float, folded: float, profile: str, sense: int, lowest: float, damping: float
) -> dict[str, Any]:
    """Return what is seen with these assumptions: for each pattern and size (phases,) of each statement's number."""
    jax.config.update("jax_enable_x64", True)
    arm = assumed(read_arm(arm_path).arm, ratio, sense, damping)
    slow = motion(ratio, folded, profile, lowest, percent=TEACHING, dwell=0.5)
    fast = motion(ratio, folded, profile, lowest, percent=FULL, dwell=5.0)
    slow_parts, fast_parts = basis(arm, slow, changes_of(arm)), basis(arm, fast, [{}])
    time = sample_times(fast, RATE)
    late = (time >= STAGE) & (time <= STAGE + 0.5)
    found: dict[str, Any] = {"close": closeness(arm_path, arm, slow, folded), "time": float(fast.arrival)}
    for (pattern, shares), size in product(PATTERNS.items(), SIZES):
        rows = []
        for phases in draws():
            peaks = np.abs(superposed(slow_parts, size * np.array(shares), phases)).max(1)
            largest = peaks.max(0)
            trends = np.log(largest[2::2] / largest[1::2]) * np.array(list(TRENDS.values()))
            quick = np.abs(superposed(fast_parts, size * np.array(shares), phases)[..., 0])
            rows.append([*peaks[:, 0], *quick.max(1), *quick[:, late].max(1), *trends])
        found[f"{pattern}, {size:g}"] = np.round(rows, 9).tolist()
    return found


def verdicts(found: dict[str, Any], column: str) -> np.ndarray:
    """Return which statements hold, (phases, statements)."""
    rows, close = np.array(found[column]), np.array(found["close"])
    mm = 1e3 * rows[:, :9].reshape(-1, 3, 3).max(2)
    alone = (close[1] < NEAR).all() and (close[[0, 2]] >= NEAR).all()
    within = [(mm[:, k] > low) & (mm[:, k] < high) for k, (low, high) in ((1, MOST), (2, SETTLED))]
    each = [alone, found["time"] <= STAGE, *within]
    return np.stack([np.broadcast_to(e, len(rows)) for e in (*each, (rows[:, 9:] > 0).all(1))], 1)


def details(found: dict[tuple[Any, ...], Any], column: str) -> None:
    """Print for each assumption how often each statement holds, over the phases."""
    print(f"\nshare of phases [%] in which each statement holds; eccentricities {column} kg m")
    print(HEADING + "".join(f"{name:>21}" for name in (*STATEMENTS, "all")))
    for (_, *assumptions), one in found.items():
        holds = verdicts(one, column)
        shares = [*holds.mean(0), holds.all(1).mean()]
        print("".join(f"{part!s:>12}" for part in assumptions) + "".join(f"{100 * s:21.0f}" for s in shares))


def summary(found: dict[tuple[Any, ...], Any]) -> None:
    """Print for each assumption how often all statements hold together, by the eccentricities."""
    columns = [f"{pattern}, {size:g}" for pattern, size in product(PATTERNS, SIZES)]
    print("share of phases [%] in which all statements hold together, by eccentricities [kg m]")
    print(HEADING + "".join(f"{column:>21}" for column in columns))
    for (_, *assumptions), one in found.items():
        shares = [verdicts(one, column).all(1).mean() for column in columns]
        print("".join(f"{part!s:>12}" for part in assumptions) + "".join(f"{100 * s:21.0f}" for s in shares))


def main() -> None:
    """Simulate what is left to simulate, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", type=Path, default=DATA / "lcd_arm" / "arm.toml")
    parser.add_argument("--file", type=Path, default=None, help="results so far, JSON lines")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    arm = str(options.arm)
    ratio, folded, profile, sense, lowest, _ = NOMINAL
    wanted = [(arm, *NOMINAL)]
    wanted += [(arm, n, f, profile, sense, lowest, 1.0) for n, f in product(RATIOS, FOLDED)]
    wanted += [(arm, n, f, p, sense, lowest, 1.0) for n, f, p in product(RATIOS[1::2], COARSE, RAMPS)]
    wanted += [(arm, ratio, f, profile, -sense, lowest, 1.0) for f in FOLDED]
    wanted += [(arm, ratio, folded, profile, sense, f, 1.0) for f in SLOWER_OR_FASTER]
    wanted = list(dict.fromkeys([*wanted, *((arm, ratio, folded, profile, sense, lowest, d) for d in DAMPING)]))
    header = {"arm": read_arm(arm).sha256, "seed": SEED, "phases": PHASES}
    found = resumable.run(measured, wanted, header, options.file, options.processes)
    summary(found)
    details(found, "4 : 4 : 1, 0.004")


if __name__ == "__main__":
    main()
