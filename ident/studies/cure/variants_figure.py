"""Variants of an arm side by side: a panel for each quantity."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from ident.report.style import BLUE, ORANGE, key_below, lines, plain, titled
from ident.studies.basis import motion_title
from ident.studies.cure.design_figure import LIMIT
from ident.studies.cure.variants_report import QUANTITIES, differs, names

if TYPE_CHECKING:
    from ident.studies.cure.variants import Variant, VariantsOptions


def variants_figure(variants: Sequence["Variant"], options: "VariantsOptions") -> Figure:
    """Draw each quantity of all variants as bars; those that differ from the first are orange."""
    figure = titled((10.0, 6.0), motion_title("Variants", variants[0].motions.basis), (0.08, 0.1))
    panels = figure.subplots(2, len(QUANTITIES) // 2)
    for axes, (name, (words, factor, _)) in zip(panels.ravel(), QUANTITIES.items(), strict=True):
        values = [each.numbers[name] for each in variants]
        colours = [ORANGE if differs(x, values[0]) else BLUE for x in values]
        axes.bar(names(variants), [factor * (x or 0.0) for x in values], color=colours, width=0.6)
        axes.tick_params(axis="x", rotation=90 if len(variants) > 3 else 0)
        axes.set_title(words, fontsize=9, loc="left")
        plain(axes, grid=True)
        if name == "vibration":
            axes.axhline(options.limit, **LIMIT)
    entries = {"as the first": {"color": BLUE}, "differs": {"color": ORANGE}, f"limit {options.limit:g} mm": LIMIT}
    key_below(figure, lines(entries), "no bar: no motion keeps the limit")
    return figure
