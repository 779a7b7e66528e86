"""Campaigns of few sizes: one that is not much longer or shorter needs no other program."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident.identify.build_problem import build_problem
from ident.identify.conditions import roomy
from ident.identify.unknowns import Unknowns
from ident.measure import Campaign, Load, read_campaign

DISCREPANT = Unknowns(discrepancy={"frequency": 0.05})


def shuffled(labels=True):
    """The shipped campaign in another order, with a difference and a damping ratio, some labels left out."""
    rows = list(read_campaign(DATA / "lcd_arm" / "campaign.csv"))
    sag = next(m for m in rows if m.kind == "deflection")
    rows.append(replace(sag, kind="deflection_difference", load=Load.parse("5 kg @ tip"), reference_load=sag.load))
    rows.append(replace(rows[0], kind="damping_ratio", value=0.02, sigma=0.001))
    rows = [replace(m, mode=None) if i % 3 == 0 and m.kind == "frequency" else m for i, m in enumerate(rows)]
    order = np.random.default_rng(0).permutation(len(rows))
    return Campaign(measurements=tuple(rows[i] for i in order))


@pytest.mark.parametrize("unknowns", [Unknowns(), DISCREPANT], ids=["plain", "discrepancy"])
def test_a_padded_problem_says_the_same_where_its_own_values_are(unknowns):
    problem = build_problem(lcd_arm(), shuffled(), unknowns)
    padded, places = problem.padded()
    theta = problem.parameters.theta(problem.parameters.column("start")) + 0.1
    own, more = (np.asarray(jax.jit(lambda t, p=p: p.predict(t))(theta)) for p in (problem, padded))
    np.testing.assert_allclose(more[places], own, rtol=1e-12)
    assert [padded.kinds[i] for i in places] == list(problem.kinds)
    np.testing.assert_array_equal(padded.measured[places], problem.measured)
    weight = 1 / np.asarray(padded.sigma)
    np.testing.assert_array_equal(np.flatnonzero(weight), np.sort(places))
    ours, theirs = (p.weigh(x, jnp.zeros((len(x), len(theta))), theta)[0] for p, x in ((problem, own), (padded, more)))
    np.testing.assert_allclose((theirs**2).sum(), (ours**2).sum(), rtol=1e-12)


def program(rows):
    """What tells one program from another: static parts, shapes and types."""
    padded, _ = build_problem(lcd_arm(), Campaign(measurements=rows)).padded()
    leaves, structure = jax.tree.flatten((padded, padded.unheld()))
    return structure, [(np.shape(x), np.asarray(x).dtype) for x in leaves]


def test_a_campaign_of_other_rows_and_postures_has_the_same_program():
    rows = tuple(read_campaign(DATA / "lcd_arm" / "campaign.csv"))
    for other in (rows[:-3], rows[5:], rows[::-1]):
        assert program(other) == program(rows)
    moved = tuple(replace(m, posture=(0.1 * i, -0.2, 0.1)) for i, m in enumerate(rows[:6]))
    assert program((*moved, *rows[6:-5])) != program(rows), "of more postures"
    assert program(rows[:4])[0] != program(rows)[0], "there is no deflection"


def test_sizes_are_few_and_never_much_larger():
    sizes = [roomy(count) for count in range(5001)]
    assert sizes[0] == 0
    assert all(count <= size < max(2 * count, 5) for count, size in enumerate(sizes) if count)
    assert all(size <= 1.5 * count for count, size in enumerate(sizes) if count > 16)
    assert len(set(sizes)) < 25
