"""How an amplitude depends on what is swept, in a word: falls, rises, least or largest in between, hardly changed."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ident.vibrate.redesign.sweep import Axis, Sweep
from ident.vibrate.response.study import DIRECTIONS

NOTABLE = 0.05
"""Part of the largest amplitude in a range that counts as a change."""
NEAR_FACTOR, NEAR_SHARE = 1.25, 0.15
"""How far about the present value is near: a factor, or a share of the range of what is changed by a difference."""


LINES = (*DIRECTIONS, "largest")
"""Directions, and the largest of them."""


@dataclass(frozen=True)
class Trend:
    """How a curve goes.

    Attributes:
        shape: `flat`, `falls`, `rises`, `minimum`, `maximum`, or `wavy` with several of them.
        span: first and last value of what is swept.
        ends: amplitude at both [m]
        least: value and amplitude of the lowest point.
        largest: value and amplitude of the highest point.
    """

    shape: str
    span: tuple[float, float]
    ends: tuple[float, float]
    least: tuple[float, float]
    largest: tuple[float, float]


def trend(values: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"]) -> Trend:
    """Return how an amplitude goes with growing values; ups and downs below `NOTABLE` of its largest do not count."""
    turns = _turns(amplitude, NOTABLE * float(amplitude.max()))
    ups = [bool(amplitude[b] > amplitude[a]) for a, b in pairwise(turns)]
    names = {(): "flat", (True,): "rises", (False,): "falls", (False, True): "minimum", (True, False): "maximum"}

    def point(place: np.intp) -> tuple[float, float]:
        return float(values[place]), float(amplitude[place])

    span, ends = (float(values[0]), float(values[-1])), (float(amplitude[0]), float(amplitude[-1]))
    shape = names.get(tuple(ups), "wavy")
    return Trend(shape, span, ends, point(amplitude.argmin()), point(amplitude.argmax()))


def curve(sweep: Sweep) -> tuple[Float[np.ndarray, "K"], Float[np.ndarray, "4 K"]]:
    """Return the values of a sweep of one axis, and amplitudes in x, y, z and the largest of them [m].

    The present value is among them, if it lies within the range.
    """
    (axis,) = sweep.axes
    values, amplitude = axis.values, sweep.amplitude
    if has_present(axis) and not np.isclose(values, axis.present, rtol=1e-9, atol=1e-12).any():
        place = int(np.searchsorted(values, axis.present))
        values = np.insert(values, place, axis.present)
        amplitude = np.insert(amplitude, place, sweep.present, axis=1)
    return values, np.vstack([amplitude, amplitude.max(0)])


def trends(sweep: Sweep) -> Iterator[tuple[str, Trend, Trend | None]]:
    """Yield the trend of each direction and of the largest, over the whole range and about the present value."""
    (axis,) = sweep.axes
    values, amplitudes = curve(sweep)
    close = near(axis, values)
    for name, amplitude in zip(LINES, amplitudes, strict=True):
        about = trend(values[close], amplitude[close]) if close.sum() > 1 else None
        yield name, trend(values, amplitude), about


def near(axis: Axis, values: Float[np.ndarray, "K"]) -> np.ndarray:
    """Return which values are near the present one, a neighbour on either side at least; none if it is not within."""
    if not has_present(axis):
        return np.zeros(len(values), bool)
    if not axis.shifted:
        inside = np.abs(np.log(values / axis.present)) <= np.log(NEAR_FACTOR) * (1 + 1e-9)
    else:
        inside = np.abs(values - axis.present) <= NEAR_SHARE * (values[-1] - values[0]) * (1 + 1e-9)
    place = int(np.abs(values - axis.present).argmin())
    inside[max(place - 1, 0) : place + 2] = True
    return inside


def has_present(axis: Axis) -> bool:
    """Tell whether the present value lies within the range."""
    slack = 1e-9 * (axis.values[-1] - axis.values[0])
    return bool(axis.values[0] - slack <= axis.present <= axis.values[-1] + slack)


def below(values: Float[np.ndarray, "K"], amplitude: Float[np.ndarray, "K"], limit: float) -> list[tuple[float, float]]:
    """Return the ranges in which an amplitude meets a limit, straight between the values."""
    meets, ranges = amplitude <= limit, []
    for k in map(int, np.flatnonzero(meets)):
        if k == 0 or not meets[k - 1]:
            start = float(values[0]) if k == 0 else _crossing(values, amplitude, limit, k - 1)
            ranges.append([start, float(values[-1])])
        if k + 1 < len(values) and not meets[k + 1]:
            ranges[-1][1] = _crossing(values, amplitude, limit, k)
    return [(start, end) for start, end in ranges]


def _crossing(values: np.ndarray, amplitude: np.ndarray, limit: float, k: int) -> float:
    share = (limit - amplitude[k]) / (amplitude[k + 1] - amplitude[k])
    return float(values[k] + share * (values[k + 1] - values[k]))


def _turns(amplitude: np.ndarray, least: float) -> list[int]:
    """Return the places of start, turning points and end, between which it changes by at least so much."""
    turns: list[int] = []
    way = low = high = 0
    for k in range(len(amplitude)):
        low = k if amplitude[k] < amplitude[low] else low
        high = k if amplitude[k] > amplitude[high] else high
        if way != 1 and amplitude[k] - amplitude[low] >= least and k > low:
            turns.append(low)
            way, high = 1, k
        elif way != -1 and amplitude[high] - amplitude[k] >= least and k > high:
            turns.append(high)
            way, low = -1, k
    return [*turns, {0: 0, 1: high, -1: low}[way]]
