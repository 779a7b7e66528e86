"""How many fresh draws keep what `ident motion` promises, all of them by the exact equations.

    python tests/benchmarks/schedules.py [--limit 0.5] [--time 25] [--draws 200] [--seed 0] [--resume FILE]
    python tests/benchmarks/schedules.py --shaper "mid-mode ZVD" [--draws 200] [--seed 0] [--resume FILE]

`ident motion` takes the least vibration in that time for the worst phases, judged by 50 draws. The fresh ones, from the
fit's normal approximation to the shipped campaign, have phases of their own. A shaper is judged at full speed
(trapezoid) by 200 draws: what it leaves of the vibration after the arrival, the drives balanced; and how many fresh
draws keep the limit that nine tenths of the judging ones keep.
"""

import argparse
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
import resumable
from scipy.stats import norm
from timing import commit, machine

import ident
from ident.arm.arm import Arm
from ident.identify.values import Values
from ident.studies.cure.motion import MotionResult
from ident.studies.cure.motion_study import Candidate
from ident.vibrate.motion import Motion
from ident.vibrate.simulate import simulate

HERE = Path(__file__).parents[2] / "data" / "lcd_arm"
ABREAST, JUDGING, JUDGING_SHAPERS = 20, 50, 200
PROMISED = 0.9
"""Share of the judging draws that keep the limit by which a shaper is judged."""


@cache
def fitted() -> ident.FitResult:
    """Return the fit of the shipped campaign."""
    return ident.fit(HERE / "arm.toml", HERE / "campaign.csv", ident.FitOptions(no_explain=True))


def drawn(count: int, seed: int) -> Values:
    """Return draws of the stiffnesses."""
    fit, rng = fitted(), np.random.default_rng(seed)
    names, scale = fit.fitted.information.names, np.linalg.cholesky(fit.fitted.information.covariance)
    each = np.exp(scale @ rng.standard_normal((len(names), count)))
    values = {(name,): fit.parameters[name] * x for name, x in zip(names, each, strict=True)}
    return Values.of_arm(values, fit.fitted_arm)


@cache
def proposed(limit: float, time: float, shaper: str) -> MotionResult:
    """Return the motions, at full speed where a shaper is asked for."""
    count = JUDGING_SHAPERS if shaper else JUDGING
    options = ident.MotionOptions(limit=limit, time=time, draws=count, fresh=0)
    if shaper:
        options = replace(options, speed=100.0, profile="trapezoid", time=6.0, segments=4)
    return ident.motion(HERE / "arm.toml", options, posterior=drawn(count, 1_000_000))


def shaped(limit: float, time: float, shaper: str) -> Candidate:
    """Return the motion that a shaper makes."""
    made = {each.name: each for each in proposed(limit, time, shaper).motions.candidates if each.kind == "shaper"}
    if f"{shaper} shaper" not in made:
        sys.exit(f"no {shaper} shaper, but {', '.join(made)}")
    return made[f"{shaper} shaper"]


def peaks(arms: list[Arm], motion: Motion, dwell: float, after: bool = False) -> list[float]:
    """Return the peak of each arm's vibration [m] by the exact equations, over all of a motion or after arrival."""
    every = [simulate(arm, motion.dwell(dwell), method="exact", rate=250.0) for arm in arms]
    return [float(np.abs(each.after(motion.arrival) if after else each.vibration).max()) for each in every]


def work(first: int, limit: float, time: float, seed: int, shaper: str) -> list[Any]:
    """Return the peaks [m] of some draws; with a shaper also what it, and the motion as it is, leave after arrival."""
    study = proposed(limit, time, shaper).motions
    basis, dwell = study.basis, study.scheduling.dwell
    draws = basis.drawn(drawn(ABREAST, seed + first), seed + first)
    arms = [basis.arm.replace({path: x[k] for path, x in draws.items()}) for k in range(ABREAST)]
    if not shaper:
        return peaks(arms, study.schedule.motion, dwell)
    motion, as_it_is = shaped(limit, time, shaper).motion, study.candidates[0].motion
    balanced = [arm.replace({f"{drive.name}.eccentricity": 0.0 for drive in arm.drives}) for arm in arms]
    left = (peaks(balanced, each, dwell, after=True) for each in (motion, as_it_is))
    return list(zip(peaks(arms, motion, dwell), *left, strict=True))


def main() -> None:
    """Print how many draws keep the limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=float, default=0.5, help="[mm], not of a shaper")
    parser.add_argument("--time", type=float, default=25.0, help="[s], not of a shaper")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    parser.add_argument("--shaper", default="", help="judge this one instead, as 'mid-mode ZVD'")
    asked = parser.parse_args()
    print(f"{machine()}, seed {asked.seed}, commit {commit()}")
    about = {"limit": asked.limit, "time": asked.time, "seed": asked.seed, "shaper": asked.shaper}
    firsts = range(ABREAST, ABREAST + asked.draws, ABREAST)  # the judging draws have the phases of 0
    wanted = [(k, asked.limit, asked.time, asked.seed, asked.shaper) for k in firsts]
    found = np.concatenate(list(resumable.run(work, wanted, about, asked.resume, 1).values()))
    if asked.shaper:
        print_shaper(shaped(asked.limit, asked.time, asked.shaper), *found.T)
        return
    kept, (low, high) = int((1e3 * found <= asked.limit).sum()), 1e3 * np.quantile(found, (0.05, 0.95))
    print(f"{asked.limit:g} mm in {asked.time:g} s: kept by {kept} of {len(found)}; 5 to 95 %: {low:.3f} to {high:.3f}")


def print_shaper(judged: Candidate, largest: np.ndarray, left: np.ndarray, before: np.ndarray) -> None:
    """Print what a shaper leaves, and whether fresh draws keep what the judging ones promise."""
    share, limit = left / before, float(np.quantile(judged.peaks, PROMISED))
    low, middle, high = 100 * np.quantile(share, (0.05, 0.5, 0.95))
    print(f"{judged.name}, {judged.time:.2f} s: leaves {low:.1f} to {high:.1f} % after the arrival (5 to 95 %), median")
    print(f"{middle:.1f} %, {100 * share.max():.1f} % at most; at most 20 % in {(share <= 0.2).sum()} of {len(share)}")
    wide = np.sqrt(PROMISED * (1 - PROMISED) * (1 / len(judged.peaks) + 1 / len(largest)))
    band = len(largest) * (PROMISED + np.array([-1, 1]) * norm.ppf(0.995) * wide)
    print(f"{1e3 * limit:.3f} mm, promised by {100 * PROMISED:g} % of {len(judged.peaks)} judging draws: kept by")
    print(f"{(largest <= limit).sum()} of {len(largest)} (99 % band of both draws {band[0]:.0f} to {band[1]:.0f})")


if __name__ == "__main__":
    main()
