"""What is said of a fleet: its verdict, who stands out, and all of it on one screen; robots with normal likelihoods."""

from dataclasses import replace

import numpy as np
import pytest
from reports import assert_one_screen

from ident.identify.fleet import Robot, SourceFile, fleet
from ident.inference.population import Likelihood
from ident.report.report import text_of
from ident.studies.stiffness.fleet_report import fleet_sections

NAMES = tuple(f"joint{j}.{field}" for field in ("k_bend", "k_tors") for j in (1, 2, 3))
MEDIAN = np.log(3e5)


def robots(faults=(), count=8):
    """Robots that differ by 5 % from each other, their data good to 1 %; those at (robot, stiffness) 40 % lower."""
    theta = MEDIAN + 0.05 * np.random.default_rng(0).standard_normal((count, len(NAMES)))
    for place in faults:
        theta[place] += np.log(0.6)
    precision = np.eye(len(NAMES)) / 0.01**2
    return [
        Robot(
            name=f"robot{r:03d}",
            campaign=SourceFile(f"robots/robot{r:03d}.csv"),
            arm=SourceFile("robots/arm.toml"),
            names=NAMES,
            theta=own,
            sd=np.full(len(NAMES), 0.01),
            prior_mean=np.full(len(NAMES), MEDIAN),
            prior_sd=np.ones(len(NAMES)),
            likelihood=Likelihood(precision, precision @ own),
            measurements=20,
        )
        for r, own in enumerate(theta)
    ]


def failed(name):
    campaign, arm = SourceFile(f"robots/{name}.csv"), SourceFile("robots/arm.toml")
    return Robot(name=name, campaign=campaign, arm=arm, error=f"{name}.csv: got no rows")


def said(robots, out=0):
    """What is said of them, on one screen."""
    report = fleet_sections(fleet(robots))
    assert_one_screen(text_of(report), files=5, extra=out)
    return report


@pytest.mark.parametrize(
    ("made", "word"),
    [
        (robots(), "NONE STANDS OUT"),
        ([*robots(), failed("broken")], "INCOMPLETE"),
        ([*robots()[1:], replace(robots()[0], doubts=("a kind contradicts another one",))], "INCOMPLETE"),
        ([*robots()[:2], failed("broken")], "NO POPULATION"),
        ([failed("broken")], "NO POPULATION"),
    ],
)
def test_the_verdict_where_none_stands_out(made, word):
    report = said(made)
    assert report.verdict.word == word
    assert ("Failed: broken." in report.verdict.reason) == any(robot.failed for robot in made)


def test_who_stands_out_is_named_with_the_joint_and_by_how_much():
    report = said([*robots([(3, 4)]), failed("{broken}")], out=1)
    assert report.verdict.word == "1 OF 8 STANDS OUT"
    out, population = report.answer
    assert len(population.rows) == len(NAMES)
    ((name, stiffness, change, healthy, chance),) = out.rows
    assert (name, stiffness) == ("robot003", "joint2 in torsion")
    assert -45 < float(change.removesuffix(" %")) < -35
    assert report.verdict.reason.endswith(f"robot003 (joint2 in torsion {change}). Failed: {{broken}}.")
    assert healthy.startswith("-")
    assert float(chance.removesuffix(" %")) < 3
    assert "joint2 in torsion of robot003" in report.findings[0].text
    assert report.next == "ident fit robots/robot003.csv --arm robots/arm.toml"


@pytest.mark.slow
def test_many_that_stand_out_have_a_line_each():
    report = said(robots([(3, 4), (3, 0), (7, 2), (11, 5)], count=16), out=3)
    assert report.verdict.word == "3 OF 16 STAND OUT"
    assert [row[0] for row in report.answer[0].rows if "(and 1 more)" in row[1]] == ["robot003"]
    details = next(section for section in report.details if section.title == "Robots that stand out")
    assert len(details.parts[0].rows) == 4
