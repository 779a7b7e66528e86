"""Motions that a controller can be set to: speed, acceleration or ramp time, jerk or jerk time, as its knobs allow.

A ramp of constant acceleration that lasts n periods of an undamped mode leaves nothing of it; with a jerk time w the
acceleration is that of a ramp averaged over w, which leaves nothing of a mode of period w either: of a step of speed
|sin(pi f T) / (pi f T)| |sin(pi f w) / (pi f w)| remains. So one ramp and one jerk time cancel two modes. What a knob
scales decides: an override stretches time, so accelerations fall with its square and ramps last longer; a programmed
speed leaves the acceleration alone, and its ramp gets shorter.

References:
    Meckl and Seering, "Minimizing residual vibration for point-to-point motion", ASME J. Vib. Acoust. 107, 1985.
    Biagiotti, Melchiorri, "Trajectory Planning for Automatic Machines and Robots", 2008, section 4.5 (averaged ramps).
"""

from collections.abc import Iterator, Mapping
from itertools import product
from math import ceil, radians
from typing import Any

from ident.arm.parts import Stroke
from ident.description.schema import KnobTable
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.schedule import Path
from ident.vibrate.shaping import averaged

FACTORS = {"%": 0.01, "s": 1.0, "ms": 1e-3, "deg/s": radians(1), "deg/s^2": radians(1), "deg/s^3": radians(1)}
"""SI by unit of a knob; a percentage is of the stroke's number."""
ROUNDED = 1e-9
"""What a whole number of periods may lack by rounding."""
LONGER = 2
"""Further whole numbers of periods tried for a ramp; assumed."""
Knobs = Mapping[str, KnobTable]
"""Knobs of a controller, by what they scale."""


def typed(knob: KnobTable, value: float, full: float) -> tuple[str, float]:
    """Return the nearest number that a knob takes, in its words, and what it stands for [SI].

    Args:
        knob: of the controller.
        value: [SI] wanted.
        full: [SI] what 100 % stands for.
    """
    unit = FACTORS[knob.unit] * (full if knob.unit == "%" else 1.0)
    number = min(max(round(value / unit / knob.step) * knob.step, knob.range[0]), knob.range[1])
    return f"{knob.name} {number:.6g} {knob.unit}", number * unit


def setting(knobs: Knobs, own: Stroke, speed: float, ramp: float, jerk_time: float = 0.0) -> tuple[str, Stroke, float]:
    """Return the numbers to type, and what comes of them: a trapezoid's limits, and the jerk time [s].

    Args:
        knobs: of the controller.
        own: the stroke, whose limits are 100 %.
        speed: [rad/s] of alpha.
        ramp: [s] from rest to that speed.
        jerk_time: [s] in which the acceleration rises; 0 for a jump.
    """
    words: list[str] = []

    def turned(scales: str, value: float, full: float = 1.0) -> float:
        if scales not in knobs:
            return value
        text, value = typed(knobs[scales], value, full)
        words.append(text)
        return value

    turned("time", 1.0)
    speed = turned("speed", speed, float(own.speed))
    acceleration = turned("acceleration", speed / turned("ramp", ramp), float(own.acceleration))
    if jerk_time:
        jerk_time = acceleration / turned("jerk", acceleration / turned("jerk time", jerk_time), float(own.jerk))
    numbers: Any = {"folded": own.folded, "unfolded": own.unfolded, "jerk": 1.0}
    return ", ".join(words), Stroke([1.0], speed=speed, acceleration=acceleration, **numbers), jerk_time


def settings(
    knobs: Knobs, own: Stroke, path: Path, percent: float, periods: tuple[float, float], slower: list[float]
) -> Iterator[tuple[str, str, Motion]]:
    """Yield motions with ramps of whole periods at some speeds: name, numbers to type, and the motion of all joints.

    As many periods as the stroke's acceleration asks for or more, and for the jerk time as many as its jerk does.

    Args:
        knobs: of the controller; without one for the ramp there is none.
        own: the stroke.
        path: its path.
        percent: [%] of full speed.
        periods: [s] of the two lowest modes at the arrival.
        slower: factors of the speed; without a knob for the speed it stays.
    """
    retract = path.ends[0] == float(own.unfolded)
    jerks = (False, True) if {"jerk", "jerk time"} & set(knobs) else (False,)
    for factor in (slower if "speed" in knobs else [1.0]) if {"ramp", "acceleration"} & set(knobs) else []:
        speed = factor * percent / 100 * float(own.speed)
        least = ceil(speed / float(own.acceleration) / periods[0] - ROUNDED)
        for jerk, count in product(jerks, range(least, least + 1 + LONGER)):
            rises = jerk * max(1, ceil(speed / (count * periods[0] * periods[1] * float(own.jerk)) - ROUNDED))
            words, limits, jerk_time = setting(knobs, own, speed, count * periods[0], rises * periods[1])
            motion = stroke(limits, profile="trapezoid", retract=retract)
            name = f"ramp {count}/f1" + f", jerk {rises}/f2" * jerk + f", {factor:.0%}" * (factor < 1)
            yield name, words, path.motion(averaged(motion, jerk_time) if jerk else motion)
