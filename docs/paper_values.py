"""What the model gives for the statements of the paper: `paper_table.py` puts both side by side."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import periodogram

import ident
from ident.arm.arm import Arm
from ident.vibrate.fast import vibrations
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import fast_method, sample_times, superposition

ARM = Path(__file__).parents[1] / "data" / "lcd_arm" / "arm.toml"
RATE, STACKING = 200.0, 4.0
"""Samples a second, and when the glass is stacked at full speed [s]."""
FACTOR, SHIFT = 1.25, {"bracket.com.x": 0.0435, "fingers.com.x": 0.18}
"""How far each number is changed either way: a factor, or a shift [m]."""
TORSION, CENTRES = [f"joint{j}.k_tors" for j in (1, 2, 3)], list(SHIFT)
SIMILAR, VISIBLE, DRAWS = 1.25, 0.2, 40
"""By which factor peaks may differ that are called similar; share of the highest line from which on a line is seen."""
BALANCED = {f"drive{j}.eccentricity": 0.0 for j in (1, 2, 3)}

Found = dict[str, Any]


def changed(arm: Arm) -> dict[str, dict[str, float]]:
    """Return the arms that are simulated at 10 %, by what is changed in them."""
    arms: dict[str, dict[str, float]] = {"present": {}, "balanced": BALANCED}
    for j in (1, 2, 3):
        arms[f"only drive {j}"] = {name: 0.0 for name in BALANCED if f"drive{j}" not in name}
    for path in (*TORSION, *CENTRES):
        present = float(arm.get(path))
        if path in SHIFT:
            down, up = present - SHIFT[path], present + SHIFT[path]
        else:
            down, up = present / FACTOR, present * FACTOR
        arms |= {f"{path} down": {path: down}, f"{path} up": {path: up}}
    both = {path: value for name in ("joint1.k_tors up", "fingers.com.x up") for path, value in arms[name].items()}
    return arms | {"both up": both}


def simulated(arm: Arm, motion: Motion, arms: dict[str, dict[str, float]]) -> dict[str, np.ndarray]:
    """Return how the finger end of each vibrates [mm], (3, T)."""
    paths = {path for values in arms.values() for path in values}
    numbers = {path: np.array([one.get(path, float(arm.get(path))) for one in arms.values()]) for path in paths}
    found = 1e3 * np.asarray(vibrations(arm, numbers, fast_method(arm, motion, None, False, RATE, None)))[..., 0, :]
    return {name: found[..., i] for i, name in enumerate(arms)}


def standing() -> Found:
    """Return what the arm is when it stands: Table 1 and damping."""
    result = ident.predict(ARM, ident.PredictOptions(modes=6))
    modes = {row["label"]: (row["frequency"], row["damping_ratio"]) for row in result.table()}
    return {
        "bending": modes["vertical bending 1"][0],
        "torsion": modes["lateral torsion 1"][0],
        "down": -1e3 * float(result.deflections[0]["tip"][2]),
        "damping": (modes["vertical bending 1"][1], modes["lateral torsion 1"][1]),
    }


def met() -> Found:
    """Return the natural frequencies along the stroke at 10 %, and which pulleys come near them."""
    result = ident.resonance(ARM, ident.ResonanceOptions(speed=10))
    lowest = np.asarray(result.branches.median)
    near = {(each.source.pulley, str(each.label)) for each in result.crossings if each.branch < 2}
    spans = [(each.start, each.end) for each in result.crossings]
    pulleys = {each.source.pulley for each in result.crossings}
    return {"lowest": lowest, "near": near, "spans": spans, "pulleys": pulleys}


def share(trace: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the share of the power from 1 to 20 Hz that lies in a band, by direction."""
    frequency, power = periodogram(trace, RATE, window="hann")
    whole, band = (power[:, (frequency >= a) & (frequency <= b)].sum(1) for a, b in ((1, 20), (low, high)))
    return band / whole


def spectrum_beyond(trace: np.ndarray) -> np.ndarray:
    """Return the highest line from 8.5 to 20 Hz over the highest from 3.5 to 8.5 Hz, by direction: of amplitudes."""
    frequency, power = periodogram(trace, RATE, window="hann")
    bands = ((frequency > low) & (frequency <= high) for low, high in ((3.5, 8.5), (8.5, 20.0)))
    within, beyond = (power[:, band].max(1) for band in bands)
    return np.sqrt(beyond / within)


def allowed_errors(arm: Arm) -> tuple[float, float]:
    """Return which transmission errors of all drives, peak to peak [arc s], Figures 5 to 7 allow beside the imbalance.

    The largest with which, at 10 %, the largest vibration in no direction exceeds that by imbalance alone by `SIMILAR`,
    whatever the phases; and with which no line beyond 8.5 Hz is `VISIBLE` beside the highest from 3.5 to 8.5 Hz, in the
    mean over draws of phases.
    """
    arm = arm.replace({f"{drive.name}.error": np.deg2rad(0.5 / 3600) for drive in arm.drives})
    phases = [f"{drive.name}.{end}" for end in ("phase", "error_phase") for drive in arm.drives]
    whole = superposition(arm, stroke(arm.stroke, percent=10, dwell=4.0), phases, rate=RATE, measured=True)
    size, half = np.hypot(whole.cosine, whole.sine), len(phases) // 2
    alone = np.abs(whole.sure) + size[:half].sum(0)
    errors = np.arange(0.1, 8.0, 0.1)
    peaks = np.array([(alone + error * size[half:].sum(0)).max(1) / alone.max(1) for error in errors]).max(1)
    drawn = np.random.default_rng(0).uniform(0, 2 * np.pi, (len(phases), DRAWS))

    def lines(error: float) -> float:
        turns = np.repeat([1.0, error], half)[:, None] * np.exp(1j * drawn)
        traces = np.tensordot(whole.cosine - 1j * whole.sine, turns, ((0,), (0,))).real + whole.sure[..., None]
        return float(np.mean([spectrum_beyond(traces[..., k]) for k in range(DRAWS)], 0).max())

    seen = [lines(error) for error in errors[::5]]
    return float(np.interp(SIMILAR, peaks, errors)), float(np.interp(VISIBLE, seen, errors[::5]))


def teaching() -> Found:
    """Return the vibration at 10 %."""
    arm = ident.read_arm(ARM).arm
    slow = stroke(arm.stroke, percent=10, dwell=4.0)
    traces = simulated(arm, slow, changed(arm))
    ratios, times = np.array([[float(drive.ratio)] for drive in arm.drives]), sample_times(slow, RATE)
    turns = np.abs(ratios * np.asarray(slow(times)[1]))
    return {
        "peak": {name: np.abs(trace).max(1) for name, trace in traces.items()},
        "when": times[np.abs(traces["present"][1]).argmax()],
        "turns": turns.max(1) / (2 * np.pi),
        "band": share(traces["present"], 3.5, 8.5),
        "near 9.5": share(traces["present"], 9.0, 10.0),
    }


def normal() -> Found:
    """Return the vibration at full speed."""
    arm = ident.read_arm(ARM).arm
    full = stroke(arm.stroke, percent=100, dwell=STACKING)
    traces = simulated(arm, full, {"present": {}, "balanced": BALANCED})
    time = sample_times(full, RATE)
    stacked = (time >= STACKING) & (time <= STACKING + 0.5)
    return {
        "full": np.abs(traces["present"]).max(1),
        "full balanced": np.abs(traces["balanced"]).max(1),
        "stacked": np.abs(traces["present"][:, stacked]).max(1),
        "stacked balanced": np.abs(traces["balanced"][:, stacked]).max(1),
        "arrival": float(full.arrival),
    }


def errors() -> Found:
    """Return which transmission errors the figures allow, of the shipped arm and of the first guess."""
    arms = (ident.read_arm(path).arm for path in (ARM, ARM.with_name("first_guess.toml")))
    return {"errors": tuple(map(allowed_errors, arms))}


class Computed(dict[str, Any]):
    """What the rows are about, each part computed when one of its values is first asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.parts = iter((standing, met, teaching, normal, errors))

    def __missing__(self, name: str) -> Any:
        """Compute one part after the other, until one has the value."""
        for part in self.parts:
            self.update(part())
            if name in self:
                return self[name]
        raise KeyError(name)


def compute() -> Found:
    """Return all that the rows are about."""
    return Computed()
