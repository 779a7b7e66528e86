"""Campaigns in few sizes, and large ones in parts of one size: few programs serve all, and memory stays bounded."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Int

from ident.identify.conditions import Conditions, Unnamed, repeats

# -------- Padding


def bucket(count: int) -> int:
    """Return the next of 0, 4, 8, 16, 24, 32, 48, 64, 96, ...: few sizes, and little padding.

    For large counts padding adds at most a half, above 2048 a quarter.
    """
    if not count:
        return 0
    power = max(4, 1 << (count - 1).bit_length())
    if power > 2048:
        return -(-count // (power // 8)) * (power // 8)
    return 3 * power // 4 if power > 16 and count <= 3 * power // 4 else power


def _filled(size: int, group: np.ndarray, others: np.ndarray | None = None) -> Int[np.ndarray, "size"]:
    """Return the entries of a group, padded at the end with its first entry, or with that of others."""
    spare = group if others is None else np.concatenate([group, others])
    return np.concatenate([group, np.repeat(spare[:1], size - len(group))]).astype(int)


def padded(conditions: Conditions) -> tuple[Conditions, Int[np.ndarray, "n"], Int[np.ndarray, "D"]]:
    """Return the conditions of a padded campaign of a standard size, with one row for each value of this one.

    Its rows come by kind, so that their order is the same for all campaigns of a size.

    Returns:
        Also, for each padded row, an equal row of this campaign, and for each row of this campaign, its padded row.
    """
    conditions = jax.device_get(conditions)
    first, order = np.asarray(conditions.repeats.first), np.asarray(conditions.order)
    kinds = _kinds(conditions)
    groups = [_filled(bucket(len(kind)), kind) for kind in kinds]
    place = np.zeros(conditions.count, int)
    for kind, start in zip(kinds, np.cumsum([0, *map(len, groups)]), strict=False):
        place[kind] = start + np.arange(len(kind))
    states = np.arange(conditions.posture.shape[1])
    more = _some(conditions, groups, _filled(bucket(len(states)), states))
    return more, first[np.concatenate(groups)], place[order]


# -------- Parts

LARGE = 512
"""Largest number of states of an undivided campaign."""
PART = 128
"""Approximate number of states of a part."""
SEVERAL = 8
"""Least number of states of the first part with each kind of reading, if there are as many."""


@dataclass(frozen=True)
class Parts:
    """The conditions of a campaign in parts of one size.

    Attributes:
        conditions: of each part, with one row for each value; a kind missing in its states is borrowed from another
            part, and missing entries are repeats.
        values: (K, n) for each value of each part, the index of the campaign's value.
        places: (V,) for each value of the campaign, its index among the parts' values, one part after the other.
        labelled: number of the campaign's labelled values; they come first.
    """

    conditions: tuple[Conditions, ...]
    values: Int[np.ndarray, "K n"]
    places: Int[np.ndarray, "V"]
    labelled: int

    @property
    def labels(self) -> int:
        """Number of labelled values of each part; they come first."""
        return len(self.conditions[0].named.states)


def in_parts(conditions: Conditions) -> Parts | None:
    """Return a large campaign in parts, None for one that stays whole.

    The first part is representative: its states are drawn at random, with at least `SEVERAL` of each kind of reading.
    """
    if conditions.posture.shape[1] <= LARGE:
        return None
    conditions = jax.device_get(conditions)
    kinds, values_of = _kinds(conditions), (conditions.named, conditions.unnamed, conditions.readings)
    states = np.concatenate([np.asarray(each.states, int) for each in values_of])
    part = _dealt(conditions, states)
    own = [[kind[part[states[kind]] == k] for kind in kinds] for k in range(part.max() + 1)]
    sizes = [max(len(groups[i]) for groups in own) for i in range(len(kinds))]
    values = [[_filled(n, group, kind) for group, kind, n in zip(groups, kinds, sizes, strict=True)] for groups in own]
    used = []  # the states of values, and the reference states of differences
    for groups in values:
        references = conditions.readings.references[np.concatenate(groups[3:]) - _modal(conditions)]
        used.append(np.unique(np.concatenate([states[np.concatenate(groups)], references[references >= 0]])))
    most = max(map(len, used))
    places = np.zeros(len(states), int)
    for k, groups in enumerate(own):
        for kind, start in zip(groups, np.cumsum([0, *sizes]), strict=False):
            places[kind] = k * sum(sizes) + start + np.arange(len(kind))
    parts = tuple(_some(conditions, *each) for each in zip(values, (_filled(most, x) for x in used), strict=True))
    numbers = np.array([np.concatenate(groups) for groups in values])
    return Parts(parts, numbers, places, len(conditions.named.states))


def _kinds(conditions: Conditions) -> list[Int[np.ndarray, "_"]]:
    """Return the values of each kind: labelled frequencies, shapes, frequencies, readings by kind."""
    labels = len(conditions.named.states)
    read = labels + len(conditions.unnamed.states)
    return [
        *np.split(np.arange(read), [conditions.named.frequencies, labels]),
        *(read + own for own in conditions.readings.by_kind()),
    ]


def _dealt(conditions: Conditions, states: Int[np.ndarray, "V"]) -> Int[np.ndarray, "S"]:
    """Return the part of each state."""
    count = conditions.posture.shape[1]
    what = np.concatenate([conditions.named.places, conditions.unnamed.ordinals, conditions.readings.points])
    kind = np.zeros(len(states), int)
    for i, own in enumerate(_kinds(conditions)):
        kind[own] = i
    shuffled = np.random.default_rng(0).permutation(count)
    first: dict[int, None] = {}
    _, word, often = np.unique(np.stack([kind, what]), axis=1, return_inverse=True, return_counts=True)
    for rare in np.argsort(often, kind="stable"):
        there = np.zeros(count, bool)
        there[states[word.ravel() == rare]] = True
        first |= dict.fromkeys(shuffled[there[shuffled]][:SEVERAL].tolist())
    order = np.array(list(dict.fromkeys([*first, *shuffled.tolist()])))
    part = np.empty(count, int)
    part[order] = np.arange(count) // -(-count // -(-count // PART))
    return part


def _modal(conditions: Conditions) -> int:
    """Return the number of modal values, which come before the readings."""
    return len(conditions.named.states) + len(conditions.unnamed.states)


def _some(conditions: Conditions, groups: Sequence[Int[np.ndarray, "_"]], states: Int[np.ndarray, "_"]) -> Conditions:
    """Return the conditions of some values in some states."""
    named, unnamed, readings = conditions.named, conditions.unnamed, conditions.readings
    label, other = np.concatenate(groups[:2]), groups[2] - len(named.states)
    reading = np.concatenate(groups[3:]) - _modal(conditions)
    place = np.full(conditions.posture.shape[1], -1)
    place[states[::-1]] = np.arange(len(states))[::-1]
    frequency = np.full(named.frequencies + 1, -1)
    frequency[groups[0][::-1]] = np.arange(len(groups[0]))[::-1]
    own = readings.of(reading)
    references, rows = own.references, np.arange(sum(map(len, groups)))
    hertz = np.concatenate([groups[0], groups[2] - named.shapes])
    return Conditions(
        conditions.posture[:, states],
        jax.tree.map(lambda x: x[..., states], conditions.loads),
        replace(
            named,
            **{name: getattr(named, name)[label] for name in ("ordinals", "words", "places")},
            states=place[named.states[label]],
            largest=named.largest[:, states],
            at=frequency[named.at[:, states]],
            shapes=len(groups[1]),
        ),
        Unnamed(place[unnamed.states[other]], unnamed.ordinals[other], unnamed.last[other], unnamed.highest),
        replace(own, states=place[own.states], references=np.where(references >= 0, place[references], -1)),
        rows,
        repeats(rows, rows),
        None if conditions.definitions is None else conditions.definitions[hertz],
        None if conditions.servo is None else conditions.servo[states],
        None if conditions.shapes is None else conditions.shapes.of(groups[1] - (len(named.states) - named.shapes)),
    )
