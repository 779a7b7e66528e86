"""The report of a fleet: population and outliers; its table, and the priors of the next robot."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ident.identify.fleet import FEWEST, Fleet, Robot
from ident.inference.information import p_in_words
from ident.inference.population import FALSE_ALARM, LARGEST_K, LEAST_EFFECTIVE, Population
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut, without_empty_columns
from ident.report.words import counted, in_shown_unit, percent, sentence, some, span, unit_of
from ident.studies.stiffness.compare_report import ratio_words, stiffness_words
from ident.text import as_word

LISTED = 20
"""Robots listed per group; the result file has all."""
LONGEST = 130
"""Longest reason on the first screen [characters]."""
COLUMNS = 4
"""Stiffnesses per row block in a table of robots."""
R_HAT_MOST = 1.02
"""R-hat up to which chains count as agreeing."""
BOUND = 0.25
"""Spread of theta above which it is called wide: robots of one design differ less."""


def fleet_sections(fleet: Fleet) -> Report:
    """Return the report of a fleet."""
    counts = [f"{len(fleet.members)} in the population"]
    counts += [f"{len(fleet.failed)} failed"] * bool(fleet.failed)
    counts += [f"{len(fleet.doubted)} with data in doubt"] * bool(fleet.doubted)
    stiffnesses = f", {len(fleet.names)} stiffnesses each" if fleet.names else ""
    clearest = [_clearest(fleet)] if fleet.standing_out else []
    population = [population_table(fleet, fleet.population)] if fleet.population else []
    return Report(
        f"Fleet of {counted(len(fleet.robots), 'robot')}{stiffnesses}: {', '.join(counts)}",
        _verdict(fleet),
        (*clearest, *population, *_damping(fleet)),
        tuple(_findings(fleet)),
        next=_next(fleet),
        details=tuple(_details(fleet)),
    )


def _damping(fleet: Fleet) -> Iterator[str]:
    """Yield the median and spread of the robots' damping ratios; the verdict does not depend on them."""
    ratios = [fleet.robots[i].damping_ratio for i in fleet.members if fleet.robots[i].damping_ratio]
    if len(ratios) > 1:
        middle, spread = percent(float(np.median(ratios))), percent(float(np.log(ratios).std(ddof=1)))
        yield f"Damping ratio, mean of the measured modes: median {middle}, spread {spread} ({len(ratios)} robots)."


def member(fleet: Fleet, place: int) -> Robot:
    """Return a member of the population."""
    return fleet.robots[fleet.members[place]]


def outlying(fleet: Fleet) -> dict[int, str]:
    """Return by outlying member which stiffness stands out and by how much: `joint2 in torsion -46.3 %`."""
    if fleet.population is None:
        return {}
    return {
        r: ", ".join(f"{stiffness_words(fleet.names[i])} {_change(fleet.population, r, i)}" for i in which)
        for r, which in fleet.standing_out.items()
    }


def _change(population: Population, r: int, i: int) -> str:
    """Write the distance of a member's stiffness from the fleet's median."""
    return ratio_words(float(population.robot_mean[r, i] - population.next_mean[i]))


# -------- Verdict


def _verdict(fleet: Fleet) -> Verdict:
    """Judge a fleet: NO POPULATION, n OF m STAND OUT, INCOMPLETE if robots are missing, else NONE STANDS OUT."""
    groups = {"Failed": fleet.failed, "Data in doubt": fleet.doubted}
    named = {word: some([cut(each.name, 30) for each in robots]) for word, robots in groups.items() if robots}
    others = "".join(f" {word}: {names}." for word, names in named.items())
    if fleet.population is None:
        few = f"A population takes {FEWEST} robots with usable data; there are {len(fleet.members)}."
        return Verdict("NO POPULATION", few + others, "bad")
    out, count = outlying(fleet), len(fleet.members)
    if out:
        who = some([cut(f"{cut(member(fleet, r).name, 30)} ({words})", 90) for r, words in out.items()])
        word = f"{len(out)} OF {count} {'STANDS' if len(out) == 1 else 'STAND'} OUT"
        return Verdict(word, f"Against the fleet's median: {who}.{others}", "caution")
    judged = fleet.deviations
    assert judged is not None
    r, i = map(int, np.unravel_index(int(np.argmin(judged.p)), judged.p.shape))
    where = f"{cut(member(fleet, r).name, 30)}, {stiffness_words(fleet.names[i])} {_change(fleet.population, r, i)}"
    largest = f"{where} ({p_in_words(judged.p[r, i])}; {judged.p.size} compared)"
    known = f"Largest deviation of {count} robots: {largest}."
    if others:
        return Verdict("INCOMPLETE", f"No robot stands out.{others} {known}", "caution")
    return Verdict("NONE STANDS OUT", known, "good")


def _findings(fleet: Fleet) -> Iterator[Finding]:
    """Yield the findings that affect the verdict, most important first."""
    population = fleet.population
    if population:
        yield from _advice(fleet, population)
    if fleet.failed:
        first = fleet.failed[0]
        error = cut(first.error.splitlines()[0], LONGEST)
        yield Finding(f"{cut(first.name, 30)} has no fit: {error}{_others(fleet.failed)}")
    if fleet.doubted:
        first = fleet.doubted[0]
        text = f"{cut(first.name, 30)} is left out: {cut(first.doubts[0], LONGEST)}{_others(fleet.doubted)}"
        yield Finding(text, "fit it alone (`ident fit`)")
    if population and population.r_hat > R_HAT_MOST:
        yield Finding(f"the population's chains disagree (R-hat {population.r_hat:.3f}): its numbers are rough")
    if population and population.log_likelihood_variance > 1:
        variance = f"{population.log_likelihood_variance:.1g}"
        yield Finding(f"the population's numbers are rough: the variance of its log-likelihood is {variance} (limit 1)")


def _others(robots: Sequence[Robot]) -> str:
    return f" (and {counted(len(robots) - 1, 'more robot')})" if len(robots) > 1 else ""


def _advice(fleet: Fleet, population: Population) -> Iterator[Finding]:
    """Yield what to check on the outlying robots."""
    remedies = {
        "softer": "check bolts, bearing, gear and belt; look for a crack",
        "stiffer": "check what was replaced or tightened, or what rubs",
    }
    named: dict[str, list[str]] = {word: [] for word in remedies}
    for r, which in fleet.standing_out.items():
        for i in which:
            word = "softer" if population.robot_mean[r, i] < population.next_mean[i] else "stiffer"
            named[word].append(cut(f"{stiffness_words(fleet.names[i])} of {cut(member(fleet, r).name, 30)}", 60))
    for word, remedy in remedies.items():
        if named[word]:
            yield Finding(f"{word} than the fleet: {some(named[word])}", remedy)


def _next(fleet: Fleet) -> str:
    odd = [member(fleet, r) for r in fleet.standing_out] or [*fleet.failed, *fleet.doubted]
    if odd:
        command = f"ident fit {as_word(odd[0].campaign.path)} --arm {as_word(odd[0].arm.path)}"
        return command.replace("{", "{{").replace("}", "}}")
    return "ident fit CAMPAIGN $(cat {result}.prior)" if fleet.population else ""


# -------- Tables


def _clearest(fleet: Fleet) -> Table:
    """Return a row for each outlying robot, with its clearest stiffness."""
    listed = list(fleet.standing_out.items())[:LISTED]
    rows = []
    for r, which in listed:
        words, *numbers = _judged(fleet, r, which[0])
        more = f" (and {len(which) - 1} more)" if len(which) > 1 else ""
        rows.append((cut(member(fleet, r).name, 32), f"{words}{more}", *numbers))
    hidden = len(fleet.standing_out) - len(listed)
    note = f"and {counted(hidden, 'more robot')}" if hidden > 0 else ""
    return Table("", ("Stands out", *JUDGED), tuple(rows), note=note)


JUDGED = ("stiffness", "against the fleet", "95 % of healthy robots", "chance")


def _judged(fleet: Fleet, r: int, i: int) -> tuple[str, str, str, str]:
    """Return stiffness, deviation, 95 % range of healthy robots, and the deviation's probability in a healthy fleet."""
    judged, population = fleet.deviations, fleet.population
    assert judged is not None
    assert population is not None
    chance = dict(zip(judged.named, judged.chance, strict=True))[r, i]
    low, high = (100 * float(np.expm1(sign * 1.96 * judged.sd[r, i])) for sign in (-1, 1))
    words = stiffness_words(fleet.names[i])
    return words, _change(population, r, i), f"{low:+.0f} to {high:+.0f} %", percent(chance)


def population_table(fleet: Fleet, population: Population) -> Table:
    """Return the median and robot-to-robot spread of each stiffness."""
    rows = []
    for i, name in enumerate(fleet.names):
        medians = np.quantile(population.mean[:, i], [0.025, 0.5, 0.975])
        low, middle, high = (in_shown_unit(name, float(np.exp(x)))[0] for x in medians)
        least, spread, most = map(percent, np.quantile(population.sd[:, i], [0.025, 0.5, 0.975]).tolist())
        wide = "wide" if np.median(population.sd[:, i]) > BOUND else ""
        rows.append((name, middle, span(low, high), spread, f"{least} to {most}", wide))
    unit = in_shown_unit(fleet.names[0], 1.0)[1]
    heads = f"Population [{unit}]", "median|.4g", "95 % interval", "spread", "95 % interval", ""
    return without_empty_columns(by_head(heads, rows))


def against_median(population: Population, r: int) -> tuple[str, ...]:
    """Write the distance of each stiffness of a member from the fleet's median, with its standard error."""
    return tuple(f"{_change(population, r, i)} ± {percent(float(sd))}" for i, sd in enumerate(population.robot_sd[r]))


AGAINST_NOTE = "By the robot's own data and the fleet's (shrunk). ±: standard error, relative to the robot's own value."


# -------- Details


def _details(fleet: Fleet) -> Iterator[Section]:
    if fleet.standing_out and fleet.population:
        listed = list(fleet.standing_out.items())[:LISTED]
        rows = tuple((cut(member(fleet, r).name, 32), *_judged(fleet, r, i)) for r, which in listed for i in which)
        table = [Table("", ("robot", *JUDGED), rows)] if len(rows) > len(listed) else []
        rule = (
            "Chance: probability that any stiffness of a fleet of healthy robots differs as much from the others. "
            f"A robot stands out below {percent(FALSE_ALARM)}; the population is then that of the others."
        )
        yield Section("Robots that stand out", (*table, rule))
    if fleet.population:
        yield Section("Population", tuple(trust_in(fleet, fleet.population)))
    if fleet.failed:
        lines = []
        for robot in fleet.failed:
            first, *more = robot.error.splitlines()
            lines.append(f"{cut(robot.name, 30)}: {first}" + f" (and {len(more)} more)" * bool(more))
        yield Section("Failed", _listed(lines))
    if fleet.doubted:
        lines = [f"{cut(robot.name, 30)}: {sentence('; '.join(robot.doubts))}" for robot in fleet.doubted]
        yield Section("Data in doubt, left out of the population", _listed(lines))
    if fleet.population:
        yield _against(fleet, fleet.population)
        yield priors_section(fleet)


def _listed(lines: Sequence[str]) -> tuple[str, ...]:
    more = len(lines) - LISTED
    return (*lines[:LISTED], *([f"and {more} more"] if more > 0 else []))


def trust_in(fleet: Fleet, population: Population) -> Iterator[str]:
    """Yield the meaning of the population's numbers, the source of each robot's likelihood, and how far to trust it."""
    low, high = map(percent, np.quantile(population.share, [0.025, 0.975]).tolist())
    yield (
        "Spread: standard deviation of ln(stiffness) from robot to robot, without those that stand out; wide: above "
        f"{percent(BOUND)}, more than robots of one design differ."
    )
    yield f"Share of outlying stiffnesses: {low} to {high}."
    normal = "a normal approximation about its own fit, with the interim prior divided out"
    if trusted := population.trusted:
        k, effective = max(each.k for each in trusted), min(each.effective for each in trusted)
        yield "Likelihood of each robot: draws, weighted by the exact model with the interim prior left out."
        yield (
            f"Effective draws of each robot: {effective:.0f} or more (limit {LEAST_EFFECTIVE:g}); Pareto k: {k:.2f} or "
            f"less (limit {LARGEST_K:g}); Monte Carlo variance of the population's log-likelihood: "
            f"{population.log_likelihood_variance:.1g} (limit 1)."
        )
    else:
        yield f"Likelihood of each robot: {normal}."
    if trusted and population.normal:
        names = some([cut(member(fleet, r).name, 30) for r in population.normal], LISTED)
        yield f"The weights of {names} cannot be trusted: {normal} is used there."


def _against(fleet: Fleet, population: Population) -> Section:
    """Return each member against the fleet's median, a few stiffnesses per table."""
    order = [*fleet.standing_out, *(r for r in range(len(fleet.members)) if r not in fleet.standing_out)]
    tables = []
    for start in range(0, len(fleet.names), COLUMNS):
        own = slice(start, start + COLUMNS)
        rows = tuple((cut(member(fleet, r).name, 22), *against_median(population, r)[own]) for r in order[:LISTED])
        tables.append(Table("", ("robot", *(cut(name, 15) for name in fleet.names[own])), rows))
    hidden = len(order) - LISTED
    more = [f"and {counted(hidden, 'more robot')}: see the result file"] if hidden > 0 else []
    return Section("Robots against the fleet's median", (*tables, *more, AGAINST_NOTE))


def priors_section(fleet: Fleet) -> Section:
    """Return the fleet's prediction of the next robot, as priors of a fit."""
    note = "As `ident fit --prior=STIFFNESS=PRIOR` takes them; FLEET.fleet.prior holds these flags."
    table = Table("", ("stiffness", "prior [SI]"), tuple(fleet_priors(fleet).items()), note=note)
    return Section("Prediction of the next robot, before its data", (table,))


# -------- Rows


def fleet_rows(fleet: Fleet) -> list[dict[str, Any]]:
    """Return a row for each member and stiffness: own and shrunk estimate, and its distance from the others."""
    population, judged = fleet.population, fleet.deviations
    if population is None or judged is None:
        return []
    robots = [fleet.robots[place] for place in fleet.members]
    own = {"own": np.exp([robot.theta for robot in robots]), "own_sd_log": np.array([robot.sd for robot in robots])}
    shrunk = {"shrunk": np.exp(population.robot_mean), "shrunk_sd_log": population.robot_sd}
    off = {"against_fleet_log": population.robot_mean - population.next_mean, "against_others_log": judged.difference}
    columns = own | shrunk | off | {"healthy_sd_log": judged.sd, "chance_if_healthy": judged.p}
    return [
        {"robot": robot.name, "parameter": name, "unit": unit_of(name)}
        | {column: float(numbers[r, i]) for column, numbers in columns.items()}
        | {"stands_out": i in fleet.standing_out.get(r, ())}
        for r, robot in enumerate(robots)
        for i, name in enumerate(fleet.names)
    ]


def fleet_priors(fleet: Fleet) -> dict[str, str]:
    """Return the population's prediction of the next healthy robot, as log-normal priors [SI] by stiffness."""
    if fleet.population is None:
        return {}
    ends = zip(fleet.names, np.exp(fleet.population.next_mean), fleet.population.next_sd, strict=True)
    return {name: f"log-normal:{median:.6g}:{sd:.3g}" for name, median, sd in ends}
