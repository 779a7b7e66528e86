"""Synthetic traces of the paper's moving arm of which it is known what makes them vibrate."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from arms import lcd_arm

from ident.arm.arm import Arm
from ident.vibrate.motion import Motion, MovingTrace, stroke
from ident.vibrate.simulate import Superposition, superposition
from ident.vibrate.triage import Finding, Triage

RATE, DWELL, ARCSEC = 200.0, 8.0, np.pi / 180 / 3600
TRUTHS = (("drive",), ("mode",), ("line",), ("drive", "line"), ("mode", "line"), ("drive", "mode"))
SLOW = tuple((percent, retract, "cycloid") for percent in (7.0, 10.0, 13.0) for retract in (False, True))
FAST = tuple((percent, retract, "trapezoid") for percent in (20.0, 35.0, 50.0) for retract in (False, True))
SOURCES = {
    "drive1.phase": ("drive1", 1),
    "drive2.phase": ("drive2", 1),
    "drive3.phase": ("drive1", 1),
    "drive1.error_phase": ("drive2", 1),
    "drive2.error_phase": ("drive2", 2),
    "drive3.error_phase": ("drive2", 1),
}
"""What each imbalance and transmission error is told as: one of the group of all that turn as fast."""
LOW = 2.0
"""Frequency [Hz] above which the arm vibrates, rather than follows its command."""


@dataclass(frozen=True)
class Case:
    """A trace, the arm as it is known, and what makes the trace: kinds, or a (drive, order) of its group."""

    arm: Arm
    trace: MovingTrace
    truth: frozenset
    about: str


@cache
def columns(percent: float, retract: bool, profile: str) -> tuple[Motion, Superposition]:
    """The vibration by each imbalance, by transmission errors of one arc second, and by the motion itself."""
    arm = lcd_arm().replace({f"{drive.name}.error": ARCSEC for drive in lcd_arm().drives})
    motion = stroke(arm.stroke, percent=percent, profile=profile, retract=retract, dwell=DWELL)
    return motion, superposition(arm, motion, list(SOURCES), rate=RATE, measured=True)


def case(number: int, seed: int = 0) -> Case:
    """Return one of many cases: six kinds of truth in turn, all else by chance."""
    rng = np.random.default_rng([seed, number])
    truth = TRUTHS[number % len(TRUTHS)]
    motions = FAST[: 2 if "drive" in truth else None] if "mode" in truth else SLOW
    run, direction = motions[rng.integers(len(motions))], int(rng.integers(1, 3))
    motion, whole = columns(*run)
    values, causes = whole.sure[direction], {kind for kind in truth if kind != "drive"}
    if "drive" in truth:
        source = list(SOURCES)[rng.integers(1, len(SOURCES))]  # drive 1's imbalance hardly moves the tip
        k, phase = whole.unknown.index(source), rng.uniform(0, 2 * np.pi)
        caused = whole.cosine[k, direction] * np.cos(phase) + whole.sine[k, direction] * np.sin(phase)
        causes.add(SOURCES[source])
        if "mode" in truth:
            values = values + caused * vibration(values) / vibration(caused) * 10 ** rng.uniform(-0.2, 0.2)
        else:
            values = values + caused * np.abs(values).max() / np.abs(caused).max() * 10 ** rng.uniform(0.5, 1.5)
    if "line" in truth:
        frequency = (9.5, 12.5, rng.uniform(5, 25))[rng.integers(3)]
        size = np.sqrt(2) * vibration(values) * 10 ** rng.uniform(-0.2, 0.2)
        if len(truth) == 1:
            size = np.abs(values).max() * 10 ** rng.uniform(0.5, 1.5)
        values = values + size * np.sin(2 * np.pi * frequency * whole.time + rng.uniform(0, 2 * np.pi))
    values = values + 0.05 * np.abs(values).max() * rng.normal(size=len(values))
    time = whole.time + rng.uniform(-0.02, 0.02)
    about = f"{motion.name}, {'xyz'[direction]}"
    return Case(known(rng), MovingTrace(time, values, motion), frozenset(causes), about)


def known(rng: np.random.Generator) -> Arm:
    """The paper's arm with each stiffness 2 % off."""
    paths = [f"{joint.name}.{kind}" for joint in lcd_arm().joints for kind in ("k_bend", "k_tors")]
    return lcd_arm().replace({path: float(lcd_arm().get(path)) * (1 + 0.02 * rng.normal()) for path in paths})


def vibration(values: np.ndarray) -> float:
    """Return the rms of what is faster than the arm follows its command."""
    spectrum = np.fft.rfft(values - np.linspace(values[0], values[-1], len(values)))
    spectrum[np.fft.rfftfreq(len(values), 1 / RATE) < LOW] = 0
    return float(np.fft.irfft(spectrum, len(values)).std())


def said(finding: Finding) -> object:
    """Return what a finding is told as, as in a case's truth."""
    return finding.drives[0] if finding.kind == "drive" else finding.kind


def verdict(triage: Triage, truth: frozenset) -> str:
    """Return `right`, `cannot tell` where something true is missing and something is not told, else what is wrong."""
    told = {said(finding) for finding in triage.findings if finding.told and finding.kind != "unexplained"}
    if told == truth:
        return "right"
    if told - truth:
        return f"wrong: {', '.join(sorted(map(str, told)))} for {', '.join(sorted(map(str, truth)))}"
    return "cannot tell" if any(not finding.told for finding in triage.findings) or not told else "missed one"
