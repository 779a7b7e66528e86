"""Whether the kinds of measurement agree, in words that the reports of check and fit share."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ident.inference.cross_prediction import FEW, CrossPrediction, contradicting
from ident.inference.verdicts import RARE, standard_deviations
from ident.measure import Campaign, Measurement
from ident.present.text.units import in_read_unit
from ident.present.text.words import describe, three_digits

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations


def agreement(predictions: Sequence[CrossPrediction], measured: Sequence[Measurement]) -> Iterator[str]:
    """Say for each kind how far it is off the others and the prior, and for the values of a small kind as well."""
    for cross in predictions:
        values = "value" if len(cross.rows) == 1 else "values"
        yield (
            f"  {cross.kind.replace('_', ' ')}, {len(cross.rows)} {values}: T {three_digits(cross.statistic)} on"
            f" {cross.degrees_of_freedom:.1f} degrees of freedom, {chance(cross)}"
        )
        for i, row in enumerate(cross.rows if len(cross.rows) <= FEW else ()):
            yield f"    {against(cross, i, measured[row])}"
    yield "  T: how much more the data cost together than each part by itself; priors count as the others'."


def chance(cross: CrossPrediction) -> str:
    """Write how improbable a disagreement is; as standard deviations, too, where these say anything."""
    return f"p = {cross.p_value:.2g}" + (f" ({cross.sd:.1f} sd)" if cross.sd >= 1 else "")


def against(cross: CrossPrediction, i: int, m: Measurement) -> str:
    """Say what the other kinds lead to for the i-th value of a small kind, and what was measured."""
    value, unit = in_read_unit(m.kind, cross.measured[i])
    predicted, _ = in_read_unit(m.kind, cross.predicted[i])
    off = f": {cross.z[i]:+.1f} sd" if cross.z is not None else ""
    return f"{describe(m)}: by the others {predicted:.3g} {unit}, measured {value:.3g}{off}"


def dependence_on_priors(predictions: Sequence[CrossPrediction]) -> str:
    """Say in a word whether a contradiction would stand with wider priors."""
    worst = min(contradicting(predictions), key=lambda cross: cross.p_value)
    word = "hardly depends on" if worst.wider < RARE else "rests on"
    wider = f"{standard_deviations(worst.wider):.1f} sd were they twice as wide"
    return f"It {word} the priors: {worst.sd:.1f} sd, and {wider}."


def what_may_be_wrong(predictions: Sequence[CrossPrediction]) -> tuple[str, ...]:
    """Say where to look when deflections and frequencies contradict each other; nothing for other kinds.

    A mass on a spring deflects by g / omega^2, whatever the spring; a chain adds a factor that masses and lengths give.
    A spring that hardens vibrates about its loaded state: tangent above secant, so that omega^2 times deflection grows.
    """
    kinds = {cross.kind: cross for cross in predictions}
    if not {"frequency", "deflection"} <= set(kinds) or kinds.keys().isdisjoint(
        cross.kind for cross in contradicting(predictions)
    ):
        return ()
    deflection = kinds["deflection"]
    small = bool(np.mean(deflection.measured / deflection.predicted) < 1)
    first = "Deflection times the square of the frequency is nearly fixed by masses and lengths alone,"
    if small:
        return (
            first,
            "and here it is too small: was the deflection measured under less load or mass than the frequency?",
            "Then look at mass centres and lengths. Drives that stiffen under load would make it larger.",
        )
    return (
        first,
        "and here it is too large: was the deflection measured under more load or mass than the frequency?",
        "Then look at mass centres and lengths, and at drives that stiffen under load or stick.",
    )


def reconciling(found: "Explanations | None", campaign: Campaign) -> Iterator[str]:
    """Say what would reconcile a campaign, where that was searched for."""
    if found is None:
        return
    from ident.present.text.explanations import explanations_in_words  # which imports all that found them

    yield from explanations_in_words(found, campaign)
