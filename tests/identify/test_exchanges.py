"""Two values that were taken for each other are named; data that are right, or wrong otherwise, name none."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.fit import CampaignFit, exchangeable, fit_campaign
from ident.measure import Campaign, read_campaign
from ident.present.text.fit import fit_report

SHIPPED = read_campaign(DATA / "lcd_arm" / "campaign.csv")


def fitted(campaign: Campaign) -> CampaignFit:
    return fit_campaign(lcd_arm(), campaign, starts=4)


def exchanged(i: int, j: int) -> Campaign:
    rows = list(SHIPPED.measurements)
    one, other = rows[i], rows[j]
    rows[i], rows[j] = (replace(a, value=b.value, sigma=b.sigma) for a, b in ((one, other), (other, one)))
    return replace(SHIPPED, measurements=tuple(rows))


@pytest.fixture(scope="module")
def right():
    return fitted(SHIPPED)


@pytest.mark.parametrize(
    "rows",
    [(5, 6), (2, 3), (12, 13), (9, 14), (4, 19)],
    ids=["labels", "labels of a state", "labels that decide the modes", "deflections", "far deflections"],
)
def test_two_values_that_were_taken_for_each_other_are_named_with_what_the_fit_would_be(right, rows):
    found = fitted(exchanged(*rows))
    assert found.doubts
    assert found.exchanges[0].rows == rows
    assert found.exchanges[0].chi_squared == pytest.approx(right.chi_squared, rel=1e-4)
    names = " and ".join(SHIPPED.measurements[i].where.rpartition(":")[2] for i in rows)
    report = fit_report(found)
    assert f"REMARK: rows {names}, their values exchanged, would fit (chi-squared " in report
    assert "-> 9.38)" in report
    assert "is nearly fixed by masses and lengths" not in report, "no reason to look there"


def test_what_is_right_or_wrong_otherwise_names_none(right):
    assert right.exchanges == ()
    rows = list(SHIPPED.measurements)
    rows[5] = replace(rows[5], value=1.1 * rows[5].value)
    typing_error = fitted(replace(SHIPPED, measurements=tuple(rows)))
    assert typing_error.outliers.any()
    assert typing_error.exchanges == ()


def test_only_values_that_may_be_confused_are_compared():
    pairs = set(exchangeable(SHIPPED))
    assert (0, 1) in pairs, "two labels at one posture"
    assert (4, 9) in pairs, "one point at two postures"
    assert not {(0, 4), (0, 6), (1, 5)} & pairs, "another kind; other label and other posture"
    blank = replace(SHIPPED, measurements=tuple(replace(m, mode=None) for m in SHIPPED if m.kind == "frequency"))
    assert not [pair for pair in exchangeable(blank) if np.ptp(np.array(pair) // 4) == 0], "in order anyhow"
