"""Two values that were taken for each other are named; data that are right, or wrong otherwise, name none."""

from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.exchangeable import exchangeable, moves_of
from ident.identify.explanations import Change, Explanation, Explanations
from ident.identify.fit import CampaignFit, _suspected, fit_campaign
from ident.identify.problem import pose
from ident.inference.fit import fit
from ident.measure import Campaign, read_campaign
from ident.report.report import text_of
from ident.studies.stiffness.fit_report import fit_sections

slow = pytest.mark.slow

SHIPPED = read_campaign(DATA / "lcd_arm" / "campaign.csv")


def fitted(campaign: Campaign) -> CampaignFit:
    return fit_campaign(lcd_arm(), campaign, starts=1)


def exchanged(i: int, j: int, campaign: Campaign = SHIPPED) -> Campaign:
    rows = list(campaign.measurements)
    one, other = rows[i], rows[j]
    rows[i], rows[j] = (replace(a, value=b.value, sigma=b.sigma) for a, b in ((one, other), (other, one)))
    return replace(campaign, measurements=tuple(rows))


def without_labels(blank: Iterable[int]) -> Campaign:
    rows = (replace(m, mode=None) if i in set(blank) else m for i, m in enumerate(SHIPPED))
    return replace(SHIPPED, measurements=tuple(rows))


@pytest.fixture(scope="module")
def right():
    return fitted(SHIPPED)


@slow
@pytest.mark.parametrize(
    "rows",
    [(12, 13), (4, 19)],
    ids=["labels that decide the modes", "far deflections"],
)
def test_two_values_that_were_taken_for_each_other_are_named_with_what_the_fit_would_be(right, rows):
    found = fitted(exchanged(*rows))
    assert found.doubts
    assert found.exchanges[0].rows == rows
    assert found.exchanges[0].chi_squared == pytest.approx(right.chi_squared, rel=1e-4)
    names = " and ".join(SHIPPED.measurements[i].where.rpartition(":")[2] for i in rows)
    (finding,) = [each.text for each in fit_sections(found).findings if "swapped" in each.text]
    what = "values" if SHIPPED.measurements[rows[0]].mode is None else "labels"
    assert f"the {what} of rows {names} are probably swapped" in finding
    assert "Masses and lengths alone" not in " ".join(each.text for each in fit_sections(found).findings)


@slow
def test_a_swap_among_the_causes_is_said_once(right):
    found = fitted(exchanged(5, 6))
    swap = Explanation((Change("exchange", "", (5, 6)),), right.chi_squared, True)
    report = fit_sections(replace(found, explanations=Explanations(found.chi_squared, (swap,), ())))
    words = " ".join(text_of(report).split())
    assert "the labels of rows 12, 13 are swapped swap them, or check the mode shapes" in words
    assert words.count("swapped") == text_of(report, details=True).count("swapped") == 1


@slow
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
    assert (1, 15) in set(exchangeable(blank)), "of two postures"


@slow
def test_values_without_a_label_are_put_in_order_where_they_come_to(right):
    """By the exchange each of them, and others beside, takes another place in the order of its posture."""
    rows, campaign = (3, 18), exchanged(3, 18, without_labels(range(20)))
    plain = fit(pose(lcd_arm(), campaign).problem, starts=1)
    found = CampaignFit(**{f.name: getattr(plain, f.name) for f in fields(plain)}, arm=lcd_arm(), campaign=campaign)
    found = replace(found, exchanges=_suspected(found))
    assert found.doubts
    assert found.exchanges[0].rows == rows
    assert found.exchanges[0].chi_squared == pytest.approx(right.chi_squared, rel=1e-4)


@pytest.mark.parametrize("pair", [(0, 7), (1, 18), (3, 15), (4, 9), (2, 12)])
@pytest.mark.parametrize("labels", [(), (0, 12)], ids=["no label", "two labels"])
def test_exchanged_values_come_to_the_rows_where_they_would_have_been(pair, labels):
    """Of each posture, the values in the order of the modes are those of the campaign before the exchange."""
    before = without_labels(set(range(20)) - set(labels))
    wrong = exchanged(*pair, before)
    moves = moves_of(wrong)(pair)
    assert sorted(moves) == sorted(moves.values())
    values = [wrong.measurements[moves.get(i, i)].value for i in range(20)]
    for state in range(4):
        own = [i for i in range(5 * state, 5 * state + 4) if i not in labels]
        in_order = sorted(own, key=lambda i: wrong.measurements[i].value)
        assert [values[i] for i in in_order] == sorted(before.measurements[i].value for i in own)
    for i in (*labels, 4, 9, 14, 19):
        assert values[i] == before.measurements[i].value
