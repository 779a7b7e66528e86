"""Hits in a record: found where they are, whole, and refused by name where they are overloaded, endless or none."""

import numpy as np
import pytest
from conformance import agrees

from ident.measure import Load
from ident.modal.frf import Place, exponential_decay, exponential_window
from ident.modal.hammer import Spectra, excited, find_hits, force_window, overload, spectra
from ident.modal.recorded import Response, Source

STEP = 0.005


def pulse(count, begin, peak=100.0, width=5):
    force = np.zeros(count)
    force[begin : begin + width] = peak * np.sin(np.pi * (np.arange(width) + 0.5) / width)
    return force


def noisy(force, sd=0.05, seed=1):
    return force + sd * np.random.default_rng(seed).standard_normal(force.shape)


def test_hits_of_one_long_record_are_cut_where_the_next_begins():
    record = noisy(sum(pulse(6000, begin, peak) for begin, peak in ((300, 90), (2000, 130), (4500, 60))))
    hits = find_hits(record[None], STEP, rest=1.0)
    assert [(hit.block, hit.begin, hit.until) for hit in hits] == [(0, 300, 2000), (0, 2000, 4500), (0, 4500, 6000)]
    assert [hit.flaw for hit in hits] == ["", "", ""]
    assert all(hit.end - hit.begin == 5 for hit in hits)


def test_a_second_pulse_within_the_rest_belongs_to_its_hit():
    record = noisy(pulse(4000, 300) + pulse(4000, 318, 30.0) + pulse(4000, 2000))
    first, second = find_hits(record[None], STEP, rest=1.0)
    assert (first.begin, first.end, first.flaw) == (300, 323, "")
    assert (second.begin, second.end, second.flaw) == (2000, 2005, "")


def test_a_weak_rebound_below_the_threshold_of_hits_is_still_a_part_of_the_force():
    record = noisy(pulse(4000, 300) + pulse(4000, 330, 7.0))
    (hit,) = find_hits(record[None], STEP, rest=1.0)
    assert (hit.begin, hit.flaw) == (300, "")
    assert 331 < hit.end <= 335


@pytest.mark.parametrize("kind", ["chirp", "random"])
def test_a_burst_that_ends_is_a_hit_and_one_that_goes_on_is_none(kind):
    time = np.arange(2000) * STEP
    wave = np.sin(2 * np.pi * (2 + 3 * time) * time)
    white = np.random.default_rng(4).standard_normal((2, 2000))
    waves = np.stack([wave, wave]) if kind == "chirp" else white
    bursts = noisy(50 * waves * ((time > 0.3) & (time < 7.0)))
    for hit in find_hits(bursts, STEP, 1.0):
        assert hit.flaw == ""
        assert (force_window(np.abs(bursts[hit.block, : hit.end]) > hit.level, hit.begin, 2000)[: hit.end] == 1).all()
        assert hit.begin == pytest.approx(0.3 / STEP, abs=10)
        assert hit.end == pytest.approx(7.0 / STEP, abs=20)
    endless = noisy(50 * waves * (time > 5.0))
    assert {hit.flaw for hit in find_hits(endless, STEP, 1.0)} == {"the force does not end within its record"}


def test_triggered_blocks_hold_one_hit_each():
    blocks = noisy(np.array([pulse(500, 20), pulse(500, 20) + pulse(500, 300, 50.0), pulse(500, 20, -100.0)]))
    hits = find_hits(blocks, STEP, rest=1.0)
    assert [hit.block for hit in hits] == [0, 1, 2]
    assert [(hit.begin, hit.end, hit.flaw) for hit in hits] == [(20, 25, ""), (20, 305, ""), (20, 25, "")]
    assert find_hits(np.array([pulse(500, 20), np.zeros(500)]), STEP, 1.0)[1].flaw == "no pulse of the force"


def test_a_filter_that_rings_to_the_other_side_is_no_second_hit():
    force = pulse(500, 20)
    force[26:29] = -9.0
    assert find_hits(noisy(np.array([force, force])), STEP, 1.0)[0].flaw == ""


def source_of(point, force=None, responses=(), step=STEP):
    place = Place(point, (0.0, 0.0, 1.0))
    return Source("a.csv", (0.0,), Load(), "brake", 0.0, step, 0.0, place, force, None, responses)


def test_the_excited_lines_of_several_points_hang_on_no_order_of_these():
    """One point is hit softly, up to 10 Hz; the other one hard, up to 40 Hz, but not at 5 Hz."""
    frequency = np.arange(0.0, 60.0)
    soft, hard = np.where(frequency <= 10, 1.0, 1e-3), np.where(frequency <= 40, 5.0, 1e-3)
    hard[5] = 1e-3
    one, other = (
        Spectra(source_of(point), size[None].astype(complex), np.zeros((1, 1, 60)))
        for point, size in (("tip", soft), ("elbow", hard))
    )
    for every in ([one, other], [other, one]):
        lines = frequency[excited(every, None, frequency, 200.0)]
        assert lines.tolist() == [4.0, 6.0, 7.0, 8.0, 9.0, 10.0]
        banded = frequency[excited(every, (3.0, 30.0), frequency, 200.0)]
        assert 5.0 not in banded
        assert banded.max() == 30.0, "a given band is kept to its end"


def test_a_force_longer_than_the_shortest_record_is_no_hit():
    """Three pulses 0.9 s apart, and 2 s to the next hit; of the records only the first 1.5 s are transformed."""
    step, count = 0.001, 1500
    force = sum(pulse(9000, begin) for begin in (300, 1200, 2100, 5000, 6500)) + noisy(np.zeros(9000))
    hits = find_hits(force[None], step, rest=1.0)
    assert [hit.flaw for hit in hits] == ["", "", ""]
    answer = np.convolve(force, np.exp(-np.arange(400) / 50.0))[:9000]
    responses = (Response(Place("tip", (0.0, 0.0, 1.0)), answer[None], 0, None, "a"),)
    source = source_of("tip", force[None], responses, step)
    found = spectra(source, hits, count, 0.0)
    assert [(each.number, each.reason) for each in found.rejected] == [(1, "the force does not end within its record")]
    assert found.force.shape == (2, 751)


def test_overload_by_full_scale_or_by_a_flat_top():
    time = np.arange(2000) * STEP
    wave = noisy(80 * np.sin(9 * time) * np.exp(-time / 3), 0.01)
    assert overload(wave, None) == ""
    assert "equal samples in a row at its largest number, 60" in overload(np.clip(wave, -60, 60), None)
    assert overload(wave, 70.0).endswith("of a full scale of 70")
    assert overload(wave, 100.0) == ""
    assert overload(np.round(wave / 40), None) == "", "a coarse channel says nothing by equal numbers"


def test_windows():
    what = "decay of an exponential window"
    agrees(exponential_decay(10.0, 0.01), np.log(100) / 10, "modal", what, "-ln(end) / T", rtol=1e-6, unit="1/s")
    assert exponential_decay(10.0, 0.01, 0.3) == pytest.approx(np.log(100) / 10 - 0.3)
    assert exponential_decay(10.0, 0.01, 2.0) == exponential_decay(10.0, 1.0) == 0.0
    np.testing.assert_allclose(exponential_window(3, 0.5, 2.0), np.exp([0, -1, -2]), rtol=1e-15)
    acts = pulse(125, 20) + pulse(125, 120) > 0
    window = force_window(acts, 20, 200)
    assert (window[:40] == 1).all()
    assert (np.diff(window[40:55]) <= 0).all()
    assert (window[55:110] == 0).all()
    assert (np.diff(window[110:115]) >= 0).all()
    assert (window[115:140] == 1).all()
    assert (window[155:] == 0).all()
    single = force_window(acts[:25], 20, 200)
    np.testing.assert_array_equal(window[:100], single[:100])
    assert (single[55:] == 0).all()
