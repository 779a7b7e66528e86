"""What the paper says and the model gives: `docs/paper.md` prints what is computed, and each of its verdicts holds."""

import sys
from pathlib import Path

import pytest
from conformance import states, within
from numbers_in_text import same_text

sys.path.append(str(Path(__file__).parents[1] / "docs"))

from paper_table import PAGE, ROWS, Between, page_table, shown_table
from paper_values import compute

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found():
    return compute()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.where}: {row.paper}")
def test_a_verdict_holds(row, found):
    source, claim = f"the paper, {row.where}", row.claim
    _, word, reason = row.verdict.split("**")
    said = {"expected": row.paper, "computed": row.model(found), "note": f"{word}{reason}"}
    said["differs"] = word in ("differs", "not judged")
    if isinstance(claim, Between):
        rule = f"{claim.of} from {claim.low:g} to {claim.high:g}"
        within(claim.value(found), claim.low, claim.high, row.group, row.paper, source, rule=rule, **said)
    else:
        states(claim(found), row.group, row.paper, source, rule="as stated", **said)


def test_the_page_shows_what_is_computed(found):
    assert same_text(shown_table(), page_table(found), relative=0.002)


def test_the_page_says_which_kinematic_errors_the_figures_allow(found):
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    (peak, line), (guess_peak, guess_line) = found["errors"]
    assert f"the peaks allow {peak:.1f} arc seconds (first guess {guess_peak:.1f})" in text
    assert f"the spectra {line:.1f} ({guess_line:.1f})" in text


def test_each_verdict_is_one_of_four():
    words = [row.verdict.split("**")[1] for row in ROWS]
    assert set(words) == {"agrees", "agrees within", "differs", "not judged"}
