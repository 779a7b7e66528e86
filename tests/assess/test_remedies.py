"""Which remedy is advised, by what the verification says of those that should meet the limit."""

from dataclasses import replace

import numpy as np
import pytest

from ident.assess.diagnose import chosen
from ident.assess.remedies import Remedy, Verification, _rank, verify_in_turn
from ident.vibrate.evaluator import binomial_estimate

LIMIT = 5e-4


def remedy(meets_limit: bool) -> Remedy:
    keeps = binomial_estimate(np.arange(100) < (99 if meets_limit else 50))
    return Remedy("torsion", {}, {}, 10.0, 10.0, np.full(3, 4e-4), keeps, 4.0, 0.02, 0.2)


def verification(holds: bool) -> Verification:
    return Verification(np.full(3, 4e-4), remedy(holds).keeps, LIMIT)


@pytest.mark.parametrize(
    ("meets", "holds", "verified", "advised"),
    [
        ("yyy", "ynn", 1, 0),  # the first holds: no other is verified
        ("yyy", "nyy", 2, 1),
        ("yyyy", "nnny", 3, 0),  # none of three holds: back to the first
        ("ynn", "nyy", 1, 0),  # what does not meet the limit is no answer to one that should and does not
        ("nn", "nn", 1, 0),
        ("y", "n", 1, 0),
    ],
)
def test_remedies_are_verified_in_turn_until_one_holds(meets, holds, verified, advised):
    ranked = [remedy(word == "y") for word in meets]
    verdicts = {id(one): word == "y" for one, word in zip(ranked, holds, strict=True)}
    verifications = verify_in_turn(ranked, lambda one: verification(verdicts[id(one)]))
    assert len(verifications) == verified
    assert chosen(verifications) == advised


def test_what_takes_less_effort_comes_first_among_what_meets_the_limit():
    kinds = ("both", "torsion", "speed", "mass centre")
    every = [replace(remedy(meets), kind=kind) for meets in (True, False) for kind in kinds]
    every.append(replace(remedy(True), kind="torsion", change_norm=0.1))
    ranked = sorted(every, key=_rank)
    assert [each.kind for each in ranked[:5]] == ["speed", "mass centre", "torsion", "torsion", "both"]
    assert ranked[2].change_norm == 0.1
    assert not any(each.meets_limit for each in ranked[5:])
    assert [each.effort for each in ranked[:3]] == ["software", "screwdriver", "new part"]


def test_a_remedy_holds_by_the_exact_equations_and_by_the_draws():
    keeps, exceeds = remedy(True).keeps, remedy(False).keeps
    small, large = np.full(3, 4e-4), np.array([4e-4, 6e-4, 4e-4])
    cases = {(True, True): True, (True, False): False, (False, True): False}
    for (exact, draws), holds in cases.items():
        verified = Verification(small if exact else large, keeps if draws else exceeds, LIMIT)
        assert verified.holds is holds
    assert Verification(large, keeps, LIMIT).largest == 6e-4
