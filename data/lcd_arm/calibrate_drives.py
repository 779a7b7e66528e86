"""Calibrates drives and stroke of arm.toml: what the paper says of its arm in motion comes out of the simulation.

    python data/lcd_arm/calibrate_drives.py            write the calibrated numbers into arm.toml
    python data/lcd_arm/calibrate_drives.py --check    exit 0 if all statements come out, 1 if not

Chosen are a ratio from catalogues of harmonic drives, a folded angle at which the glass lies over the column, and a
cycloid; `tests/benchmarks/nominal_arm.py` shows what other choices give. The other numbers follow: the senses of the
ratios from belts that can run, the speed from a pulley 2 that reaches 8 Hz at 10 %, and the eccentricities, that of the
small joint 3 a quarter of the others, from a vibration of 0.1 mm when the glass is stacked (to a millimetre).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
from scipy.optimize import brentq

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import natural_frequencies
from ident.arm.plausibility import belt_mismatches
from ident.description.file import parse_arm, update_file
from ident.vibrate.fast import vibrations
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import fast_method, sample_times

ARM = Path(__file__).with_name("arm.toml")
RATIO, FOLDED, PROPORTION = 160, 142.0, (1.0, 1.0, 0.25)
"""The ratio of all drives, the folded angle [deg], and the eccentricities against one another."""
TEACHING, FULL, RATE = 10.0, 100.0, 200.0
"""Speeds [%] and samples a second."""
HIGHEST, STACKING, STACKED = 8.0, 4.0, 1e-4
"""Frequency of pulley 2 at 10 % [Hz]; when the glass is stacked at full speed [s], and how it vibrates then [m]."""
TRENDS = {"joint1.k_tors": -1, "joint2.k_tors": 1, "joint3.k_tors": 1, "bracket.com.x": -1, "fingers.com.x": -1}
"""Sign of the change of the largest amplitude with each number, Figures 9 and 10."""
FACTOR, SHIFT = 1.25, {"bracket.com.x": 0.0435, "fingers.com.x": 0.18}
"""How far about its present value each is changed: a factor, or a shift [m]."""
APART = 0.1
"""Distance from a natural frequency, relative to it, beyond which a pulley is not close."""


def vibration(arm: Arm, motion: Motion, numbers: dict[str, np.ndarray]) -> np.ndarray:
    """Return how the finger end vibrates [m] with each of some numbers of the arm, (3, T, numbers)."""
    return np.asarray(vibrations(arm, numbers, fast_method(arm, motion, None, False, RATE, None)))[..., 0, :]


def stacked(arm: Arm, eccentricity: float) -> float:
    """Return the largest vibration [m] in the half second from when the glass is stacked, at full speed."""
    motion = stroke(arm.stroke, percent=FULL, dwell=STACKING)
    numbers = {f"drive{j}.eccentricity": np.array([eccentricity * p]) for j, p in enumerate(PROPORTION, 1)}
    time = sample_times(motion, RATE)
    then = (time >= STACKING) & (time <= STACKING + 0.5)
    return float(np.abs(vibration(arm, motion, numbers)[:, then]).max())


def calibrate(text: str) -> str:
    """Return the arm file's text with calibrated drives and stroke; the same text if it is calibrated already."""
    arm = parse_arm(text)
    values = {f"drive{j}.ratio": float(n) for j, n in enumerate((RATIO + 1, -RATIO, RATIO + 1), 1)}
    values |= {"stroke.folded": np.radians(FOLDED), "stroke.speed": 2 * np.pi * HIGHEST / (2 * RATIO) * FULL / TEACHING}
    arm = arm.replace(values)
    size = 1e-3 * round(brentq(lambda mm: stacked(arm, 1e-3 * mm) - STACKED, 2.0, 20.0, xtol=1e-3))
    values |= {f"drive{j}.eccentricity": size * share for j, share in enumerate(PROPORTION, 1)}
    new = {path: value for path, value in values.items() if not np.isclose(float(parse_arm(text).get(path)), value)}
    return update_file(text, new, origin="calibrated") if new else text


def statements(arm: Arm) -> Iterator[tuple[str, str, bool]]:
    """Yield what the paper says, what the arm does, and whether that is so."""
    slow, full = stroke(arm.stroke, percent=TEACHING, dwell=0.5), stroke(arm.stroke, percent=FULL, dwell=STACKING)
    yield from _pulleys(arm, slow)
    longest = max((each.stretch for each in belt_mismatches(_stiff(arm))), default=0.0)
    yield "belts can run", f"stretch {1e3 * longest:.2g} mm", longest < 1e-9
    time = sample_times(full, RATE)
    found = np.abs(vibration(arm, full, {"joint1.k_tors": np.array([float(arm.get("joint1.k_tors"))])}))[..., 0]
    peak, late = 1e3 * found.max(), 1e3 * found[:, (time >= STACKING) & (time <= STACKING + 0.5)].max()
    yield "Figure 8: over before the glass is stacked at 4 s", f"{full.arrival:.2f} s", full.arrival < STACKING
    yield "Figure 8: about 1 mm at most", f"{peak:.2f} mm", 0.5 < peak < 1.5
    yield "Figure 8: about 0.1 mm when the glass is stacked", f"{late:.3f} mm", 0.05 < late < 0.15
    yield from _trends(arm, slow)


def _pulleys(arm: Arm, motion: Motion) -> Iterator[tuple[str, str, bool]]:
    q, qd, _ = (np.asarray(part) for part in motion(sample_times(motion, RATE)))
    turning = np.abs([float(drive.ratio) for drive in arm.drives])[:, None] * np.abs(qd) / (2 * np.pi)
    highest = turning.max(1)
    yield "4 to 8 Hz at 10 %", " ".join(f"{f:.2f}" for f in highest), np.round(highest).tolist() == [4, 8, 4]
    nodes = np.linspace(0.0, float(arm.stroke.folded), 60)
    lowest = jax.jit(lambda alpha: natural_frequencies(at_posture(arm, alpha * arm.stroke.direction), 2))
    frequencies = np.array([np.interp(q[0], nodes, f) for f in np.array([lowest(alpha) for alpha in nodes]).T])
    apart = np.abs(turning[:, None] / frequencies - 1).min(2)
    yield "Figure 4: pulley 2 meets the two lowest modes", f"within {apart[1].max():.2%}", bool(apart[1].max() < 0.01)
    others = apart[[0, 2]].min()
    yield "Figure 4: and no other pulley comes close", f"{others:.0%} apart", bool(others > APART)


def _trends(arm: Arm, motion: Motion) -> Iterator[tuple[str, str, bool]]:
    rows = []
    for path in TRENDS:
        present = float(arm.get(path))
        both = (present - SHIFT[path], present + SHIFT[path]) if path in SHIFT else (present / FACTOR, present * FACTOR)
        rows += [{path: value} for value in both]
    numbers = {path: np.array([row.get(path, float(arm.get(path))) for row in rows]) for path in TRENDS}
    largest = 1e3 * np.abs(vibration(arm, motion, numbers)).max((0, 1)).reshape(-1, 2)
    for (path, sign), (low, high) in zip(TRENDS.items(), largest, strict=True):
        what = f"Figures 9, 10: amplitude {'rises' if sign > 0 else 'falls'} with {path}"
        yield what, f"{low:.3f} to {high:.3f} mm", bool((high - low) * sign > 0)


def _stiff(arm: Arm) -> Arm:
    return arm.replace({f"{belt.name}.stiffness": 1e15 for belt in arm.belts})


def main(check: bool) -> int:
    """Calibrate the file, or check what it gives; return the exit code."""
    text = ARM.read_text(encoding="utf-8")
    after = text if check else calibrate(text)
    ARM.write_text(after, encoding="utf-8")
    every = list(statements(parse_arm(after)))
    for what, found, holds in every:
        print(f"{what:52}{found:>20}  {'yes' if holds else 'NO'}")
    return 0 if all(holds for _, _, holds in every) else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main(check="--check" in sys.argv[1:]))
