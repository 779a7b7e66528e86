"""Hits of a hammer in a record of the force: where each begins, and which are double, overloaded or cut off."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

PULSE = 0.1
"""Share of the largest force of a record beyond which it counts as a pulse."""
REBOUND = 0.05
"""Share of a hit's own peak which a second pulse must reach to make a double hit."""
NOISE = 8.0
"""Standard deviations of the noise which a pulse must exceed."""
FLAT = 3
"""Equal samples in a row at its largest number by which a channel shows that it was overloaded."""
STEPS = 50
"""Different numbers that a channel must have for a flat top to mean anything: else it is coarse, not overloaded."""
FULL = 0.999
"""Share of full scale that counts as overload."""


@dataclass(frozen=True)
class Hit:
    """A pulse of the force.

    Attributes:
        block: number of the block that it is in.
        begin: first sample of the pulse.
        end: first sample after it.
        until: first sample of the record after it that is another hit's, or the block's length.
        flaw: why it does not count; empty where it does.
    """

    block: int
    begin: int
    end: int
    until: int
    flaw: str = ""


def find_hits(force: np.ndarray, step: float, rest: float) -> list[Hit]:
    """Find the hits in blocks of the force.

    A block that was triggered holds one hit: further pulses in it make it a double one. A single block holds all hits
    of a record: pulses closer than `rest` to the one before belong to its hit.

    Args:
        force: (B, T) [N]
        step: [s] between samples.
        rest: [s] between hits, at least.

    Returns:
        The hits in order, those that are double with their flaw.
    """
    if len(force) == 1:
        return list(_of_record(force[0], step, rest))
    level = PULSE * np.median(np.abs(force).max(1))
    return [_of_block(number, block, level) for number, block in enumerate(force)]


def _of_block(number: int, force: np.ndarray, level: float) -> Hit:
    peak = float(np.abs(force).max())
    noise = NOISE * _noise(force)
    if peak <= max(level, noise) or not _stands_out(force):
        return Hit(number, 0, 0, len(force), "no pulse of the force")
    weak = max(REBOUND * peak, noise)
    pulses = _distinct(force, _pulses(force, weak), weak)
    return Hit(number, pulses[0][0], pulses[0][1], len(force), _double(force, pulses))


def _of_record(force: np.ndarray, step: float, rest: float) -> Iterator[Hit]:
    level = max(PULSE * float(np.abs(force).max()), NOISE * _noise(force))
    groups: list[list[tuple[int, int]]] = []
    for pulse in _pulses(force, level) if _stands_out(force) else ():
        if groups and (pulse[0] - groups[-1][-1][1]) * step < rest:
            groups[-1].append(pulse)
        else:
            groups.append([pulse])
    if not groups:
        return
    starts = [group[0][0] for group in groups]
    for group, until in zip(groups, [*starts[1:], len(force)], strict=True):
        begin = group[0][0]
        near = force[begin : min(until, begin + math.ceil(rest / step))]
        weak = max(REBOUND * float(np.abs(near).max()), NOISE * _noise(force))
        pulses = _distinct(near, _pulses(near, weak), weak)
        yield Hit(0, begin + pulses[0][0], begin + pulses[0][1], until, _double(near, pulses))


def _stands_out(force: np.ndarray) -> bool:
    """Tell whether anything rises above the noise about the force's median: a constant offset is no pulse."""
    return bool(np.abs(force - np.median(force)).max() > NOISE * _noise(force))


def _pulses(force: np.ndarray, level: float) -> list[tuple[int, int]]:
    """Return begin and end of each stretch in which the force exceeds a level."""
    beyond = np.concatenate([[False], np.abs(force) > level, [False]])
    edges = np.flatnonzero(np.diff(beyond.astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _distinct(force: np.ndarray, pulses: list[tuple[int, int]], level: float) -> list[tuple[int, int]]:
    """Return the pulses that push as the largest one does: filters ring to the other side, a hammer cannot pull."""
    sign = np.sign(force[np.argmax(np.abs(force))])
    return [(a, b) for a, b in pulses if (sign * force[a:b]).max() > level] or pulses[:1]


def _double(force: np.ndarray, pulses: list[tuple[int, int]]) -> str:
    if len(pulses) < 2:
        return ""
    first, second = (float(np.abs(force[a:b]).max()) for a, b in pulses[:2])
    return f"a double hit: {second:.3g} N after {first:.3g} N"


def _noise(force: np.ndarray) -> float:
    """Return the standard deviation of the quiet part, by the median of deviations from the median."""
    return float(1.4826 * np.median(np.abs(force - np.median(force))))


def overload(values: np.ndarray, full_scale: float | None) -> str:
    """Say whether a channel was overloaded: it reaches full scale, or its largest number stands in a row.

    Args:
        values: (T,) [SI] of one hit.
        full_scale: [SI] of the input; None where it is not known.

    Returns:
        What was seen; empty for no overload.
    """
    size = np.abs(values)
    largest = float(size.max())
    if full_scale is not None and largest >= FULL * full_scale:
        return f"{largest:.3g} of a full scale of {full_scale:.3g}"
    if len(np.unique(values[:: max(len(values) // 2000, 1)])) < STEPS:
        return ""
    at_top = size >= largest * (1 - 1e-9)
    run = max((b - a for a, b in _runs(at_top)), default=0)
    return f"{run} equal samples in a row at its largest number, {largest:.3g}" if run >= FLAT else ""


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
