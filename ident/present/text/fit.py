"""The printed fit report: the answer, what limits it, and then the rest."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ident.identify.conditions import is_of_loop
from ident.identify.fit import CampaignFit
from ident.inference.fit import Fit
from ident.inference.information import OPEN_ABOVE, WEAK_ABOVE, Information
from ident.inference.optima import unmet
from ident.inference.parameters import Parameter
from ident.present.text.warnings import (
    agreement,
    asked_for_lines,
    assumption_lines,
    dependence_on_priors,
    loop_widths,
    reconciling,
    what_may_be_wrong,
)
from ident.present.text.words import (
    MM,
    SETUP,
    correlated_errors,
    cut,
    describe,
    drive_states,
    in_percent,
    in_read_unit,
    in_shown_unit,
    is_length,
    odd_numbers,
    paragraphs,
    priors_in_words,
    read_unit,
    shares,
    unit_of,
    what_is_fixed,
    what_is_open,
)

# -------- Fit details
# The rest of a fit's report: measurements, where each value comes from, and the optima that were found.

LISTED = 12
"""Optima that are listed at most."""
EVERY = 200
"""Measurements up to which all are listed."""
FARTHEST = 24
"""Those that are listed of more."""
LEAST_COST = 0.01
"""Share by which an interval is widened that is worth a word."""
FAR_OFF, OWN = 2.5, 0.1
"""Standard deviations off from which what was said of a number is doubted; the prior's share below which it is idle."""
ALL_ROWS = "Measurements, each with its row in the file"


def measurements(fit: CampaignFit) -> Iterator[str]:
    """Yield each measurement beside what is predicted for it; of many, those that are farthest off."""
    count, off, z, many = len(fit.campaign), fit.off, fit.standardised, len(fit.campaign) > EVERY
    shown = sorted(fit.farthest_off[:FARTHEST]) if many else range(count)
    head = f"The {FARTHEST} of {count} measurements farthest off, with their rows" if many else ALL_ROWS
    yield f"{head:56s} measured predicted     off by      z"
    outliers, unchecked = fit.suspicious, fit.row_tests.unchecked
    for i in shown:
        m = fit.campaign.measurements[i]
        measured, unit = in_read_unit(m.kind, m.value)
        model, _ = in_read_unit(m.kind, float(fit.predicted[i]))
        row, mark = m.where.rpartition(":")[2], f" <--{_weight(fit, i)}" if outliers[i] else ""
        by_itself = f"{-z[i]:6.2f}" if np.isfinite(z[i]) else f"{'-':>6s}"
        numbers = f"{measured:8.4g} {model:9.4g} {unit:3s} {-off[i]:7.2f} {by_itself}{' ?' * bool(unchecked[i])}{mark}"
        yield f"  {row:>3s} {cut(describe(m), 50):50s} {numbers}"
    if many:
        yield from _by_kind(fit)
    yield "  off by: measured less predicted, in sigma; z: in its own standard deviation, which is smaller as"
    yield "  the fit follows the value: by z a value is judged"
    if unchecked.any():
        yield "  ? cannot be checked: no other measurement tells the same, and an error would pass unnoticed"
    if fit.weights is None:
        limit = f"{fit.row_tests.limit:.1f}{'; vectors as a whole' if fit.problem.vectors is not None else ''}"
        yield f"  limit for the farthest z of {fit.row_tests.tested}: {limit}; what lies too far off is marked <--"
        return
    several = int(fit.suspicious.sum())
    yield f"  robust: {several} of {count} values count for less than half, each marked <-- with its weight."


def _weight(fit: CampaignFit, i: int) -> str:
    return "" if fit.weights is None else f" {fit.weights[i]:.2g}"


def _by_kind(fit: CampaignFit) -> Iterator[str]:
    """Yield for each kind how far its values are off."""
    kinds, outliers = np.array([m.kind for m in fit.campaign]), fit.suspicious
    for kind in dict.fromkeys(kinds.tolist()):
        z = -fit.off[kinds == kind]
        far = int(outliers[kinds == kind].sum())
        numbers = f"off by {z.mean():+.2f} sigma in the mean, {np.sqrt((z**2).mean()):.2f} sigma rms; {far} too far off"
        yield f"  {len(z)} of {kind.replace('_', ' ')}: {numbers}"
    yield "  All are in the result file."


def uncertain_numbers(fit: CampaignFit) -> Iterator[str]:
    """Yield for each number that is not exactly known what the fit makes of it, and what knowing it would gain."""
    parameters, known = fit.problem.parameters, fit.information
    places = [i for i, item in enumerate(parameters.items) if item.nuisance and not is_of_loop(item.name)]
    if not places:
        return
    yield "Not exactly known          said  within    fitted   off by   known to   costs most"
    for i in places:
        item, off = parameters.items[i], float(parameters.prior_residuals(fit.best.theta)[0][i])
        size, _ = read_unit(item.name)
        said, now = (_known_to(item, float(sd)) for sd in (item.prior_sd, known.sd[i]))
        shift = f"{off:+.1f} sd" if np.isfinite(item.prior_sd) else "-"
        values = f"{float(item.start) / size:8.4g} {said:>7s} {fit.best.values[i] / size:9.4g} {shift:>8s} {now:>10s}"
        yield f"  {cut(item.name, 20):20s} {values}   {_cost(fit, i)}"
        advice = _advice(item, known, i, off)
        yield from [f"    <-- {advice}"] if advice else []
    yield "  costs most: how much wider an interval is than it would be were this number known exactly."
    if any(item.name.startswith(SETUP) for item in parameters.items):
        yield "  setup: place [mm] and further turn [mrad] of its frame; what was free was found from the data first."


def _known_to(item: Parameter, sd: float) -> str:
    if not np.isfinite(sd):
        return "free"
    if item.positive:
        return f"{100 * sd:.2g} %"
    size, unit = read_unit(item.name)
    return f"{sd * float(item.scale) / size:.2g} {unit}"


def _cost(fit: CampaignFit, i: int) -> str:
    """Name the unknown whose interval a number widens most."""
    known, own = fit.information, ~fit.problem.parameters.nuisance
    shared = np.where(own, np.nan_to_num(known.correlation[i]), 0.0)
    worst = int(np.argmax(np.abs(shared)))
    wider = (1 - shared[worst] ** 2) ** -0.5 - 1
    return f"{known.names[worst]} {100 * wider:.2g} % wider" if wider >= LEAST_COST else "hardly anything"


def _advice(item: Parameter, known: Information, i: int, off: float) -> str:
    """Say whether the data contradict what was said of a number, or know it better."""
    if not np.isfinite(item.prior_sd):
        return ""
    if abs(off) > FAR_OFF:
        return "far from what was said of it: either that is wrong, or something else is (masses, loads, labels)"
    if known.prior_share[i] < OWN:
        return f"the data alone tell it: it might as well be an unknown (`free` {known.names[i]})"
    return ""


def origins(fit: CampaignFit) -> Iterator[str]:
    """Yield for each parameter the arm file's value, the fitted one, and what tells it."""
    known, items = fit.information, fit.problem.parameters.items
    yield f"{'Parameters':21s}{'fitted':>10s} {'arm file':>10s} {'':10s} {'ratio':>6s}   told by data, prior, both"
    for i, (item, value) in enumerate(zip(items, fit.best.values.tolist(), strict=True)):
        if item.nuisance:
            continue
        (now, unit), (start, _) = (in_shown_unit(item.name, number) for number in (value, float(item.start)))
        ratio = f"{now / start:.3g}" if start else "-"
        numbers = f"{now:10.5g} {start:10.4g} {unit:10s} {ratio:>6s}   {shares(known, i)}"
        yield f"  {cut(item.name, 22):18s} {numbers}"
    yield "  both: the data, together with the priors of others"
    for prior in priors_in_words([item for item in items if not item.nuisance]):
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


def optima(fit: Fit) -> Iterator[str]:
    """Yield the optima, the answer first."""
    tried = sum(o.starts for o in fit.optima) + fit.failed
    failed = f"; {fit.failed} starts reached none" if fit.failed else ""
    first = f"; the first {LISTED} of them" if len(fit.optima) > LISTED else ""
    yield f"Optima: {len(fit.optima)} found from {tried} starts{failed}{first}"
    yield f"  {'':6s} {'score':>9s} {'labels':>8s} {'starts':>6s}   values, in the order of Parameters [SI]"
    for i, optimum in enumerate(fit.optima[:LISTED]):
        note = (" (open)" if len(optimum.open) else "") if optimum.converged else " (not converged)"
        mark = "answer" if i == 0 else "other "
        numbers = f"{optimum.score:9.4g} {round(optimum.said, 3) + 0.0:8.3g} {optimum.starts:6d}"
        yield f"  {mark} {numbers}   {_values(optimum.values)}{note}"
    yield "  score: chi-squared of data and priors, and what speaks against the labels, which `labels` is of it"
    if fit.best.converged and len(fit.best.open):
        count = f"{len(fit.best.open)} of {len(fit.best.theta)} directions"
        yield f"  open: along {count} the cost stays flat, or still falls, over several e-folds"


def _values(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:9.4g}" for value in values)


# -------- Fit


def fit_report(fit: CampaignFit) -> str:
    """Return the report of a fit: the values, what limits them, measurements, what the data fix, optima."""
    sections = [
        _heading(fit),
        _answer(fit),
        _limits(fit),
        reconciling(fit.explanations, fit.campaign),
        uncertain_numbers(fit),
        assumption_lines(fit),
        measurements(fit),
        loop_widths(fit),
        what_is_fixed(fit),
        _agreement(fit),
        origins(fit),
        optima(fit),
    ]
    return paragraphs(sections)


def _heading(fit: CampaignFit) -> Iterator[str]:
    yield f"Fit of {fit.arm.name} to {fit.campaign.name}"
    p = "" if math.isnan(fit.p_value) else f", p = {fit.p_value:.2g}"
    p += "" if fit.weights is None else ", with robust weights"
    count, beside, loops = len(fit.information.names), int(fit.problem.parameters.nuisance.sum()), len(fit.loops)
    uncertain = f", {beside - loops} uncertain number{'s' * (beside - loops > 1)}" if beside > loops else ""
    uncertain += f", {loops} loop{'s' * (loops > 1)} of ramps" if loops else ""
    yield (
        f"  {len(fit.campaign)} measurements, {count - beside} unknowns{uncertain};"
        f" chi-squared {fit.chi_squared:.3g} on {fit.degrees_of_freedom} degrees of freedom{p}"
    )
    yield from odd_numbers(fit.arm)
    yield from correlated_errors(fit.campaign)
    yield from drive_states(fit.arm, fit.campaign)


def _answer(fit: CampaignFit) -> Iterator[str]:
    """Yield each value with its interval, or why it has none."""
    yield "Fitted values, with their 95 % intervals"
    items, words = fit.problem.parameters.items, [why_no_interval(fit, i) for i in range(len(fit.best.values))]
    width = max(16, *(len(cut(item.name, 40)) for item in items))
    for item, value, interval, word in zip(items, fit.best.values, fit.interval(), words, strict=True):
        if item.nuisance:
            continue
        shown = word or _either_side(item, float(value), interval)
        number, unit = in_shown_unit(item.name, float(value))
        yield f"  {cut(item.name, 40):{width}s} {number:10.4g} {unit:7s}  {shown}"
        for other in item.paths[1:]:
            yield f"    = {other}"
    meanings = {
        "open": "the data alone leave it open; what is known of it rests on the priors",
        "weak": f"the data alone know it no better than to a factor of {math.exp(WEAK_ABOVE):.2g} (one sd)",
        "withheld": "data and model would support an interval, but the fit is in doubt",
    }
    yield from (f"  {word}: {meaning}" for word, meaning in meanings.items() if word in words)


def why_no_interval(fit: Fit, i: int) -> str:
    """Return in one word why a parameter has no interval; nothing where it has one."""
    known = fit.information
    if known.supported[i] or fit.problem.parameters.nuisance[i]:
        return "" if fit.supported[i] else "withheld"
    return "weak" if known.data_sd[i] < OPEN_ABOVE else "open"


def _either_side(item: Parameter, value: float, interval: np.ndarray) -> str:
    """Write how far an interval reaches to either side, as `-3.7 % +3.9 %`."""
    if item.positive:
        return " ".join(f"{in_percent(float(end) / value - 1):>8s}" for end in interval)
    factor, unit = (MM, "mm") if is_length(item.name) else (1.0, unit_of(item.name))
    return "  ".join(f"{factor * (float(end) - value):+.2g} {unit}" for end in interval)


def _limits(fit: CampaignFit) -> Iterator[str]:
    """Yield what speaks against the answer, what else would fit, and what the data leave open."""
    lines = [
        *_doubts(fit),
        *asked_for_lines(fit),
        *_rivals(fit),
        *what_is_open(fit.information, fit.problem.parameters.items),
    ]
    nothing = "Nothing in the data speaks against them: no doubt, no rival met, no open direction"
    yield "What limits them" if lines else nothing
    yield from lines


def _doubts(fit: CampaignFit) -> Iterator[str]:
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt}"
    if fit.doubts:
        yield "  So no interval is quoted: those that data and model would support are `withheld`."
    if fit.contradictory:
        yield from _explanation(fit)
    for remark in fit.remarks:
        yield f"  REMARK: {remark}"


def _explanation(fit: CampaignFit) -> Iterator[str]:
    yield f"  CONTRADICTION. {dependence_on_priors(fit.cross_predictions)}"
    hint = what_may_be_wrong(fit.cross_predictions)
    if len(fit.blamed) == 1 or fit.exchanges or not hint:
        yield "  Check the values named below, their labels, units and load cases first."
        return
    yield from (f"  {line}" for line in hint)
    yield f"  The values above are a compromise that {_stretch(fit)}"


def _stretch(fit: Fit) -> str:
    items = fit.problem.parameters.items
    ratios = [
        abs(math.log(v / float(p.start))) if p.positive else 0.0 for p, v in zip(items, fit.best.values, strict=True)
    ]
    worst = int(np.argmax(ratios))
    factor = fit.best.values[worst] / float(items[worst].start)
    return f"takes {items[worst].name} to {factor:.2g} times the arm file's value."


def _rivals(fit: Fit) -> Iterator[str]:
    """Yield that other optima fit as well, or nearly."""
    costs = [optimum.score - fit.best.score for optimum in fit.rivals[fit.ties :]]
    if fit.ties:
        yield f"  NOT UNIQUE: {fit.ties + 1} optima fit exactly as well: globally not identifiable. The answer is"
        yield "  the one nearest to the priors' centre; all are listed below."
    if costs:
        others = "another optimum" if len(costs) == 1 else f"{len(costs)} other optima"
        yield f"  WARNING: the data do not rule out {others}: the next costs {min(costs):.2g} more (see below)."
    if fit.rivals:
        expected = unmet(fit.optima)
        if np.isfinite(expected):
            yield f"  By how often each of them was met, {expected:.1f} more like them are expected."
        else:
            yield "  Each was met too seldom to say how many more like them there are: try more starts."
        yield "  Each interval reaches over all that were found; all else here holds about the answer alone."


def _agreement(fit: CampaignFit) -> Iterator[str]:
    if not fit.cross_predictions:
        return
    yield "Do the kinds of measurement agree? Each one, against the others and the priors:"
    yield from agreement(fit.cross_predictions, fit.campaign.measurements)
    parameters = fit.problem.parameters
    if not (parameters.proper | parameters.nuisance).all():
        yield "  Where there is no prior on a stiffness, the default one was taken for this comparison."
