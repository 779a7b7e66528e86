"""Which remedy is advised, by what the proof says of those that are said to cure."""

import numpy as np
import pytest

from ident.assess import remedies
from ident.assess.remedies import Proof, Remedy, chosen, verify_in_turn
from ident.assess.task import Task
from ident.present.html.diagnose import _verdict
from ident.present.html.diagnose_sections import proof_section
from ident.vibrate.redesign.binomial import binomial_estimate, binomial_to_json


def asked() -> Task:
    """What the words need of a task: the limit."""
    task = object.__new__(Task)
    object.__setattr__(task, "limit", 5e-4)
    return task


def remedy(cures: bool) -> Remedy:
    keeps = binomial_estimate(np.arange(100) < (99 if cures else 50))
    return Remedy("torsion", {}, {}, 10.0, np.full(3, 4e-4), keeps, 4.0, 0.02, 0.2)


@pytest.mark.parametrize(
    ("cures", "holds", "tried", "advised"),
    [
        ("yyy", "ynn", 1, 0),  # the first holds: no other is asked
        ("yyy", "nyy", 2, 1),
        ("yyyy", "nnny", 3, 0),  # none of three holds: back to the first
        ("ynn", "nyy", 1, 0),  # what does not cure is no answer to a cure that fails
        ("nn", "nn", 1, 0),
        ("y", "n", 1, 0),
    ],
)
def test_cures_are_proved_in_turn_until_one_holds(monkeypatch, cures, holds, tried, advised):
    found = [remedy(word == "y") for word in cures]
    verdicts = {id(one): word == "y" for one, word in zip(found, holds, strict=True)}

    def prove(task, remedy, progress):
        return Proof(remedy.amplitude, remedy.keeps, verdicts[id(remedy)])

    monkeypatch.setattr(remedies, "prove", prove)
    proofs = verify_in_turn(asked(), found)
    assert len(proofs) == tried
    assert chosen(proofs) == advised


@pytest.mark.parametrize(
    ("cures", "tried", "holds", "kind", "said"),
    [
        (True, 1, True, "warn", "the limit is then kept by 99 %"),
        (True, 1, False, "reject", "and the one cure did not hold when it was tried again."),
        (True, 3, False, "reject", "and none of the 3 cures that were tried again held."),
        (False, 1, True, "reject", "and no change tried cures it."),
    ],
)
def test_the_verdict_says_what_the_proof_said(cures, tried, holds, kind, said):
    best = remedy(cures)
    proof = {"tried": tried, "holds": holds, "amplitude": [4e-4] * 3, "keeps": binomial_to_json(best.keeps)}
    verdict = _verdict(asked(), {"vibration": {"peak": [7e-4] * 3}, "proof": proof}, best)
    assert verdict.kind == kind
    assert said in verdict.text


def test_a_proof_says_what_was_asked_for():
    found = (remedy(True), remedy(True))
    failed, held = Proof(np.full(3, 6e-4), remedy(False).keeps, False), Proof(np.full(3, 4e-4), found[1].keeps, True)
    one, two = (proof_section(asked(), found, proofs).found for proofs in ((failed,), (failed, held)))
    assert len(one) == 2
    assert "does NOT keep" in one[0]
    assert one[1].endswith("; 95 % are asked for.")
    assert two[:2] == one
    assert "which keeps the limit" in two[2]
    assert "same draws" in two[-1]
