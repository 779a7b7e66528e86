"""What the report says of assumptions: what is asked for, what can't be told, in lines of a terminal."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.assumptions import Assumption, Assumptions
from ident.identify.fit import fit_campaign
from ident.inference.score import ScoreTest
from ident.measure import read_campaign
from ident.present.text.assumptions import assumption_lines


@pytest.fixture(scope="module")
def fit():
    return fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), starts=1)


def scored(z, *, seen=True, apart=0.5, positive=True, shift=0.0, sd=0.02):
    return ScoreTest(0.1, positive, np.array([shift, 0, 0, 0, 0, 0]), seen, apart, z, sd)


def lines(fit, *items):
    return list(assumption_lines(replace(fit, assumptions=Assumptions(items, 0.5))))


def test_what_the_data_ask_for_is_named_with_how_much_and_what_to_do(fit):
    sd = fit.information.sd[0]
    found = lines(
        fit,
        Assumption("base rocks", "", scored(6.0, shift=2.5 * sd)),
        Assumption("link bends", "joint1", scored(1.0)),
        Assumption("link bends", "joint2", scored(4.5)),
    )
    assert "+2.5 sd joint1.k_bend" in found[1]
    assert found[1].endswith("ASKED FOR: z +6.0")
    assert found[2].endswith("ASKED FOR: z +4.5 (joint2)")
    assert "most of all: base rocks" in found[-3]
    assert "12 % +- 2 %" in found[-2]
    assert found[-1] == "  Fit again with --soft-base 0.5"


def test_what_they_do_not_ask_for_and_what_they_cannot_tell(fit):
    found = lines(
        fit,
        Assumption("base rocks", "", scored(-6.0)),
        Assumption("base turns", "", scored(6.0, apart=1e-14)),
        Assumption("link twists", "joint1", scored(np.nan, seen=False, apart=0.0)),
        Assumption("mass", "joint1", scored(-1.2, positive=False)),
    )
    said = [line.rsplit("  ", 1)[1].strip() for line in found[1:5]]
    assert said == ["not asked for, z -6.0", "cannot be told apart", "do not depend on it", "not asked for, |z| 1.2"]
    assert "WARNING" not in "\n".join(found)


def test_no_optimum_no_verdict(fit):
    assert list(assumption_lines(replace(fit, assumptions=None))) == [
        "What this fit takes for granted: not looked at, as this is no optimum"
    ]


def test_long_names_keep_within_the_terminal(fit):
    long = "a_joint_with_a_name_of_unusual_length"
    names = tuple(f"{long}.k_tors" for _ in fit.information.names)
    known = replace(fit.information, names=names)
    test = scored(9.0, shift=100.0)
    found = lines(
        replace(fit, information=known),
        *(Assumption(kind, long, test) for kind in ("link bends", "mass centre", "servo gives")),
    )
    assert max(map(len, found)) <= 100
