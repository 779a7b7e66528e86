"""Traces of the paper's moving arm with a peak near 9.5 Hz of which it is known what makes it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
from arms import lcd_arm
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.fields import names_of
from ident.arm.multibody import IMBALANCE, possible_orders
from ident.arm.parts import Drive, ErrorOrder
from ident.vibrate.motion import stroke
from ident.vibrate.source_causes import CAUSES, WIDTH, Band, Causes, compared
from ident.vibrate.source_identification import Point
from ident.vibrate.source_problem import Channel, Place, Prior, SourceProblem, Whitening, slow_columns
from ident.vibrate.unit_response import Response, Run, Sensor, path_of, unit_response

PEAK, RATE = 9.5, 60.0
SPEEDS = (6.0, 15.0)
NOISE, BESIDE = 0.05, 0.15
"""Noise by each trace's peak; and imbalance and error by the cause, where they are none, rms in the band."""
SENSORS = (Sensor("tip", (0.0, 1.0, 0.0)), Sensor("tip", (0.0, 0.0, 1.0)))
TEETH = {"belt1": 12.0}
MESH = {"drive1": 12.0 * 160 / 161, "drive2": 6.0}
"""Orders of the belt's teeth, whose driven pulley is half as large; the driver turns by 160 q on the link below it."""


@cache
def toothed(seed: int | None = None) -> Arm:
    """The paper's arm whose first belt excites as its teeth mesh, its stiffnesses 1.5 % off by a seed."""
    arm, drives = lcd_arm(), []
    for drive in arm.drives:
        numbers = {name: getattr(drive, name) for name in names_of("Drive")}
        orders = (ErrorOrder(drive.name, MESH[drive.name]),) if drive.name in MESH else ()
        drives.append(Drive(drive.name, drive.joint, errors=orders, **numbers))
    arm = replace(arm, drives=tuple(drives))
    rng, off = np.random.default_rng(seed or 0), 0.0 if seed is None else 0.015
    return arm.replace({p: float(arm.get(p)) * np.exp(off * rng.standard_normal()) for p in stiffness_paths(arm)})


class Remembered(SourceProblem):
    """A problem that computes the responses of an arm and a run once, however many problems have them."""

    known: ClassVar[dict[tuple[Any, ...], tuple[Run, Response]]] = {}

    def responses(self, place: Place) -> list[Response]:
        """Return what the sensors see of unit sources, run by run."""
        return [self.remembered(run, place.changes) for run in self.runs]

    def remembered(self, run: Run, changes: np.ndarray) -> Response:
        """Return it of one run, whose motion stays the same object."""
        key = id(run.motion), self.sources, changes.tobytes()
        if key not in self.known:
            numbers = self.prior.numbers(self.arm, changes)
            self.known[key] = run, unit_response(self.arm.replace(numbers), run, self.sources)
        return self.known[key][1]


@cache
def response(speed: float, profile: str | None, seed: int | None) -> Response:
    """What the sensors see of each unit source in a run."""
    arm = toothed(seed)
    run = Run(f"{speed:g} %", stroke(arm.stroke, percent=speed, profile=profile, dwell=2.0), None, SENSORS)
    return unit_response(arm, run, possible_orders(arm))


def problem(
    kind: str,
    seed: int,
    *,
    speeds: Sequence[float] = SPEEDS,
    profile: str | None = None,
    window: tuple[float, float] = (0.2, np.inf),
    off: bool = False,
) -> SourceProblem:
    """Runs in which one cause makes most of the band about the peak, imbalance and transmission error a little.

    Args:
        kind: the cause.
        seed: of phases, amplitudes, frequencies and noise.
        speeds: of the runs [%].
        profile: of the stroke.
        window: of each trace [s], 0.2 s before the end at most.
        off: whether stiffnesses are 1.5 % off.
    """
    rng = np.random.default_rng([seed, CAUSES.index(kind)])
    runs = [response(speed, profile, seed if off else None) for speed in speeds]
    times = [np.arange(window[0], min(window[1], float(run.time[-1]) - 0.2), 1 / RATE) for run in runs]
    orders = possible_orders(toothed())
    kinds = np.array(["imbalance" if e.kind == IMBALANCE else "error" if e.order == 2 else "mesh" for e in orders])
    sizes, phases = 10 ** rng.uniform(-0.3, 0.3, len(orders)), rng.uniform(-np.pi, np.pi, len(orders))
    unit = sizes[:, None] * np.stack([np.cos(phases), np.sin(phases)], 1)

    def seen(parts: np.ndarray, sure: float) -> list[np.ndarray]:
        weights = np.append(sure, parts.ravel())
        pairs = list(zip(runs, times, strict=True))
        return [run.along(s, time) @ weights for run, time in pairs for s in range(len(SENSORS))]

    parts = np.zeros_like(unit)
    for name in dict.fromkeys(("imbalance", "error", *(("mesh",) if kind == "mesh" else ()))):
        alone = np.where((kinds == name)[:, None], unit, 0.0)
        parts += alone / in_band(seen(alone, 0.0)) * (1.0 if name == kind else BESIDE) * 1e-4
    values = seen(parts, 1.0)
    frequency, damping = frequency_of(kind, seed), 10 ** rng.uniform(-2.5, -2)
    if kind == "line":
        every = [time for time in times for _ in SENSORS]
        lines = [np.cos(2 * np.pi * frequency * time + rng.uniform(-np.pi, np.pi)) for time in every]
        values = [own + 1e-4 * line / in_band(lines) for own, line in zip(values, lines, strict=True)]
    if kind == "finger":
        for r, (run, time) in enumerate(zip(runs, times, strict=True)):
            path = path_of(toothed(seed if off else None), run.run, "tip")
            values[r * len(SENSORS) + 1] += 1.5 * swing(run, path, parts, time, frequency, damping)
    channels = []
    for k, own in enumerate(values):
        noisy = own + NOISE * np.abs(own).max() * rng.standard_normal(len(own))
        r, s = divmod(k, len(SENSORS))
        channels.append(Channel(f"{speeds[r]:g} % {'yz'[s]}", r, s, times[r], noisy))
    known = lcd_arm()
    prior, sources = Prior.of(known, {}), tuple(possible_orders(known))
    return Remembered(known, tuple(run.run for run in runs), (0,) * len(runs), tuple(channels), sources, prior, 0.05)


def frequency_of(kind: str, seed: int) -> float:
    """The frequency [Hz] of a line or a finger."""
    return PEAK * float(np.random.default_rng([seed, CAUSES.index(kind), 1]).uniform(0.95, 1.05))


def in_band(traces: Sequence[np.ndarray]) -> float:
    """Root mean square of traces in the band about the peak."""
    parts = [Band(PEAK, WIDTH * PEAK, RATE)(trace) for trace in traces]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def swing(
    run: Response, path: np.ndarray, parts: np.ndarray, times: np.ndarray, frequency: float, damping: float
) -> np.ndarray:
    """A light vertical oscillator on the tip, by an integrator."""
    up = make_interp_spline(run.time, path[2] + run.moved["tip"][2] @ np.append(1.0, parts.ravel()), k=5)
    pushed, omega = up.derivative(2)(run.time), 2 * np.pi * frequency

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -2 * damping * omega * y[1] - omega**2 * y[0] - float(np.interp(t, run.time, pushed))]

    solution = solve_ivp(rate, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-6, atol=1e-12, max_step=0.02)
    return solution.y[0]


def causes(
    posed: SourceProblem, *, further: Mapping[float, Run] | None = None, teeth: Mapping | None = TEETH
) -> Causes:
    """What is told of the peak, with the arm as it is but for its sources, which are fitted."""
    whitenings = [Whitening(slow_columns(channel), np.ones(1)) for channel in posed.channels]
    place = Point(posed, posed.start, posed.responses(posed.start), whitenings).fitted()[0].place
    sd = [np.full(place.changes.size, 0.005), np.tile([1e-3, 1e-5], len(posed.runs)), np.full(place.tilt.size, 0.01)]
    sd = np.concatenate([*sd, np.ones(place.factors.size + place.parts.size)])
    return compared(posed, place, np.diag(sd**2), PEAK, teeth=teeth, further=further)
