"""The limits of hypotheses stand in two tables, for data with sigmas and for traces; no other limit has their names."""

import ast
from pathlib import Path

import numpy as np
import pytest

from ident.identify.hypotheses import KINDS, RIGID, SCALES, SOFT
from ident.vibrate.hypotheses import PEAK, TRACKS, probability, score

PACKAGE = Path(__file__).parents[1] / "ident"
LIMITS = {"SURE", "SEEN", "COST", "CHANCE", "LIKELY", "MISFIT", "MARGIN", "SLIP"}
APART = dict.fromkeys(("instruments", "resonance", "design_search", "hammer", "motion_study"), ("MARGIN",))
"""Margins of an angle, a frequency, an amplitude, a band and a limit: they judge no hypothesis."""


def constants(path):
    """Names that a module gives to values at its top level."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", ast.Pass())]
        for target in targets:
            yield from (name.id for name in ast.walk(target) if isinstance(name, ast.Name))


def test_limits_of_hypotheses_stand_in_two_places():
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        if own := LIMITS.intersection(constants(path)) - set(APART.get(path.stem, ())):
            found[str(path.relative_to(PACKAGE))] = own
    assert found == {"identify/hypotheses.py": {"CHANCE", "MARGIN", "SLIP"}, "vibrate/hypotheses.py": {"COST"}}


def test_one_table_has_all_kinds():
    assert {*SOFT, *RIGID, *SCALES} < set(KINDS)
    assert all(0 < kind.plausible < 1 and kind.of and kind.origin for kind in KINDS.values())


def test_a_set_that_leaves_less_wins_by_the_bits_that_count():
    """By hand: 100 numbers, all of them explained to the misfit against none at all."""
    count = np.array([40.0, 60.0])
    for limits in (TRACKS, PEAK):
        gain = score(np.zeros(2), count, limits) - score(np.ones(2), count, limits)
        assert gain == pytest.approx(50 * np.log((1 + limits.misfit**2) / limits.misfit**2))
    assert probability([0.0], [0.0]) == pytest.approx(0.5)
    assert probability([np.log(3.0)], [0.0]) == pytest.approx(0.75)
    assert probability([0.0, 0.0], [0.0]) == pytest.approx(2 / 3)
    assert probability([0.0], [1e4]) == 0.0
    assert probability([0.0], []) == 1.0
