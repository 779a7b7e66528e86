"""The report of a recovery, by rates made up: its verdict, its bands, what to do next."""

from types import SimpleNamespace

import pytest
from reports import assert_one_screen
from scipy.stats import beta, binom

from ident.identify.fit import CampaignFit
from ident.identify.recovery import CHANGED, RATES, RIGHT, Recovery
from ident.inference.parameters import Parameter
from ident.report.report import text_of
from ident.studies.stiffness.recovery_report import recovery_sections

NAMES = ("joint1.k_bend", "joint1.k_tors", "link1.com.x")
ITEMS = tuple(Parameter((name,), "k_" in name, 1.0, 1.0, 1.0) for name in NAMES)
FIT = object.__new__(CampaignFit)  # of a fit the report needs only names
for place, value in {
    "arm": SimpleNamespace(name="arm"),
    "campaign": SimpleNamespace(name="campaign"),
    "problem": SimpleNamespace(parameters=SimpleNamespace(items=ITEMS)),
}.items():
    object.__setattr__(FIT, place, value)


def recovery(held=(95, 93, 96), intervals=(100, 98, 100), alarms=2, power=(0.99, 0.97, None), row_off=18):
    bias, errors, level = (0.001, -0.02, 0.0015), (0.002, 0.01, 0.0005), (0.95,) * 3
    numbers = zip(NAMES, bias, errors, held, intervals, level, power, strict=True)
    rates = tuple(dict(zip(RATES, row, strict=True)) for row in numbers)
    noticed = {RIGHT: (alarms, 100), CHANGED: (17, 20), "one row 6 sigma off": (row_off, 20), "labels swapped": (0, 0)}
    return Recovery(FIT, "prior", rates, noticed, 17.4)


def test_right_intervals_are_recovered():
    report = recovery_sections(recovery())
    assert report.verdict.word == "RECOVERED"
    assert report.verdict.reason == ("Of 100 robots, each 95 % interval holds the truth of 95 to 96 %; 2 false alarms.")
    unknowns, wrong = report.answer
    low, high = binom.interval(0.95, 98, 0.95)
    assert unknowns.texts[1][1:] == ("-2 % ± 2 %", "93 of 98", f"{low:.0f} to {high:.0f}", "97 %")
    assert unknowns.texts[2][1:3] == ("+1.5 mm ± 0.98 mm", "96 of 100")
    ends = beta.ppf([0.025, 0.975], (18, 19), (3, 2))  # Clopper, Pearson
    assert wrong.texts[2] == ("one row 6 sigma off", "18 of 20", f"{100 * ends[0]:.0f} to {100 * ends[1]:.0f} %")
    assert wrong.texts[1][1] == "17 of 20; by the linear problem 17.4"
    assert wrong.texts[3][1:] == ("0 of 0", "-")
    assert not report.findings
    assert report.next == "ident sample {campaign}"
    assert_one_screen(text_of(report), files=1)


@pytest.mark.parametrize(
    ("held", "alarms", "named"),
    [((95, 80, 96), 2, "joint1.k_tors"), ((95, 93, 96), 12, RIGHT), ((100, 98, 60), 2, "link1.com.x")],
)
def test_a_rate_outside_its_band_is_named(held, alarms, named):
    wrong = recovery(held, alarms=alarms)
    assert wrong.missed == (named,)
    report = recovery_sections(wrong)
    assert report.verdict.word == "NOT RECOVERED"
    assert report.verdict.reason.startswith(f"Outside the binomial band: {named}. ")
    assert report.next == "ident profile {campaign}"


def test_what_is_often_unnoticed_is_said():
    report = recovery_sections(recovery(power=(0.99, 0.5, None), row_off=12))
    (finding,) = report.findings
    assert finding.text == "Often unnoticed: a change of joint1.k_tors, one row 6 sigma off"
    assert report.next == "ident plan {campaign}"


def test_no_interval_is_no_recovery():
    nothing = recovery((0, 0, 0), (0, 0, 0), power=(0.0, 0.99, None))
    assert nothing.covered == 0
    report = recovery_sections(nothing)
    assert report.verdict.word == "NOT RECOVERED"
    assert report.verdict.reason == "Of 100 robots, each 95 % interval is not reported; 2 false alarms."
    assert report.answer[0].texts[0][2:] == ("0 of 0", "-", "0 %")
    assert report.findings[0].text == "Often unnoticed: a change of joint1.k_bend"
