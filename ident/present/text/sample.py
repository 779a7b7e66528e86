"""The printed report of a sampled posterior."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.fit import CampaignFit
from ident.identify.sample import CampaignSample
from ident.inference.cross_prediction import contradicting
from ident.inference.diagnostics import LONG_ENOUGH, MIXED, Diagnosis
from ident.inference.linear_marginal import MOVED
from ident.inference.posterior_summary import LEARNED, combinations, quantiles, share_of_prior
from ident.inference.sample import RIVAL, Sample
from ident.present.text.directions import product
from ident.present.text.units import SETUP, in_read_unit, in_shown_unit
from ident.present.text.words import cut, describe, drive_states, paragraphs, priors_in_words, scatter, span


def sample_report(result: CampaignSample) -> str:
    """Return the report: parameters, combinations, measurements, optima, and how far to trust the chains."""
    sections = [
        _heading(result),
        *(_parameters(result, basin) for basin in result.sample.basins),
        _combinations(result),
        _measurements(result),
        _optima(result),
        _trust(result),
    ]
    return paragraphs(sections)


def _heading(result: CampaignSample) -> Iterator[str]:
    sample = result.sample
    yield f"Posterior of {result.fitted.arm.name} given {result.fitted.campaign.name}"
    draws, ensembles, walkers, _ = sample.theta.shape
    yield f"  {(draws - sample.burn_in) * ensembles * walkers} draws by {ensembles} ensembles of {walkers} walkers"
    yield from drive_states(result.fitted.arm, result.fitted.campaign)
    for doubt in result.fitted.doubts:
        yield f"  WARNING: of the fit: {doubt.replace('see below', 'see ident fit')}"
    if result.withheld:
        yield "  So no interval is quoted: each is `withheld`, as ident fit withholds it."
        yield from what_to_do(result.fitted)


def what_to_do(fit: CampaignFit) -> Iterator[str]:
    """Say what to do about a posterior whose fit is in doubt."""
    yield "  First look for a wrong row, label, unit or mass: ident fit names the candidates."
    kinds = [cross for cross in contradicting(fit.cross_predictions) if (cross.measured * cross.predicted > 0).all()]
    if kinds:
        fewest = min(kinds, key=lambda cross: len(cross.rows))
        off = float(np.abs(np.log(fewest.measured / fewest.predicted)).max())
        width = max(1, math.ceil(10 * off / 1.96)) / 10
        words = f"{fewest.kind.replace('_', ' ')} by a common factor"
        yield f"  If the data are right, the model is not: let it get {words} wrong,"
        yield f"  --discrepancy {fewest.kind}:{width:g} ({width:.0%}), and the factor is inferred with the rest."
    else:
        yield "  If the data are right, the model is not: let it get a kind of measurement wrong by a common factor,"
        yield "  --discrepancy KIND:WIDTH, or infer the size of the errors, --noise KIND."


def _parameters(result: CampaignSample, basin: int) -> Iterator[str]:
    sample, optimum, doubted = result.sample, result.fitted.optima[basin], bool(result.withheld)
    items = sample.posterior.parameters.items
    fitted = [*optimum.values, *(1.0 for _ in sample.posterior.noise.items)]
    where = f" about optimum {basin + 1}" if len(sample.basins) > 1 else ""
    yield f"{f'Parameters{where}':18s}     median  {'95 % interval':22s}       fit  arm file  of prior"
    rows = zip(items, quantiles(sample, basin).T, fitted, share_of_prior(sample, basin), strict=True)
    for item, (low, _, median, _, high), best, share in rows:
        if item.name.startswith(SETUP):
            continue
        width = f"{share:6.0%} {'<--' if share > LEARNED else ''}" if math.isfinite(float(item.prior_sd)) else "  none"
        one, unit = in_shown_unit(item.name, 1.0)
        interval = "withheld" if doubted else span(low * one, high * one)
        yield (
            f"  {item.name:16s} {median * one:10.4g}  {interval:22s} {best * one:9.4g} {float(item.start) * one:9.4g}"
            f" {width:11s}  [{unit}]"
        )
    if basin == sample.basins[0]:
        yield "  of prior: width of the 95 % interval as a share of the prior's; near 100 % the data say nothing;"
        yield f"  <-- above {LEARNED:.0%}: what is known of it is mostly the prior"
        for prior in priors_in_words([item for item in items if not item.name.startswith(SETUP)]):
            yield f"  prior: {prior}"


def _combinations(result: CampaignSample) -> Iterator[str]:
    items = result.fitted.problem.parameters.items
    if len(items) > 1 and not result.withheld:
        yield f"Combinations{of_first(result)}, best known first: standard deviation of the product over the draws"
        spread = result.sample.draws()[:, : len(items)].std(0)
        for direction in combinations(result.sample):
            yield f"  {scatter(direction.sd):>11s}   {product(direction, items, spread)}"


def _measurements(result: CampaignSample) -> Iterator[str]:
    head = f"Measurements{of_first(result)}, each with its row in the file"
    yield f"{head:57s}  measured       {'predicted, 95 %':18s}  below"
    drawn = result.posterior_predictive
    for i, m in enumerate(result.fitted.campaign):
        low, high = (in_read_unit(m.kind, q)[0] for q in np.quantile(drawn.predicted[:, i], (0.025, 0.975)))
        measured, unit = in_read_unit(m.kind, m.value)
        below = float((drawn.simulated[:, i] < m.value).mean())
        row, mark = m.where.rpartition(":")[2], " <--" if not 0.005 < below < 0.995 else ""
        numbers = f"{measured:9.4g} {unit:3s} {span(low, high):18s} {below:6.1%}{mark}"
        yield f"  {row:>3s}  {cut(describe(m), 50):50s}  {numbers}"
    yield "  below: share of measurements simulated by the posterior that are less; <-- too few or too many"


def of_first(result: CampaignSample) -> str:
    """Say about which optimum it is, where there are several."""
    return f" about optimum {result.sample.basins[0] + 1}" if len(result.sample.basins) > 1 else ""


def _optima(result: CampaignSample) -> Iterator[str]:
    basins, left_out = result.sample.basins, len(result.fitted.optima) - len(set(result.sample.started))
    if left_out:
        yield f"Optima left out, as their cost is higher by more than {RIVAL:g}: {left_out}"
    if len(basins) < 2:
        return
    yield f"Optima: {len(basins)} that the data hardly tell apart; each was sampled on its own"
    if result.weights is None:
        yield "  Their shares of the probability are unknown, as no ensemble crosses between them; --weights finds them"
        return
    for basin, share, sd in zip(basins, result.weights.share, result.weights.sd, strict=True):
        yield f"  optimum {basin + 1}: {share:.1%} +- {sd:.1%} of the probability"
    yield f"  by nested sampling; log evidence {result.weights.log_evidence:.2f}"


def _trust(result: CampaignSample) -> Iterator[str]:
    sample = result.sample
    yield "How far to trust the chains"
    for basin, diagnosis in zip(sample.basins, sample.diagnosis, strict=True):
        where = f"optimum {basin + 1}: " if len(sample.basins) > 1 else ""
        accepted = sample.acceptance[np.array(sample.basin) == basin].mean()
        yield (
            f"  {where}{diagnosis.steps} steps, burn-in {diagnosis.burn_in}, autocorrelation time "
            f"{diagnosis.tau.max():.0f} steps, acceptance {accepted:.0%}"
        )
        yield (
            f"  {where}effective sample size at least {diagnosis.bulk.min():.0f} (bulk), "
            f"{diagnosis.tail.min():.0f} (tail); R-hat at most {diagnosis.rhat.max():.4f}"
        )
        yield from _shortfall(diagnosis, sample.settings.target_ess)
    yield from _nuisances(sample)


def _nuisances(sample: Sample) -> Iterator[str]:
    """Say which of the uncertain numbers were integrated out, and which were sampled."""
    out = sample.marginalised
    rest = [item.name for item in sample.posterior.parameters.items if item.nuisance and item.name not in out]
    if out:
        yield f"  integrated out, and drawn given the rest: {', '.join(out)}"
        yield f"  What is not linear in them would move a mean by {max(out.values()):.2g} sd ({MOVED:g} is let pass)."
    if rest:
        yield f"  sampled like the unknowns: {', '.join(rest)}"


def _shortfall(diagnosis: Diagnosis, target: float) -> Iterator[str]:
    if diagnosis.enough(target):
        return
    reasons = {
        f"the ensembles disagree (R-hat above {MIXED})": not diagnosis.mixed,
        f"shorter than {LONG_ENOUGH} autocorrelation times": not diagnosis.long_enough,
        f"fewer than {target:.0f} effective samples": diagnosis.bulk.min() < target,
    }
    why = " and ".join(reason for reason, holds in reasons.items() if holds)
    yield f"  TOO SHORT: {why}; about {diagnosis.more_steps(target)} steps more are needed (--steps)"
