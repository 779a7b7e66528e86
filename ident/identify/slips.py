"""Slips of the pen that a campaign may hold: a payload that was on, or off, where its rows say otherwise."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ident.arm.arm import Arm
from ident.measure import Campaign, Load, Measurement

MOST_STATES = 3
"""States (posture and load) of the values farthest off, each of which is asked about by itself."""


@dataclass(frozen=True)
class Slip:
    """A payload that may have been on, or off, in some rows.

    Attributes:
        payload: its name.
        on: whether it was on in rows that do not say so; else it was off in rows that do.
        rows: places of these rows.
        campaign: with these rows put right.
    """

    payload: str
    on: bool
    rows: tuple[int, ...]
    campaign: Campaign


def slips(arm: Arm, campaign: Campaign, farthest_off: Sequence[int]) -> Iterator[Slip]:
    """Yield all slips with payloads of whole kinds of rows, of all rows, and of the states of values that are far off.

    Args:
        arm: its payloads are those that may be on.
        campaign: what was measured.
        farthest_off: places of rows, those farthest off first.
    """
    rows = campaign.measurements
    kinds = {kind: [i for i, m in enumerate(rows) if m.kind == kind] for kind in dict.fromkeys(m.kind for m in rows)}
    states = list(dict.fromkeys((rows[i].posture, rows[i].load) for i in farthest_off))[:MOST_STATES]
    own = [[i for i, m in enumerate(rows) if (m.posture, m.load) == state] for state in states]
    seen = set()
    for payload in (payload.body.name for payload in arm.payloads):
        for among in (range(len(rows)), *kinds.values(), *own):
            for on in (True, False):
                moved = tuple(i for i in among if (payload in rows[i].load.payloads) != on)
                if moved and (payload, moved) not in seen:
                    seen.add((payload, moved))
                    changed = tuple(_with(m, payload, on) if i in moved else m for i, m in enumerate(rows))
                    yield Slip(payload, on, moved, replace(campaign, measurements=changed))


def _with(m: Measurement, payload: str, on: bool) -> Measurement:
    names = {*m.load.payloads, payload} if on else set(m.load.payloads) - {payload}
    load = m.load
    return replace(m, load=Load(tuple(names), load.masses, load.forces, load.moments, load.own))
