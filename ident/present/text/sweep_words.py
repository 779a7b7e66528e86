"""What is swept, and how an amplitude goes with it, put into words."""

from collections.abc import Iterator

import numpy as np

from ident.arm.fields import field_of
from ident.present.text.amplitude_words import mm
from ident.present.text.units import value_in_words
from ident.vibrate.redesign.sweep import Axis, Sweep
from ident.vibrate.redesign.trend import NOTABLE, Trend, below, curve, trends
from ident.vibrate.response.study import DIRECTIONS


def axis_in_words(axis: Axis, *, brief: bool = False) -> str:
    """Say what is swept: `joint1.k_tors, torsional stiffness of joint1`; of several numbers only the first if brief."""
    if axis.is_speed:
        return "speed, percent of full speed"
    if len(axis.paths) > 1:
        names = f"{axis.paths[0]} and {len(axis.paths) - 1} more" if brief else f"{', '.join(axis.paths)} together"
        return f"{names}, by one {'difference' if axis.shifted else 'factor'}"
    part, name, *component = axis.name.split(".")
    field = field_of(axis.name)
    if field is None or (field.words == name.replace("_", " ") and not field.rank):
        return axis.name
    return f"{axis.name}, {', '.join([f'{field.words} of {part}', *component])}"


def value_on(axis: Axis, value: float) -> str:
    """Write a value of what is swept with its unit."""
    return value_in_words(axis.paths[0], value)


def trends_in_words(sweep: Sweep) -> Iterator[str]:
    """Say how the amplitudes go, over the whole range and about the present value."""
    (axis,) = sweep.axes
    lines = {name: (whole, about) for name, whole, about in trends(sweep)}
    *each, largest = curve(sweep)[1]
    same = next((name for name, line in zip(DIRECTIONS, each, strict=True) if (line == largest).all()), "")
    for name, (whole, _) in lines.items():
        words = f"that in {same}" if same and name == "largest" else _over_range(axis, whole)
        yield f"  {name + ':':8s} {words}"
    near = {name: about for name, (_, about) in lines.items() if about and not (same and name == "largest")}
    if not near:
        yield "  the present value is outside the range"
        return
    low, high = next(iter(near.values())).span
    span = f"{low:.4g} to {value_on(axis, high)}"
    if not axis.shifted:
        span = f"{low / axis.present:.3g}x to {high / axis.present:.3g}x"
    ways = "; ".join(f"{name} {_about(axis, about)}" for name, about in near.items())
    yield f"  about the present value, {span}: {ways}"


def _over_range(axis: Axis, whole: Trend) -> str:
    least, largest = (f"{mm(size)} mm at {value_on(axis, value)}" for value, size in (whole.least, whole.largest))
    start, end = (mm(size) for size in whole.ends)
    return {
        "flat": f"is hardly changed (by less than {100 * NOTABLE:.0f} %)",
        "falls": f"falls from {start} to {end} mm",
        "rises": f"rises from {start} to {end} mm",
        "minimum": f"has a minimum, {least}",
        "maximum": f"has a maximum, {largest}",
        "wavy": f"goes up and down, from {start} to {end} mm; largest {largest}",
    }[whole.shape]


def _about(axis: Axis, about: Trend) -> str:
    return {
        "flat": "is hardly changed",
        "falls": "falls",
        "rises": "rises",
        "minimum": f"has a minimum at {value_on(axis, about.least[0])}",
        "maximum": f"has a maximum at {value_on(axis, about.largest[0])}",
        "wavy": "goes up and down",
    }[about.shape]


def kept_in_words(sweep: Sweep, limit: float) -> str:
    """Say where the largest amplitude keeps a limit [m]."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    spans = below(values, amplitudes[-1], limit)
    if not spans:
        return "kept nowhere in the range"
    if spans == [(values[0], values[-1])]:
        return "kept in the whole range"
    return f"kept {', '.join(_span(axis, values, span) for span in spans)}"


def _span(axis: Axis, values: np.ndarray, span: tuple[float, float]) -> str:
    start, end = (value_on(axis, value) for value in span)
    if span[0] == span[1]:
        return f"at {start}"
    if span[0] == values[0]:
        return f"up to {end}"
    return f"from {start} on" if span[1] == values[-1] else f"from {start} to {end}"
