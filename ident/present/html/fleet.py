"""A fleet as pages: one at a glance, a robot a row, and one for each robot."""

import re
import shlex
from collections.abc import Iterator, Mapping
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from ident.assess.show import ArmView
from ident.identify.fleet import FEWEST, Fleet, Robot
from ident.inference.population import FALSE_ALARM, Population
from ident.present.figures.sample import stiffness_figure
from ident.present.files.sample import fleet_priors
from ident.present.html.diagnose import arm_section
from ident.present.html.page import Page, Picture, Section, Table, Verdict, picture
from ident.present.text.check import stiffness_words
from ident.present.text.sample import known_by, outlying
from ident.present.text.words import cut, in_shown_unit, percent

Kind = Literal["accept", "warn", "reject"]


def file_name(robot: Robot) -> str:
    """Return the name of a robot's page."""
    return re.sub(r"[/\\\0]", "_", robot.name) + ".html"


def fleet_page(fleet: Fleet, label: str, head: Mapping[str, Any], pages: str, view: ArmView | None = None) -> Page:
    """Return the page of all robots.

    Args:
        fleet: robots and population.
        label: what the fleet is called.
        head: provenance, as in the result file.
        pages: address of the folder with the robots' pages, relative to this one.
        view: the arm of all of them, as it is drawn.
    """
    population, count = fleet.population, len(fleet.robots)
    sections = [_robots(fleet, pages)]
    sections += [_population(fleet, population), _next(fleet)] if population else []
    sections += [arm_section(view, "The arm that all of them are fitted to")] if view else []
    odd = len(fleet.failed) + len(fleet.doubted) + len(fleet.standing_out)
    kind: Kind = "reject" if population is None else "warn" if odd else "accept"
    arms = sorted({(robot.arm.path, robot.arm.sha256) for robot in fleet.robots})
    return Page(
        f"Fleet {cut(label, 60)}",
        f"{count} robots; {head['created'][:10]}",
        Verdict(kind, _verdict(fleet)),
        (),
        tuple(sections),
        Table(
            "Arms; each robot's own page has its files", ("what", "file", "SHA-256"), tuple(("arm", *a) for a in arms)
        ),
        (
            "Robots are of one design; a stiffness is log-normal from robot to robot, but for the few that are off.",
            *([" ".join(map(str.strip, known_by(fleet, population)))] if population else []),
        ),
        tuple(_provenance(head)),
    )


def _verdict(fleet: Fleet) -> str:
    if fleet.population is None:
        return f"No population: it takes {FEWEST} robots whose data fit, and there are {len(fleet.members)}."
    counts = {
        "stands out": [f"{fleet.robots[fleet.members[r]].name} ({said})" for r, said in outlying(fleet).items()],
        "failed": [robot.name for robot in fleet.failed],
        "has data in doubt": [robot.name for robot in fleet.doubted],
    }
    said = [f"{_some(names)} {_of(words, len(names))}" for words, names in counts.items() if names]
    return f"{'; '.join(said)}." if said else "No robot stands out, and none failed."


def _of(words: str, count: int) -> str:
    several = {"stands out": "stand out", "has data in doubt": "have data in doubt"}
    return words if count == 1 else several.get(words, words)


def _some(names: list[str], most: int = 5) -> str:
    shown, more = ", ".join(cut(name, 90) for name in names[:most]), len(names) - most
    return f"{shown} and {more} more" if more > 0 else shown


def _robots(fleet: Fleet, pages: str) -> Section:
    """Return the table of all robots: those that are odd first."""
    population = fleet.population
    place = {robot: r for r, robot in enumerate(fleet.members)}
    odd = [fleet.members[r] for r in fleet.standing_out]
    odd += [i for i, robot in enumerate(fleet.robots) if robot.failed or robot.doubts]
    rest = [i for i in range(len(fleet.robots)) if i not in set(odd)]
    names = fleet.names if population else ()
    rows = tuple(
        (cut(fleet.robots[i].name, 30), _state(fleet, i, place.get(i)), *_against(population, place.get(i), len(names)))
        for i in (*odd, *rest)
    )
    note = "Against the fleet's median, by the robot's own data and the fleet's, ± standard deviation. A robot's name "
    head = ("robot", "", *(f"{stiffness_words(name)} [%]" for name in names))
    links = tuple(f"{pages}/{quote(file_name(fleet.robots[i]))}" for i in (*odd, *rest))
    said = (
        "A robot stands out where a stiffness differs so much from the other robots' that the chance of it in a fleet "
        f"of healthy ones is below {percent(FALSE_ALARM)}."
    )
    table = Table("The robots", head, rows, note + "leads to its own page.", tuple(range(len(odd))), links)
    return Section("The robots", (said,), tables=(table,))


def _state(fleet: Fleet, i: int, r: int | None) -> str:
    robot = fleet.robots[i]
    if robot.failed:
        return "failed"
    if robot.doubts:
        return "data in doubt"
    return f"stands out: {outlying(fleet)[r]}" if r is not None and r in fleet.standing_out else ""


def _against(population: Population | None, r: int | None, count: int) -> tuple[str, ...]:
    if population is None or r is None:
        return ("",) * count
    away = np.exp(population.robot_mean[r] - population.next_mean) - 1
    each = zip(away, (1 + away) * population.robot_sd[r], strict=True)
    return tuple(f"{100 * x:+.1f} ± {100 * sd:.1f}" for x, sd in each)


def _population(fleet: Fleet, population: Population) -> Section:
    unit = in_shown_unit(fleet.names[0], 1.0)[1]
    rows = []
    for i, name in enumerate(fleet.names):
        low, middle, high = (
            f"{in_shown_unit(name, float(np.exp(x)))[0]:#.4g}"
            for x in np.quantile(population.mean[:, i], [0.025, 0.5, 0.975])
        )
        least, spread, most = map(percent, np.quantile(population.sd[:, i], [0.025, 0.5, 0.975]).tolist())
        rows.append((stiffness_words(name), middle, f"{low} to {high}", spread, f"{least} to {most}"))
    head = (f"stiffness [{unit}]", "median", "95 % interval", "spread", "95 % interval of that")
    note = "Spread: standard deviation of ln(stiffness) from robot to robot, without those that are off."
    table = Table("The population", head, tuple(rows), note)
    drawn = tuple(_picture(fleet, population, i) for i in range(len(fleet.names)))
    low, high = map(percent, np.quantile(population.share, [0.025, 0.975]).tolist())
    return Section("The population", (f"{low} to {high} of all stiffnesses are off.",), tables=(table,), pictures=drawn)


def _picture(fleet: Fleet, population: Population, i: int) -> Picture:
    words = stiffness_words(fleet.names[i])
    caption = f"{words}: each robot's own fit and its shrunk estimate with 95 % intervals, in the order of their names."
    alt = f"{words} of all robots beside the population"
    return picture(stiffness_figure(fleet, population, i), alt, caption)


def _next(fleet: Fleet) -> Section:
    rows = tuple(fleet_priors(fleet).items())
    note = "As --prior=STIFFNESS=PRIOR of ident fit takes them, in SI units; FLEET.fleet.prior holds all."
    said = "What the fleet says of the next robot before its data: with it, a few measurements are enough."
    return Section("The next robot", (said,), tables=(Table("Priors", ("stiffness", "prior"), rows, note),))


def robot_page(fleet: Fleet, i: int, label: str, head: Mapping[str, Any], above: str) -> Page:
    """Return the page of one robot.

    Args:
        fleet: robots and population.
        i: its place among the robots.
        label: what the fleet is called.
        head: provenance, as in the result file.
        above: address of the fleet's page, relative to this one.
    """
    robot, r = fleet.robots[i], fleet.members.index(i) if i in fleet.members else None
    out = r is not None and r in fleet.standing_out
    kind: Kind = "reject" if robot.failed else "warn" if robot.doubts or out else "accept"
    command = shlex.join(["ident", "fit", robot.campaign.path, "--arm", robot.arm.path])
    sections = [_stiffnesses(fleet, robot, r)] if not robot.failed else []
    findings = tuple(robot.error.splitlines()) or (f"{robot.measurements} measurements.", *map(_sentence, robot.doubts))
    sections += [Section("Data", findings, f"what its own data say, with residuals and open directions: {command}")]
    return Page(
        f"Robot {cut(robot.name, 60)}",
        f"of the fleet {cut(label, 60)}; {head['created'][:10]}",
        Verdict(kind, _of_robot(fleet, robot, r)),
        (),
        tuple(sections),
        Table(
            "Inputs",
            ("what", "file", "SHA-256"),
            (("campaign", robot.campaign.path, robot.campaign.sha256), ("arm", robot.arm.path, robot.arm.sha256)),
        ),
        (),
        tuple(_provenance(head)),
        (f"All robots of {cut(label, 60)}", above),
    )


def _of_robot(fleet: Fleet, robot: Robot, r: int | None) -> str:
    if robot.failed:
        return "It has no fit: see below."
    if robot.doubts:
        return "Its data contradict the model or each other; it is no part of the population."
    judged = fleet.deviations
    if judged is None or r is None:
        return "There is no population to compare it with."
    if r not in fleet.standing_out:
        return "Nothing stands out."
    chance = max(p for place, p in zip(judged.named, judged.chance, strict=True) if place[0] == r)
    return (
        f"{outlying(fleet)[r]} against the fleet's median; the chance that a fleet of healthy robots shows as much "
        f"is {percent(chance)}."
    )


def _stiffnesses(fleet: Fleet, robot: Robot, r: int | None) -> Section:
    population, judged, unit = fleet.population, fleet.deviations, in_shown_unit(robot.names[0], 1.0)[1]
    own = [f"{in_shown_unit(n, float(np.exp(x)))[0]:#.4g}" for n, x in zip(robot.names, robot.theta, strict=True)]
    words, sd = [stiffness_words(name) for name in robot.names], [percent(float(x)) for x in robot.sd]
    head: tuple[str, ...] = (f"stiffness [{unit}]", "own fit", "± sd of ln")
    rows = list(zip(words, own, sd, strict=True))
    if population is None or judged is None or r is None:
        return Section("Stiffnesses", (), tables=(Table("By its own data", head, tuple(rows)),))
    shrunk = [
        f"{in_shown_unit(n, float(np.exp(x)))[0]:#.4g}"
        for n, x in zip(robot.names, population.robot_mean[r], strict=True)
    ]
    against, chance = _against(population, r, len(own)), [percent(float(p)) for p in judged.p[r]]
    head = (*head, "with the fleet", "against its median [%]", "chance if healthy")
    full = tuple((*row, *more) for row, *more in zip(rows, shrunk, against, chance, strict=True))
    note = (
        "With the fleet: by its own data, in place of a prior what the other robots are like. Chance if healthy: that "
        "this stiffness of a healthy robot differs as far from the other robots'. "
        f"{len(own) * len(fleet.members)} are compared, so one stands out below about "
        f"{percent(FALSE_ALARM / len(own) / len(fleet.members))}."
    )
    return Section(
        "Stiffnesses", (), tables=(Table("Own fit and fleet", head, full, note, fleet.standing_out.get(r, ())),)
    )


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _provenance(head: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "format", str(head["format"])
    yield "created", str(head["created"])
    yield from ((name, str(version)) for name, version in head["software"].items())
    given = ((name, value) for name, value in head["options"].items() if value not in (None, [], {}, ""))
    yield from ((f"option {name}", str(value)) for name, value in given)
