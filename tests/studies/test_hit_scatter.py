"""The scatter of hits is judged by what it does to the errors that are reported, and an arm in motion explains it."""

from types import SimpleNamespace

import numpy as np
import pytest
from hammer_files import one_record

from ident.arm.modes import parse_label
from ident.identify.mode_names import ModeLabels
from ident.measure.load import Load
from ident.measure.reproducibility import Reproducibility
from ident.modal.frf import MOVING, Frf, ModalTest, Place
from ident.modal.modes import Modes, Ratio
from ident.modal.poles import Diagram, ModalModel
from ident.studies.measuring.modal import ModalOptions, modal_test
from ident.studies.measuring.modal_campaign import IdentifiedModes, with_effect
from ident.studies.measuring.modal_report import _findings, _verdict

FREQUENCY = 5.0


def identified(sigma, ratio=15.0, label="vertical bending 1", converged=True):
    """One mode at 5 Hz, damped by 1 %, whose scatter within the test is a share of both."""
    covariance = np.diag([(sigma * FREQUENCY) ** 2, (sigma * 0.01) ** 2, 1e-6, 1e-6])
    one, none, tip = np.ones((1, 1), complex), np.zeros(0, int), (Place("tip", (0.0, 0.0, 1.0)),)
    diagram = Diagram(none, np.zeros(0, complex), np.zeros((1, 0), complex), none, none, none)
    model = ModalModel(np.array([-0.3 + 31j]), one, one, np.zeros((0, 1, 1)))
    frf = Frf(np.array([4.0, 5.0]), np.ones((2, 1, 1, 2), complex), tip, tip, 0.0)
    poles = np.array([FREQUENCY]), np.array([0.01]), one, covariance, frf.responses, (1.0, 20.0), diagram, ()
    modes = Modes(*poles, one, Ratio(ratio, 56), 1.0, converged, model, frf)
    named = (parse_label(label) if label else None,)
    return IdentifiedModes(modes, ModeLabels((), np.zeros((1, 0)), np.zeros((1, 0)), (), named, ("",)))


@pytest.mark.parametrize(
    ("sigma", "share", "label", "word"),
    [
        (3e-5, {}, "vertical bending 1", "GOOD"),
        (5e-3, {}, "vertical bending 1", "DOUBTFUL"),
        (3e-5, {"frequency": 0.0, "damping_ratio": 0.0}, "vertical bending 1", "DOUBTFUL"),
        (5e-3, {}, None, "DOUBTFUL"),
    ],
    ids=["quiet", "loud", "alone", "without a name"],
)
def test_scatter_counts_by_what_it_does_to_the_reported_errors(sigma, share, label, word):
    """15 times the expected variance, of 0.003 % beside an assumed 0.2 %: hypot(3e-5, 2e-3) is 1.0001 times 2e-3."""
    each = with_effect(identified(sigma, label=label), Reproducibility.of(share))
    verdict = _verdict([], [each])
    assert verdict.word == word
    assert ("without effect on the std. errors" in verdict.reason) == (word == "GOOD")
    assert [finding.text[:16] for finding in _findings([], [each], [], [], None)] == ["the hits scatter"] * (
        word != "GOOD"
    )


def test_an_arm_that_still_moves_is_doubtful_whatever_the_scatter():
    each = with_effect(identified(3e-5, ratio=1.0), Reproducibility())
    for remarks, word in (((), "GOOD"), ((f"a.uff: {MOVING} hit 2",), "DOUBTFUL")):
        test = ModalTest((0.0,), Load(), "brake", ("a.uff",), each.modes.frf, np.ones((1, 1, 2)), 8.0, (), (), remarks)
        verdict = _verdict([test], [each])
        assert (verdict.word, test.good) == (word, word == "GOOD")
        assert ("The arm was still moving before hits in 1 file;" in verdict.reason) == (word != "GOOD")


def test_scatter_within_its_band_is_said_as_before():
    each = with_effect(identified(5e-3, ratio=0.97), Reproducibility())
    assert _verdict([], [each]).reason == "Hit scatter 0.97 times the expected variance, within 0.58 to 1.55."


def test_an_arm_that_still_moves_is_the_first_finding_and_explains_the_others():
    remark = f"a.uff: {MOVING} hits 2, 3, 4, 5"
    test = SimpleNamespace(checks=(), remarks=(remark, "outside"))
    found = list(_findings([test], [identified(5e-3, converged=False)], [], [], None))
    assert [(each.text, each.remedy) for each in found] == [(remark, "wait longer between hits"), ("outside", "")]
    still = SimpleNamespace(checks=(), remarks=())
    assert len(list(_findings([still], [identified(5e-3, converged=False)], [], [], None))) == 2


@pytest.mark.slow  # identifies modes of two records of 150 s and one of 20 s
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("gap", "noise", "least", "word"),
    [(30.0, 0.005, 0.01, "GOOD"), (30.0, 0.1, 0.01, "GOOD"), (4.0, 0.005, 0.0, "DOUBTFUL")],
    ids=["quiet", "noisy", "ringing"],
)
def test_quiet_hits_of_an_arm_at_rest_are_good_and_those_of_one_that_rings_never(gap, noise, least, word, tmp_path):
    """Noise of 0.0005 and 0.01 g. After 4 s, 0.67 of the mode at 5.01 Hz is left, which is damped by 0.32 %."""
    one_record(tmp_path, gap, noise, least=least)
    result = modal_test(tmp_path, options=ModalOptions(band=(3.0, 18.0)))
    found = _verdict(result.tests, result.identified).word
    assert found == word or (word != "GOOD" and found == "NOT CONVERGED")
    assert result.doubtful == (word != "GOOD")
    for truth in (5.0132, 13.9337) if word == "GOOD" else ():
        assert np.abs(result.identified[0].modes.frequency / truth - 1).min() < 1e-3
