"""Campaigns of few sizes: one that is not much longer or shorter needs no other program."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm
from one_program import predicted

from ident.errors import InputError
from ident.identify.conditions import bind, repeats
from ident.identify.padding import bucket
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.problem import Data
from ident.inference.search import evaluate
from ident.measure import Campaign, Load, Measurement, read_campaign

DISCREPANT = Unknowns(discrepancy={"frequency": 0.05})


def shuffled(labels=True):
    """The shipped campaign in another order, with a difference, some labels left out."""
    rows = list(read_campaign(DATA / "lcd_arm" / "campaign.csv"))
    sag = next(m for m in rows if m.kind == "deflection")
    rows.append(replace(sag, kind="deflection_difference", load=Load.parse("5 kg @ tip"), reference_load=sag.load))
    rows.append(replace(sag, kind="rotation", direction=(0, 1, 0), value=0.02, sigma=1e-3))
    rows.append(replace(rows[-2], kind="rotation_difference", direction=(0, 1, 0)))
    rows = [replace(m, mode=None) if i % 3 == 0 and m.kind == "frequency" else m for i, m in enumerate(rows)]
    order = np.random.default_rng(0).permutation(len(rows))
    return Campaign(measurements=tuple(rows[i] for i in order))


@pytest.mark.slow
def test_a_padded_problem_says_the_same_where_its_own_values_are():
    problem = pose(lcd_arm(), shuffled(), DISCREPANT).problem
    parts = problem.in_parts
    padded, places, scatter = parts.problems[0], parts.parts.places, parts.scatter
    assert scatter == 0
    theta = problem.parameters.theta(problem.parameters.column("start")) + 0.1
    own, more = predicted(problem, theta), predicted(padded, theta)
    np.testing.assert_allclose(more[places], own, rtol=1e-12)
    assert [padded.kinds[i] for i in places] == list(problem.kinds)
    np.testing.assert_array_equal(padded.measured[places], problem.measured)
    weight = 1 / np.asarray(padded.sigma)
    np.testing.assert_array_equal(np.flatnonzero(weight), np.sort(places))
    ours, theirs = (p.weigh(x, jnp.zeros((len(x), len(theta))), theta)[0] for p, x in ((problem, own), (padded, more)))
    np.testing.assert_allclose((theirs**2).sum(), (ours**2).sum(), rtol=1e-12)


def again(campaign, most=70):
    """Every labelled frequency and every deflection up to so many times, with other values, in another order."""
    rng = np.random.default_rng(1)
    rows = [m for m in campaign for _ in range(1 if m.kind == "frequency" and not m.mode else rng.integers(1, most))]
    rows = [replace(m, value=m.value + m.sigma * z) for m, z in zip(rows, rng.standard_normal(len(rows)), strict=True)]
    rows = [replace(m, sigma=m.sigma * s) for m, s in zip(rows, rng.uniform(0.5, 2, len(rows)), strict=True)]
    return Campaign(measurements=tuple(rows[i] for i in rng.permutation(len(rows))))


@pytest.mark.slow
def test_repeated_rows_are_predicted_once_and_fit_as_each_of_them_does():
    once, problem = shuffled(), pose(lcd_arm(), again(shuffled()), DISCREPANT).problem
    assert len(problem.kinds) > 20 * len(once)
    parts = problem.in_parts
    padded, places, scatter = parts.problems[0], parts.parts.places, parts.scatter
    assert len(padded.kinds) == len(pose(lcd_arm(), once, DISCREPANT).problem.in_parts.problems[0].kinds)
    theta = problem.parameters.theta(problem.parameters.column("start")) + 0.1
    own, more = predicted(problem, theta), predicted(padded, theta)
    np.testing.assert_allclose(more[places], own, rtol=1e-12)
    slope = jnp.zeros((len(own), len(theta)))
    ours, theirs = (p.weigh(x, slope[: len(x)], theta)[0] for p, x in ((problem, own), (padded, more)))
    assert float((theirs**2).sum()) + scatter == pytest.approx(float((ours**2).sum()), rel=1e-12)


@pytest.mark.slow
def test_repeated_rows_have_the_label_cost_of_their_value():
    problem = pose(lcd_arm(), again(read_campaign(DATA / "lcd_arm" / "campaign.csv"))).problem
    parts = problem.in_parts
    theta = problem.parameters.theta(problem.parameters.column("start")) + 0.1
    cost = evaluate(problem, theta).choice.cost
    expected = np.asarray(evaluate(parts.problems[0], theta).choice.cost)
    assert len(cost) > 10 * len(expected)
    np.testing.assert_array_equal(cost, expected[parts.parts.places])


@pytest.mark.slow
@pytest.mark.parametrize("most", [2, 8, 9, 64, 65, 700])
def test_rows_are_added_up_and_pooled_by_value(most):
    rng = np.random.default_rng(most)
    order = rng.permutation(np.repeat(np.arange(5), [1, most, 3, 1, most // 2 + 1]))
    first = np.array([np.argmax(order == value) for value in range(5)])
    tables, x = repeats(order, first), rng.uniform(1, 2, (len(order), 2))
    expected = np.stack([np.bincount(order, column) for column in x.T], 1)
    np.testing.assert_allclose(tables.total(x), expected, rtol=1e-13)
    sigma = np.where(order == 2, np.inf, rng.uniform(0.5, 2, len(order)))
    mean, sd = tables.pooled(Data(x[:, 0], sigma))
    weight = sigma**-2
    own = [value for value in range(5) if value != 2]
    np.testing.assert_allclose(
        mean[np.array(own)], [np.average(x[order == v, 0], weights=weight[order == v]) for v in own]
    )
    np.testing.assert_allclose(sd, [weight[order == v].sum() ** -0.5 if v != 2 else np.inf for v in range(5)])
    assert sum(table.size for table in tables.sums) < 20 * len(order) + 100, "memory grows with the rows"


def test_a_campaign_that_is_too_large_is_refused_by_its_size_and_many_repeats_are_not():
    row = Measurement(kind="deflection", posture=(0.0, 0.0, 0.0), value=0.02, sigma=0.001, point="tip")
    many = [replace(row, posture=(i * 1e-5, 0.0, 0.0)) for i in range(20001)]
    with pytest.raises(InputError, match=r"20001 different values in 20001 states.*at most 20000 different values"):
        pose(lcd_arm(), Campaign(measurements=tuple(many)))
    assert bind(lcd_arm(), Campaign(measurements=(row,) * 20001)).count == 1


def program(rows):
    """What tells one program from another: static parts, shapes and types."""
    padded = pose(lcd_arm(), Campaign(measurements=rows)).problem.in_parts.problems[0]
    leaves, structure = jax.tree.flatten((padded, padded.first_matching()))
    return structure, [(np.shape(x), np.asarray(x).dtype) for x in leaves]


def test_a_campaign_of_other_rows_and_postures_has_the_same_program():
    rows = tuple(read_campaign(DATA / "lcd_arm" / "campaign.csv"))
    for other in (rows[:-3], rows[5:], rows[::-1]):
        assert program(other) == program(rows)
    moved = tuple(replace(m, posture=(0.1 * i, -0.2, 0.1)) for i, m in enumerate(rows[:6]))
    assert program((*moved, *rows[6:-5])) != program(rows), "of more postures"
    assert program(rows[:4])[0] != program(rows)[0], "there is no deflection"


def test_sizes_are_few_and_never_much_larger():
    sizes = [bucket(count) for count in range(5001)]
    assert sizes[0] == 0
    assert all(count <= size < max(2 * count, 5) for count, size in enumerate(sizes) if count)
    assert all(size <= 1.5 * count for count, size in enumerate(sizes) if count > 16)
    assert len(set(sizes)) < 25


def frequencies(values, labels=()):
    """Frequencies at one posture, the first of them with labels."""
    labels = (*labels, *[None] * (len(values) - len(labels)))
    return Campaign(
        measurements=tuple(
            Measurement(kind="frequency", posture=(0.0, 0.0, 0.0), value=value, sigma=0.05, mode=label)
            for value, label in zip(values, labels, strict=True)
        )
    )


def test_equal_values_without_a_label_are_of_two_modes():
    """What the ordinals give: `test_predict.py`."""
    assert bind(lcd_arm(), frequencies([13.5, 4.4, 4.4])).unnamed.ordinals.tolist() == [3, 1, 2]


@pytest.mark.parametrize(
    ("labels", "left"),
    [((), 9), (("vertical bending 1", "lateral torsion 1", "torsion 1"), 7), (("torsion 1", "vertical torsion 1"), 8)],
    ids=["no label", "labels of two modes and perhaps a third", "labels of one mode and perhaps a second"],
)
def test_more_frequencies_than_modes_are_refused(labels, left):
    """An arm of three joints has nine modes; a label of half a name may be of the mode of another label."""
    values = [float(i) for i in range(1, 1 + len(labels) + left)]
    pose(lcd_arm(), frequencies(values, labels))
    refused = f"mode: got {left + 1} frequencies without a label at this posture and load, expected at most {left},"
    with pytest.raises(InputError, match=refused):
        pose(lcd_arm(), frequencies([*values, 99.0], labels))
    elsewhere = replace(frequencies([99.0]).measurements[0], load=Load.parse("5 kg @ tip"))
    pose(lcd_arm(), Campaign(measurements=(*frequencies(values, labels), elsewhere)))
