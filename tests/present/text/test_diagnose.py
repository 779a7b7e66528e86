"""What a diagnosis says: verdicts, changes and verifications in words."""

import re

import numpy as np
import pytest
from arms import DATA, lcd_arm
from runs import short, swing

from ident.assess.diagnose import Diagnosis, Identification
from ident.assess.remedies import Remedy, Task, Verification, VibrationAssessment
from ident.assess.scenario import OverPhases
from ident.description.file import read_arm
from ident.identify.compare import CampaignSample
from ident.present.text.diagnose import StageReport, change_words, stage_report, verdict_words
from ident.studies.diagnose import DiagnoseOptions
from ident.studies.motion import basis_of
from ident.vibrate.evaluator import binomial_estimate

pytestmark = pytest.mark.slow

GOOD, BAD = (binomial_estimate(np.arange(100) < count) for count in (99, 50))
SMALL, LARGE = np.full(3, 4e-4), np.full(3, 6e-4)


def remedy(meets_limit: bool) -> Remedy:
    values, before = {"joint1.k_tors": 3e5}, {"joint1.k_tors": 2e5}
    return Remedy("torsion", values, before, 10.0, 10.0, SMALL, GOOD if meets_limit else BAD, 4.0, 0.02, 0.2)


def diagnosis(meets_limit: bool, holds: tuple[bool, ...], excess: float = 1.4, phases: str = "file") -> Diagnosis:
    """A vibration of `excess` times the limit, and a remedy for each verification."""
    basis = basis_of(read_arm(DATA / "lcd_arm" / "arm.toml"), DiagnoseOptions(phases=phases))
    division = np.array([[0.0, 1e-4, 0.0], [0.0, 6e-4, 0.0], [0.0, 0.0, 0.0]])
    over = None if phases == "file" else OverPhases(np.full((3, 9), 5e-4), division.sum(0)[:, None], division)
    response = short(lcd_arm(), swing())
    limit = float(np.abs(np.asarray(response.vibration)).max()) / excess
    vibration = VibrationAssessment(response, SMALL, np.ones((3, 100)), BAD, limit, over)
    verifications = tuple(Verification(SMALL if good else LARGE, GOOD if good else BAD, 5e-4) for good in holds)
    begun = Diagnosis().then("stiffness", Identification(object.__new__(CampaignSample), Task(basis, limit)))
    begun = begun.then("vibration", vibration).then("remedies", (remedy(meets_limit),) * len(holds))
    return begun.then("verification", verifications)


@pytest.mark.parametrize(
    ("meets_limit", "holds", "verdict", "said"),
    [
        (True, (True,), "warn", "the limit is then kept by 99 of 100 draws"),
        (True, (False, True), "warn", "the limit is then kept by 99 of 100 draws"),
        (
            True,
            (False,),
            "reject",
            "and the one remedy verified did not hold. Make joint 1 50 % stiffer in torsion: that brings it to 0.6 mm",
        ),
        (True, (False, False, False), "reject", "and none of the 3 remedies verified held."),
        (False, (True,), "reject", "and no change tried meets the limit."),
    ],
)
def test_the_verdict_says_what_the_verification_said(meets_limit, holds, verdict, said):
    diagnosed = diagnosis(meets_limit, holds)
    assert diagnosed.verdict == verdict
    words = verdict_words(diagnosed)
    assert said in words
    assert "mm, more than" in words


def test_a_vibration_below_the_limit_may_still_be_too_likely_above():
    assert ", but not surely, and no change" in verdict_words(diagnosis(False, (False,), excess=0.9))


def test_a_verification_says_what_was_asked_for():
    one, two = (stage_report(diagnosis(True, holds), "verification").findings for holds in ((False,), (False, True)))
    assert len(one) == 2
    assert "does NOT keep" in one[0]
    assert one[1].endswith("; 95 % are asked for.")
    assert two[:2] == one
    assert "which keeps the limit" in two[2]
    assert "same draws" in two[-1]


def test_a_change_that_is_too_small_has_no_word():
    values = {"joint1.k_tors": 2.009e5, "joint2.k_tors": 3e5, "fingers.com.x": 1.0004, "bracket.com.x": 0.187}
    before = {"joint1.k_tors": 2e5, "joint2.k_tors": 2e5, "fingers.com.x": 1.0, "bracket.com.x": 0.2}
    changed = Remedy("both", values, before, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.2)
    expected = "make joint 2 50 % stiffer in torsion and move the mass centre of bracket by -13 mm in x"
    assert change_words(changed) == expected
    assert change_words(Remedy("both", before, before, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.2)) == "change nothing"
    slower = Remedy("speed", {}, {}, 5.0, 10.0, SMALL, GOOD, 4.0, 0.02, 1.0)
    assert change_words(slower) == "run at 5 % of full speed instead of 10 %"


def test_several_stiffnesses_are_one_sentence():
    values = {"joint1.k_tors": 3e5, "joint2.k_tors": 1e5, "shoulder.k_tors": 3e5}
    before = dict.fromkeys(values, 2e5)
    words = change_words(Remedy("torsion", values, before, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.2))
    assert words == "make joint 1 50 % stiffer, joint 2 50 % softer and shoulder 50 % stiffer in torsion"


def test_the_verdict_says_what_makes_the_vibration_and_what_its_probability_leaves_out():
    """What is assumed of the drives stands in the sentence of the probability; drawn phases are no part of it."""
    known, drawn = (verdict_words(diagnosis(True, (True,), phases=phases)) for phases in ("file", "unknown"))
    sentence = known[known.index("is then kept by") :]
    taken = [
        int(re.search(r"with (\d+) assumed numbers of drives, belts and stroke", words)[1]) for words in (known, drawn)
    ]
    assert "." not in sentence[sentence.index("assumed") : -1]
    assert taken[0] - taken[1] == len(lcd_arm().drives)
    made = "Of 0.7 mm with the worst phases of the turning masses the motion itself makes 0.1 mm, imbalance 0.6 mm and "
    assert made + "kinematic error nothing, as none is assumed." in drawn
    assert "posterior and of the phases" in drawn
    assert "worst phases" not in known


def test_a_stage_is_printed_with_its_number():
    report = StageReport(2, "Does it?", ("It does.", "Twice."), "Go on.", resumed=True)
    assert str(report) == "2. Does it? (as found before)\n   It does.\n   Twice.\n   -> Go on."
    assert str(StageReport(6, "Does it hold?", ("Yes.",))) == "6. Does it hold?\n   Yes."
