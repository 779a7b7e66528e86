"""Correlated errors of rows: read from beside a campaign, written there again, and what is wrong with a file said."""

from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError
from ident.measure import Campaign, Measurement, read_campaign, write_campaign
from ident.measure.covariance import Covariance, Group
from ident.measure.reproducibility import Reproducibility

ROWS = """kind,q1 [deg],value,unit,sigma,group
frequency,0,4.1,Hz,0.02,first hit
frequency,0,4.8,Hz,0.02,
frequency,0,5.9,Hz,0.02,first hit
frequency,30,4.2,Hz,0.02,b
frequency,30,4.9,Hz,0.02,first hit
frequency,30,6.1,Hz,0.02,b
"""
PAIRS = """# as the analyser says
group,i,j,correlation
first hit,1,2,0.5
first hit,3,1,-0.25
b,1,2,0.9
"""


def written(tmp_path, rows=ROWS, pairs=PAIRS):
    (tmp_path / "c.csv").write_text(rows)
    if pairs is not None:
        (tmp_path / "c.covariance.csv").write_text(pairs)
    return tmp_path / "c.csv"


def test_groups_are_read_by_the_places_of_their_rows(tmp_path):
    campaign = read_campaign(written(tmp_path))
    (first, of_first), (second, of_second) = campaign.correlated
    assert (first, second) == ((0, 2, 4), (3, 5))
    np.testing.assert_array_equal(of_first, [[1, 0.5, -0.25], [0.5, 1, 0], [-0.25, 0, 1]])
    np.testing.assert_array_equal(of_second, [[1, 0.9], [0.9, 1]])
    assert campaign.covariance.path == str(tmp_path / "c.covariance.csv")
    assert len(campaign.covariance.sha256) == 64


def test_rows_keep_their_correlation_where_some_are_left_out_or_others_come_first(tmp_path):
    campaign = read_campaign(written(tmp_path))
    rows = campaign.measurements
    some = replace(campaign, measurements=(rows[4], rows[1], rows[0], rows[3]))
    assert some.correlated == (((0, 2), ((1.0, -0.25), (-0.25, 1.0))),)


def test_it_is_written_and_read_again(tmp_path):
    campaign = read_campaign(written(tmp_path))
    path = tmp_path / "again.csv"
    write_campaign(campaign, path)
    again = read_campaign(path)
    assert again == campaign
    assert again.correlated == campaign.correlated
    some = replace(campaign, measurements=campaign.measurements[2:])
    write_campaign(some, path)
    assert read_campaign(path).correlated == some.correlated
    write_campaign(replace(campaign, measurements=(rows := campaign.measurements)[1:2], covariance=None), path)
    assert not (tmp_path / "again.covariance.csv").exists()
    assert read_campaign(path).measurements == rows[1:2]


def test_a_campaign_of_other_correlations_is_another_one(tmp_path):
    campaign = read_campaign(written(tmp_path))
    groups = tuple(
        Group(g.name, tuple(tuple(map(float, row)) for row in np.eye(len(g)))) for g in campaign.covariance.groups
    )
    assert replace(campaign, covariance=Covariance(groups)) != campaign


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        (None, "c.covariance.csv: got no such file, expected the correlations of the rows in groups; write it"),
        ("group,i,j\n", "c.covariance.csv:1, correlation: got no such column, expected a column correlation"),
        ("group,i,j,correlation [%]\n", "the unknown column 'correlation [%]'"),
        ("", "c.covariance.csv: got no row, expected a header with group,i,j,correlation; write one"),
        (PAIRS + "c,1,2,0.1\n", "c.covariance.csv:6, group: got 'c', expected a group that rows of the campaign name"),
        (PAIRS + "b,1,3,0.1\n", "c.covariance.csv:6, j: got '3', expected the place of a row in its group, 1 to 2"),
        (PAIRS + "b,x,2,0.1\n", "c.covariance.csv:6, i: got 'x', expected the place of a row"),
        (PAIRS + "b,2,1,0.1\n", "c.covariance.csv:6: got the pair again, expected each pair once"),
        (PAIRS + "b,2,2,0.1\n", "c.covariance.csv:6, correlation: got 0.1 of a row with itself, expected 1"),
        (PAIRS + "b,1,2\n", "c.covariance.csv:6: got 3 fields"),
        (PAIRS + "b,1,2,nan\n", "c.covariance.csv:6, correlation: got 'nan', expected a"),
        (
            PAIRS.replace("0.9", "0.999999999999"),
            "c.covariance.csv:5, correlation: got 0.999999999999 between two rows",
        ),
        (
            PAIRS.replace("0.9", "-1"),
            "c.covariance.csv:5, correlation: got -1.0 between two rows, expected at most 1 -",
        ),
        (PAIRS.replace("0.9", "1.1"), "c.covariance.csv:5, correlation: got '1.1', expected a number from -1 to 1"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, pairs, expected):
    with pytest.raises(InputError) as caught:
        read_campaign(written(tmp_path, pairs=pairs))
    assert expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_of_correlations_beside_a_campaign_without_groups_is_refused(tmp_path):
    rows = "\n".join(line.rpartition(",")[0] for line in ROWS.splitlines())
    with pytest.raises(InputError, match=r"got correlations, but no row has a group, expected rows of c\.csv"):
        read_campaign(written(tmp_path, rows + "\n"))


def test_a_group_without_a_correlation_is_refused():
    row = Measurement(kind="frequency", posture=(0.0,), value=4.1, sigma=0.02, group="a", member=1)
    with pytest.raises(InputError, match="got the group 'a', expected a correlation of its errors"):
        Campaign(measurements=(row,))


def test_reproducibility_is_in_part_common_to_the_values_of_a_kind():
    """Variances and covariances of draws: one number for all frequencies, and one for each value."""
    known = Reproducibility.of({"frequency": 0.01}, 0.3)
    values = [("frequency", 4.0), ("frequency", 10.0), ("damping_ratio", 0.02), ("shape", 0.5)]
    rng, share = np.random.default_rng(0), np.array([0.01, 0.01, 0.05, 0.0])
    both, own = rng.standard_normal((400000, 2))[:, [0, 0, 1, 1]], rng.standard_normal((400000, 4))
    drawn = share * np.array([v for _, v in values]) * (np.sqrt(0.3) * both + np.sqrt(0.7) * own)
    covariance = np.array(known.covariance(values))
    scale = np.sqrt(np.outer(*[np.maximum(np.diag(covariance), 1e-12)] * 2))
    np.testing.assert_allclose(np.cov(drawn.T) / scale, covariance / scale, atol=0.01)
    assert covariance[0, 1] > 0
    assert not covariance[:2, 2].any(), "another kind has its own"


@pytest.mark.parametrize(
    ("said", "common", "words"),
    [
        ({"freq": 0.01}, 0.5, "got 'freq', expected one of frequency, damping_ratio"),
        ({"frequency": -0.1}, 0.5, "got frequency=-0.1, expected a share from 0, below 1"),
        ({"frequency": 2.0}, 0.5, "got frequency=2, expected a share from 0, below 1"),
        ({"frequency": float("nan")}, 0.5, "got frequency=nan"),
        ({}, 1.5, "common: got 1.5, expected a share from 0 to 1"),
    ],
)
def test_a_reproducibility_that_cannot_be_is_refused(said, common, words):
    with pytest.raises(InputError, match=words):
        Reproducibility.of(said, common)


def test_repeated_tests_count_the_more_the_more_there_are():
    assumed = Reproducibility.of({})
    assert assumed.after("frequency", 0.0, 0) is assumed
    few, many = (assumed.after("frequency", n * 0.01**2, n) for n in (2, 400))
    assert 0.002 < few.share["frequency"] < many.share["frequency"] < 0.01
    assert many.share["frequency"] == pytest.approx(0.01, rel=0.01)
    assert many.freedom == {"frequency": 400}
    said = Reproducibility.of({"frequency": 0.002})
    assert said.after("frequency", 400 * 0.01**2, 400) is said
