"""What a diagnosis says: verdicts, causes, remedies and stages."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from runs import short, swing

from ident.description.file import read_arm
from ident.identify.sample import CampaignSample
from ident.studies.cure.diagnose import DiagnoseOptions
from ident.studies.cure.diagnose_report import (
    StageReport,
    cause_and_remedies,
    change_words,
    contribution_words,
    judged,
    vibration_line,
)
from ident.studies.cure.diagnosis import Diagnosis, Identification, ResonanceAssessment
from ident.studies.cure.remedies import Remedy, Task, Verification, VibrationAssessment
from ident.studies.motion_options import basis_of
from ident.studies.scenario import OverPhases
from ident.vibrate.binomial import binomial_estimate
from ident.vibrate.schedule import Path, Schedule
from ident.vibrate.sweep import Sensitivities

pytestmark = pytest.mark.slow

GOOD, BAD = (binomial_estimate(np.arange(100) < count) for count in (99, 50))
SMALL, LARGE = np.full(3, 4e-4), np.full(3, 6e-4)


def remedy(meets_limit: bool) -> Remedy:
    values, before = {"joint1.k_tors": 3e5}, {"joint1.k_tors": 2e5}
    return Remedy("torsion", values, before, 10.0, 10.0, SMALL, GOOD if meets_limit else BAD, 4.0, 0.02, 0.2)


SLOWER = Remedy("speed", {}, {}, 5.0, 10.0, SMALL, GOOD, 4.0, 0.02, 1.0, 63.0)
ARM = read_arm(DATA / "lcd_arm" / "arm.toml").arm
SPEEDS = Schedule(
    Path.of_stroke(ARM, ARM.stroke, 10.0), np.radians([142.0, 70.0, 0.0]), np.radians([0.0, 5.0, 0.0]), (0.2, 0.2)
)
AHEAD = Remedy("schedule", {}, {}, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.4, 12.0, SPEEDS)


def diagnosis(meets_limit=True, holds=(), excess=1.4, phases="file", doubts=(), keeps=BAD) -> Diagnosis:
    """A vibration of `excess` times the limit, a remedy for each verification, and a lower speed."""
    basis = basis_of(read_arm(DATA / "lcd_arm" / "arm.toml"), DiagnoseOptions(phases=phases))
    division = np.array([[0.0, 1e-4, 0.0], [0.0, 6e-4, 0.0], [0.0, 0.0, 0.0]])
    over = None if phases == "file" else OverPhases(np.full((3, 9), 5e-4), division.sum(0)[:, None], division)
    response = short(lcd_arm(), swing())
    limit = float(np.abs(np.asarray(response.vibration)).max()) / excess
    vibration = VibrationAssessment(response, SMALL, np.ones((3, 100)), keeps, limit, over)
    verifications = tuple(Verification(SMALL if good else LARGE, GOOD if good else BAD, 5e-4) for good in holds)
    sampled = object.__new__(CampaignSample)
    object.__setattr__(sampled, "fitted", SimpleNamespace(doubts=doubts))
    identified, slopes = Identification(sampled, Task(basis, limit)), object.__new__(Sensitivities)
    begun = Diagnosis(identified, (), ResonanceAssessment(), vibration, slopes)
    remedies = (*(remedy(meets_limit) for _ in holds), SLOWER)
    return replace(begun, remedies=remedies, verifications=verifications) if holds else begun


@pytest.mark.parametrize(
    ("options", "word", "kind"),
    [
        ({}, "NOT OK", "bad"),
        ({"excess": 0.9}, "NOT DECIDED", "caution"),
        ({"excess": 0.9, "keeps": GOOD}, "OK", "good"),
        ({"excess": 1.4, "keeps": GOOD}, "NOT OK", "bad"),
        ({"excess": 0.9, "keeps": GOOD, "doubts": ("frequencies and deflections disagree",)}, "NOT DECIDED", "caution"),
    ],
)
def test_the_verdict_is_that_of_peak_draws_and_fit(options, word, kind):
    verdict = judged(diagnosis(**options))
    assert (verdict.word, verdict.kind) == (word, kind)
    assert ("exceeds" if options.get("excess") != 0.9 else "is within") in verdict.reason
    assert "it is kept with probability " in verdict.reason
    assert "% (95 % interval)" in verdict.reason


STIFFER = "new part: make joint 1 50 % stiffer in torsion"


@pytest.mark.parametrize(
    ("meets_limit", "holds", "verdict", "said"),
    [
        (
            True,
            (True,),
            "warn",
            f"{STIFFER} (2e5 to 3e5 N m/rad): 0.4 mm, limit kept with probability 94 to 100 % (exact equations and ",
        ),
        (True, (False, True), "warn", f"{STIFFER} (2e5 to 3e5 N m/rad): 0.4 mm"),
        (True, (False,), "reject", f"the one remedy verified does not hold; the best: {STIFFER[10:]}: 0.6 mm"),
        (True, (False, False, False), "reject", "none of the 3 remedies verified holds"),
        (False, (True,), "reject", "none of the 2 remedies tried keeps the limit"),
    ],
)
def test_the_remedy_is_what_the_verification_left(meets_limit, holds, verdict, said):
    diagnosed = diagnosis(meets_limit, holds)
    assert diagnosed.verdict == verdict
    labels = dict(cause_and_remedies(diagnosed))
    assert labels["Remedy"].startswith(said)
    assert ("or" in labels) == (verdict == "warn")


def test_another_remedy_says_that_it_is_not_verified():
    arrival = diagnosis().task.basis.motion.arrival
    words = dict(cause_and_remedies(diagnosis(True, (True,))))["or"]
    assert words.startswith("software: run at 5 % of full speed instead of 10 %")
    assert f"(63 s instead of {arrival:.3g} s): 0.4 mm" in words
    assert words.endswith("(fast method and the search's own draws, not verified)")


@pytest.mark.parametrize(
    ("first", "cures"),
    [
        (SLOWER, ["software: run at 5 %", "screwdriver: balance", "new part: make"]),
        (remedy(True), ["new part: make", "software: run at 5 %"]),
        (AHEAD, ["software: set the speed along the path (12 s instead of", "screwdriver: balance", "new part: make"]),
    ],
)
def test_cures_by_effort_name_what_was_not_computed(monkeypatch, first, cures):
    monkeypatch.setattr(
        "ident.studies.cure.diagnose_report._resonant", lambda resonance, arm: "imbalance of drive 2 excites a mode"
    )
    given = diagnosis(True, (True,))
    others = remedy(True), SLOWER
    ranked = (first, *(each for each in others if each.kind != first.kind))
    said = [text for label, text in cause_and_remedies(replace(given, remedies=ranked)) if label != "Cause"]
    assert len(said) == len(cures)
    assert all(text.startswith(cure) for text, cure in zip(said, cures, strict=True))
    assert all("not computed" in text for text in said if "see ident" in text)
    assert ("at one lower speed 63 s" in said[0]) == (first is AHEAD)


def test_a_change_that_is_too_small_has_no_word():
    values = {"joint1.k_tors": 2.009e5, "joint2.k_tors": 3e5, "fingers.com.x": 1.0004, "bracket.com.x": 0.187}
    before = {"joint1.k_tors": 2e5, "joint2.k_tors": 2e5, "fingers.com.x": 1.0, "bracket.com.x": 0.2}
    changed = Remedy("mass centre + torsion", values, before, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.2)
    expected = "make joint 2 50 % stiffer in torsion and move the mass centre of bracket by -13 mm in x"
    assert change_words(changed) == expected
    assert change_words(replace(changed, values=before)) == "change nothing"
    assert change_words(SLOWER) == "run at 5 % of full speed instead of 10 %"
    pair = replace(changed, kind="schedule + torsion", schedule=SPEEDS)
    assert change_words(pair) == f"set the speed along the path, {expected}"


def test_several_stiffnesses_are_one_sentence():
    values = {"joint1.k_tors": 3e5, "joint2.k_tors": 1e5, "shoulder.k_tors": 3e5}
    before = dict.fromkeys(values, 2e5)
    words = change_words(Remedy("torsion", values, before, 10.0, 10.0, SMALL, GOOD, 4.0, 0.02, 0.2))
    assert words == "make joint 1 50 % stiffer, joint 2 50 % softer and shoulder 50 % stiffer in torsion"


def test_contributions_are_those_at_the_worst_phases():
    known, drawn = (diagnosis(True, (True,), phases=phases) for phases in ("file", "unknown"))
    assert contribution_words(known) == ""
    made = "contributions to the 0.7 mm at the worst phases: drive imbalance 0.6 mm, motion 0.1 mm, transmission error "
    assert contribution_words(drawn) == made + "not modelled (set to 0)"
    assert dict(cause_and_remedies(drawn))["Cause"] == contribution_words(drawn), "where nothing crosses"


def test_a_finished_stage_is_a_line():
    assert "kept by 50 of 100 draws" in vibration_line(diagnosis().vibration)
    report = StageReport(6, 7, "remedies", "2 of 9", resumed=True)
    assert str(report) == "6/7 remedies: 2 of 9 (from an earlier run)"
