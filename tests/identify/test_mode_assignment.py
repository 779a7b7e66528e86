"""Labels as data: the probability of each pair of value and mode, and fits that no label leads astray."""

import dataclasses
from dataclasses import fields
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm
from equinox import filter_jit
from one_program import predicted
from scipy.stats import norm

from ident.arm.mechanics import static_equilibrium
from ident.arm.modes import modes_about, parse_label, torsion_share, vertical_share
from ident.errors import InputError
from ident.identify.conditions import bind
from ident.identify.data_checks import check_values
from ident.identify.fit import CampaignFit, fit_campaign
from ident.identify.label_checks import changing_labels
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_matching import NAMING_SD, most_probable
from ident.identify.predict import chains
from ident.identify.problem import pose
from ident.inference.fit import fit
from ident.inference.search import End, solve
from ident.measure import Campaign, Measurement, read_campaign

slow = pytest.mark.slow

LABELS = ("vertical bending 1", "lateral torsion 1", "vertical 2", "torsion 2")


def two_states():
    """Labels in two postures of an arm whose torsion is so stiff that names are near draws."""
    arm = lcd_arm().replace({f"joint{j}.k_tors": 1.4 * float(lcd_arm().get(f"joint{j}.k_tors")) for j in (1, 2, 3)})
    postures = (0.0, 0.0, 0.0), tuple(np.deg2rad([60.0, -120.0, 60.0]))
    rows = tuple(
        Measurement(kind="frequency", posture=posture, value=9.0, sigma=0.1, mode=mode)
        for posture, modes in zip(postures, (LABELS, LABELS[:2]), strict=True)
        for mode in modes
    )
    conditions = bind(arm, Campaign(measurements=rows))
    return conditions.named, five_lowest(arm, conditions)


@filter_jit
def five_lowest(arm, conditions):
    chain = chains(arm, conditions)
    return modes_about(chain, static_equilibrium(chain), 5)


def by_enumeration(values, modes, state):
    """Return the best of all ways to name five modes."""
    v = norm.cdf((np.asarray(vertical_share(modes))[:, state] - 0.5) / NAMING_SD)
    t = norm.cdf((np.asarray(torsion_share(modes))[:, state] - 0.5) / NAMING_SD)
    rows = np.flatnonzero(np.asarray(values.states) == state)
    best = (0.0, ())
    for names in product(product(("vertical", "lateral"), ("bending", "torsion")), repeat=5):
        places = []
        for row in rows:
            label = parse_label(LABELS[row % len(LABELS)])
            fit = [i for i, (d, k) in enumerate(names) if label.direction in (None, d) and label.kind in (None, k)]
            places.append(fit[label.ordinal - 1] if len(fit) >= label.ordinal else None)
        if None in places:
            continue
        likely = np.prod([v[i] if d == "vertical" else 1 - v[i] for i, (d, _) in enumerate(names)])
        likely *= np.prod([t[i] if k == "torsion" else 1 - t[i] for i, (_, k) in enumerate(names)])
        best = max(best, (likely, tuple(places)))
    return rows, best[1]


@slow
@pytest.mark.parametrize("state", [0, 1])
def test_the_best_of_all_ways_to_name_the_modes_is_found(state):
    values, modes = two_states()
    rows, best = by_enumeration(values, modes, state)
    chosen = np.asarray(jax.jit(lambda m: most_probable(values, m, None, 0.0))(modes))
    assert tuple(np.argmax(chosen[:, rows], 0)) == best
    np.testing.assert_array_equal(chosen.sum(0), 1)


def shipped(*words):
    rows = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    return pose(
        lcd_arm(), Campaign(measurements=tuple(m for m in rows if any(w in (m.mode or "") for w in words)))
    ).problem


def step_length(problem, end):
    residuals, slope = (
        np.asarray(x) for x in problem.weigh(*map(jnp.asarray, (end.predicted, end.jacobian, end.theta)))
    )
    return np.linalg.norm(np.linalg.svd(slope, full_matrices=False)[0].T @ residuals)


@slow
def test_no_start_is_lost_where_only_vertical_modes_were_measured():
    problem = shipped("vertical")
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    ends: list[End] = []
    for noise in np.random.default_rng(1).standard_normal((12, len(start))):
        ends.append(jax.device_get(solve(problem, start + noise, min(ends, key=lambda end: end.score, default=None))))
    assert max(step_length(problem, end) for end in ends) < 1e-3


@slow
def test_labels_lead_every_start_to_the_optimum_of_the_file():
    """One of these 8 starts was stuck where a label was a rule that jumps."""
    problem = pose(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv")).problem
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    ends = [solve(problem, start)]
    for noise in np.random.default_rng(2).standard_normal((8, len(start))):
        ends.append(solve(problem, start + noise, ends[0]))
    assert all(end.choice.settled for end in ends)
    np.testing.assert_allclose([float(end.cost) for end in ends], float(ends[0].cost), atol=1e-6)


@slow
def test_data_do_not_overrule_clear_names():
    rows = tuple(m for m in read_campaign(DATA / "lcd_arm" / "campaign.csv") if m.kind == "frequency")[:2]
    swapped = (dataclasses.replace(rows[0], mode=rows[1].mode), dataclasses.replace(rows[1], mode=rows[0].mode))
    problem = pose(lcd_arm(), Campaign(measurements=swapped)).problem
    start = problem.parameters.theta(problem.parameters.column("start"))
    hertz = predicted(problem, start)
    assert hertz[0] > hertz[1], "vertical bending 1 is the second mode there, whatever was measured"


def relabelled(row, mode):
    """The shipped campaign with another label in one row of the file, which begins in its line 7."""
    rows = list(read_campaign(DATA / "lcd_arm" / "campaign.csv"))
    rows[row - 7] = dataclasses.replace(rows[row - 7], mode=mode)
    return Campaign(measurements=tuple(rows))


@slow
def test_a_label_that_no_mode_can_bear_is_refused_with_its_row_even_where_it_is_trusted():
    posed = pose(lcd_arm(), relabelled(7, "torsion 9"))
    for trusted in ((), ("7",), ("all",)):
        with pytest.raises(InputError, match=r"campaign.csv:7, mode: got 'torsion 9', .*or leave it empty") as raised:
            check_values(posed, trusted)
        assert len(raised.value.problems) == 1


@slow
def test_a_label_that_the_arm_never_has_is_refused_and_where_it_is_trusted_withholds_every_interval():
    """No other row is blamed; in the fit it is named."""
    campaign = relabelled(7, "vertical torsion 3")
    posed = pose(lcd_arm(), campaign)
    with pytest.raises(InputError, match=r"campaign.csv:7, mode: got 'vertical torsion 3'.*`trust_values` 7") as raised:
        check_values(posed)
    assert len(raised.value.problems) == 1
    check_values(posed, ("7",))
    plain = fit(posed.problem, starts=2)
    found = CampaignFit(**{f.name: getattr(plain, f.name) for f in fields(plain)}, arm=lcd_arm(), campaign=campaign)
    assert not found.supported.any()
    assert 0 in found.renamed
    assert any("7 ('vertical torsion 3')" in remark for remark in found.remarks)


@slow
def test_right_labels_leave_nothing_to_remark():
    found = fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / "campaign.csv"), starts=1)
    assert found.renamed == ()
    assert not found.mislabelled
    assert found.doubts == found.remarks == ()


@slow
def test_labels_that_change_within_the_prior_are_those_of_modes_near_one_half():
    """By the shares of torsion and of vertical motion at the same points, straight from the modes."""
    campaign = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    problem = pose(lcd_arm(), campaign).problem
    often = changing_labels(problem, points=8, seed=3)
    parameters, start = problem.parameters, np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    points = [start, *(start + np.random.default_rng(3).standard_normal((8, len(start))))]
    counts = dict.fromkeys(range(len(campaign)), 0)
    for theta in points:
        arm = lcd_arm().replace(parameters.by_path(np.asarray(parameters.values(theta))))
        for i, m in enumerate(campaign):
            if m.mode:
                seen = modal_analysis(arm, m.posture, m.load, modes=9)
                mode = next((k for k, label in enumerate(seen.labels) if str(label) == m.mode), None)
                squared = seen.modes.motion[:, -1] ** 2
                sides = seen.modes.tors.sum(0), squared[2] / squared.sum(0)
                likely = [norm.cdf(abs(float(x[mode]) - 0.5) / 0.05) for x in sides] if mode is not None else [0.0]
                counts[i] += np.prod(likely) < norm.cdf(2.0)
    assert often == {i: count / 9 for i, count in counts.items() if count}
