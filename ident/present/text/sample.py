"""The printed report of a sampled posterior."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.sample import CampaignSample
from ident.inference.diagnostics import LONG_ENOUGH, MIXED, Diagnosis
from ident.inference.posterior_summary import LEARNED, combinations, quantiles, share_of_prior
from ident.inference.sample import RIVAL
from ident.present.text.fit import product
from ident.present.text.units import in_read_unit, is_stiffness, nmm_per_deg, unit_of
from ident.present.text.words import describe, paragraphs, priors_in_words, scatter, span


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
    for doubt in result.fitted.doubts:
        yield f"  WARNING: of the fit: {doubt}"
    if result.fitted.contradictory and not any("discrepancy" in n for n in sample.posterior.parameters.names):
        yield "  The posterior takes the model as right. Infer how wrong it is: --discrepancy KIND:WIDTH"


def _parameters(result: CampaignSample, basin: int) -> Iterator[str]:
    sample, optimum = result.sample, result.fitted.optima[basin]
    items = sample.posterior.parameters.items
    fitted = [*optimum.values, *(1.0 for _ in sample.posterior.noise.items)]
    where = f" about optimum {basin + 1}" if len(sample.basins) > 1 else ""
    yield (
        f"Parameters{where:17s}   median   {'50 % interval':24s} {'95 % interval':24s}        fit   arm file   of prior"
    )
    rows = zip(items, quantiles(sample, basin).T, fitted, share_of_prior(sample, basin), strict=True)
    for item, (low, lower, median, upper, high), best, share in rows:
        width = (
            f"{share:6.0%}{' <- open' if share > LEARNED else ''}" if math.isfinite(float(item.prior_sd)) else "  none"
        )
        yield (
            f"  {item.name:22s} {median:10.4g}   {span(lower, upper):24s} {span(low, high):24s} {best:10.4g} "
            f"{float(item.start):10.4g}   {width}   [{unit_of(item.name)}]"
        )
    stiff = [(item, q) for item, q in zip(items, quantiles(sample, basin).T, strict=True) if is_stiffness(item.name)]
    if stiff:
        yield "  in N mm/deg, the unit of the paper's Table 1:"
        for item, (low, _, median, _, high) in stiff:
            numbers = f"{nmm_per_deg(median):10.4g}   95 %: {span(nmm_per_deg(low), nmm_per_deg(high)):24s}"
            yield f"    {item.name:20s} {numbers}   arm file {nmm_per_deg(float(item.start)):.4g}"
    if basin == sample.basins[0]:
        yield "  of prior: width of the 95 % interval as a share of the prior's; near 100 % the data say nothing"
        for prior in priors_in_words(items):
            yield f"  prior: {prior}"


def _combinations(result: CampaignSample) -> Iterator[str]:
    items = result.fitted.problem.parameters.items
    if len(items) > 1:
        yield f"Combinations{of_first(result)}, best known first: standard deviation of the product over the draws"
        for direction in combinations(result.sample):
            yield f"  {scatter(direction.sd):>11s}   {product(direction, items)}"


def _measurements(result: CampaignSample) -> Iterator[str]:
    head = f"Measurements{of_first(result)}, each with its row in the file"
    yield f"{head:61s}  measured  predicted, 95 % band               simulated below"
    drawn = result.posterior_predictive
    for i, m in enumerate(result.fitted.campaign):
        low, median, high = (
            in_read_unit(m.kind, q)[0] for q in np.quantile(drawn.predicted[:, i], (0.025, 0.5, 0.975))
        )
        measured, unit = in_read_unit(m.kind, m.value)
        below = float((drawn.simulated[:, i] < m.value).mean())
        row, mark = m.where.rpartition(":")[2], "  <--" if not 0.005 < below < 0.995 else ""
        band = f"{median:10.4g}  {f'({low:.4g} to {high:.4g})':24s}"
        yield f"  {row:>3s}  {describe(m):53s} {measured:10.4g} {band} {below:7.1%}   [{unit}]{mark}"


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
