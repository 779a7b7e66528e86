"""The printed report of a fleet: the population, who stands out, whose data are in doubt, each robot's estimates."""

from collections.abc import Iterator

import numpy as np

from ident.identify.fleet import FEWEST, Fleet, Robot
from ident.inference.population import FALSE_ALARM, LARGEST_K, LEAST_EFFECTIVE, Population
from ident.present.files.fleet import fleet_priors
from ident.present.text.compare import ratio_words, stiffness_words
from ident.present.text.units import in_shown_unit
from ident.present.text.words import cut, kept, paragraphs, percent

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
