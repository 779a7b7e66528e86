"""The report of a sampled posterior, and its table."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.data_checks import row_names
from ident.inference.chains import LONG_ENOUGH, MIXED, Diagnosis
from ident.inference.draws import LEARNED, combinations, quantiles, share_of_prior
from ident.inference.fit import contradicting
from ident.inference.posterior import MOVED
from ident.inference.sample import RIVAL
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, by_row, cut, without_empty_columns
from ident.report.words import (
    SETUP,
    counted,
    describe,
    in_read_unit,
    in_shown_unit,
    is_stiffness,
    priors_in_words,
    product,
    scatter,
    sentence,
    shared_unit,
    some,
    span,
    unit_of,
)
from ident.studies.stiffness.fit_report import damping_in_words, refused, unknown_places
from ident.studies.stiffness.warnings import asked_for, contradiction, drive_states, good_if, odd_numbers

if TYPE_CHECKING:
    from ident.identify.fit import CampaignFit
    from ident.identify.sample import CampaignSample

LEAST_BELOW = 0.005
"""Share of simulated values on one side of a measured value below which it lies outside the prediction."""


def sample_sections(result: "CampaignSample") -> Report:
    """Return the report of a posterior."""
    fit = result.fitted
    conflict = contradiction(fit.cross_predictions, fit.campaign)
    steps, ensembles, walkers, _ = result.sample.theta.shape
    return Report(
        f"Posterior of {cut(fit.arm.name, 40)} given {cut(fit.campaign.name, 30) or 'a campaign'}: "
        f"{counted(len(fit.campaign), 'measurement')}, {counted(len(unknown_places(result.fitted)), 'unknown')}, "
        f"{(steps - result.sample.burn_in) * ensembles * walkers} draws",
        _verdict(result),
        (*conflict, _values(result, result.sample.basins[0], _main(result)), *damping_in_words(fit.damping)),
        tuple(_findings(result)),
        "" if result.withheld else _farthest(result),
        _next(result),
        (_further_values(result), *_combinations(result), _measurements(result), *_optima(result), _chains(result)),
    )


def _main(result: "CampaignSample") -> list[int]:
    """Return the indices of the first screen: the unknowns and the noise scales."""
    count = len(result.fitted.problem.parameters.items)
    return [*unknown_places(result.fitted), *range(count, len(result.sample.posterior.parameters.items))]


def _mostly_prior(result: "CampaignSample") -> list[int]:
    """Return the indices of the unknowns that the data hardly narrow beyond the prior."""
    share = share_of_prior(result.sample, result.sample.basins[0])
    return [i for i in unknown_places(result.fitted) if share[i] > LEARNED]


# -------- Verdict


def _verdict(result: "CampaignSample") -> Verdict:
    """Judge a posterior: NOT USABLE like its fit, TOO SHORT, DOUBTFUL, SEVERAL OPTIMA, PARTLY or GOOD."""
    sample, fit, short = result.sample, result.fitted, _shortfall(result)
    refusal = refused(fit)
    if refusal and not sample.posterior.noise.items:
        too = " The chains are too short as well." if short else ""
        return Verdict(refusal.word, refusal.reason + too, refusal.kind)
    if short:
        return Verdict("TOO SHORT", sentence(short), "bad")
    if refusal:
        inferred = "The size of the errors is inferred, so intervals are reported."
        return Verdict("DOUBTFUL", f"{' '.join(map(sentence, fit.doubts)) or refusal.reason} {inferred}", "caution")
    chains = (
        f"chains agree (R-hat at most {max(d.rhat.max() for d in sample.diagnosis):.4f}, "
        f"{min(d.bulk.min() for d in sample.diagnosis):.0f} effective samples or more)."
    )
    if len(sample.basins) > 1:
        shares = [f"{100 * float(share):.1f} %" for share in result.weights.share] if result.weights else ["unknown"]
        text = f"The data hardly distinguish {len(sample.basins)} optima (probability: {', '.join(shares)}); {chains}"
        return Verdict("SEVERAL OPTIMA", text, "caution")
    own, prior = unknown_places(result.fitted), _mostly_prior(result)
    determined = [i for i in own if i not in prior]
    if not determined:
        return Verdict("NOT USABLE", f"All {len(own)} unknowns are known mostly by the prior; {chains}", "bad")
    sd = sample.draws(sample.basins[0])[:, determined].std(0).max()
    known = f"determined (std. error at most {scatter(float(sd))}); {chains}"
    if prior:
        count = f"{len(determined)} OF {len(own)}"
        return Verdict(f"PARTLY {count}", f"{count.lower()} unknowns {known}", "caution")
    return Verdict(good_if(fit), f"All {len(own)} unknowns {known}", "good")


def _short_chains(result: "CampaignSample") -> list[Diagnosis]:
    target = result.sample.settings.target_ess
    return [each for each in result.sample.diagnosis if not each.enough(target)]


def _more_steps(result: "CampaignSample") -> int:
    return max(each.more_steps(result.sample.settings.target_ess) for each in _short_chains(result))


def _shortfall(result: "CampaignSample") -> str:
    """Say which criterion the chains miss, and how many steps are missing; empty if they meet it."""
    target, chains = result.sample.settings.target_ess, _short_chains(result)
    if not chains:
        return ""
    rhat, bulk = max(d.rhat.max() for d in chains), min(d.bulk.min() for d in chains)
    reasons = {
        f"the ensembles disagree (R-hat {rhat:.3f}, limit {MIXED})": not all(d.mixed for d in chains),
        f"fewer than {LONG_ENOUGH} autocorrelation times": not all(d.long_enough for d in chains),
        f"{bulk:.0f} effective samples instead of {target:.0f}": bulk < target,
    }
    why = " and ".join(reason for reason, holds in reasons.items() if holds)
    return f"{why}; about {_more_steps(result)} more steps are needed"


def _next(result: "CampaignSample") -> str:
    word = _verdict(result).word
    if word == "NOT USABLE":
        return "check the causes that ident fit names, then: ident fit {campaign}"
    if _short_chains(result):
        steps = max(each.steps for each in result.sample.diagnosis)
        return f"the same command with --steps {steps + _more_steps(result)}"
    if not word.startswith("GOOD"):
        return "ident plan {campaign}"
    return "ident resonance {arm} --posterior {result}.nc" if result.fitted.arm.stroke else ""


# -------- Findings


def _findings(result: "CampaignSample") -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    fit, names = result.fitted, result.sample.posterior.parameters.names
    if result.withheld:
        yield from what_to_do(fit)
    yield from filter(None, [asked_for(fit)])
    yield from odd_numbers(fit.arm, fit.problem.parameters)
    yield from drive_states(fit.arm, fit.campaign)
    if len(result.sample.basins) > 1 and result.weights is None:
        yield Finding("no ensemble crosses between the optima, so their shares are unknown", "repeat with --weights")
    if (prior := _mostly_prior(result)) and not result.withheld:
        text = f"known mostly by the prior: {some([cut(names[i], 24) for i in prior])}"
        yield Finding(text, "measure what `ident plan` proposes")


def what_to_do(fit: "CampaignFit") -> Iterator[Finding]:
    """Yield what to do about a posterior with a doubtful fit."""
    yield Finding("a row, label, unit or mass may be wrong", "check the candidates that `ident fit` names")
    kinds = [cross for cross in contradicting(fit.cross_predictions) if (cross.measured * cross.predicted > 0).all()]
    remedy = "infer a common factor of a kind (`--discrepancy KIND:WIDTH`) or its error (`--noise KIND`)"
    if kinds:
        fewest = min(kinds, key=lambda cross: len(cross.rows))
        off = float(np.abs(np.log(fewest.measured / fewest.predicted)).max())
        width = max(1, math.ceil(10 * off / 1.96)) / 10
        option = f"`--discrepancy {fewest.kind}:{width:g}` ({100 * width:.0f} %)"
        remedy = f"infer a common model factor of every {fewest.kind.replace('_', ' ')}: {option}"
    yield Finding("if the data are right, the model is not", remedy)


def _below(result: "CampaignSample") -> np.ndarray:
    """Return for each measurement the share of smaller simulated values."""
    simulated = result.posterior_predictive.simulated
    return (simulated < np.array([m.value for m in result.fitted.campaign])).mean(0)


def _outside(below: np.ndarray) -> np.ndarray:
    return np.abs(below - 0.5) >= 0.5 - LEAST_BELOW


def _farthest(result: "CampaignSample") -> str:
    """Name the measurement farthest out in the posterior's prediction."""
    below = _below(result)
    out, i = _outside(below), int(np.argmax(np.abs(below - 0.5)))
    row = row_names(result.fitted.campaign)[i]
    which = f"{out.sum()} of {len(out)}" if out.any() else f"All {len(out)}"
    far = f"farthest out: row {row}, with {100 * below[i]:.1f} % of the simulated values below it."
    return f"{which} measurements lie {'outside' if out.any() else 'within'} the predicted 99 %; {far}"


# -------- Values


def _values(result: "CampaignSample", basin: int, places: Sequence[int]) -> Table:
    """Return unknowns about one optimum: median, interval, values of fit and arm file, share of the prior."""
    sample = result.sample
    items = sample.posterior.parameters.items
    fitted = [*result.fitted.optima[basin].values, *(1.0 for _ in sample.posterior.noise.items)]
    known, share = quantiles(sample, basin).T, share_of_prior(sample, basin)
    shared = shared_unit(items[i].name for i in places)
    rows = []
    for i in places:
        size, unit = in_shown_unit(items[i].name, 1.0)
        low, _, median, _, high = (float(q) * size for q in known[i])
        interval = "not reported" if result.withheld else span(low, high)
        of_prior = f"{100 * share[i]:.0f} %" if math.isfinite(float(items[i].prior_sd)) else "no prior"
        of_prior += " (prior)" if share[i] > LEARNED else ""
        numbers = (median, interval, float(fitted[i]) * size, float(items[i].start) * size)
        rows.append((items[i].name, *numbers, of_prior, "" if shared else unit))
    what = "Stiffness" if all(is_stiffness(items[i].name) for i in places) else "Unknown"
    heads = f"{what}{shared}", "median|#.4g", "95 % interval", "fit|#.4g", "arm file|.4g", "interval / prior", "unit"
    caption = f"About optimum {basin + 1}" if len(sample.basins) > 1 else ""
    return without_empty_columns(by_head(heads, rows, caption))


# -------- Details


def of_first(result: "CampaignSample") -> str:
    """Name the optimum, if there are several."""
    return f" about optimum {result.sample.basins[0] + 1}" if len(result.sample.basins) > 1 else ""


def _further_values(result: "CampaignSample") -> Section:
    """Return the values that are not on the first screen, and the priors."""
    items = result.sample.posterior.parameters.items
    shown = [i for i, item in enumerate(items) if not item.name.startswith(SETUP)]
    first, *others = result.sample.basins
    hidden = [i for i in shown if i not in _main(result)]
    tables = [_values(result, first, hidden)] if hidden else []
    note = (
        "interval / prior: width of the 95 % interval over the prior's; near 100 % the data say nothing, above "
        f"{100 * LEARNED:.0f} % the value is mostly the prior's: (prior)."
    )
    tables += [_values(result, basin, shown) for basin in others]
    return Section("Values and priors", (*tables, note, *priors_in_words([items[i] for i in shown])))


def _combinations(result: "CampaignSample") -> Iterator[Section]:
    items = result.fitted.problem.parameters.items
    if len(items) < 2 or result.withheld:
        return
    spread = result.sample.draws()[:, : len(items)].std(0)
    title = f"Combinations{of_first(result)} and their std. error over the draws, best determined first"
    known = (f"{scatter(each.sd)}: {product(each, items, spread)}" for each in combinations(result.sample))
    yield Section(title, tuple(known))


def _measurements(result: "CampaignSample") -> Section:
    """Return each measurement next to the posterior's prediction."""
    below = _below(result)
    out, rows, names = _outside(below), [], row_names(result.fitted.campaign)
    for i, m in enumerate(result.fitted.campaign):
        drawn = np.quantile(result.posterior_predictive.predicted[:, i], (0.025, 0.975))
        low, high = (in_read_unit(m.kind, float(end))[0] for end in drawn)
        measured, unit = in_read_unit(m.kind, m.value)
        mark = "outside" if out[i] else ""
        rows.append((names[i], describe(m), unit, measured, span(low, high), 100 * float(below[i]), mark))
    note = (
        "Below: share of the measurements simulated by the posterior, with their errors, that are lower than the "
        f"measured value; outside: fewer than {100 * LEAST_BELOW:g} % lie on one side."
    )
    heads = "row", "measurement", "unit", "measured|.4g", "predicted 95 %", "below [%]|.1f", ""
    return Section(f"Measurements and predictions{of_first(result)}", (by_head(heads, rows, note=note),))


def _optima(result: "CampaignSample") -> Iterator[Section]:
    basins, left_out = result.sample.basins, len(result.fitted.optima) - len(set(result.sample.started))
    parts: list[str | Table] = []
    if len(basins) > 1 and result.weights is not None:
        shares = zip(basins, result.weights.share, result.weights.sd, strict=True)
        rows = [(str(basin + 1), 100 * float(share), 100 * float(sd)) for basin, share, sd in shares]
        note = f"By nested sampling; log evidence {result.weights.log_evidence:.2f}."
        parts.append(by_head(("optimum", "probability [%]|.1f", "std. error [%]|.1f"), rows, note=note))
    if left_out:
        parts.append(f"Not sampled, because their score is higher by more than {RIVAL:g}: {left_out}.")
    if parts:
        yield Section("Optima", tuple(parts))


def _chains(result: "CampaignSample") -> Section:
    """Return how far to trust the chains, and how the uncertain numbers were treated."""
    sample = result.sample
    rows = []
    for basin, each in zip(sample.basins, sample.diagnosis, strict=True):
        accepted = 100 * float(sample.acceptance[np.array(sample.basin) == basin].mean())
        worst = float(each.bulk.min()), float(each.tail.min()), float(each.rhat.max())
        rows.append((str(basin + 1), each.steps, each.burn_in, float(each.tau.max()), accepted, *worst))
    heads = "optimum", "steps|d", "burn-in|d", "autocorrelation time [steps]|.0f", "accepted [%]|.0f"
    _, ensembles, walkers, _ = sample.theta.shape
    note = (
        f"{counted(ensembles, 'ensemble')} of {walkers} walkers. Numbers of the worst unknown. ESS: effective "
        f"sample size. Sufficient: R-hat below {MIXED}, {LONG_ENOUGH} autocorrelation times and a bulk ESS of "
        f"{sample.settings.target_ess:.0f}."
    )
    table = by_head((*heads, "bulk ESS|.0f", "tail ESS|.0f", "R-hat|.4f"), rows, note=note)
    out, said = sample.marginalised, [sentence(_shortfall(result))] if _short_chains(result) else []
    if out:
        said.append(
            f"Integrated out, and drawn given the other unknowns: {', '.join(out)}. Their nonlinearity would move a "
            f"mean by {max(out.values()):.2g} std. errors (limit {MOVED:g})."
        )
    return Section("Convergence of the chains", (table, *said))


# -------- Rows


def sample_rows(result: "CampaignSample") -> list[dict[str, Any]]:
    """Return a row for each unknown about each optimum: median, intervals [SI], and diagnostics."""
    sample, names = result.sample, result.sample.posterior.parameters.names
    rows = list[dict[str, Any]]()
    for basin, chains in zip(sample.basins, sample.diagnosis, strict=True):
        about = {"parameter": names, "optimum": [basin + 1] * len(names), "unit": map(unit_of, names)}
        known = zip(("low_95", "low_50", "median", "high_50", "high_95"), quantiles(sample, basin), strict=True)
        rows += by_row(**about, **dict(known), effective_samples=chains.bulk, r_hat=chains.rhat)
    return rows
