"""Which remedy is advised, by what the proof says of those that are said to cure."""

import numpy as np
import pytest

from ident.diagnose import remedies
from ident.diagnose.remedies import Proof, Remedy, chosen, prove_in_turn
from ident.diagnose.task import Task
from ident.vibrate.chance import chance


def remedy(cures: bool) -> Remedy:
    keeps = chance(np.arange(100) < (99 if cures else 50))
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
    proofs = prove_in_turn(object.__new__(Task), found)
    assert len(proofs) == tried
    assert chosen(proofs) == advised
