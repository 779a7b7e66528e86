"""Values of a campaign that may have been swapped, and what that would change."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations

from ident.inference.scrutiny import Moves, Pair
from ident.measure import Campaign, Measurement
from ident.measure.kinds import SHAPES

MOST = 300
"""Values up to which all pairs are looked at; of more, those of the values that are farthest off."""


def exchangeable(campaign: Campaign, far_off: Sequence[int] = ()) -> Iterator[Pair]:
    """Yield the places of values of one kind that may be taken for each other: at one posture, or of one name.

    Frequencies without a label are never so at one posture, as their order alone tells them apart. Shapes are not, as
    what is predicted of one is scaled to what was measured.

    Args:
        campaign: what was measured.
        far_off: where there are more than `MOST` values, pairs must have one of these places.
    """
    rows = campaign.measurements
    if len(rows) <= MOST:
        pairs: Iterable[Pair] = combinations(range(len(rows)), 2)
    else:
        pairs = sorted({(min(i, j), max(i, j)) for i in far_off for j in range(len(rows)) if i != j})
    for i, j in pairs:
        a, b = rows[i], rows[j]
        if a.kind == b.kind and a.kind not in SHAPES and (_state(a) == _state(b)) != (_name(a) == _name(b)):
            yield i, j


def moves_of(campaign: Campaign) -> Callable[[Pair], Moves]:
    """Return what tells which row gets the value of which other one, where two values are exchanged.

    A frequency without a label may take another place in the order of its new state, and so move others there.
    """
    rows, states = campaign.measurements, [_state(m) for m in campaign]
    ascending: dict[tuple[object, ...], list[int]] = {}
    for i in sorted(range(len(rows)), key=lambda i: rows[i].value):
        if rows[i].kind == "frequency" and not rows[i].mode:
            ascending.setdefault(states[i], []).append(i)

    def moves(pair: Pair) -> Moves:
        source = {pair[0]: pair[1], pair[1]: pair[0]}
        for state in {states[i] for i in pair}:
            own = ascending.get(state, [])
            if set(pair) & set(own):
                values = sorted((source.get(i, i) for i in own), key=lambda i: rows[i].value)
                source |= dict(zip(own, values, strict=True))
        return source

    return moves


def _state(m: Measurement) -> tuple[object, ...]:
    return m.posture, m.load, m.reference_load, m.drives


def _name(m: Measurement) -> tuple[object, ...]:
    return m.mode, m.point, m.direction, m.joint, m.reference_point, m.reference_direction
