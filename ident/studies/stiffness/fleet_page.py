"""A fleet as pages: an overview with one row a robot, and a page for each robot."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from ident.inference.population import FALSE_ALARM, Population
from ident.report.page import Page, Section, picture, provenance
from ident.report.report import Table, Verdict, cut
from ident.report.words import in_shown_unit, percent, sentence
from ident.studies.look.arm_page import arm_section
from ident.studies.stiffness.compare_report import stiffness_words
from ident.studies.stiffness.fleet_figure import stiffness_figure
from ident.studies.stiffness.fleet_report import (
    AGAINST_NOTE,
    against_median,
    fleet_sections,
    outlying,
    population_table,
    priors_section,
    robots_in_order,
    trust_in,
    what_stands_out,
)
from ident.text import as_word

if TYPE_CHECKING:
    from ident.identify.fleet import Fleet, Robot
    from ident.studies.look.arm_view import ArmView

FILE_HEAD = ("what", "file", "SHA-256")
"""Head of the table of input files."""


def file_name(robot: "Robot") -> str:
    """Return the name of a robot's page."""
    return re.sub(r"[/\\\0]", "_", robot.name) + ".html"


def fleet_page(fleet: "Fleet", label: str, head: Mapping[str, Any], pages: str, view: "ArmView | None" = None) -> Page:
    """Return the page of all robots.

    Args:
        fleet: robots and population.
        label: name of the fleet.
        head: provenance, as in the result file.
        pages: address of the folder with the robots' pages, relative to this one.
        view: the drawing of the arm that all robots share.
    """
    said, population = fleet_sections(fleet), fleet.population
    assert said.verdict is not None
    sections = [_robots(fleet, pages)]
    if population:
        prior = priors_section(fleet)
        tables = (replace(part, caption="Priors") for part in prior.parts if isinstance(part, Table))
        words = "With these priors a few measurements of the next robot are enough."
        sections += [_population(fleet, population), Section(prior.title, (words, *tables))]
    sections += [arm_section(view, "The arm that all of them are fitted to")] if view else []
    arms = sorted({(robot.arm.path, robot.arm.sha256) for robot in fleet.robots})
    return Page(
        f"Fleet {cut(label, 60)}",
        f"{said.subject}; {head['created'][:10]}",
        said.verdict,
        tuple(("Caution", " ".join(map(sentence, filter(None, (each.text, each.remedy))))) for each in said.findings),
        tuple(sections),
        Table("Arms; each robot's own page has its files", FILE_HEAD, tuple(("arm", *arm) for arm in arms)),
        ("Robots are of one design; a stiffness is log-normal from robot to robot, except for outliers.",),
        provenance(head),
    )


def _robots(fleet: "Fleet", pages: str) -> Section:
    """Return the table of all robots: unusual ones first."""
    population = fleet.population
    place = {robot: r for r, robot in enumerate(fleet.members)}
    order, names = robots_in_order(fleet), fleet.names if population else ()
    rows = tuple(
        (
            cut(fleet.robots[i].name, 30),
            _state(fleet, i, place.get(i)),
            *(against_median(population, place[i]) if population and i in place else ("",) * len(names)),
        )
        for i in order
    )
    odd = tuple(range(sum(bool(row[1]) for row in rows)))
    head = ("robot", "", *map(stiffness_words, names))
    links = tuple(f"{pages}/{quote(file_name(fleet.robots[i]))}" for i in order)
    note = f"Against the fleet's median. {AGAINST_NOTE} A robot's name leads to its own page."
    return Section("The robots", (what_stands_out(), Table("The robots", head, rows, (), note, odd, links)))


def _state(fleet: "Fleet", i: int, r: int | None) -> str:
    robot = fleet.robots[i]
    if robot.failed:
        return "failed"
    if robot.doubts:
        return "data in doubt"
    return f"stands out: {outlying(fleet)[r]}" if r is not None and r in fleet.standing_out else ""


def _population(fleet: "Fleet", population: Population) -> Section:
    drawn, shown = [], "each robot's own fit and its shrunk estimate with 95 % intervals, in the order of their names."
    for i, name in enumerate(fleet.names):
        words, figure = stiffness_words(name), stiffness_figure(fleet, population, i)
        drawn.append(picture(figure, f"{words} of all robots beside the population", f"{words}: {shown}"))
    table = replace(population_table(fleet, population), caption="The population")
    return Section("The population", (*trust_in(fleet, population), table), tuple(drawn))


def robot_page(fleet: "Fleet", i: int, label: str, head: Mapping[str, Any], above: str) -> Page:
    """Return the page of one robot.

    Args:
        fleet: robots and population.
        i: index of the robot.
        label: name of the fleet.
        head: provenance, as in the result file.
        above: address of the fleet's page, relative to this one.
    """
    robot, r = fleet.robots[i], fleet.members.index(i) if i in fleet.members else None
    files = {"campaign": robot.campaign, "arm": robot.arm}
    command = f"ident fit {as_word(robot.campaign.path)} --arm {as_word(robot.arm.path)}"
    sections = [_stiffnesses(fleet, robot, r)] if not robot.failed else []
    findings = tuple(robot.error.splitlines()) or (f"{robot.measurements} measurements.", *map(sentence, robot.doubts))
    sections += [Section("Data", (*findings, f"Its own fit, with all residuals: {command}"))]
    return Page(
        f"Robot {cut(robot.name, 60)}",
        f"of the fleet {cut(label, 60)}; {head['created'][:10]}",
        _of_robot(fleet, robot, r),
        (),
        tuple(sections),
        Table("Inputs", FILE_HEAD, tuple((what, file.path, file.sha256) for what, file in files.items())),
        (),
        provenance(head),
        (f"All robots of {cut(label, 60)}", above),
    )


def _of_robot(fleet: "Fleet", robot: "Robot", r: int | None) -> Verdict:
    if robot.failed:
        return Verdict("FAILED", "It has no fit; the reason is given under Data.", "bad")
    if robot.doubts:
        left_out = "Its data contradict the model or each other: it is left out of the population."
        return Verdict("DATA IN DOUBT", left_out, "caution")
    judged = fleet.deviations
    if judged is None or r is None:
        return Verdict("NO POPULATION", "There is no population to compare it with.", "caution")
    if r not in fleet.standing_out:
        return Verdict("OK", "Nothing stands out.", "good")
    chance = max(p for place, p in zip(judged.named, judged.chance, strict=True) if place[0] == r)
    healthy = f"the chance that a fleet of healthy robots shows as much is {percent(chance)}"
    return Verdict("STANDS OUT", f"{outlying(fleet)[r]} against the fleet's median; {healthy}.", "caution")


def _stiffnesses(fleet: "Fleet", robot: "Robot", r: int | None) -> Section:
    population, judged, unit = fleet.population, fleet.deviations, in_shown_unit(robot.names[0], 1.0)[1]
    own = _shown(robot, robot.theta)
    words, sd = [stiffness_words(name) for name in robot.names], [percent(float(x)) for x in robot.sd]
    head: tuple[str, ...] = (f"stiffness [{unit}]", "own fit", "std. error of ln")
    rows = list(zip(words, own, sd, strict=True))
    if population is None or judged is None or r is None:
        return Section("Stiffnesses", (Table("By its own data", head, tuple(rows)),))
    against, chance = against_median(population, r), [percent(float(p)) for p in judged.p[r]]
    head = (*head, "with the fleet", "against its median", "chance if healthy")
    columns = _shown(robot, population.robot_mean[r]), against, chance
    full = tuple((*row, *more) for row, *more in zip(rows, *columns, strict=True))
    note = (
        "With the fleet: by its own data, with the fleet as the prior. Chance if healthy: probability that this "
        "stiffness of a healthy robot differs as much from the other robots. "
        f"{len(own) * len(fleet.members)} are compared, so one stands out below about "
        f"{percent(FALSE_ALARM / len(own) / len(fleet.members))}."
    )
    return Section("Stiffnesses", (Table("Own fit and fleet", head, full, (), note, fleet.standing_out.get(r, ())),))


def _shown(robot: "Robot", theta: np.ndarray) -> list[str]:
    """Write the stiffnesses of a robot in display units."""
    values = zip(robot.names, np.exp(theta).tolist(), strict=True)
    return [f"{in_shown_unit(name, value)[0]:#.4g}" for name, value in values]
