"""Fifty mutated inputs of all kinds of files through the program, as `tests/benchmarks/fuzz.py` runs thousands."""

import pytest
from fuzz import fuzzed


@pytest.mark.slow
def test_fifty_mutated_inputs_end_in_an_answer_or_in_one_line():
    outcomes = fuzzed(0, range(1000), light=50)
    assert len(outcomes) == 50
    assert [(each.number, each.kind, fault) for each in outcomes for fault in each.faults] == []
    assert len({each.command for each in outcomes}) > 8
    assert {"csv", "json", "toml", "nc", "unv"} <= {each.kind.partition(" ")[0] for each in outcomes}
    statuses = [each.status for each in outcomes]
    assert 0 < statuses.count(0) < statuses.count(2)
