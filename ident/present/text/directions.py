"""Combinations of parameters in words: how well each is known, and what may change unnoticed."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ident.inference.fit import Fit
from ident.inference.information import Direction, Information, TradeOff
from ident.inference.parameters import Parameter
from ident.present.text.words import kept, main_factors, percent, scatter


def what_is_fixed(fit: Fit) -> Iterator[str]:
    """Say which combinations the data fix, best known first, and how well; no width where the fit is in doubt."""
    known, items = fit.information, fit.problem.parameters.items
    withheld = "; the fit is in doubt, so none has a width" if fit.doubts else ""
    yield f"What the data fix: {known.fixed} of {len(known.directions)} directions{withheld}"
    for direction in fit.combinations:
        name = product(direction, items, known.sd)
        if fit.doubts or np.isnan(direction.sd):
            yield f"  {name}"
            continue
        weak = "weakly known, to" if direction.weak or direction.open else "known to"
        yield f"  {weak} {spread_in_words(direction.sd)}: {name}"


def what_is_open(known: Information, items: tuple[Parameter, ...]) -> Iterator[str]:
    """Say what else may change unnoticed, for each direction that the data leave open."""
    trades = known.trade_offs()
    if trades:
        filler = "filled by the prior alone" if np.isfinite(known.sd).all() else "left where the search stopped"
        yield f"  The data leave open {len(trades)} of {len(known.directions)} directions, {filler}:"
    for trade in trades:
        yield f"    {in_words(trade, items)}: the data would not notice"


def spread_in_words(sd: float) -> str:
    """Say how well a theta is known: in percent, or as a factor."""
    return scatter(sd).replace("factor", "a factor of")


def product(direction: Direction, items: tuple[Parameter, ...], spread: Float[np.ndarray, "P"]) -> str:
    """Write a direction as a product of powers of parameters; one of either sign enters as its exponential.

    Args:
        direction: the combination.
        items: the parameters.
        spread: (P,) standard deviation of each theta: a factor is shown where its exponent times that matters.
    """
    factors = [item.name if item.positive else f"exp({item.name} / {float(item.scale):g} m)" for item in items]
    parts = [(factors[i], _exponent(direction.weights[i])) for i in main_factors(direction, spread)]
    if len(parts) == 1:
        return parts[0][0]
    return f" {kept('* ')}".join(f"{name}^{exponent}" for name, exponent in parts)


def _exponent(weight: float) -> str:
    return f"{weight:.2f}" if abs(weight) > 0.095 else f"{weight:.1g}"


def in_words(trade: TradeOff, items: tuple[Parameter, ...]) -> str:
    """Say what else changes unnoticed when one parameter rises by 10 %, or by a tenth of its scale."""
    step = math.log(1.1)
    moved = [
        _change(item, change * step)
        for item, change in zip(items, trade.change, strict=True)
        if item.name != trade.name and abs(change) > 0.05
    ]
    lead = next(_change(item, step) for item in items if item.name == trade.name)
    along = f" together with {' and '.join(moved)}" if moved else ""
    return f"{lead}{along}"


def _change(item: Parameter, theta: float) -> str:
    if item.positive:
        return f"{item.name} by {percent(math.expm1(theta), '+')}"
    return f"{item.name} by {1e3 * theta * float(item.scale):+.2g} mm"
