"""Ramps of loads and the widths of their loops, in words."""

from collections.abc import Iterator, Sequence

import numpy as np

from ident.identify.fit import CampaignFit
from ident.identify.loops import Ramp
from ident.measure import Campaign
from ident.present.text.units import read_unit
from ident.present.text.words import cut, place_read


def loop_widths(fit: CampaignFit) -> Iterator[str]:
    """Yield for each ramp of loads how wide its loop is."""
    if not fit.loops:
        return
    yield f"{'Loops of ramps':54s}unloading - loading  of largest  rows"
    for loop in fit.loops:
        size, unit = read_unit(loop.name)
        width = f"{loop.width / size:9.3g} +- {loop.sd / size:.2g} {unit}" if np.isfinite(loop.sd) else "not told"
        share = f"{100 * abs(loop.width) / loop.largest:.2g} %" if loop.largest and np.isfinite(loop.sd) else "-"
        yield f"  {cut(place_read(loop.of), 44):44s} {width:>26s} {share:>11s} {len(loop.rows):5d}"
        yield from _one_way(fit.campaign, loop)
    yield "  Friction and play: no stiffness follows from the width; rows of both ways tell stiffness by their middle."


def ramps_told(campaign: Campaign, ramps: Sequence[Ramp]) -> Iterator[str]:
    """Yield for each ramp of loads how well the width of its loop will be told."""
    if not ramps:
        return
    yield f"{'Loops of ramps':54s}{'width known within':>18s}  rows"
    for ramp in ramps:
        size, unit = read_unit(ramp.name)
        within = f"{ramp.sd / size:.2g} {unit}" if np.isfinite(ramp.sd) else "not told"
        yield f"  {cut(place_read(ramp.of), 52):52s}{within:>18s} {len(ramp.rows):5d}"
        yield from _one_way(campaign, ramp)
    yield "  within: one sd by the data alone, at the arm file's values. `ident fit` finds the widths."


def _one_way(campaign: Campaign, ramp: Ramp) -> Iterator[str]:
    ways = {campaign.measurements[i].ramp for i in ramp.rows}
    if len(ways) == 1:
        yield f"    <-- only {ways.pop()}: its rows tell how readings change with the load, not where they begin"
