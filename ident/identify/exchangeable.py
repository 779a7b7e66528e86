"""Values of a campaign that may have been swapped, and the effect of a swap."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations

from ident.inference.scrutiny import Moves, Pair
from ident.measure import Campaign, Measurement
from ident.measure.kinds import SHAPES
from ident.text import by_key

MOST = 300
"""Most values for which all pairs are examined; of more, only pairs with one of the worst outliers."""


def exchangeable(campaign: Campaign, far_off: Sequence[int] = ()) -> Iterator[Pair]:
    """Yield the indices of values of one kind that may be swapped: at one posture, or with one name.

    Frequencies without a label at one posture are excluded, as only their order distinguishes them. So are shapes, as
    their predictions are scaled to the measured ones.

    Args:
        campaign: the measurements.
        far_off: for more than `MOST` values, pairs must have one of these indices.
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
    """Return the function from a swapped pair to the moves of values between rows.

    A frequency without a label may get another order number in its new state, and so move others there.
    """
    rows, states = campaign.measurements, [_state(m) for m in campaign]
    unnamed = [i for i, m in enumerate(rows) if m.kind == "frequency" and not m.mode]
    ascending = by_key((states[i], i) for i in sorted(unnamed, key=lambda i: rows[i].value))

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
