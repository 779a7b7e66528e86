"""Parts of a campaign that a laboratory might have: no traceback, no nan, no start that is lost without a word.

A small form; all 55 parts, several truths each, are tests/benchmarks/subcampaigns.py.
"""

import pytest
from subcampaigns import judge, parts

PARTS = ("deflections, at 60 deg", "all modes, at 0 deg", "one mode and deflections, everywhere")


def test_there_are_55_parts():
    assert len(parts()) == 55
    assert all(len(part) for part in parts().values())


@pytest.mark.timeout(600)
@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_judged_without_a_break_and_what_is_shown_holds(part):
    verdict = judge(part, 1.0, 0, 0)
    assert verdict.broken == ""
    assert verdict.lost == 0
    assert verdict.refused == ""
    assert len(verdict.held) >= len(verdict.shown) - 1
    assert len(verdict.profiled) >= len(verdict.shown) - 1
