"""What the report says of assumptions: what is asked for, what can't be told, in lines of a terminal."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.fit import KINDS, Assumption, Assumptions, fit_campaign
from ident.inference.information import ScoreTest
from ident.inference.parameters import Parameter, Parameters
from ident.measure import read_campaign
from ident.present.text.fit import fit_report
from ident.present.text.warnings import asked_for_lines, assumption_lines

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fit():
    return fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), starts=1)


def scored(z, *, seen=True, apart=0.5, positive=True, shift=0.0, sd=0.02):
    return ScoreTest(0.1, positive, np.array([shift, 0, 0, 0, 0, 0]), seen, apart, z, sd)


def taking(fit, *items):
    return replace(fit, assumptions=Assumptions(items, 0.5))


def lines(fit, *items):
    return list(assumption_lines(taking(fit, *items)))


def asking(fit):
    sd = fit.information.sd[0]
    return (
        Assumption("base rocks", "", scored(6.0, shift=2.5 * sd)),
        Assumption("link bends", "joint1", scored(1.0)),
        Assumption("link bends", "joint2", scored(4.5)),
    )


def test_what_the_data_ask_for_is_named_with_how_much_and_what_to_do(fit):
    found = lines(fit, *asking(fit))
    assert "+2.5 sd joint1.k_bend" in found[1]
    assert found[1].endswith("ASKED FOR: z +6.0")
    assert found[2].endswith("ASKED FOR: z +4.5 (joint2)")
    warning = list(asked_for_lines(taking(fit, *asking(fit))))
    assert "most of all: base rocks" in warning[0]
    assert "12 % +- 2 % of joint 1's bending compliance" in warning[1]
    assert warning[-1] == "  Fit again with --soft-base 0.5"


def test_what_the_data_ask_for_limits_the_answer_but_withholds_no_interval(fit):
    report = fit_report(taking(fit, *asking(fit)))
    limits = report.index("What limits them")
    assert limits < report.index("WARNING: the data ask for an assumption") < report.index("What this fit takes")
    assert "Nothing in the data speaks against them" not in report
    assert "withheld" not in report


def test_an_sd_is_said_only_of_an_interval_that_is_quoted(fit):
    """In doubt, a value moves by so many percent; of what the data leave open nothing is said beside what they know."""
    shift = 2.5 * fit.information.sd[0]
    doubtful = replace(fit, predicted=fit.predicted * 1.1)
    (row,) = [line for line in lines(doubtful, asking(fit)[0]) if line.startswith("  base rocks")]
    assert f"+{100 * np.expm1(shift):.2g} % joint1.k_bend" in row
    assert "may be the cause: look for one first" in "".join(asked_for_lines(taking(doubtful, *asking(fit))))
    known = replace(fit.information, data_sd=np.where(np.arange(6) == 0, np.inf, fit.information.data_sd))
    test = replace(scored(1.0), shift=np.array([9.0, 0.0, 0, 0, 0, 0.1 * fit.information.sd[5]]))
    row = lines(replace(fit, information=known), Assumption("base rocks", "", test))[1]
    assert "+0.1 sd joint3.k_tors" in row


def test_a_length_moves_by_millimetres_and_the_columns_say_so(fit):
    assert "where it has none, in percent; and" in " ".join(lines(fit, *asking(fit)))
    x = Parameter(("link3.com.x",), False, 0.3, 0.3, 0.1, scale=0.1)
    unknowns = Parameters((x, *fit.problem.parameters.items[1:]))
    names = tuple(item.name for item in unknowns.items)
    known = replace(fit.information, names=names)
    doubtful = replace(
        fit, problem=replace(fit.problem, parameters=unknowns), information=known, predicted=fit.predicted * 1.1
    )
    found = lines(doubtful, Assumption("base rocks", "", scored(1.0, shift=0.02)))
    assert "+2 mm link3.com.x" in found[1]
    assert "where it has none, in percent, or in its unit where it may be negative; and" in " ".join(found)


def test_the_columns_are_explained_with_every_share_and_its_origin(fit):
    found = " ".join(lines(fit, *(Assumption(kind, "joint1", scored(1.0)) for kind in KINDS)))
    for kind in KINDS.values():
        assert kind.of in found
        assert all(part in found for part in kind.origin.split("; "))
    assert "of the joint in brackets" in found


def test_what_they_do_not_ask_for_and_what_they_cannot_tell(fit):
    found = lines(
        fit,
        Assumption("base rocks", "", scored(-6.0)),
        Assumption("base turns", "", scored(6.0, apart=1e-14)),
        Assumption("link twists", "joint1", scored(np.nan, seen=False, apart=0.0)),
        Assumption("mass", "joint1", scored(-1.2, positive=False)),
    )
    said = [line.rsplit("  ", 1)[1].strip() for line in found[1:5]]
    mass = "not asked for: z -1.2 (joint1)"
    assert said == ["not asked for: z -6.0", "cannot be told apart", "do not depend on it", mass]


def test_a_row_speaks_of_the_joint_of_the_largest_score(fit):
    """Of what can't be negative the largest, of a mass the farthest from zero."""
    pair = [(("link bends", -3.0), ("link bends", 0.5)), (("mass", 1.0), ("mass", -2.0))]
    for two in pair:
        rows = [Assumption(kind, f"joint{i}", scored(z, positive=kind != "mass")) for i, (kind, z) in enumerate(two, 1)]
        assert lines(fit, *rows)[1].endswith(f"z {two[1][1]:+.1f} (joint2)")


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
    assert max(map(len, found[:4])) <= 100
