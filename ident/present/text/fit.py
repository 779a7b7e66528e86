"""The printed fit report."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.fit import CampaignFit
from ident.inference.fit import Fit
from ident.inference.information import Direction, Information, TradeOff
from ident.inference.parameters import Parameter
from ident.inference.verdicts import farthest
from ident.present.text.agreement import agreement, dependence_on_priors, what_may_be_wrong
from ident.present.text.units import in_read_unit, is_stiffness, nmm_per_deg, unit_of
from ident.present.text.words import NOTABLE, describe, known_from, paragraphs, priors_in_words, scatter, span


def fit_report(fit: CampaignFit) -> str:
    """Return the report of a fit: parameters, measurements, what the data fix, contradictions, optima."""
    sections = [
        _heading(fit),
        _parameters(fit),
        _measurements(fit),
        _information(fit),
        _contradictions(fit),
        _optima(fit),
    ]
    return paragraphs(sections)


def _heading(fit: CampaignFit) -> Iterator[str]:
    yield f"Fit of {fit.arm.name} to {fit.campaign.name}"
    yield f"  {len(fit.campaign)} measurements, {len(fit.information.names)} unknowns"
    p = f", p = {fit.p_value:.2g}" if fit.degrees_of_freedom > 0 else ""
    yield f"  chi-squared {fit.chi_squared:.3g} on {fit.degrees_of_freedom} degrees of freedom{p}"
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt}"
    if fit.doubts:
        yield "  So no interval is quoted: those that data and model would support are marked `withheld`."
    for remark in fit.remarks:
        yield f"  REMARK: {remark}"


def _parameters(fit: CampaignFit) -> Iterator[str]:
    known, items = fit.information, fit.problem.parameters.items
    yield "Parameters                fitted    95 % interval            arm file   ratio   known from"
    rows = zip(items, fit.best.values, fit.interval(), strict=True)
    for i, (item, value, (low, high)) in enumerate(rows):
        interval = span(low, high) if fit.supported[i] else ("withheld" if known.supported[i] else "open")
        source = known_from(known.prior_share[i], known.sd[i])
        ratio = f"{value / float(item.start):.3g}" if float(item.start) else "-"
        yield (
            f"  {item.name:16s} {value:13.5g}    {interval:23s} {float(item.start):10.4g} {ratio:>7s}   {source}"
            f"   [{unit_of(item.name)}]"
        )
        for other in item.paths[1:]:
            yield f"    = {other}"
    stiff = [(item, v) for item, v in zip(items, fit.best.values, strict=True) if is_stiffness(item.name)]
    if stiff:
        yield "  in N mm/deg, the unit of the paper's Table 1 (arm file in brackets):"
        for item, value in stiff:
            yield f"    {item.name:16s} {nmm_per_deg(value):10.4g}   ({nmm_per_deg(float(item.start)):.4g})"
    for prior in priors_in_words(items):
        yield f"  prior: {prior}"
    if not any("tau" in item.name for item in items):
        times = sorted({f"{float(tau):.2g} s" for j in fit.arm.joints for tau in (j.tau_bend, j.tau_tors)})
        yield f"  damping was not fitted; the arm file's is {' to '.join(times)} times the stiffness"
    worst = _worst_correlation(known)
    if worst:
        yield f"  largest correlation: {worst}"


def _worst_correlation(known: Information) -> str:
    correlation = np.triu(np.nan_to_num(known.correlation), 1)
    i, j = np.unravel_index(np.argmax(np.abs(correlation)), correlation.shape)
    return f"{correlation[i, j]:+.2f} between {known.names[i]} and {known.names[j]}" if correlation[i, j] else ""


def _measurements(fit: CampaignFit) -> Iterator[str]:
    yield "Measurements, each with its row in the file                   measured  predicted   residual   res./sigma"
    rows = zip(fit.campaign, fit.predicted, fit.residuals, fit.outliers, strict=True)
    for m, predicted, z, outlying in rows:
        measured, unit = in_read_unit(m.kind, m.value)
        model, _ = in_read_unit(m.kind, float(predicted))
        numbers = f"{measured:10.4g} {model:10.4g} {measured - model:10.3g} {-z:8.2f}"
        row = m.where.rpartition(":")[2]
        yield f"  {row:>3s}  {describe(m):53s} {numbers}   [{unit}]{'  <--' if outlying else ''}"
    count = len(fit.campaign)
    yield f"  limit for the farthest of {count}: {farthest(count):.1f} sigma; what lies too far off is marked <--"


def _information(fit: CampaignFit) -> Iterator[str]:
    known, items = fit.information, fit.problem.parameters.items
    count = len(known.names)
    filler = "filled by the prior alone" if np.isfinite(known.sd).all() else "left where the search stopped"
    yield f"What the data fix: {known.rank} of {count} directions"
    for direction in known.directions:
        if direction.seen:
            weak = "weakly known, to" if direction.weak else "known to"
            yield f"  {weak} {spread_in_words(direction.sd)}: {product(direction, items)}"
    if known.rank < count:
        yield f"What they leave open: {count - known.rank} of {count} directions, {filler}"
        for trade in known.trade_offs():
            yield f"  {in_words(trade, items)}: the data would not notice"
    single = [name for name, ok in zip(known.names, fit.supported, strict=True) if ok]
    if len(single) < count:
        yield f"  Single values that the data support: {', '.join(single) if single else 'none'}."


def spread_in_words(sd: float) -> str:
    """Say how well a theta is known: in percent, or as a factor."""
    return scatter(sd).replace("factor", "a factor of")


def product(direction: Direction, items: tuple[Parameter, ...]) -> str:
    """Write a direction as a product of powers of parameters; one of either sign enters as its exponential."""
    order = np.argsort(-np.abs(direction.weights))
    factors = [item.name if item.positive else f"exp({item.name} / {float(item.scale):g} m)" for item in items]
    parts = [(factors[i], direction.weights[i]) for i in order if abs(direction.weights[i]) > NOTABLE]
    if len(parts) == 1:
        return parts[0][0]
    return " * ".join(f"{name}^{weight:.2f}" for name, weight in parts)


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
        return f"{item.name} by {100 * math.expm1(theta):+.2g} %"
    return f"{item.name} by {1e3 * theta * float(item.scale):+.2g} mm"


def _contradictions(fit: CampaignFit) -> Iterator[str]:
    if not fit.cross_predictions:
        return
    yield "Do the kinds of measurement agree? Each one, against the others and the priors:"
    yield from agreement(fit.cross_predictions, fit.campaign.measurements)
    if not fit.problem.parameters.proper.all():
        yield "  Where there is no prior on a stiffness, the default one was taken for this comparison."
    if fit.contradictory:
        yield from _explanation(fit)


def _explanation(fit: CampaignFit) -> Iterator[str]:
    yield f"  CONTRADICTION. {dependence_on_priors(fit.cross_predictions)}"
    hint = what_may_be_wrong(fit.cross_predictions)
    if fit.outliers.sum() == 1 or not hint:
        yield "  Check the values named above, their labels, units and load cases first."
        return
    yield from (f"  {line}" for line in hint)
    yield f"  The stiffnesses above are a compromise that {_stretch(fit)}"


def _stretch(fit: Fit) -> str:
    items = fit.problem.parameters.items
    ratios = [
        abs(math.log(v / float(p.start))) if p.positive else 0.0 for p, v in zip(items, fit.best.values, strict=True)
    ]
    worst = int(np.argmax(ratios))
    factor = fit.best.values[worst] / float(items[worst].start)
    return f"takes {items[worst].name} to {factor:.2g} times the arm file's value."


def _optima(fit: Fit) -> Iterator[str]:
    tried = sum(o.starts for o in fit.optima) + fit.failed
    yield f"Optima: {len(fit.optima)} found from {tried} starts" + (
        f"; {fit.failed} starts reached none" if fit.failed else ""
    )
    for i, optimum in enumerate(fit.optima[:5]):
        values = "  ".join(f"{v:.4g}" for v in optimum.values)
        note = ("  (open)" if len(optimum.open) else "") if optimum.converged else "  (not converged)"
        mark = "answer" if i == 0 else "other "
        yield f"  {mark}  cost {optimum.cost:10.4g}  starts {optimum.starts:3d}   {values}{note}"
    if fit.best.converged and len(fit.best.open):
        count = f"{len(fit.best.open)} of {len(fit.best.theta)} directions"
        yield f"  open: along {count} the cost stays flat, or still falls, over several e-folds"
    if fit.ties:
        yield f"  NOT UNIQUE: {fit.ties + 1} optima fit exactly as well: globally not identifiable. The answer is"
        yield "  the one nearest to the priors' centre."
    if rivals := len(fit.rivals):
        others = "another optimum" if rivals == 1 else f"{rivals} other optima"
        yield f"  WARNING: the data do not rule out {others}; each interval reaches over all that were found"
