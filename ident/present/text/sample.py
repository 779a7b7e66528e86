"""The printed reports of a sampled posterior and of a fleet."""

import math
from collections.abc import Iterator

import numpy as np

from ident.identify.compare import CampaignSample
from ident.identify.fit import CampaignFit
from ident.identify.fleet import FEWEST, Fleet, Robot
from ident.inference.chains import LONG_ENOUGH, MIXED, Diagnosis
from ident.inference.draws import LEARNED, combinations, quantiles, share_of_prior
from ident.inference.fit import contradicting
from ident.inference.population import FALSE_ALARM, LARGEST_K, LEAST_EFFECTIVE, Population
from ident.inference.posterior import MOVED
from ident.inference.sample import RIVAL, Sample
from ident.present.files.sample import fleet_priors
from ident.present.text.check import ratio_words, stiffness_words
from ident.present.text.words import (
    SETUP,
    cut,
    describe,
    drive_states,
    in_read_unit,
    in_shown_unit,
    kept,
    paragraphs,
    percent,
    priors_in_words,
    product,
    scatter,
    span,
)


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


# -------- Fleet
# The printed report of a fleet: the population, who stands out, whose data are in doubt, each robot's estimates.

LISTED = 20
"""Robots of a kind that are listed; the result's file has all."""
R_HAT_MOST = 1.02
"""R-hat up to which chains agree."""
BOUND = 0.25
"""Spread in theta from which it is said that robots of one design differ less."""


def fleet_report(fleet: Fleet) -> str:
    """Return the report."""
    known = [_population(fleet, fleet.population), _standing_out(fleet, fleet.population)] if fleet.population else []
    estimates = [_estimates(fleet, fleet.population), _next(fleet)] if fleet.population else []
    return paragraphs([_fleet_heading(fleet), *known, _failed(fleet), _doubted(fleet), *estimates])


def _fleet_heading(fleet: Fleet) -> Iterator[str]:
    yield f"Fleet of {len(fleet.robots)} robots"
    left_out = [f"{len(fleet.failed)} failed"] * bool(fleet.failed)
    left_out += [f"{len(fleet.doubted)} whose data are in doubt"] * bool(fleet.doubted)
    yield f"  {len(fleet.members)} make the population" + (f"; left out: {', '.join(left_out)}" if left_out else "")
    if fleet.population is None:
        yield f"  NO population: it takes {FEWEST} robots"
        return
    if fleet.standing_out:
        said = [f"{_member(fleet, r).name} ({words})" for r, words in outlying(fleet).items()]
        yield f"  STANDS OUT: {_some(said, 90)}"
    else:
        yield "  No robot stands out."
    if fleet.population.r_hat > R_HAT_MOST:
        yield f"  WARNING: the population's chains disagree (R-hat {fleet.population.r_hat:.3f}): its numbers are rough"


def _member(fleet: Fleet, place: int) -> Robot:
    return fleet.robots[fleet.members[place]]


def outlying(fleet: Fleet) -> dict[int, str]:
    """Say of each member that stands out which stiffness does and by how much: `joint2 in torsion -46.3 %`."""
    population = fleet.population
    if population is None:
        return {}
    away = population.robot_mean - population.next_mean
    return {
        r: ", ".join(f"{stiffness_words(fleet.names[i])} {ratio_words(float(away[r, i]))}" for i in which)
        for r, which in fleet.standing_out.items()
    }


def _some(names: list[str], length: int = 30) -> str:
    more = len(names) - LISTED
    return ", ".join(cut(name, length) for name in names[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _population(fleet: Fleet, population: Population) -> Iterator[str]:
    unit = in_shown_unit(fleet.names[0], 1.0)[1]
    yield f"{f'Population [{unit}]':24s}{'median':>11s}   {'95 % interval':25s}{'spread':>8s}   95 % interval"
    for i, name in enumerate(fleet.names):
        low, middle, high = (
            f"{in_shown_unit(name, float(np.exp(x)))[0]:.4g}"
            for x in np.quantile(population.mean[:, i], [0.025, 0.5, 0.975])
        )
        least, spread, most = map(percent, np.quantile(population.sd[:, i], [0.025, 0.5, 0.975]).tolist())
        wide = "   WIDE" if np.median(population.sd[:, i]) > BOUND else ""
        yield f"  {cut(name, 22):22s}{middle:>11s}   {f'{low} to {high}':25s}{spread:>8s}   {least} to {most}{wide}"
    yield "  spread: standard deviation of ln(stiffness) from robot to robot, without those that are off"
    low, high = map(percent, np.quantile(population.share, [0.025, 0.975]).tolist())
    yield f"  share of stiffnesses that are off: {low} to {high}"
    yield from (f"  {line}" for line in known_by(fleet, population))


def known_by(fleet: Fleet, population: Population) -> Iterator[str]:
    """Say how it is known what each robot's data say, and how far that can be trusted."""
    trusted, variance = population.trusted, population.log_likelihood_variance
    if trusted:
        k, effective = max(each.k for each in trusted), min(each.effective for each in trusted)
        yield "each robot's data by draws, weighed by the exact model with the interim prior left out"
        yield f"  effective draws of each: {effective:.0f} or more; {LEAST_EFFECTIVE:g} do"
        yield f"  Pareto k: {k:.2f} or less; {LARGEST_K:g} does"
        yield f"  Monte Carlo variance of the population's log-likelihood: {variance:.1g}; less than 1 does"
    if variance > 1:
        yield "  WARNING: that variance makes the population's numbers rough"
    normal = "a normal approximation about its own fit, the interim prior divided out"
    if not trusted:
        yield f"each robot's data by {normal}"
    elif population.normal:
        names = _some([_member(fleet, r).name for r in population.normal])
        yield f"weights of {names} can't be trusted: data by {normal}"


def _standing_out(fleet: Fleet, population: Population) -> Iterator[str]:
    judged = fleet.deviations
    if judged is None or not judged.named:
        return
    chance = dict(zip(judged.named, judged.chance, strict=True))
    yield f"{'Stands out':34s}{'against the fleet':>18s}{'95 % of healthy robots':>25s}{'chance':>9s}"
    for r, which in list(fleet.standing_out.items())[:LISTED]:
        yield f"  {cut(_member(fleet, r).name, 32)}"
        for i in which:
            change = ratio_words(float(population.robot_mean[r, i] - population.next_mean[i]))
            low, high = (100 * float(np.expm1(sign * 1.96 * judged.sd[r, i])) for sign in (-1, 1))
            words, healthy = stiffness_words(fleet.names[i]), f"{low:+.0f} to {high:+.0f} %"
            yield f"    {words:30s}{change:>18s}{healthy:>25s}{percent(chance[r, i]):>9s}"
    yield "  chance: that any stiffness of a fleet of healthy robots differs so much from the other robots';"
    yield f"  below {percent(FALSE_ALARM)} it stands out, and the population is that of the others"


def _failed(fleet: Fleet) -> Iterator[str]:
    if fleet.failed:
        yield "Failed"
    for robot in fleet.failed[:LISTED]:
        first, *others = robot.error.splitlines()
        yield f"  {cut(robot.name, 30)}: {first}" + (f" (and {len(others)} more)" if others else "")
    if len(fleet.failed) > LISTED:
        yield f"  and {len(fleet.failed) - LISTED} more"


def _doubted(fleet: Fleet) -> Iterator[str]:
    if fleet.doubted:
        yield "Data in doubt: left out of the population; see ident fit"
    for robot in fleet.doubted[:LISTED]:
        yield f"  {cut(robot.name, 30)}: {'; '.join(robot.doubts).replace('see below', 'see ident fit')}"
    if len(fleet.doubted) > LISTED:
        yield f"  and {len(fleet.doubted) - LISTED} more"


def _estimates(fleet: Fleet, population: Population) -> Iterator[str]:
    yield f"{'Robots against the median':26s}" + "".join(f"{_short(name):>16s}" for name in fleet.names[:4])
    rows = [*fleet.standing_out, *(r for r in range(len(fleet.members)) if r not in fleet.standing_out)]
    for r in rows[:LISTED]:
        away = population.robot_mean[r] - population.next_mean
        parts = [
            f"{ratio_words(float(x))} ± {percent(float(sd))}"
            for x, sd in zip(away, population.robot_sd[r], strict=True)
        ]
        for start in range(0, len(parts), 4):
            name = cut(_member(fleet, r).name, 22) if not start else ""
            yield f"  {name:24s}" + "".join(f"{part:>16s}" for part in parts[start : start + 4])
    if len(fleet.names) > 4:
        second = ", ".join(_short(name) for name in fleet.names[4:])
        yield f"  second lines: {second}"
    if len(rows) > LISTED:
        yield f"  and {len(rows) - LISTED} more: see the result's file"
    yield "  shrunk: by the robot's own data and the fleet's; ± standard deviation"


def _short(name: str) -> str:
    return cut(name, 15)


def _next(fleet: Fleet) -> Iterator[str]:
    yield "The next robot: what the fleet says before its data, for ident fit (FLEET.fleet.prior holds these)"
    for name, prior in fleet_priors(fleet).items():
        yield f"  {kept(f'--prior={name}={prior}')}"
